//! Rows without events.
//!
//! In: a walk of a plant without comparisons and nonlinear blocks, at a row, with no `sample` due before the next row. If the plant is not stiff, its
//! rates must be polynomials. Out: the walk at the next row, if the first part of the series, or the existing matrices, reach it in every lane. This
//! is the same computation as for a general row, without the parts that are not needed here, so the bits are the same.

use super::walk::{Walk, larger};

impl<const L: usize> Walk<'_, L> {
    /// Whether this plant can have rows without events.
    pub(super) fn can_be_plain(&self) -> bool {
        let counts = self.programs.counts;
        counts.held == 0 && counts.guesses == 0 && counts.states > 0
    }

    /// One step to the end of a row. Returns `false` if a lane needs more than one step; then all lanes keep their states.
    #[inline]
    pub(super) fn plain(&mut self, now: f64, end: f64) -> bool {
        let rest = end - now;
        if self.is_stiff == [true; L] {
            return self.plain_exponential(now, end);
        }
        if !self.programs.is_polynomial || (0..L).any(|lane| self.is_stiff[lane] || self.suggestion[lane] < 0.999 * rest) {
            return false;
        }
        let layout = self.programs.layout;
        self.slots[layout.step as usize] = [rest; L];
        let Some((code, order)) = self.programs.first_part() else { return false };
        code.run(&mut self.slots, &mut self.spare);
        let (last, before) = self.thresholds.of(order);
        let count = self.programs.counts.states;
        let terms = &self.programs.terms;
        let at = |slot: u32| slot as usize..slot as usize + count;
        let list = |slot: u32| &self.slots[at(slot)];
        let (states, ends) = (list(layout.states), list(self.programs.end()));
        let (first, one, other) = (list(terms[0]), list(terms[order - 1]), list(terms[order - 2]));
        // A term that is not finite makes the end not finite. Its product with zero is then NaN.
        let (mut excess, mut zero) = ([0.0; L], [0.0; L]);
        for k in 0..count {
            let (x, end, largest, first, one, other) = (&states[k], &ends[k], &self.largest[k], &first[k], &one[k], &other[k]);
            for lane in 0..L {
                let moved = larger((end[lane] - x[lane]).abs(), first[lane].abs());
                let scale = larger(larger(x[lane].abs(), largest[lane]), moved);
                excess[lane] = larger(one[lane].abs() - last * scale, excess[lane]);
                excess[lane] = larger(other[lane].abs() - before * scale, excess[lane]);
                zero[lane] += end[lane] * 0.0;
            }
        }
        if excess != [0.0; L] || zero != [0.0; L] {
            return false;
        }
        self.finish_step(self.programs.end() as usize, end);
        for suggestion in &mut self.suggestion {
            *suggestion = suggestion.max(2.0 * rest);
        }
        true
    }
}

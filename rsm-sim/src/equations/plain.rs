//! Rows without events.
//!
//! In: a walk of a plant without comparisons and nonlinear blocks, at a row, with no `sample` due before the next row. If the plant is not stiff, its
//! rates must be polynomials. Out: the walk at the next row, if the first part of the series, or the existing matrices, reach it in every lane. This
//! is the same computation as for a general row, without the parts that are not needed here, so the bits are the same.

use super::walk::{Walk, larger};
use crate::code::{Work, over_lanes};

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
        let terms = &self.programs.terms;
        let ends = self.programs.end() as usize;
        let fits = over_lanes::<L, _>(Fits {
            slots: &self.slots,
            largest: &self.largest,
            states: layout.states as usize,
            ends,
            first: terms[0] as usize,
            one: (terms[order - 1] as usize, last),
            other: (terms[order - 2] as usize, before),
        });
        if !fits {
            return false;
        }
        self.finish_step(ends, end);
        for suggestion in &mut self.suggestion {
            *suggestion = suggestion.max(2.0 * rest);
        }
        true
    }
}

/// Whether the last two terms of the series show, in every lane, that a step was not too long.
struct Fits<'a, const L: usize> {
    slots: &'a [[f64; L]],
    largest: &'a [[f64; L]],
    states: usize,
    ends: usize,
    first: usize,
    /// The last two terms, each with its limit.
    one: (usize, f64),
    other: (usize, f64),
}

impl<const L: usize> Work for Fits<'_, L> {
    type Found = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Fits { slots, largest, states, ends, first, one: (one, last), other: (other, before) } = self;
        let count = largest.len();
        let list = |begin: usize| &slots[begin..begin + count];
        let (states, ends, first, one, other) = (list(states), list(ends), list(first), list(one), list(other));
        // A term that is not finite makes the end not finite. Its product with zero is then NaN.
        let (mut excess, mut zero) = ([0.0; L], [0.0; L]);
        for k in 0..count {
            let (x, end, largest, first, one, other) = (&states[k], &ends[k], &largest[k], &first[k], &one[k], &other[k]);
            for lane in 0..L {
                let moved = larger((end[lane] - x[lane]).abs(), first[lane].abs());
                let scale = larger(larger(x[lane].abs(), largest[lane]), moved);
                excess[lane] = larger(one[lane].abs() - last * scale, excess[lane]);
                excess[lane] = larger(other[lane].abs() - before * scale, excess[lane]);
                zero[lane] += end[lane] * 0.0;
            }
        }
        excess == [0.0; L] && zero == [0.0; L]
    }
}

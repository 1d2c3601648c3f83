//! Rows without events.
//!
//! In: a walk of a plant without comparisons and nonlinear blocks, at a row, with no `sample` due before the next row. If the plant is not stiff, its
//! rates must be polynomials. Out: the walk at the next row, if the first part of the series, or the existing matrices, reach it in every lane. This
//! is the same computation as for a general row, without the parts that are not needed here, so the bits are the same.

use super::choice::{ROW_BY_SERIES, STEP};
use super::stiff::SMALL;
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
        if self.suggestion.iter().any(|it| *it < 0.999 * rest) {
            return false;
        }
        if self.is_stiff == [true; L] {
            return self.plain_by_matrices(rest, end);
        }
        if !self.programs.is_polynomial || self.is_stiff != [false; L] {
            return false;
        }
        let layout = self.programs.layout;
        let Some((checked, order)) = self.programs.checked_series() else { return false };
        let (last, before) = self.thresholds.of(order);
        checked.step.run_with(&[rest, last, before], &mut self.slots, &mut self.spare);
        if self.slots[layout.excess as usize] != [0.0; L] {
            return false;
        }
        checked.accept.run_with(&[end], &mut self.slots, &mut self.spare);
        self.finish_plain(2.0 * rest, ROW_BY_SERIES);
        true
    }

    /// The same with existing matrices.
    fn plain_by_matrices(&mut self, rest: f64, end: f64) -> bool {
        if !self.select_all(rest) {
            return false;
        }
        let layout = self.programs.layout;
        let Some(checked) = self.programs.checked_linear() else { return false };
        let tolerance = self.setting.tolerance;
        checked.step.run_with(&[rest, tolerance, SMALL * tolerance], &mut self.slots, &mut self.spare);
        if self.slots[layout.excess as usize] != [0.0; L] {
            let fits = self.allowed();
            if fits != [true; L] {
                (0..L).filter(|lane| !fits[*lane]).for_each(|lane| self.kept[lane].failed(0));
                return false;
            }
        }
        if let Some(checked) = self.programs.checked_linear() {
            checked.accept.run_with(&[end], &mut self.slots, &mut self.spare);
        }
        self.finish_plain(rest, STEP);
        true
    }

    /// After the states at the end of a row are taken in all lanes.
    fn finish_plain(&mut self, suggestion: f64, work: u64) {
        self.work.iter_mut().for_each(|it| *it += work);
        self.suggestion.iter_mut().for_each(|it| *it = larger(*it, suggestion));
    }
}

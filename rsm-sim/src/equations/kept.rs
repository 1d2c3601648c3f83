//! Linear parts that a lane keeps from step to step.
//!
//! In: the linear parts of a lane so far, the held values of comparisons, a length. Out: the part that fits, or a free place for a new one. The
//! decisions depend on the lane alone.

use super::choice::{Choice, PART};
use super::part::{MOST_STATES, Part};

/// The number of linear parts that a lane keeps: a plant with a few comparisons alternates between few combinations of their values.
const MOST_PARTS: usize = 6;

/// Two lengths are the same if they differ by less than this share of the tolerance: instants of rows are sums of decimals.
pub(super) const SAME: f64 = 0.01;

/// After this number of failed steps in sequence with parts from earlier points, such steps are not tried for the next `SKIPPED` attempts.
const FAILURES: u32 = 2;
const SKIPPED: u32 = 16;

/// After this number of steps with a part, it is recomputed before the next step that is shorter than a row. This adds at most a quarter to the
/// work.
const MOST_AGE: u64 = 4 * PART;

/// The linear parts of a lane, and data about their use.
#[derive(Debug, Clone, Default)]
pub(super) struct Kept {
    pub parts: Vec<Part>,
    /// The number of parts that belong to this run.
    count: usize,
    pub current: Option<usize>,
    /// Whether the current part was computed at the current point of the lane.
    pub is_fresh: bool,
    /// Whether a step over a whole row with the current part was tried at the current point, and its error was too large.
    pub has_failed: bool,
    /// The number of failed steps in sequence, shorter than a row, with parts from earlier points.
    failures: u32,
    /// The number of times that a part was recomputed instead of trying such a step.
    skipped: u32,
    /// The number of steps with the current part since it was computed.
    age: u64,
    /// The choice between the series and linear parts.
    pub choice: Choice,
    clock: u64,
}

impl Kept {
    /// Before a run.
    pub(super) fn clear(&mut self) {
        let parts = std::mem::take(&mut self.parts);
        *self = Kept { parts, ..Kept::default() };
    }

    /// The number of linear parts that were computed or selected again in this run.
    #[cfg(test)]
    pub(super) fn computed(&self) -> usize {
        self.clock as usize
    }

    pub(super) fn tick(&mut self) -> u64 {
        self.clock += 1;
        self.clock
    }

    /// Finds the part for these comparisons and this length, and makes it the current one.
    pub(super) fn find(&mut self, is_held: impl Fn(&[f64]) -> bool, length: f64, tolerance: f64) -> Option<usize> {
        let fits = |it: &Part| (it.length - length).abs() <= SAME * tolerance * length && is_held(&it.held);
        let place = match self.current {
            Some(current) if fits(&self.parts[current]) => return Some(current),
            _ => self.parts[..self.count].iter().position(fits)?,
        };
        (self.current, self.is_fresh, self.has_failed, self.age) = (Some(place), false, false, 0);
        self.parts[place].used = self.tick();
        Some(place)
    }

    /// Whether the current part must be recomputed before a step of a level. For a whole row this is the case if such a step failed here: a failed
    /// step costs an eighth of a new part, so an old part is always tried. For shorter steps, it is the case if steps with parts from earlier points
    /// failed several times in sequence, or if the part was used for many such steps, because its error may be the reason for the short steps. Also
    /// counts the steps that are not tried.
    pub(super) fn must_recompute(&mut self, level: usize) -> bool {
        if self.is_fresh || level == 0 {
            return !self.is_fresh && self.has_failed;
        }
        let is_hopeless = self.failures >= FAILURES && self.skipped < SKIPPED;
        self.skipped = if is_hopeless { self.skipped + 1 } else { 0 };
        is_hopeless || self.age >= MOST_AGE
    }

    /// The current part has just been computed at the current point of the lane.
    pub(super) fn renewed(&mut self) {
        (self.is_fresh, self.has_failed, self.age) = (true, false, 0);
    }

    /// A step with the current part was valid.
    pub(super) fn step_accepted(&mut self) {
        if !self.is_fresh {
            self.failures = 0;
        }
        self.moved();
        self.age += 1;
    }

    /// The lane is at another point: by a step over a whole row, or by another method.
    pub(super) fn moved(&mut self) {
        (self.is_fresh, self.has_failed) = (false, false);
    }

    /// The error of a step of a level with the current part, from an earlier point, was too large.
    pub(super) fn failed(&mut self, level: usize) {
        if level == 0 {
            self.has_failed = true;
        } else {
            self.failures += 1;
        }
    }

    /// The place of a new part: the current one, a free one, or the one that has not been used for the longest time.
    pub(super) fn place_for_part(&mut self, replaces: bool) -> usize {
        let oldest = || (0..self.count).min_by_key(|k| self.parts[*k].used).unwrap_or(0);
        let place = match self.current {
            Some(current) if replaces => current,
            _ if self.count < MOST_PARTS => {
                self.count += 1;
                self.count - 1
            }
            _ => oldest(),
        };
        if self.parts.len() < self.count {
            self.parts.push(Part::default());
        }
        self.current = Some(place);
        let now = self.tick();
        (self.parts[place].used, self.parts[place].version) = (now, now);
        place
    }
}

/// The matrices that are in the slots of a lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loaded {
    pub version: u64,
    pub level: usize,
    /// The span of the part.
    pub whole: f64,
}

/// A point inside of the last step: the changes of the states up to there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    pub share: f64,
    pub moved: [f64; MOST_STATES],
}

impl Anchor {
    pub(super) const START: Anchor = Anchor { share: 0.0, moved: [0.0; MOST_STATES] };
}

/// The time to a row, divided into equal steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub length: f64,
    pub level: usize,
    /// The number of steps of this level that are done.
    pub index: u64,
}

#[cfg(test)]
mod tests {
    use super::{FAILURES, Kept, MOST_AGE, SKIPPED};

    #[test]
    fn a_part_that_failed_time_and_again_is_taken_anew_and_tried_again_later() {
        let mut kept = Kept::default();
        for _ in 0..FAILURES {
            assert!(!kept.must_recompute(1));
            kept.failed(1);
            kept.renewed();
            kept.step_accepted();
        }
        for _ in 0..SKIPPED {
            assert!(kept.must_recompute(1));
            kept.renewed();
            assert!(!kept.must_recompute(1), "where it was taken it serves");
            kept.step_accepted();
        }
        assert!(!kept.must_recompute(1), "an old part is tried once");
        kept.step_accepted();
        assert!(!kept.must_recompute(1), "an old part has served");
    }

    #[test]
    fn an_old_part_is_tried_for_every_row_once() {
        let mut kept = Kept::default();
        for _ in 0..2 * FAILURES {
            assert!(!kept.must_recompute(0));
            kept.failed(0);
            assert!(kept.must_recompute(0), "it has failed at this point");
            kept.renewed();
            assert!(!kept.must_recompute(0));
            kept.moved();
        }
        kept.failed(0);
        kept.moved();
        assert!(!kept.must_recompute(0), "another method moved the lane");
    }

    #[test]
    fn a_part_serves_for_so_many_shares_of_a_row_and_for_any_number_of_rows() {
        let mut kept = Kept::default();
        kept.renewed();
        for _ in 0..MOST_AGE {
            assert!(!kept.must_recompute(3));
            kept.step_accepted();
        }
        assert!(kept.must_recompute(3) && !kept.must_recompute(0));
        kept.renewed();
        assert!(!kept.must_recompute(3));
    }
}

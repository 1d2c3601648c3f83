//! Linear parts that a lane keeps from step to step.
//!
//! In: the parts that a lane has taken so far, how comparisons are held, a length. Out: the part that fits, or room for another. What is kept depends on the lane alone.

use super::part::{MOST_STATES, Part};

/// Linear parts that a lane keeps: a plant with a few comparisons goes to and fro between few.
const MOST_PARTS: usize = 6;

/// A length that differs by this share of the tolerance is the same: instants of rows are sums of decimals.
pub(super) const SAME: f64 = 0.01;

/// So many steps in a row by parts that were taken elsewhere fail before the next ones are not tried. One is tried again after so many.
const FAILURES: u32 = 2;
const SKIPPED: u32 = 16;

/// Shares of a row that a part serves for: taking it costs 8 steps ([`super::stiff::TAKEN`]), so a quarter more at most.
const AGE: u64 = 32;

/// What a lane keeps of linear parts.
#[derive(Debug, Clone, Default)]
pub(super) struct Kept {
    pub parts: Vec<Part>,
    /// How many of them belong to this run.
    count: usize,
    pub current: Option<usize>,
    /// Whether the current one was taken where the lane stands.
    pub is_fresh: bool,
    /// Whether a whole row by the current one was tried where the lane stands, and its error was too large.
    pub has_failed: bool,
    /// Steps in a row by parts that were taken elsewhere whose error was too large.
    failures: u32,
    /// How often a part was taken again in place of such a step.
    skipped: u32,
    /// Steps by the current part since it was taken.
    age: u64,
    /// What a row may cost before the lane goes back to the series.
    pub budget: u64,
    pub cost: u64,
    /// Whether it went back before.
    pub went_back: bool,
    clock: u64,
}

impl Kept {
    /// Before a run.
    pub(super) fn clear(&mut self) {
        let parts = std::mem::take(&mut self.parts);
        *self = Kept { parts, ..Kept::default() };
    }

    pub(super) fn tick(&mut self) -> u64 {
        self.clock += 1;
        self.clock
    }

    /// The part of these comparisons over this length becomes the current one.
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

    /// Whether the current part is taken again before a step of a level: a whole row by it has failed here; or steps by parts that were taken elsewhere have failed time and again; or it has served for many shares of a row,
    /// and its error may be what keeps steps short. Counts the steps that are not tried.
    pub(super) fn is_worn(&mut self, level: usize) -> bool {
        if self.is_fresh {
            return false;
        }
        let is_hopeless = self.failures >= FAILURES && self.skipped < SKIPPED;
        self.skipped = if is_hopeless { self.skipped + 1 } else { 0 };
        is_hopeless || self.has_failed && level == 0 || self.age >= AGE && level > 0
    }

    /// The current part has just been taken where the lane stands.
    pub(super) fn renewed(&mut self) {
        (self.is_fresh, self.has_failed, self.age) = (true, false, 0);
    }

    /// A step by the current part was right.
    pub(super) fn served(&mut self) {
        if !self.is_fresh {
            self.failures = 0;
        }
        (self.is_fresh, self.has_failed) = (false, false);
        self.age += 1;
    }

    /// The error of a step by the current part, taken elsewhere, was too large.
    pub(super) fn failed(&mut self) {
        self.failures += 1;
    }

    /// The place of a new part: the current one, or a free one, or the one that was not used for the longest time.
    pub(super) fn room(&mut self, replaces: bool) -> usize {
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

/// The matrices that stand in the slots of a lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loaded {
    pub version: u64,
    pub level: usize,
    /// The span of its part.
    pub whole: f64,
}

/// A place inside of the last step: what the states have moved by up to there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    pub share: f64,
    pub moved: [f64; MOST_STATES],
}

impl Anchor {
    pub(super) const START: Anchor = Anchor { share: 0.0, moved: [0.0; MOST_STATES] };
}

/// The time to a row, divided.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub length: f64,
    pub level: usize,
    /// Steps of this level behind the walk.
    pub index: u64,
}

#[cfg(test)]
mod tests {
    use super::{AGE, FAILURES, Kept, SKIPPED};

    #[test]
    fn a_part_that_failed_time_and_again_is_taken_anew_and_tried_again_later() {
        let mut kept = Kept::default();
        for _ in 0..FAILURES {
            assert!(!kept.is_worn(1));
            kept.failed();
            kept.renewed();
            kept.served();
        }
        for _ in 0..SKIPPED {
            assert!(kept.is_worn(1));
            kept.renewed();
            assert!(!kept.is_worn(1), "where it was taken it serves");
            kept.served();
        }
        assert!(!kept.is_worn(1), "an old part is tried once");
        kept.served();
        assert!(!kept.is_worn(1), "an old part has served");
    }

    #[test]
    fn a_part_serves_for_so_many_shares_of_a_row_and_for_any_number_of_rows() {
        let mut kept = Kept::default();
        kept.renewed();
        for _ in 0..AGE {
            assert!(!kept.is_worn(3));
            kept.served();
        }
        assert!(kept.is_worn(3) && !kept.is_worn(0));
        kept.renewed();
        assert!(!kept.is_worn(3));
    }
}

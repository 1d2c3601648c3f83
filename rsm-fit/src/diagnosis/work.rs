//! How much work a diagnosis may be, counted in multiplications: the same data give the same answer on every machine.
//!
//! In: what has been done. Out: whether to go on. Knows nothing of what the work is.

use std::cell::Cell;

/// Counts work against a limit.
#[derive(Debug)]
pub struct Work {
    taken: Cell<usize>,
    limit: usize,
    refused: Cell<bool>,
}

impl Work {
    /// So many multiplications, and no more begun.
    pub fn within(limit: usize) -> Self {
        Work { taken: Cell::new(0), limit, refused: Cell::new(false) }
    }

    /// No limit.
    #[cfg(test)]
    pub fn unbounded() -> Self {
        Work::within(usize::MAX)
    }

    /// Counts.
    pub fn takes(&self, multiplications: usize) {
        self.taken.set(self.taken.get().saturating_add(multiplications));
    }

    /// Whether there is work left; once it is asked for and is not there, the answer remembers.
    pub fn goes_on(&self) -> bool {
        let goes_on = self.taken.get() < self.limit;
        if !goes_on {
            self.refused.set(true);
        }
        goes_on
    }

    /// Whether anything was left undone.
    pub fn ran_out(&self) -> bool {
        self.refused.get()
    }

    /// The share of the limit that is spent, at most 1.
    pub fn share(&self) -> f64 {
        (self.taken.get() as f64 / self.limit as f64).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_ends_at_its_limit_and_says_so() {
        let work = Work::within(10);
        work.takes(9);
        assert!(work.goes_on() && !work.ran_out() && work.share() == 0.9);
        work.takes(5);
        assert!(!work.ran_out(), "nobody has asked yet");
        assert!(!work.goes_on() && work.ran_out() && work.share() == 1.0);
    }
}

//! The limit of work of a diagnosis, counted in multiplications: the same data give the same answer on every machine.
//!
//! In: the work done so far. Out: whether to go on. Knows nothing of what the work is.

use std::cell::Cell;

/// Counts work against a limit.
pub(crate) struct Work<'a> {
    taken: Cell<usize>,
    limit: usize,
    refused: Cell<bool>,
    told: Option<&'a dyn Fn(usize)>,
}

impl<'a> Work<'a> {
    /// So many multiplications, and no more begun.
    pub(crate) fn within(limit: usize) -> Self {
        Work { taken: Cell::new(0), limit, refused: Cell::new(false), told: None }
    }

    /// The same, and somebody hears at every whole per cent of the limit.
    pub(crate) fn telling(limit: usize, told: &'a dyn Fn(usize)) -> Self {
        Work { told: Some(told), ..Work::within(limit) }
    }

    /// No limit.
    #[cfg(test)]
    pub(crate) fn unbounded() -> Self {
        Work::within(usize::MAX)
    }

    /// Counts.
    pub(crate) fn takes(&self, multiplications: usize) {
        let before = self.percent();
        self.taken.set(self.taken.get().saturating_add(multiplications));
        if let Some(told) = self.told.filter(|_| self.percent() > before) {
            told(self.percent());
        }
    }

    /// Whether there is work left; once it is asked for and is not there, the answer remembers.
    pub(crate) fn goes_on(&self) -> bool {
        let goes_on = self.taken.get() < self.limit;
        if !goes_on {
            self.refused.set(true);
        }
        goes_on
    }

    /// Whether anything was left undone.
    pub(crate) fn ran_out(&self) -> bool {
        self.refused.get()
    }

    /// How much of the limit is spent, at most 100.
    fn percent(&self) -> usize {
        (100.0 * (self.taken.get() as f64 / self.limit as f64).min(1.0)) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_ends_at_its_limit_and_says_so() {
        let heard = std::cell::RefCell::new(Vec::new());
        let tell = |percent| heard.borrow_mut().push(percent);
        let work = Work::telling(1000, &tell);
        work.takes(900);
        work.takes(1);
        assert!(work.goes_on() && !work.ran_out());
        work.takes(500);
        assert!(!work.ran_out(), "nobody has asked yet");
        assert!(!work.goes_on() && work.ran_out());
        assert_eq!(*heard.borrow(), [90, 100]);
    }
}

//! The work limit of a diagnosis. It counts operations, not seconds, so the same data give the same answer on every machine.
//!
//! In: the work done so far, in multiplications or steps. Out: whether to continue. Independent of the kind of work.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The work so far and its limit. Clones share the counter, so parallel jobs count together.
#[derive(Debug, Clone)]
pub(crate) struct Count {
    taken: Arc<AtomicU64>,
    end: Arc<AtomicU64>,
}

impl Count {
    /// A counter with this limit.
    pub(crate) fn within(end: u64) -> Self {
        Count { taken: Arc::default(), end: Arc::new(AtomicU64::new(end)) }
    }

    /// Adds work.
    pub(crate) fn takes(&self, work: u64) {
        self.taken.fetch_add(work, Ordering::Relaxed);
    }

    /// The work so far.
    pub(crate) fn taken(&self) -> u64 {
        self.taken.load(Ordering::Relaxed)
    }

    /// Sets the limit, counted from the beginning.
    pub(crate) fn ends_at(&self, end: u64) {
        self.end.store(end, Ordering::Relaxed);
    }

    /// Whether the limit is used up. Call this between jobs, never in parallel with them: then the answer does not depend on the number of threads.
    pub(crate) fn is_spent(&self) -> bool {
        self.taken() >= self.end.load(Ordering::Relaxed)
    }

    /// The used share of the limit, at most one.
    fn share(&self) -> f64 {
        (self.taken() as f64 / self.end.load(Ordering::Relaxed) as f64).min(1.0)
    }
}

/// Counts work against a limit.
pub(crate) struct Work<'a> {
    count: Count,
    refused: Cell<bool>,
    told: Option<&'a dyn Fn(usize)>,
}

impl<'a> Work<'a> {
    /// A limit of this many multiplications.
    pub(crate) fn within(limit: usize) -> Self {
        Work { count: Count::within(limit as u64), refused: Cell::new(false), told: None }
    }

    /// The same, with a progress call at every whole per cent of the limit.
    pub(crate) fn telling(limit: usize, told: &'a dyn Fn(usize)) -> Self {
        Work { told: Some(told), ..Work::within(limit) }
    }

    /// No limit.
    #[cfg(test)]
    pub(crate) fn unbounded() -> Self {
        Work::within(usize::MAX)
    }

    /// Adds work.
    pub(crate) fn takes(&self, multiplications: usize) {
        let before = self.percent();
        self.count.takes(multiplications as u64);
        if let Some(told) = self.told.filter(|_| self.percent() > before) {
            told(self.percent());
        }
    }

    /// Whether there is work left. If not, the limit remembers that it stopped something.
    pub(crate) fn goes_on(&self) -> bool {
        let goes_on = !self.count.is_spent();
        if !goes_on {
            self.refused.set(true);
        }
        goes_on
    }

    /// Whether the limit stopped any work.
    pub(crate) fn ran_out(&self) -> bool {
        self.refused.get()
    }

    /// The used part of the limit in per cent, at most 100.
    fn percent(&self) -> usize {
        (100.0 * self.count.share()) as usize
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

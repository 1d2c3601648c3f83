//! The work limit of a diagnosis. It counts operations, not seconds, so the same data give the same answer on every machine.
//!
//! In: the work done so far, in multiplications or steps. Out: whether to continue. Independent of the kind of work.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The work so far and its limit. Clones share the counter, so parallel jobs count together.
#[derive(Debug, Clone)]
pub(crate) struct WorkCount {
    taken: Arc<AtomicU64>,
    end: Arc<AtomicU64>,
}

impl WorkCount {
    /// A counter with this limit.
    pub(crate) fn within(end: u64) -> Self {
        WorkCount { taken: Arc::default(), end: Arc::new(AtomicU64::new(end)) }
    }

    /// Adds work.
    pub(crate) fn add(&self, work: u64) {
        self.taken.fetch_add(work, Ordering::Relaxed);
    }

    /// The work so far.
    pub(crate) fn done(&self) -> u64 {
        self.taken.load(Ordering::Relaxed)
    }

    /// Sets the limit, counted from the beginning.
    pub(crate) fn set_limit(&self, end: u64) {
        self.end.store(end, Ordering::Relaxed);
    }

    /// A separate count, limited to what is left of this one.
    pub(crate) fn remaining(&self) -> Self {
        WorkCount::within(self.end.load(Ordering::Relaxed).saturating_sub(self.done()))
    }

    /// Whether the limit is used up. Call this between jobs, never in parallel with them: then the answer does not depend on the number of threads.
    pub(crate) fn is_limit_reached(&self) -> bool {
        self.done() >= self.end.load(Ordering::Relaxed)
    }

    /// The used share of the limit, at most one.
    fn share(&self) -> f64 {
        (self.done() as f64 / self.end.load(Ordering::Relaxed) as f64).min(1.0)
    }
}

/// Counts work against a limit.
pub(crate) struct Work<'a> {
    count: WorkCount,
    has_stopped: Cell<bool>,
    progress: Option<&'a dyn Fn(usize)>,
}

impl<'a> Work<'a> {
    /// A limit of this many multiplications.
    pub(crate) fn within(limit: usize) -> Self {
        Work { count: WorkCount::within(limit as u64), has_stopped: Cell::new(false), progress: None }
    }

    /// The same, with a progress call at every whole per cent of the limit.
    pub(crate) fn with_progress(limit: usize, progress: &'a dyn Fn(usize)) -> Self {
        Work { progress: Some(progress), ..Work::within(limit) }
    }

    /// No limit.
    #[cfg(test)]
    pub(crate) fn unbounded() -> Self {
        Work::within(usize::MAX)
    }

    /// Adds work.
    pub(crate) fn add(&self, multiplications: usize) {
        let before = self.percent();
        self.count.add(multiplications as u64);
        if let Some(progress) = self.progress.filter(|_| self.percent() > before) {
            progress(self.percent());
        }
    }

    /// Whether there is work left. If not, the limit remembers that it stopped something.
    pub(crate) fn has_work_left(&self) -> bool {
        let has_work = !self.count.is_limit_reached();
        if !has_work {
            self.has_stopped.set(true);
        }
        has_work
    }

    /// Whether the limit stopped any work.
    pub(crate) fn has_stopped_work(&self) -> bool {
        self.has_stopped.get()
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
        let work = Work::with_progress(1000, &tell);
        work.add(900);
        work.add(1);
        assert!(work.has_work_left() && !work.has_stopped_work());
        work.add(500);
        assert!(!work.has_stopped_work(), "nobody has asked yet");
        assert!(!work.has_work_left() && work.has_stopped_work());
        assert_eq!(*heard.borrow(), [90, 100]);
    }
}

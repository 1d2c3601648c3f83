//! The threads of a fit: their number, and passes over rows.
//!
//! In: the work for items or for ranges of rows. Out: the results in their order, so sums have the same bits for any number of threads. Few results
//! wait for others, so the memory does not depend on the number of items.

use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

use rsm_core::threads;

/// The number of results of each thread that may wait. Each needs memory; two keep a thread at work while another one is slower.
const HELD: usize = 2;

/// The largest number of threads; 0 without a limit.
static MOST: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Whether this thread does the work of an item: its own items are then done one after the other.
    static IS_WORKER: Cell<bool> = const { Cell::new(false) };
}

/// Limits the number of threads of all later fits of this process; 0 removes the limit. No result depends on it.
pub fn limit(threads: usize) {
    MOST.store(threads, Ordering::Relaxed);
}

/// The number of threads for new work: those of the machine, up to the limit.
fn threads() -> usize {
    if IS_WORKER.get() {
        return 1;
    }
    match MOST.load(Ordering::Relaxed) {
        0 => threads::available(),
        // A limit above the number of processors is kept: tests use it on machines with one.
        most => most,
    }
}

/// Gives the results of the items `0..count` to `take`, in their order, by the threads that a fit may use.
pub(crate) fn in_order<A: Send>(count: usize, work: impl Fn(usize) -> A + Sync, take: impl FnMut(A)) {
    let threads = threads().min(count);
    if threads < 2 {
        threads::in_order(count, 1, 1, work, take);
        return;
    }
    let as_worker = |item| {
        let _mark = Mark(IS_WORKER.replace(true));
        work(item)
    };
    threads::in_order(count, threads, threads * HELD, as_worker, take);
}

/// Restores the mark of a thread after its item.
struct Mark(bool);

impl Drop for Mark {
    fn drop(&mut self) {
        IS_WORKER.set(self.0);
    }
}

/// The results of the items `0..count`, in their order. An item takes the time of so many rows: those of few rows are not worth a thread.
pub(crate) fn all<A: Send>(count: usize, rows: usize, work: impl Fn(usize) -> A + Sync) -> Vec<A> {
    if count * rows <= ROWS {
        return (0..count).map(work).collect();
    }
    let mut results = Vec::with_capacity(count);
    in_order(count, work, |result| results.push(result));
    results
}

/// The number of rows of an item, for passes over rows: some milliseconds of work, and results of less than a megabyte.
pub(crate) const ROWS: usize = 8192;

/// A pass over rows: the results of consecutive ranges of rows, in their order.
pub(crate) fn over_rows<A: Send>(rows: usize, work: impl Fn(std::ops::Range<usize>) -> A + Sync, take: impl FnMut(A)) {
    in_order(rows.div_ceil(ROWS), |item| work(item * ROWS..rows.min((item + 1) * ROWS)), take);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_the_items_for_any_number_of_threads() {
        let expected: Vec<usize> = (0..100).map(|item| item * item).collect();
        for threads in [1, 2, 3, 0] {
            limit(threads);
            // An item with items of its own.
            let square = |item: usize| all(item, ROWS, |_| item).iter().sum::<usize>();
            assert_eq!(all(100, ROWS, square), expected, "{threads}");
            let mut rows = Vec::new();
            over_rows(3 * ROWS + 5, |range| range, |range| rows.extend(range));
            assert!(rows.iter().copied().eq(0..3 * ROWS + 5));
        }
        limit(0);
        assert!(all(0, ROWS, |item| item).is_empty());
    }

    #[test]
    #[should_panic(expected = "item < 5")]
    fn a_panic_of_an_item_is_one_of_the_caller() {
        limit(2);
        all(9, ROWS, |item| assert!(item < 5));
    }
}

//! The same work for many items, on several threads.
//!
//! In: a number of items, and the work for one item. Out: the results, one at a time, in the order of the items. So sums over items have the same
//! bits for any number of threads. Every thread holds few results, so the memory does not depend on the number of items.

use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;

/// The number of results that a thread holds until they are taken. Each needs memory; two keep a thread at work while another one is slower.
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
    let available = || std::thread::available_parallelism().map_or(1, usize::from);
    match MOST.load(Ordering::Relaxed) {
        0 => available(),
        // A limit above the number of processors is kept: tests use it on machines with one.
        most => most,
    }
}

/// Gives the results of the items `0..count` to `take`, in their order. Thread t does the items t, t + threads, and so on.
pub(crate) fn in_order<A: Send>(count: usize, work: impl Fn(usize) -> A + Sync, mut take: impl FnMut(A)) {
    let threads = threads().min(count);
    if threads < 2 {
        (0..count).for_each(|item| take(work(item)));
        return;
    }
    let work = &work;
    std::thread::scope(|scope| {
        let start = |thread: usize| {
            let (send, receive) = sync_channel(HELD);
            scope.spawn(move || {
                IS_WORKER.set(true);
                // A send fails only if another thread has panicked.
                (thread..count).step_by(threads).all(|item| send.send(work(item)).is_ok())
            });
            receive
        };
        let results: Vec<_> = (0..threads).map(start).collect();
        for item in 0..count {
            // After a panic of a thread nothing arrives, and the scope panics too.
            let Ok(result) = results[item % threads].recv() else { return };
            take(result);
        }
    });
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
    #[should_panic(expected = "a scoped thread panicked")]
    fn a_panic_of_an_item_is_one_of_the_caller() {
        limit(2);
        all(9, ROWS, |item| assert!(item < 5));
    }
}

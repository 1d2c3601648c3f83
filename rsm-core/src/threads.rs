//! The same work for many items, on several threads.
//!
//! In: a number of items, and the work for one item. Out: the results, one at a time, in the order of the items. So sums over items have the same
//! bits for any number of threads. Items never share data that changes.
//!
//! Only the places of results are generic. What starts threads and makes them wait is compiled once.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// The number of threads that this machine can run at the same time.
#[must_use]
pub fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Applies the work to every item, with this number of threads. The results are in the order of the items.
///
/// # Panics
/// If the work panics, with the same message.
///
/// ```
/// let squares = rsm_core::threads::in_threads(&[1, 2, 3], 2, |item| item * item);
/// assert_eq!(squares, [1, 4, 9]);
/// ```
pub fn in_threads<T: Sync, A: Send>(items: &[T], threads: usize, work: impl Fn(&T) -> A + Sync) -> Vec<A> {
    let mut results = Vec::with_capacity(items.len());
    in_order(items.len(), threads, items.len(), |item| work(&items[item]), |result| results.push(result));
    results
}

/// Gives the results of the items `0..count` to `take`, in their order. At most `held` results wait at the same time for that of an earlier item, so
/// the memory does not depend on the number of items. This thread calls `take`, and works too.
///
/// # Panics
/// If the work or `take` panics, with the same message.
pub fn in_order<A: Send>(count: usize, threads: usize, held: usize, work: impl Fn(usize) -> A + Sync, mut take: impl FnMut(A)) {
    let threads = threads.min(count);
    if threads < 2 {
        (0..count).for_each(|item| take(work(item)));
        return;
    }
    let held = held.clamp(threads, count);
    let places: Vec<Mutex<Option<A>>> = (0..held).map(|_| Mutex::new(None)).collect();
    // Nothing panics while it has a lock.
    let place = |item: usize| places[item % held].lock().unwrap_or_else(PoisonError::into_inner);
    let run = |item: usize| {
        let result = work(item);
        *place(item) = Some(result);
    };
    let mut taken = |item: usize| {
        let result = place(item).take();
        result.into_iter().for_each(&mut take);
    };
    Shared::new(count, held).run(threads, &run, &mut taken);
}

/// How far the items are.
struct Progress {
    /// Items below this number have begun.
    begun: usize,
    /// Items below this number have been taken.
    taken: usize,
    /// For each place of a result, whether one is there.
    is_finished: Vec<bool>,
    /// Whether a thread has panicked.
    is_broken: bool,
}

struct Shared {
    count: usize,
    progress: Mutex<Progress>,
    changed: Condvar,
}

/// What a thread does next.
enum Next {
    Run(usize),
    Take(usize),
    End,
}

impl Shared {
    fn new(count: usize, held: usize) -> Shared {
        let progress = Progress { begun: 0, taken: 0, is_finished: vec![false; held], is_broken: false };
        Shared { count, progress: Mutex::new(progress), changed: Condvar::new() }
    }

    fn run(&self, threads: usize, run: &(dyn Fn(usize) + Sync), take: &mut dyn FnMut(usize)) {
        std::thread::scope(|scope| {
            let others: Vec<_> = (1..threads).map(|_| scope.spawn(|| self.work(run, None))).collect();
            self.work(run, Some(take));
            for other in others {
                if let Err(panic) = other.join() {
                    std::panic::resume_unwind(panic);
                }
            }
        });
    }

    /// Does items until none is left. One thread takes the results.
    fn work(&self, run: &(dyn Fn(usize) + Sync), mut take: Option<&mut dyn FnMut(usize)>) {
        let _guard = OnPanic(self);
        loop {
            match (self.next(take.is_some()), &mut take) {
                (Next::Run(item), _) => {
                    run(item);
                    self.change(|progress, place| progress.is_finished[place] = true, item);
                }
                (Next::Take(item), Some(take)) => {
                    take(item);
                    let is_taken = |progress: &mut Progress, place: usize| {
                        progress.is_finished[place] = false;
                        progress.taken += 1;
                    };
                    self.change(is_taken, item);
                }
                (Next::Take(_) | Next::End, _) => return,
            }
        }
    }

    /// Waits until there is something to do.
    fn next(&self, takes: bool) -> Next {
        let mut progress = self.lock();
        loop {
            let held = progress.is_finished.len();
            if progress.is_broken || progress.taken == self.count || (!takes && progress.begun == self.count) {
                return Next::End;
            }
            if takes && progress.is_finished[progress.taken % held] {
                return Next::Take(progress.taken);
            }
            if progress.begun < self.count.min(progress.taken + held) {
                progress.begun += 1;
                return Next::Run(progress.begun - 1);
            }
            progress = self.changed.wait(progress).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn change(&self, change: impl FnOnce(&mut Progress, usize), item: usize) {
        let mut progress = self.lock();
        let place = item % progress.is_finished.len();
        change(&mut progress, place);
        drop(progress);
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ends the other threads if this one panics: they would wait for its result.
struct OnPanic<'a>(&'a Shared);

impl Drop for OnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.change(|progress, _| progress.is_broken = true, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn the_order_of_results_is_that_of_the_items() {
        let items: Vec<u64> = (0..40).collect();
        let expected: Vec<u64> = items.iter().map(|item| item * item).collect();
        for threads in [0, 1, 2, 3, 60] {
            assert_eq!(in_threads(&items, threads, |item| item * item), expected, "{threads}");
        }
        assert!(in_threads(&[], 3, |item: &u64| *item).is_empty());
    }

    #[test]
    fn few_results_wait() {
        for (threads, held) in [(2, 0), (2, 2), (3, 7), (4, 1000)] {
            let (begun, mut taken) = (AtomicUsize::new(0), Vec::new());
            let work = |item: usize| {
                begun.fetch_add(1, Ordering::Relaxed);
                item
            };
            let take = |item: usize| {
                // The item itself has been begun, and so have those whose results may wait. This thread is in here, so it has no other one.
                assert!(begun.load(Ordering::Relaxed) <= taken.len() + held.max(threads), "{threads} {held}");
                taken.push(item);
            };
            in_order(200, threads, held, work, take);
            assert!(taken.iter().copied().eq(0..200), "{threads} {held}");
        }
    }

    #[test]
    fn a_panic_of_an_item_or_of_the_caller_ends_all_threads_with_its_message() {
        for threads in [1, 2, 4] {
            for wrong in [0, 5, 99] {
                let of_work = std::panic::catch_unwind(|| {
                    in_order(100, threads, 4, |item| assert!(item != wrong, "item {wrong}"), |()| ());
                });
                let of_caller = std::panic::catch_unwind(|| {
                    in_order(100, threads, 4, |item| item, |item| assert!(item != wrong, "item {wrong}"));
                });
                for found in [of_work, of_caller] {
                    let message = found.unwrap_err().downcast::<String>().unwrap();
                    assert_eq!(*message, format!("item {wrong}"));
                }
            }
        }
    }
}

//! The same work for many items, on several threads.
//!
//! In: items, and the work for one item. Out: the results in the order of the items, for any number of threads. Items never share data that changes.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Applies the work to every item, with this number of threads. The results are in the order of the items.
pub fn in_threads<T: Sync, A: Send>(items: &[T], threads: usize, work: impl Fn(&T) -> A + Sync) -> Vec<A> {
    let next = AtomicUsize::new(0);
    let answers: Vec<(usize, A)> = std::thread::scope(|scope| {
        let worker = || {
            let mut own = vec![];
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(item) = items.get(index) else { return own };
                own.push((index, work(item)));
            }
        };
        let others: Vec<_> = (1..threads.min(items.len())).map(|_| scope.spawn(worker)).collect();
        let mut all = worker();
        for other in others {
            match other.join() {
                Ok(own) => all.extend(own),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        all
    });
    let mut in_order: Vec<Option<A>> = items.iter().map(|_| None).collect();
    for (index, answer) in answers {
        in_order[index] = Some(answer);
    }
    in_order.into_iter().flatten().collect()
}

/// The number of threads that this machine can run at the same time.
#[must_use]
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_answers_is_that_of_the_items() {
        let items: Vec<u64> = (0..40).collect();
        for threads in [0, 1, 3] {
            assert_eq!(
                in_threads(&items, threads, |item| item * item),
                items.iter().map(|item| item * item).collect::<Vec<_>>()
            );
        }
    }
}

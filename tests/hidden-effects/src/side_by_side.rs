//! Cases side by side.
//!
//! In: cases, made one after the other, and the work for one. Out: the results in the order of the cases.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Does the work for each case, with some cases at the same time. The first failure ends the work.
pub(super) fn each<C, R: Send>(
    at_once: usize,
    cases: impl Iterator<Item = C> + Send,
    work: impl Fn(C) -> Result<R, String> + Sync,
) -> Result<Vec<R>, String> {
    let (cases, found, has_failed) = (Mutex::new(cases.enumerate()), Mutex::new(Vec::new()), AtomicBool::new(false));
    let worker = || -> Result<(), String> {
        while !has_failed.load(Ordering::Relaxed) {
            let next = cases.lock().map_err(|_| "a case could not be made")?.next();
            let Some((place, case)) = next else { break };
            let result = work(case).inspect_err(|_| has_failed.store(true, Ordering::Relaxed))?;
            found.lock().expect("no panic in between").push((place, result));
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().try_for_each(|it| it.join().map_err(|_| "a case ended early".to_string())?)
    })?;
    let mut found = found.into_inner().expect("no panic in between");
    found.sort_by_key(|it| it.0);
    Ok(found.into_iter().map(|it| it.1).collect())
}

#[cfg(test)]
mod tests {
    use super::each;

    #[test]
    fn results_have_the_order_of_the_cases_and_a_failure_ends_the_work() {
        let slow_first = |k: u64| {
            std::thread::sleep(std::time::Duration::from_millis(20 / (k + 1)));
            Ok(k * k)
        };
        for at_once in [1, 3] {
            assert_eq!(each(at_once, 0..6, slow_first), Ok(vec![0, 1, 4, 9, 16, 25]));
            let failing = |k: u64| if k == 1 { Err("one".to_string()) } else { Ok(k) };
            assert_eq!(each(at_once, 0..6, failing), Err("one".to_string()));
        }
    }
}

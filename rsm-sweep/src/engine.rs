//! Runs tasks on the cores of this machine.
//!
//! In: tasks without a result. Out: their results in a store, each written when it is ready. The store does not depend on the number of threads.

use std::sync::atomic::{AtomicBool, Ordering};

use rsm_core::threads::in_threads;
use serde_json::Value;

use crate::run::Diagnose;
use crate::scenario::Scenario;
use crate::store::Store;
use crate::tasks::Task;

/// Runs tasks. `done` is called after each.
///
/// # Errors
/// A sentence, if a result could not be written. The other results are kept.
pub fn run(
    scenario: &Scenario,
    tasks: &[&Task],
    store: &Store,
    threads: usize,
    diagnose: &Diagnose<'_>,
    done: &(dyn Fn(&Task, &Value) + Sync),
) -> Result<(), String> {
    let stopped = AtomicBool::new(false);
    let inside = (threads / tasks.len().max(1)).max(1);
    let one = |task: &&Task| {
        if stopped.load(Ordering::Relaxed) {
            return Ok(());
        }
        let keep = || {
            store.start(task)?;
            let result = task.run(scenario, inside, diagnose);
            store.put(task, &result)?;
            done(task, &result);
            Ok(())
        };
        keep().inspect_err(|_: &String| stopped.store(true, Ordering::Relaxed))
    };
    in_threads(tasks, threads, one).into_iter().collect()
}

//! Runs tasks on a Dask cluster.
//!
//! In: tasks without a result, the address of a scheduler. Out: their results in a store on this machine, each written when it arrives. The script
//! `python/rsm_sweep_dask.py` communicates with the scheduler. It receives the bundle of the scenario and the hashes on its standard input, and
//! prints a line for each task. Dask handles scheduling, lost workers and retries.

use std::collections::HashMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};

use serde_json::{Value, json};

use crate::bundle;
use crate::scenario::Scenario;
use crate::store::Store;
use crate::tasks::Task;

/// The cluster and its programs.
#[derive(Debug, Clone)]
pub struct Cluster<'a> {
    /// HOST:PORT of the scheduler.
    pub scheduler: &'a str,
    /// The Python program on this machine, with the script and the package `distributed`.
    pub python: &'a str,
    /// The command `rsm` on the workers.
    pub program: &'a str,
}

/// A child process that is killed when this value is dropped.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs tasks. `done` is called after each.
///
/// # Errors
/// A sentence: the script cannot be started; tasks failed on the workers (the results of all others are kept); or a result cannot be written.
pub fn run(
    scenario: &Scenario,
    tasks: &[&Task],
    store: &Store,
    cluster: &Cluster<'_>,
    done: &dyn Fn(&Task, &Value),
) -> Result<(), String> {
    let mut command = Command::new(cluster.python);
    command.args(["-m", "rsm_sweep_dask", cluster.scheduler]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let child = command.spawn().map_err(|error| format!("{} cannot be started: {error}", cluster.python))?;
    let mut child = Guarded(child);
    let hashes: Vec<&str> = tasks.iter().map(|it| it.hash.as_str()).collect();
    let job = json!({ "program": cluster.program, "bundle": bundle::write(scenario), "tasks": hashes });
    // A script that ends immediately does not read its input; its error is reported below.
    if let Some(mut input) = child.0.stdin.take() {
        let _ = input.write_all(job.to_string().as_bytes());
    }
    let by_hash: HashMap<&str, &Task> = tasks.iter().map(|it| (it.hash.as_str(), *it)).collect();
    let mut left = by_hash.clone();
    let mut failed = Vec::new();
    let output = child.0.stdout.take().ok_or("the script has no standard output")?;
    for line in BufReader::new(output).lines() {
        let line = line.map_err(|error| format!("the script cannot be read: {error}"))?;
        let told: Value = serde_json::from_str(&line)
            .map_err(|error| format!("the script printed `{line}`, expected one JSON object: {error}"))?;
        let hash = told["task"].as_str().unwrap_or_default();
        let task = by_hash.get(hash).ok_or_else(|| format!("the script reported an unknown task: `{hash}`"))?;
        if let Some(why) = told["error"].as_str() {
            failed.push(format!("task {hash}: {why}"));
            continue;
        }
        let result: Value = serde_json::from_str(told["result"].as_str().unwrap_or_default())
            .map_err(|error| format!("the result of the task {hash} is incomplete: {error}"))?;
        if result["task"].as_str() != Some(hash) {
            return Err(format!("the script returned the result of another task for the task {hash}"));
        }
        store.put(task, &result)?;
        if left.remove(hash).is_some() {
            done(task, &result);
        }
    }
    let status = child.0.wait().map_err(|error| format!("the script cannot be waited for: {error}"))?;
    if let Some(first) = failed.first() {
        return Err(format!("{} of {} tasks failed on the cluster; the first: {first}", failed.len(), tasks.len()));
    }
    if !status.success() || !left.is_empty() {
        return Err(format!(
            "{} -m rsm_sweep_dask ended with {status}, {} of {} tasks have no result\n  help: install the script here by `pip install PROJECT/rsm-sweep/python`, and this version of `rsm` on every worker",
            cluster.python,
            left.len(),
            tasks.len()
        ));
    }
    Ok(())
}

//! Many simulations or diagnoses as a list of tasks: Monte Carlo, designed experiments, many machines.
//!
//! ```text
//!   scenario.toml --scenario--> Scenario --tasks--> [Task, Task, ...]     each with a hash of everything that affects its result
//!                                                        |
//!          all cores | a shard K/N | Dask  --run-->  result.json          complete or absent, in a Store
//!                                                        |
//!                        Store + tasks --table--> CSV, Parquet --summary--> quantiles with their intervals
//! ```
//!
//! A result depends only on its task: not on threads, order, shards, or on whether the list was killed and started again. An existing result is not
//! computed again. Nothing here prints. The caller gives the function that runs a diagnosis.
//!
//! ```
//! use rsm_core::source::{Fault, Faults, Source};
//! use rsm_sweep::{scenario::Scenario, summary, table::Table, tasks};
//!
//! let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\n\
//!             viscous_friction = 0.0\ncommand_limit = 10.0\n[tolerance]\nmass = 0.1\n";
//! let record = "time[s],command[V],position[m]\n0,1,0\n0.5,1,0\n1,1,0\n";
//! let sweep = "format = 1\nsweep = \"mass\"\nplants = [\"axis.toml\"]\nrecords = [\"in.csv\"]\nruns = 100\n\
//!              outputs.position = [\"final\"]\n[[vary]]\nparameter = \"mass\"\ndistribution = \"tolerance\"\n";
//! let open = |name: &str| match name {
//!     "axis.toml" => Ok(Source::new(name, axis)),
//!     "in.csv" => Ok(Source::new(name, record)),
//!     _ => Err(Faults::one(Fault::whole_file(name, "cannot be read"))),
//! };
//! let scenario = Scenario::read(&Source::new("sweep.toml", sweep), &open)?;
//! let tasks = tasks::list(&scenario)?;
//! let results: Vec<_> = tasks.iter().map(|task| Some(task.run(&scenario, 1, &rsm_sweep::no_diagnosis))).collect();
//! let table = Table::of(&scenario, &tasks, &results);
//! let found = summary::of(&scenario, &table);
//! // 4 N on a mass of 2 kg +- 10 % for 1 s: 1 m, divided by the mass.
//! let median = found[0].quantiles.iter().find(|it| it.share == 0.5).unwrap();
//! assert!(median.low.unwrap() < 1.0 && 1.0 < median.high.unwrap());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Only what a user of the library needs is public.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod distribution;

pub mod scenario;

pub mod tasks;

mod run;

pub mod bundle;

pub mod store;

pub mod engine;

pub mod dask;

pub mod table;

pub mod parquet;

pub mod summary;

/// Part of every hash besides the files, because another version may give other bits.
pub const PROGRAM: &str = concat!("rsm ", env!("CARGO_PKG_VERSION"));

/// The diagnosis function for scenarios without diagnoses.
///
/// # Errors
/// Always.
pub fn no_diagnosis(_: &Case<'_>) -> Result<serde_json::Value, String> {
    Err("no diagnosis is made here".to_string())
}

pub use run::{Case, Diagnose};

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

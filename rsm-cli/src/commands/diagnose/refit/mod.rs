//! `rsm diagnose --refit`: repeats the designed experiment on the extended plant, fits and emits its surfaces, and reports what the controller gains.
//!
//! ```text
//!   nominal plant  --experiment--> data --fit--> surfaces of before --.
//!   extended plant --experiment--> data --fit--> surfaces of after  --+--judged on--> the true plant if it is given, else the extended one;
//!                                                                     |               and the records
//!                                                                     '--emitted (C, Rust)
//! ```
//!
//! In: a diagnosis, the nominal plant, records, and for simulated studies the true plant. Out: files for DIR/refit, the key `refit`, words. The true
//! plant is used only for the test, never for a fit.

mod driveline;
mod motor;

use std::path::{Path, PathBuf};

use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use serde_json::Value;

use crate::outcome::Refusal;

/// The inputs of a refit.
pub struct Request<'a> {
    /// The plant file of the diagnosis.
    pub nominal: &'a PlantFile,
    /// The extended plant of the diagnosis.
    pub extended: &'a PlantFile,
    /// The true plant, if it is known.
    pub truth: Option<&'a PlantFile>,
    /// All records.
    pub records: &'a [Record],
    /// The folder in which the files will be written.
    pub folder: &'a Path,
    /// Called with a message at each step.
    pub progress: &'a dyn Fn(&str),
}

/// The results of a refit.
pub struct Refitted {
    /// Files: path and text.
    pub files: Vec<(PathBuf, String)>,
    /// The value of the key `refit`.
    pub value: Value,
    /// Lines for standard error and for the report.
    pub words: Vec<String>,
}

/// Refuses a plant without a designed experiment, and a true plant of another kind. Called before any work.
pub fn refuse(nominal: &PlantFile, truth: Option<&PlantFile>) -> Result<(), Refusal> {
    let found = nominal.kind.name();
    if !["pmac", "driveline"].iter().any(|name| nominal.kind.is(name)) {
        return Err(Refusal::new(format!(
            "--refit: found the plant \"{found}\", expected \"pmac\" (the bench) or \"driveline\" (the track): no experiment is designed for another one"
        )));
    }
    match truth {
        Some(truth) if truth.kind != nominal.kind => {
            Err(Refusal::new(format!("--truth: found the plant \"{}\", expected \"{found}\"", truth.kind.name())))
        }
        _ => Ok(()),
    }
}

/// Repeats the experiment.
pub fn refit(request: &Request<'_>) -> Result<Refitted, Refusal> {
    match request.nominal.kind {
        kind if kind.is("driveline") => driveline::refit(request),
        _ => motor::refit(request),
    }
}

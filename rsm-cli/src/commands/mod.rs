//! One file a subcommand.

pub mod check;
pub mod completions;
pub mod cosim;
pub mod demo;
pub mod design;
pub mod diagnose;
pub mod emit;
pub mod equations;
pub mod eval;
pub mod experiment;
pub mod federate;
pub mod fit;
pub mod import;
pub mod limits;
pub mod man;
pub mod merge;
pub mod optimise;
pub mod simulate;
pub mod stream;
pub mod sweep;

use std::io::Read as _;
use std::path::Path;

use clap::ValueEnum;
use rsm_core::check::Checked;
use rsm_core::number::Precision;
use rsm_core::source::{Fault, Faults, Source};

/// The text of a model file; `-` is standard input.
///
/// # Errors
/// One fault that names the file and the reason.
pub fn model_source(path: &Path) -> Result<Source, Faults> {
    if path != Path::new("-") {
        return Source::read(path);
    }
    let mut text = String::new();
    match std::io::stdin().read_to_string(&mut text) {
        Ok(_) => Ok(Source::new("standard input", text)),
        Err(error) => Err(Faults::one(Fault::whole_file("standard input", format!("cannot be read: {error}")))),
    }
}

/// A precision on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PrecisionName {
    /// IEEE 754 binary64
    F64,
    /// IEEE 754 binary32
    F32,
}

impl PrecisionName {
    /// The precision.
    pub fn precision(self) -> Precision {
        match self {
            PrecisionName::F64 => Precision::F64,
            PrecisionName::F32 => Precision::F32,
        }
    }
}

/// The precisions that were asked for, each once, in the order of files.
pub fn precisions(names: &[PrecisionName]) -> Vec<Precision> {
    let mut found: Vec<Precision> = names.iter().map(|name| name.precision()).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Prints on standard error which precisions cannot represent the model, and why. If the user named no precision, this is a note and not a
/// failure.
pub fn print_left_out(checked: &Checked) {
    for precision in Precision::ALL {
        if let Some(faults) = checked.refusal(precision) {
            tell!("{} is left out, because it cannot represent this model:\n{faults}", precision.name());
        }
    }
}

//! The subcommands, one file or folder for each.

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
pub mod following;
pub mod import;
pub mod limits;
pub mod man;
pub mod merge;
pub mod optimise;
pub mod simulate;
pub mod stream;
pub mod sweep;
pub mod track;

use std::io::Read as _;
use std::path::Path;

use clap::ValueEnum;
use rsm_core::check::Checked;
use rsm_core::number::Precision;
use rsm_core::source::{Fault, Faults, Source};

use crate::outcome::Refusal;

/// The text of a model file; `-` is standard input.
///
/// # Errors
/// A fault with the file and the reason.
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

/// The index of a surface by its name, which may be missing if there is only one.
pub fn surface_index(checked: &Checked, name: Option<&str>) -> Result<usize, Refusal> {
    let surfaces = &checked.model().surfaces;
    let known = || surfaces.iter().map(|surface| surface.name.as_str()).collect::<Vec<_>>().join(", ");
    match name {
        None if surfaces.len() == 1 => Ok(0),
        None => Err(Refusal::new(format!("--surface is missing: the surfaces of {} are {}", checked.file(), known()))),
        Some(name) => surfaces.iter().position(|surface| surface.name == name).ok_or_else(|| {
            Refusal::new(format!("--surface: found {name}, the surfaces of {} are {}", checked.file(), known()))
        }),
    }
}

/// The requested precisions, each once, in the order of the files.
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
            stderr_line!("{} is left out, because it cannot represent this model:\n{faults}", precision.name());
        }
    }
}

//! One file a subcommand.

pub mod check;
pub mod demo;
pub mod design;
pub mod diagnose;
pub mod emit;
pub mod eval;
pub mod experiment;
pub mod fit;
pub mod limits;
pub mod simulate;

use clap::ValueEnum;
use rsm_core::check::Checked;
use rsm_core::number::Precision;

use crate::outcome::Refusal;

/// A precision on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PrecisionName {
    /// IEEE 754 binary64
    F64,
    /// IEEE 754 binary32
    F32,
    /// fixed point (not in this version)
    Fixed,
}

impl PrecisionName {
    /// The precision, or why there is none.
    pub fn precision(self) -> Result<Precision, Refusal> {
        match self {
            PrecisionName::F64 => Ok(Precision::F64),
            PrecisionName::F32 => Ok(Precision::F32),
            PrecisionName::Fixed => Err(Refusal::new("--precision: found fixed, this version has f64 and f32")),
        }
    }
}

/// The precisions that were asked for, each once, in the order of files.
pub fn precisions(names: &[PrecisionName]) -> Result<Vec<Precision>, Refusal> {
    let mut found = names.iter().map(|name| name.precision()).collect::<Result<Vec<_>, _>>()?;
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

/// Says on standard error which precisions cannot hold the model, and why: where none was asked for by name, that is worth a word and no
/// failure.
pub fn tell_left_out(checked: &Checked) {
    for precision in Precision::ALL {
        if let Some(faults) = checked.refusal(precision) {
            tell!("{} is left out:\n{faults}", precision.name());
        }
    }
}

//! The tests of the library, one binary.

mod bits;
mod closed_form;
mod designs;
#[path = "../../../tests/src/refused.rs"]
mod refused;
mod rejected;

use std::path::{Path, PathBuf};

use rsm_core::source::{Faults, Source};
use rsm_sweep::scenario::Scenario;

/// A file below the tests.
fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(name)
}

/// Opens a file of the cases; messages have its name without the folder.
fn open(name: &str) -> Result<Source, Faults> {
    std::fs::read_to_string(path("cases").join(name))
        .map(|text| Source::new(name, text))
        .map_err(|_| Faults::one(rsm_core::source::Fault::whole_file(name, "cannot be read")))
}

/// A scenario with files of the cases.
fn scenario(text: &str) -> Scenario {
    Scenario::read(&Source::new("sweep.toml", text), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The axis with its mass and its friction drawn.
fn axis(runs: usize) -> String {
    format!(
        "format = 1\nsweep = \"axis\"\nplants = [\"axis.toml\"]\nrecords = [\"motion.csv\"]\nruns = {runs}\n\
         outputs.position = [\"final\", \"max\", \"rmse\"]\n\
         [[vary]]\nparameter = \"mass\"\ndistribution = \"tolerance\"\n\
         [[vary]]\neffect = \"coulomb-friction\"\nnumber = \"force\"\ndistribution = \"uniform\"\nrange = [0.0, 2.0]\n"
    )
}

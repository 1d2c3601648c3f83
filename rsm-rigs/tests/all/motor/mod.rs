//! The motor's drive: each part against a case worked out otherwise, then the loop against closed forms, then the surfaces against the full
//! controller.

mod bench;
mod closed_loop;
mod limits;
mod parts;

use rsm_core::check::Checked;
use rsm_core::source::Source;
use rsm_rigs::motor::surface::Surfaces;
use rsm_sim::plant_file::PlantFile;

fn motor() -> PlantFile {
    super::plant("pmac", "")
}

/// The surfaces that are shipped.
fn shipped() -> Surfaces {
    let path = super::path("../generated/coefficients/motor.toml");
    let model = Checked::read(&Source::read(&path).unwrap()).unwrap_or_else(|faults| panic!("{faults}"));
    Surfaces::new(&model).unwrap_or_else(|faults| panic!("{faults}"))
}

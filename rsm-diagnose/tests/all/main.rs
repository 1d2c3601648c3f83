//! The tests of the diagnosis of surfaces and plants, one binary.

mod bursts;
mod correction;
mod diagnosis;
mod equation_plants;
#[path = "../../../rsm-fit/tests/all/folders.rs"]
mod folders;
mod names;
mod open_numbers;
mod random;
mod rest;
#[path = "../../../rsm-sim/tests/all/shipped.rs"]
mod shipped;
mod standing;
mod surface;

use shipped::{effect, path, plant, record, run};

//! The tests of the diagnosis of surfaces and plants, one binary.

mod correction;
mod diagnosis;
mod equals;
mod equation_plants;
#[path = "../../../rsm-fit/tests/all/folders.rs"]
mod folders;
mod measured;
mod names;
mod next_experiment;
mod random;
mod rest;
#[path = "../../../rsm-sim/tests/all/shipped.rs"]
mod shipped;
mod surface;
mod units;

use shipped::{axis_record, car_record, effect, motor_record, path, plant, record, run};

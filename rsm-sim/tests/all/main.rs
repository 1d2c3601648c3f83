//! The tests of the plants, one binary.

mod catalogue;
mod configurations;
mod cross_check;
mod equations;
mod fixed_steps;
mod judged;
mod lanes;
#[path = "../../../tests/src/refused.rs"]
mod refused;
mod rejected;
mod sensitivities;
mod shipped;
mod step;
mod stiff;

use shipped::{axis_record, car_record, effect, motor_record, path, plant, record, run};

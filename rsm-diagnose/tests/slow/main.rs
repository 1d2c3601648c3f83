//! The diagnoses that take minutes: families of explanations that are alike, units, measured machines, next experiments. `cargo xtask test` runs
//! them, and `cargo test -p rsm-diagnose --test slow`; `cargo test -p rsm-diagnose` leaves them out.

mod equals;
#[expect(dead_code, reason = "certified results are for surfaces")]
#[path = "../../../rsm-fit/tests/all/folders.rs"]
mod folders;
mod long_records;
mod measured;
mod next_experiment;
#[path = "../all/random.rs"]
mod random;
mod rest;
#[path = "../../../rsm-sim/tests/all/shipped.rs"]
mod shipped;
#[expect(dead_code, reason = "the faults of records with rest are for quick tests")]
#[path = "../all/standing.rs"]
mod standing;
mod units;
mod whole_numbers;

use shipped::{axis_record, car_record, effect, motor_record, path, plant, record, run};

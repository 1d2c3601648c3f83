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

/// The next number of a pseudo-random sequence, from 0 to 1: the generator of Knuth's MMIX (TAOCP 2, 3.3.4).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64
}

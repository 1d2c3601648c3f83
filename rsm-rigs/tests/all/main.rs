//! The tests of the rigs, one binary.

mod motor;
#[path = "../../../rsm-sim/tests/all/shipped.rs"]
mod shipped;
mod track;
mod wear;

use shipped::{effect, path, plant};

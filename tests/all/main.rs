//! The tests that cross crates, in one binary.

mod bit_for_bit;
mod effects;
mod firmware;
mod layers;
mod lowering;
mod measured;
mod object_code;
mod refuses;
mod stale;
mod warnings;

//! The tests of the crate from outside, one binary.

mod against_hand;
mod faults;
mod simulator;
mod speed;
mod tapes;

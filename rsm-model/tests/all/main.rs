//! The tests of the crate's public interface, in one binary.

mod against_hand;
mod faults;
mod simulator;
mod speed;
mod tapes;

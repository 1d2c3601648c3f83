//! The tests of the command, one binary.

mod command;
mod compensator;
mod design;
mod driveline;
mod motor;
mod readme;
mod shipped_data;

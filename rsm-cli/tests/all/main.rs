//! The tests of the command, one binary.

mod command;
mod compensator;
mod design;
mod motor;
mod readme;
mod shipped_data;

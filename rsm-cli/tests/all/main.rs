//! The tests of the command, one binary.

mod command;
mod readme;
mod shipped_data;

//! The tests of the command, one binary.

mod command;
mod shipped_data;

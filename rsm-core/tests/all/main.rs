//! The tests of rsm-core, one binary.

mod compensator;
mod lowering;
mod rejected;

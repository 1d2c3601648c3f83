//! The tests of rsm-core, one binary.

mod lowering;
mod rejected;

//! Optimal designs: the runs that tell given terms apart best, within a region.
//!
//! In: a design specification that asks for one. Out: points in coded variables. Never knows units.

mod exchange;
mod line;
mod linear;
mod space;

pub(super) use exchange::{Failure, Task};
pub(super) use space::Space;

#[cfg(test)]
mod tests;

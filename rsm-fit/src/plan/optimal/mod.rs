//! Optimal designs: the best runs to estimate given terms, within a region.
//!
//! In: a specification of an optimal design. Out: points in coded variables.

mod exchange;
mod line;
mod linear;
mod space;

pub(super) use exchange::{Failure, Task};
pub(super) use space::Space;

#[cfg(test)]
mod tests;

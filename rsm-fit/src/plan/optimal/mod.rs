//! Optimal designs: the best runs to estimate given terms, within a region.
//!
//! In: a specification of an optimal design. Out: points in coded variables; the variance of predictions of any design.

mod exchange;
mod line;
mod linear;
mod space;
mod variance;

pub(super) use exchange::{Failure, Task};
pub(super) use linear::dot;
pub(super) use space::Space;
pub(super) use variance::Variance;

#[cfg(test)]
mod tests;

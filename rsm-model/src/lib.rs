//! Plants as equations: Base Modelica text to a system that is sorted, solved and reduced.
//!
//! ```text
//! plant.mo --syntax--> tree --flat--> scalar equations --system--> states, rates, outputs, switches --> programs
//! ```
//!
//! Whoever changes a plant (an effect) rewrites the flat equations; whoever runs it takes programs from the system.

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod effects;
pub mod expression;
pub mod flat;
pub mod shipped;
mod syntax;
pub mod system;
pub mod units;

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

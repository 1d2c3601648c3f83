//! Compiles plants from Base Modelica text to a sorted and reduced system of equations.
//!
//! ```text
//! plant.mo --syntax--> tree --flat--> scalar equations --system--> states, rates, outputs, switches --> programs
//! ```
//!
//! An effect changes the flat equations of a plant. A simulator gets programs from the system.

// Only what a user of the library needs is public.
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

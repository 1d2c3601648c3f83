//! Finds the causes of a model's error, and measures on holdout rows what they gain.
//!
//! ```text
//!   surface: model file + new rows  --> residual --+
//!                                                  +--> causes with probabilities, extended model, gain, next experiment
//!   plant:   plant file + records --> residual ----+
//! ```
//!
//! `surface` diagnoses a fitted response surface: its hypotheses are columns beside the terms of the fit. `plant` diagnoses a simulated plant: its
//! hypotheses are the effects of the catalogue. Both also have the verdicts "no discrepancy" and "unexplained" (no known cause explains the error).
//! The crate does not print and does not write files.

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

mod engine;

pub mod plant;

pub mod surface;

//! What a model gets wrong, which cause explains it, and what that gains on rows that nothing has seen.
//!
//! ```text
//!   surface: model file + new rows  --> residual --+
//!                                                  +--> causes with probabilities, extended model, gain, next experiment
//!   plant:   plant file + records --> residual ----+
//! ```
//!
//! `surface` judges a fitted response surface: its hypotheses are columns beside the terms of the fit. `plant` judges a simulated plant: its
//! hypotheses are the effects of the catalogue. Both say "nothing is wrong" when nothing is, and "unexplained" when no cause that they know explains it.
//! Nothing here prints or writes.

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

mod engine;

pub mod plant;

pub mod surface;

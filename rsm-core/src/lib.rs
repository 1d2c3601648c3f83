//! Models and their compiler.
//!
//! ```text
//! model.toml --model_file--> Model --check--> Checked --lower--> Tape --run--> value
//!                                                |                 |---emit::rust--> m.rs
//!                                                |                 |---emit::c-----> m.h, m.c
//!                                                |                 '---rounding----> bound of the rounding error
//!                                                '---certificate, exact--> range, stability, reference
//! ```
//!
//! A tape is a function of its arguments (a surface), or a step that also has states (a compensator).
//!
//! `rsm-fit` converts the rows of a CSV to terms of a surface. Here a term becomes operations of a tape, and each operation becomes a line of Rust
//! and of C, with the same bits in every back end:
//!
//! ```
//! use rsm_core::{check::Checked, lower, number::Precision, run::Interpreter, source::Source};
//!
//! let file = r#"
//! format = 1
//! model = "motor"
//!
//! [inputs.speed]
//! unit = "rad/s"
//! range = [0.0, 800.0]
//!
//! [surfaces.angle]
//! unit = "deg"
//! inputs = ["speed"]
//! terms = [{ powers = [0], coefficient = 30.0 }, { powers = [1], coefficient = 15.0 }]
//! "#;
//! let checked = Checked::read(&Source::new("motor.toml", file)).unwrap();
//! let tape = lower::surface(&checked, 0, Precision::F64);
//! let mut evaluator = Interpreter::<f64>::new(&tape);
//! assert_eq!(evaluator.eval(&[400.0]), 30.0);
//! assert_eq!(evaluator.eval(&[900.0]), 45.0); // clamped to 800 rad/s
//!
//! let module = rsm_core::compile::rust(&Source::new("motor.toml", file), &[]).unwrap();
//! assert!(module.text.contains("pub fn angle(speed: f64) -> f64"));
//! ```

// Only what a user of the library needs is public.
#![cfg_attr(not(test), warn(unreachable_pub))]

// In the order of the pipeline.
pub mod order;
pub mod places;
pub mod source;
pub mod threads;
pub mod toml_reader;
pub mod vector;

pub mod model;
pub mod model_file;
pub mod names;

pub mod check;

pub mod basis;
mod function;
pub mod number;
mod scalar;
pub mod tape;

pub mod elementary;
pub mod held;
pub mod series;
pub mod tangent;
pub mod transform;

pub mod bernstein;
pub mod interval;
pub mod pieces;
pub mod range;
pub mod rounding;

pub mod lower;

pub mod run;

pub mod certificate;
pub mod exact;
pub mod values;

pub mod emit;

pub mod build_script;
pub mod compile;

#[cfg(test)]
mod adversary;

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

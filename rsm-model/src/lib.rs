//! Plants as equations: Base Modelica text to a flat system.
//!
//! ```text
//! plant.mo --syntax--> tree --flat--> scalar equations over one pool of expressions
//! ```

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]
// The sorting of the equations, which uses the rest, follows.
#![allow(dead_code)]

pub mod expression;
pub mod flat;
mod syntax;

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

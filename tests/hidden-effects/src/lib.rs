//! Records with hidden effects, for the evaluation of a diagnosis.
//!
//! ```text
//!   seed -> Case (true plant, nominal file, excitations) -> records with noise -> folder -> rsm diagnose -> judge -> table
//! ```
//!
//! The plants of docs/book/src/reference/plants.md, implemented a second time from that text alone: the motor in the stator frame, the driveline with
//! twists, steps with error control, located kinks. No crate of the project is imported, so an error of these crates cannot be on both sides of a
//! comparison.

pub mod axis;
pub mod bench;
pub mod car;
pub mod case;
pub mod configurations;
pub mod coverage;
pub mod draw;
pub mod excitation;
pub mod files;
pub mod flow;
pub mod folder;
pub mod judge;
pub mod motor;
pub mod outside;
mod plans;
pub mod plant;
pub mod random;
pub mod reliability;
pub mod surfaces;
pub mod systems;
pub mod untidy;
pub mod verification;

//! Records with hidden effects, to judge a diagnosis by.
//!
//! ```text
//!   seed -> Case (true plant, nominal file, excitations) -> records with noise -> folder -> rsm diagnose -> judge -> table
//! ```
//!
//! The plants of docs/book/src/reference/plants.md, written a second time from that text alone: the motor in the frame of the stator, the driveline with twists, steps
//! controlled by error, kinks located. No crate of ours is imported, so an error of our crates cannot stand on both sides of a comparison.

pub mod axis;
pub mod bench;
pub mod car;
pub mod case;
pub mod coverage;
pub mod draw;
pub mod excitation;
pub mod files;
pub mod flow;
pub mod folder;
pub mod judge;
pub mod motor;
pub mod outside;
pub mod plant;
pub mod random;
pub mod reliability;
pub mod surfaces;
pub mod systems;
pub mod untidy;
pub mod verification;

//! Simulated plants, and the catalogue of physical effects that a nominal plant may neglect.
//!
//! ```text
//!   plant.toml --plant_file--> PlantFile --+
//!   record.csv --record--> Record ---------+--simulate--> outputs at every row
//!                                          |
//!        effects, in the equations --------+
//! ```
//!
//! A simulation runs the equations of a plant with the effects of its plant file ([`equations`]). All plants are texts of equations, also those of
//! plant files of format 1, and all effects are files ([`equation_plant`]). The same files give the same bits on one machine. Nothing here prints. A
//! simulation along a record draws no random numbers: the caller adds measurement noise.
//!
//! ```
//! use rsm_core::source::Source;
//! use rsm_sim::{plant_file::PlantFile, record::Record, simulate::Simulator};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\n\
//!             viscous_friction = 0.0\ncommand_limit = 10.0\n";
//! let plant = PlantFile::read(&Source::new("axis.toml", axis))?;
//! let record = Record::read(&Source::new("in.csv", "time[s],command[V],position[m]\n0,1,0\n0.5,1,0\n1,1,0\n"), &plant)?;
//! let outputs = Simulator::new(&plant, &record)?.run(&record)?;
//! // 4 N on 2 kg: q = t^2.
//! assert!((outputs.of("position").unwrap()[2] - 1.0).abs() < 1e-12);
//! # Ok(())
//! # }
//! ```

// Only what a user of the library needs is public.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod quantity;

pub mod configurations;

pub mod kind;

pub mod schema;

mod parameters;

pub mod plant_file;

pub mod record;

pub mod effect;

pub mod code;

pub mod equations;

pub mod equation_plant;

pub mod simulate;

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

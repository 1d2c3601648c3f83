//! Plants of equations: a plant file of format 2 and its text, run along a record.
//!
//! ```text
//! plant.toml (format 2) + plant.mo --file--> EquationFile --machine--> Machine --engine--> outputs at every row
//!                                  record.csv --signals--> inputs, start --^
//! ```
//!
//! Everything is computed by tapes, in double precision: the same bits on every machine. Inputs hold from row to row.

pub mod code;
pub mod engine;
pub mod extended;
pub mod file;
mod first_format;
pub mod fixed;
mod late;
pub mod linear;
pub mod machine;
mod methods;
pub mod rows;
pub mod signals;
pub mod step;

pub use engine::{Method, Setting, run};
pub use extended::Entry;
pub use file::EquationFile;
pub use linear::{Linearised, linearise};
pub use machine::{Machine, Point};
pub use rows::{Inputs, Stopped};
pub use signals::Signals;
pub use step::Step;

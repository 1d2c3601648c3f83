//! Plants of equations: a plant file of format 2 and its model text, simulated along a record.
//!
//! ```text
//! plant.toml (format 2) + plant.mo --file--> EquationFile --machine--> Machine --lanes--> outputs at every row
//!                                  record.csv --signals--> inputs, start --^
//! ```
//!
//! All results are computed by tapes in double precision, with the same bits on every machine. Inputs are constant from row to row (zero-order hold).

mod branches;
mod carried;
mod carried_linear;
mod changes;
mod checked;
mod choice;
pub mod code;
mod computed;
mod derivatives;
pub(crate) mod effect_files;
pub mod engine;
mod entries;
mod events;
mod exponential;
pub mod extended;
pub mod file;
mod first_format;
pub mod fixed;
mod frechet;
mod frechet_values;
mod kept;
pub mod lanes;
mod late;
mod layout;
pub mod linear;
pub mod machine;
mod methods;
mod norm;
mod numbers;
pub mod observed;
mod part;
mod phi;
mod placed;
mod plain;
mod programs;
mod reach;
pub mod rows;
mod sampling;
pub mod sensitivities;
mod series;
mod series_speeds;
mod shortened;
pub mod signals;
mod speeds;
mod start_parameters;
pub mod starts;
pub mod step;
mod stiff;
mod tables;
mod thresholds;
mod walk;
mod whole_row;

pub use engine::{Method, Setting};
pub use extended::Entry;
pub use file::EquationFile;
pub use lanes::{Lanes, run};
pub use linear::{Linearised, linearise};
pub use machine::{Machine, Point};
pub use rows::{Inputs, Stopped};
pub use sensitivities::{By, Sensitive, Sensitivities};
pub use signals::Signals;
pub use start_parameters::start_parameters;
pub(crate) use start_parameters::used_parameters;
pub use starts::Starts;
pub use step::Step;
pub use walk::Lane;

//! From measured data to a model: records, designs, least squares, selection, statistics.
//!
//! ```text
//!   fit.toml --spec--> Specification --+
//!   data.csv --table--> Table --units, records, split--> Records --+
//!                                                                  |  design
//!                                  rows of terms in double-double <+
//!                                        |  qr: one triangle of all candidates
//!                                        v
//!                  ladder (figure 1) or given terms --> coefficients
//!                                        |  statistics, canonical, evidence
//!                                        v
//!                    Outcome { model: rsm_core::model::Model, figures of each response }
//! ```
//!
//! Beside the line: recursive, rows one at a time; plan, what to run before there are data.
//!
//! Every stage collects all faults of its input; numerical outcomes are data. Nothing here writes a file, prints, or knows an
//! emitter. The same bytes in give the same model, to the bit, on every machine with IEEE 754.
//!
//! A line through seven points, from CSV text to a model file:
//!
//! ```
//! use rsm_core::source::Source;
//! use rsm_fit::{fit::fit, spec::Specification};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = std::env::temp_dir().join(format!("rsm-fit-example-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! std::fs::write(folder.join("bench.csv"), "speed[km/h],drag[N]\n0,5\n18,15\n36,25\n54,35\n72,45\n90,55\n108,65\n")?;
//! let text = r#"
//!     format = 1
//!     model = "car"
//!     data = ["bench.csv"]
//!     [inputs.speed]
//!     unit = "m/s"
//!     [responses.drag]
//!     inputs = ["speed"]
//!     select = { method = "ladder", max_order = 3, confidence = 99.0 }
//! "#;
//! let specification = Specification::from_source(Source::new("fit.toml", text), folder.clone())?;
//! let outcome = fit(&specification, &mut |_progress| {})?;
//! # std::fs::remove_dir_all(&folder)?;
//!
//! assert!(outcome.reached());
//! assert_eq!(outcome.model.inputs[0].range, [0.0, 30.0]); // 108 km/h, in the unit of the model
//! let terms: Vec<_> = outcome.model.surfaces[0].terms.iter().map(|term| (term.powers[0], term.coefficient)).collect();
//! assert_eq!(terms, [(0, 35.0), (1, 30.0)]); // 35 N in the middle of the range, 30 N more at its end
//! # Ok(())
//! # }
//! ```

pub mod units;

pub mod table;

pub mod spec;

pub mod records;

pub mod random;

pub mod split;

pub mod dd;

pub mod design;

pub mod qr;

pub mod ladder;

mod selection;

pub mod statistics;

pub mod canonical;

pub mod support;

pub mod constrain;

pub mod verdict;

pub mod warnings;

pub mod evidence;

mod response;

pub mod fit;

pub mod in_memory;

pub mod recursive;

pub mod plan;


pub use fit::{Outcome, Progress, ResponseOutcome};
pub use in_memory::{Fit, Input, Response};
pub use records::Refused;
pub use spec::{Constraint, Specification};
pub use verdict::Verdict;

#[cfg(test)]
mod reference;

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
//! Not in the picture: `partial` fits shards of the data and merges them; `recursive` fits rows one at a time; `track` lets a surface follow measured
//! rows; `plan` designs experiments; `optimise` searches the best settings of a fitted model.
//!
//! Every stage reports all faults of its input together; numerical outcomes are data. Nothing here writes a file, prints, or depends on an emitter.
//! The same input bytes give the same model, bit for bit, on every machine with IEEE 754.
//!
//! Rows in memory are fitted with [`Fit`]. A line through seven points, from the rows to a model:
//!
//! ```
//! use rsm_fit::{Fit, Input, Response};
//!
//! let speed = Input::new("speed", [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0]).unit("m/s");
//! let drag = Response::new("drag", [5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0]).unit("N");
//! let outcome = Fit::new(speed, drag).name("car").order(3).ladder(99.0).fit()?;
//!
//! assert!(outcome.reached());
//! assert_eq!(outcome.model.inputs[0].range, [0.0, 30.0]);
//! let terms: Vec<_> = outcome.model.surfaces[0].terms.iter().map(|term| (term.powers[0], term.coefficient)).collect();
//! assert_eq!(terms, [(0, 35.0), (1, 30.0)]); // 35 N in the middle of the range, 30 N more at its end
//! # Ok::<(), rsm_fit::Refused>(())
//! ```
//!
//! The same from the text of a CSV, with a conversion of units:
//!
//! ```
//! use rsm_core::source::Source;
//! use rsm_fit::{Specification, fit};
//!
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
//! let data = Source::new("bench.csv", "speed[km/h],drag[N]\n0,5\n18,15\n36,25\n54,35\n72,45\n90,55\n108,65\n");
//! let specification = Specification::from_source(Source::new("fit.toml", text), "".into())?;
//! let outcome = fit::fit_sources(&specification, &[data], &mut |_progress| {})?;
//! assert_eq!(outcome.model.inputs[0].range, [0.0, 30.0]); // 108 km/h, in the unit of the model
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod units;

pub mod missing;

mod hash;

mod columnar;

pub mod content;

pub mod threads;

mod points;

pub mod table;

pub mod spec;

pub mod records;

mod sequence;

mod series;

pub mod left_out;

pub mod random;

pub mod split;

pub mod dd;

pub mod design;

pub mod qr;

mod blocks;

pub mod ladder;

mod selection;

mod search;

mod forms;

mod observations;

pub mod distributions;

pub mod analysis;

pub mod statistics;

pub mod canonical;

pub mod support;

pub mod constrain;

pub mod verdict;

pub mod robust;

pub mod autoregressive;

mod warnings;

mod evidence;

mod outcome;

mod response;

mod transformed;

pub mod fit;

pub mod in_memory;

pub mod partial;

pub mod recursive;

pub mod track;

pub mod plan;

pub mod optimise;

pub use evidence::residual_sd_of;
pub use fit::{Outcome, Progress, ResponseOutcome};
pub use in_memory::{Fit, Input, Response, Select};
pub use missing::Missing;
pub use records::Refused;
pub use spec::{Constraint, Specification};
pub use verdict::Verdict;

#[cfg(test)]
mod reference;

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

//! From measured data to evaluators that a 1 kHz control loop can trust: the types and functions that a user of the library needs.
//!
//! ```text
//!   data --fit--> Model --Checked--> certificate (range, rounding error)
//!                            |-----> emit: C or Rust
//!                            |-----> Interpreter: the same bits, here
//!                            '-----> surface::diagnose: what new data say of it
//!   plant file + record --Simulator--> outputs;  --plant::diagnose--> causes of the difference
//! ```
//!
//! Everything here is re-exported from the crates that own it: `rsm-core` (model, compiler, certificates), `rsm-fit` (designs, fits), `rsm-sim`
//! (plants, records), `rsm-diagnose` (both diagnoses). Nothing prints, and nothing writes a file.
//!
//! Fit a surface, look at its certificate, evaluate it, emit it as C:
//!
//! ```
//! use rsm::{Fit, Input, Interpreter, Precision, Response, certificate, compile, emit, lower};
//!
//! let speed = Input::new("speed", [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0]).unit("m/s");
//! let drag = Response::new("drag", [5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0]).unit("N");
//! let checked = Fit::new(speed, drag).name("car").order(3).ladder(99.0).fit()?.checked()?;
//!
//! // 2 N a m/s, from 5 N: nowhere in the range of the data above 65 N.
//! let of_drag = certificate::surface(&checked, 0, &[Precision::F64]);
//! assert!(of_drag.range.high < 65.1);
//!
//! let tape = lower::surface(&checked, 0, Precision::F64);
//! assert_eq!(Interpreter::<f64>::new(&tape).eval(&[10.0]), 25.0);
//!
//! let unit = compile::unit(&checked, &[Precision::F64])?;
//! assert!(emit::c::emit(&unit).header.contains("double car_drag(double speed);"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The same from a specification and CSV files is [`Specification::read`] and [`fit`]. What to measure first is an [`Experiment`]:
//!
//! ```
//! use rsm::{Alpha, Experiment, Factor, Fit};
//!
//! let factors = [Factor::within("torque", "N*m", [0.0, 10.0]), Factor::within("speed", "rad/s", [680.0, 785.0])];
//! let plan = Experiment::central_composite(factors, Alpha::FaceCentred).centre_points(3).plan()?;
//! // The bench.
//! let [torque, speed] = [&plan.factors[0].values, &plan.factors[1].values];
//! let angle: Vec<f64> = torque.iter().zip(speed).map(|(t, w)| 0.2 * t + 0.1 * w - 48.0).collect();
//! assert!(Fit::new(&plan, &angle).order(2).ladder(99.0).fit()?.reached());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A plant along a record, with dry friction that the nominal plant lacks:
//!
//! ```
//! use rsm::{PlantFile, Record, Simulator, Source};
//!
//! let nominal = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\n\
//!                viscous_friction = 0.0\ncommand_limit = 10.0\n";
//! let friction = "[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 1.0 }\n";
//! let end = |text: String| {
//!     let plant = PlantFile::read(&Source::new("axis.toml", text))?;
//!     let record = Record::read(&Source::new("in.csv", "time[s],command[V],position[m]\n0,1,0\n0.5,1,0\n1,1,0\n"), &plant)?;
//!     Ok::<f64, Box<dyn std::error::Error>>(Simulator::new(&plant, &record)?.run(&record)?.of("position").unwrap()[2])
//! };
//! assert!(end(format!("{nominal}{friction}"))? < end(nominal.to_string())?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub use rsm_core::check::Checked;
pub use rsm_core::model::Model;
pub use rsm_core::number::Precision;
pub use rsm_core::run::Interpreter;
pub use rsm_core::source::{Faults, Source};
pub use rsm_core::{certificate, compile, emit, lower};
pub use rsm_diagnose::{plant, surface};
pub use rsm_fit::fit::{Outcome, fit};
pub use rsm_fit::optimise::{Front, Goal, Optimum, Study};
pub use rsm_fit::plan::{Alpha, Evaluation, Experiment, Factor, Plan, Runs};
pub use rsm_fit::spec::{Constraint, Specification};
pub use rsm_fit::{Fit, Input, Refused, Response, Select, Verdict};
pub use rsm_sim::equation_plant;
pub use rsm_sim::plant_file::PlantFile;
pub use rsm_sim::record::Record;
pub use rsm_sim::simulate::{Outputs, Simulator};

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// The Rust of the book's guides, as documentation tests.
#[cfg(doctest)]
mod guides {
    #[doc = include_str!("../../docs/book/src/guides/design.md")]
    struct Design;
    #[doc = include_str!("../../docs/book/src/guides/embed-rust.md")]
    struct EmbedRust;
    #[doc = include_str!("../../docs/book/src/guides/fit.md")]
    struct Fit;
    #[doc = include_str!("../../docs/book/src/guides/optimise.md")]
    struct Optimise;
}

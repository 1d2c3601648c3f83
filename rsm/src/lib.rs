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
//! use rsm::{Checked, Interpreter, Precision, Source, Specification, certificate, compile, emit, fit, lower};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = std::env::temp_dir().join(format!("rsm-example-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! std::fs::write(folder.join("bench.csv"), "speed[m/s],drag[N]\n0,5\n5,15\n10,25\n15,35\n20,45\n25,55\n30,65\n")?;
//! let text = "format = 1\nmodel = \"car\"\ndata = [\"bench.csv\"]\n[inputs.speed]\nunit = \"m/s\"\n\
//!             [responses.drag]\ninputs = [\"speed\"]\nselect = { method = \"ladder\", max_order = 3, confidence = 99.0 }\n";
//! let specification = Specification::from_source(Source::new("fit.toml", text), folder.clone())?;
//! let outcome = fit(&specification, &mut |_progress| {})?;
//! # std::fs::remove_dir_all(&folder)?;
//!
//! let checked = Checked::from_model(&outcome.model)?;
//! // 2 N a m/s, from 5 N: nowhere in the range of the data above 65 N.
//! let of_drag = certificate::surface(&checked, 0, &[Precision::F64]);
//! assert!(of_drag.range.high < 65.1);
//!
//! let tape = lower::surface(&checked, 0, Precision::F64);
//! assert_eq!(Interpreter::<f64>::new(&tape).eval(&[10.0]), 25.0);
//!
//! let unit = compile::unit(&checked, &[Precision::F64])?;
//! assert!(emit::c::emit(&unit).header.contains("double car_drag(double speed);"));
//! # Ok(())
//! # }
//! ```

pub use rsm_core::check::Checked;
pub use rsm_core::model::Model;
pub use rsm_core::number::Precision;
pub use rsm_core::run::Interpreter;
pub use rsm_core::source::{Faults, Source};
pub use rsm_core::{certificate, compile, emit, lower};
pub use rsm_diagnose::{plant, surface};
pub use rsm_fit::fit::{Outcome, fit};
pub use rsm_fit::spec::Specification;
pub use rsm_sim::plant_file::PlantFile;
pub use rsm_sim::record::Record;
pub use rsm_sim::simulate::{Outputs, Simulator};

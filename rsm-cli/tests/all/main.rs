//! The tests of the command, one binary.

mod calls;
mod command;
mod compensator;
mod design;
mod diagnose;
mod diagnose_surface;
mod driveline;
mod fit_categories;
mod fit_loss;
mod fit_missing;
mod fit_partial;
mod guides;
mod import;
mod libhelics;
mod limits;
mod made_up_runs;
mod motor;
mod optimise;
mod plants_as_code;
mod readme;
mod reference;
mod shell;
mod shells;
#[path = "../../../tests/src/skipped.rs"]
mod skipped;
mod splines;
mod streams;
mod sweep;
mod track;
mod transforms;
mod tutorial;

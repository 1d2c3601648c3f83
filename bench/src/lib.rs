//! The cost of an evaluation, of a simulation and of a diagnosis.
//!
//! In: the six surfaces of the peers' benchmark and the evaluators in `generated/`. Out: nanoseconds (criterion, `benches/evaluators.rs`) and
//! instructions (callgrind, `tests/instructions.rs`), both beside hand-written nested Horner in C; `bench-table` prints them together. Counts are
//! exact and are kept in `instructions.txt`, so that a review shows a change. Times are valid for one machine on one day and are not kept.
//!
//! `simulation-table` contains rows per second of the simulated plants and the seconds of a diagnosis.
//!
//! Evaluators are compiled when a benchmark runs, from the text of the emitters, and run in separate processes: this package contains no foreign
//! call.

pub mod budget;
pub mod by_hand;
pub mod counted;
pub mod engines;
pub mod horner;
pub mod peers;
pub mod simulation;
pub mod surfaces;
pub mod timed;
pub mod toolchain;

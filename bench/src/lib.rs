//! What an evaluation costs, and what a simulation and a diagnosis do.
//!
//! In: the six surfaces of the peers' benchmark and the evaluators in `generated/`. Out: nanoseconds (criterion, `benches/evaluators.rs`) and
//! instructions (callgrind, `tests/instructions.rs`), both beside hand-written nested Horner in C; `bench-table` prints them together.
//! Counts are exact and kept in `instructions.txt`, so that a change shows in review; times are of one machine on one day and are kept nowhere.
//!
//! `simulation-table` has rows a second of the simulated plants and the seconds of a diagnosis.
//!
//! Evaluators are compiled when a benchmark runs, from the text that the emitters give, and run in processes of their own: there is no
//! foreign call in this package.

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

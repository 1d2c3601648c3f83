//! Both ways between hosts, over the clock and over a wire: a program of its own, so that nothing else is at work meanwhile.
//!
//! Short, unless RSM_FEDERATION_SECONDS says how long each run is: `cargo xtask federation` says 60. Figures are printed.
#![cfg(target_os = "linux")]

#[path = "../all/libhelics.rs"]
mod libhelics;
mod lockstep;
mod namespaces;
#[path = "../all/ports.rs"]
mod ports;
mod relay;
#[path = "../../../tests/src/skipped.rs"]
mod skipped;
mod streaming;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// One test at a time: two of them would be late by each other.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How long a run is, in s.
fn seconds() -> f64 {
    std::env::var("RSM_FEDERATION_SECONDS").map_or(2.0, |words| words.parse().expect("RSM_FEDERATION_SECONDS is a number"))
}

//! Both kinds of coupling between hosts, with a clock and over a network link. This is a separate program, so that no other test runs at the same
//! time.
//!
//! The runs are short, unless RSM_FEDERATION_SECONDS gives the length of each: `cargo xtask federation` uses 60. The figures are printed.
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

/// One test at a time: two tests would delay each other.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The length of a run in s.
fn seconds() -> f64 {
    std::env::var("RSM_FEDERATION_SECONDS").map_or(2.0, |words| words.parse().expect("RSM_FEDERATION_SECONDS is a number"))
}

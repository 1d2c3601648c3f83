//! Both kinds of coupling between hosts, with a clock and over a network link. This is a separate program, so that no other test runs at the same
//! time.
//!
//! The runs are short, unless RSM_FEDERATION_SECONDS gives the length of each: `cargo xtask federation` uses 60. The figures are printed.
#![cfg(target_os = "linux")]

#[path = "../all/libhelics.rs"]
mod libhelics;
mod lockstep;
mod namespaces;
#[path = "../slow/ports.rs"]
mod ports;
mod relay;
#[path = "../../../tests/src/skipped.rs"]
mod skipped;
mod streaming;

use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

static CORES: RwLock<()> = RwLock::new(());

/// No other test at the same time: lock-step runs as fast as the cores allow, and would delay a clock.
fn alone() -> RwLockWriteGuard<'static, ()> {
    CORES.write().unwrap_or_else(PoisonError::into_inner)
}

/// No lock-step at the same time. Runs with a clock wait for most of a tick, so several of them run together.
fn with_a_clock() -> RwLockReadGuard<'static, ()> {
    CORES.read().unwrap_or_else(PoisonError::into_inner)
}

/// The length of a run in s.
fn seconds() -> f64 {
    std::env::var("RSM_FEDERATION_SECONDS").map_or(2.0, |words| words.parse().expect("RSM_FEDERATION_SECONDS is a number"))
}

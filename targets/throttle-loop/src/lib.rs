//! The step of a drive-by-wire throttle that damps driveline shuffle, in f32.
//!
//! In, every millisecond: pedal, road speed, gear and clutch. Out: the throttle, 0 to 1. The compensator `tip_in` of the model `driveline` computes
//! it, (a s^2 + b s + c)/(a s^2 + d s + c) with coefficients from response surfaces of speed and gear. b cancels the lightly damped pole pair of the
//! driveline, d places a new one. The output is saturated. Where the compensator is not valid, the throttle fades to the pedal (see [`step`]).
//!
//! [`raw`] is the same step from A/D counts and gear lines to a PWM compare value. Neither allocates, panics, loops or branches. They need nothing
//! outside `core`, and `targets/firmware/throttle_step.c` gives the same bits.
//!
//! Single precision, on the host too. The two integrators of the compensator are exact at rest in any precision, and a test compares with double
//! precision over a drive.
//!
//! ```
//! use throttle_loop::{Inputs, State, step};
//!
//! let mut state = State::default();
//! let drive = |pedal| Inputs { pedal, speed_m_s: 10.0, gear: 2, clutch: false };
//! for _ in 0..3000 {
//!     step(&mut state, &drive(0.2));
//! }
//! assert!((step(&mut state, &drive(0.2)).throttle - 0.2).abs() < 1e-6);   // at rest it passes the pedal
//! let tip_in = step(&mut state, &drive(0.9)).throttle;
//! assert!(tip_in < 0.9 && tip_in > 0.2);                              // a step of the pedal is taken in gently
//! let torn = step(&mut state, &drive(f32::NAN)).throttle;
//! assert!(torn < 0.9 && torn > 0.2 && state.bad.all == 1);              // a torn wire: the last good pedal is held
//! ```
//!
//! [`wear`] lets the damping surface follow a car that wears. [`published`] is the damping surface of the paper, (32).
#![no_std]
// Denied, not forbidden: on a host the emitted evaluators clamp with SSE instructions, which are `unsafe` functions in Rust. There is no other unsafe
// code.
#![deny(unsafe_code)]

pub mod published;
pub mod raw;
mod step;
pub mod wear;

pub use branch_free::BadSamples;
pub use step::{
    CLOSE_PER_TICK, FADE_PER_TICK, GEAR_PER_TICK, GEARS, HOLD_TICKS, Inputs, Outputs, REOPEN_PER_TICK, State, step,
};

/// The evaluators and the compensator, made by build.rs from the coefficient file of the driveline.
pub mod driveline {
    include!(concat!(env!("OUT_DIR"), "/driveline.rs"));
}

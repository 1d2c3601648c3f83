//! The two steps of a permanent-magnet AC motor in flux weakening, in f32.
//!
//! - [`references`], at 1 kHz. In: torque demand, speed, bus voltage. Out: current references, from the response surfaces of the model `motor`.
//! - [`currents`], once a PWM period (10 kHz or more). In: references, phase currents, angle, speed, bus voltage. Out: duties of three legs.
//!
//! Neither allocates, panics, loops or branches. They need nothing outside `core`, and only + - * / and comparisons, so that
//! `targets/firmware/motor_step.c` gives the same bits. Every sample is checked: it must be plausible in range and in rate ([`Limits`]). A bad sample
//! (a broken wire, a stuck encoder, a false edge) is replaced by the predicted value, and counted. Ten bad samples in a row lead to a safe state: the
//! outer step sets the torque to 0, the inner one opens the bridge. Ten good ones end it.
//!
//! ```
//! use motor_loop::{CurrentState, Demand, Drive, Measured, Motor, ReferenceState, Tuning, currents, references};
//!
//! let motor = Motor {
//!     phase_resistance_ohm: 0.08,
//!     phase_inductance_h: 0.9e-3,
//!     flux_linkage_wb: 0.06,
//!     pole_pairs: 4.0,
//!     bus_voltage_v: 270.0,
//!     current_limit_a: 60.0,
//! };
//! let tuning = Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 0.0, dead_time_current_a: 1.0 };
//! let drive = Drive::new(&motor, &tuning);
//!
//! let mut inner = CurrentState::default();
//! let mut outer = ReferenceState::default();
//! let demand = Demand { torque_nm: 3.6, speed_rad_s: 0.0, bus_voltage_v: 270.0, voltage_share: inner.voltage_share };
//! let wanted = references(&mut outer, &drive, &demand);
//! assert_eq!((wanted.i_d_a, wanted.i_q_a), (0.0, 10.0));           // slow: no weakening; 3.6 N m over 0.36 N m/A
//!
//! let measured = Measured { currents_a: [0.0; 3], angle_turns: 0.0, speed_rad_s: 0.0, bus_voltage_v: 270.0 };
//! for _ in 0..9 {
//!     assert_eq!(currents(&mut inner, &drive, &wanted, &measured).closed, 0.0);  // the bridge is still open
//! }
//! for _ in 0..2 {
//!     currents(&mut inner, &drive, &wanted, &measured);
//! }
//! let command = currents(&mut inner, &drive, &wanted, &measured);
//! assert!(command.closed == 1.0 && command.duties[1] > 0.5 && command.duties[2] < 0.5);  // the q axis is a quarter turn before phase a
//! ```
//!
//! [`published`] is the surface of the paper, (26): the advance angle of another motor.
#![no_std]
// Denied, not forbidden: on a host the emitted evaluators clamp with SSE instructions, which are `unsafe` functions in Rust. There is no other unsafe
// code.
#![deny(unsafe_code)]

mod circle;
mod currents;
mod drive;
mod plausible;
pub mod published;
mod references;

pub use branch_free::BadSamples;
pub use circle::Direction;
pub use currents::{Command, CurrentState, Measured, currents};
pub use drive::{Drive, Limits, Motor, Tuning};
pub use plausible::Band;
pub use references::{
    Demand, FOLD_PER_RAD_S, FOLD_SPEED_RAD_S, LARGEST_TORQUE_NM, ReferenceState, References, SLOWEST_RAD_S, TRIM_FROM,
    references,
};

// Single precision: the FPU of the intended processors (Cortex-M4F) has no double precision.
// Also without clamps: the outer step limits the arguments to the ranges, and passes the current limit once.
rsm_macros::include_model!("../../generated/coefficients/motor.toml", precision = "f32", once = "current");

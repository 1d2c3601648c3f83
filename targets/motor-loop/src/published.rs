//! The published surface (26): current advance against torque and speed, as printed.
//!
//! In: torque in N m, 0 to 21.6, and speed in rad/s, 0 to 800, clamped outside. Out: the angle by which the current vector leads the q axis, in
//! degrees, 0 to 90. The loop does not use it: it is the surface of the paper's motor, whose parameters are not printed, and the ranges of its
//! variables are ours.
//!
//! ```
//! use motor_loop::{Direction, published::pmac};
//!
//! // The centre of the surface is its constant term. A current of 30 A at that angle:
//! let advance_deg = pmac::current_advance_f32(10.8, 400.0);
//! assert_eq!(advance_deg, 38.19);
//! let Direction { cos, sin } = Direction::of_turns(advance_deg / 360.0);
//! let (i_d_a, i_q_a) = (-30.0 * sin, 30.0 * cos);
//! assert!((i_d_a + 18.548).abs() < 1e-3 && (i_q_a - 23.579).abs() < 1e-3);
//! ```

rsm_macros::include_model!("../../generated/coefficients/pmac.toml", precision = "f32");

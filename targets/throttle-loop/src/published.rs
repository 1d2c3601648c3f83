//! The published damping surface (32), as printed.
//!
//! In: road speed in mph, 10 to 70, and gear, 1 to 5, clamped outside. Out: a damping ratio. It is negative on a quarter of its box, probably because
//! of a misprint (see the coefficient file): no compensator can be built on it there, and `rsm check` refuses one. The loop does not use it.
//!
//! ```
//! use throttle_loop::published::throttle;
//!
//! assert_eq!(throttle::damping_ratio(40.0, 3.0), 0.4079);       // the centre of the surface: its constant term
//! assert!(throttle::damping_ratio(70.0, 5.0) < 0.0);              // top speed in top gear
//! ```

/// The evaluator, made by build.rs from `generated/coefficients/throttle.toml`.
pub mod throttle {
    include!(concat!(env!("OUT_DIR"), "/throttle.rs"));
}

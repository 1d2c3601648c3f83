//! The simulated test rigs of the two cases, for experiments without a real machine.
//!
//! In: plant files and plans. Out: measured tables with noise from a seed, and figures of a drive or a car in closed loop.
//!
//! `motor` is a permanent-magnet drive in closed loop around the plant `pmac`, and `bench` is its dynamometer. `track` runs the plant `driveline`
//! through tip-ins, estimates damping and frequency, and tunes a compensator in rounds. Nothing here prints or writes.

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod motor;

pub mod bench;

pub mod track;

pub mod refit;

//! The simulated track: tip-in runs of the driveline, what is measured of them, and the car with its compensator.
//!
//! ```text
//!   plan --run--> Trace (1 kHz, with sensor noise) --measure--> Measured: mode of the driveline, response to the pedal
//!                   ^                                              |  rsm-fit
//!                   |                                              v
//!                compensator  <--rounds--  surfaces of damping ratio, damping error, shuffle frequency
//! ```
//!
//! In: a plant file of kind `driveline` and a plan. Out: traces, data for a fit, models with a compensator, figures. The same seed gives the
//! same bits, whatever the number of threads.

pub mod plan;

pub mod run;

pub mod response;

pub mod estimator;

pub mod measure;

pub mod experiment;

pub mod rounds;

pub mod figures;

pub mod gearbox;

//! One file a plant, and what a plant is for the integrator.
//!
//! In: parameters. Out: equations of PLANTS.md section 2, with hooks at fixed places. Never knows an effect.

pub mod driveline;
pub mod pmac;
pub mod servo_axis;

use crate::hooks::Hooks;
use crate::record::Record;

/// The equations of a plant.
pub trait Plant {
    /// How many states it has without effects.
    const STATES: usize;

    /// The states at the start from the true outputs of the first row.
    fn start(&self, hooks: &Hooks, outputs: &[f64; 3], record: &Record, inputs: &[f64; 3], x: &mut [f64]);

    /// Rates and true outputs. The answer names the pieces of the laws of joints that are at work.
    fn evaluate(&self, hooks: &Hooks, inputs: &[f64; 3], x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]) -> u32;

    /// The fastest rate of the plant at a state, in 1/s, its effects included.
    fn fastest_rate(&self, hooks: &Hooks, x: &[f64]) -> f64;

    /// The command of a controller that is part of the plant, from its measured output (this row and the two before).
    fn command(&self, _reference: f64, _x: &[f64], _positions: [f64; 3], _period: f64) -> f64 {
        0.0
    }
}

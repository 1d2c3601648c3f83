//! One file for each plant, and the interface between a plant and the integrator.
//!
//! In: parameters. Out: the equations of docs/book/src/reference/plants.md, section 2, with hooks at fixed places. No plant refers to a specific
//! effect.

pub mod driveline;
pub mod pmac;
pub mod servo_axis;

use crate::hooks::Hooks;
use crate::kind::StartValues;
use crate::record::Record;

/// The rates of a plant with its effects at a state, in 1/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// The fastest rate that is visible in the outputs. A strongly damped mode may be faster, if the classical Runge-Kutta method is stable for it.
    pub fastest: f64,
    /// The fastest rate of all modes, which a sudden change of a law excites.
    pub excited: f64,
    /// The fastest rate that remains after a linear part, computed at an earlier state, is subtracted.
    pub nonlinear: f64,
    /// The sum of the rates that depend on the state. If it has changed, a linear part must be computed again.
    pub varying: f64,
}

/// The equations of a plant.
pub trait Plant {
    /// The number of states without effects.
    const STATES: usize;

    /// Sets the states at the start, from the true outputs of the first row and from the start values that are not outputs.
    fn start(&self, hooks: &Hooks, outputs: &StartValues, record: &Record, inputs: &[f64; 3], x: &mut [f64]);

    /// Computes the derivatives of the states and the true outputs. Returns the pieces of the joint laws to which the state belongs. If `held` is
    /// given, the laws use the held pieces, also outside of their range.
    fn evaluate(
        &self,
        hooks: &Hooks,
        held: Option<u32>,
        inputs: &[f64; 3],
        x: &[f64],
        dx: &mut [f64],
        outputs: &mut [f64; 3],
    ) -> u32;

    /// The rates at a state with these derivatives, valid for the following span (s).
    fn rates(&self, hooks: &Hooks, x: &[f64], dx: &[f64], span: f64) -> Rates;

    /// The command of a controller that is part of the plant, from its measured output (this row and the two previous rows).
    fn command(&self, _reference: f64, _x: &[f64], _positions: [f64; 3], _period: f64) -> f64 {
        0.0
    }
}

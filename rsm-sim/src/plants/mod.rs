//! One file a plant, and what a plant is for the integrator.
//!
//! In: parameters. Out: equations of docs/book/src/reference/plants.md section 2, with hooks at fixed places. Never knows an effect.

pub mod driveline;
pub mod pmac;
pub mod servo_axis;

use crate::hooks::Hooks;
use crate::kind::StartValues;
use crate::record::Record;

/// How fast a plant with its effects moves at a state, in 1/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// The fastest of what is seen: a mode that a damper kills at once may move faster, as long as the classical method is stable on it.
    pub fastest: f64,
    /// The fastest of all, which a sudden change of law excites.
    pub struck: f64,
    /// The fastest of what a linear part, taken at a state before, leaves.
    pub nonlinear: f64,
    /// The sum of what varies from state to state: when it has moved, a linear part is stale.
    pub varying: f64,
}

/// The equations of a plant.
pub trait Plant {
    /// How many states it has without effects.
    const STATES: usize;

    /// The states at the start from the true outputs of the first row, and what no output shows.
    fn start(&self, hooks: &Hooks, outputs: &StartValues, record: &Record, inputs: &[f64; 3], x: &mut [f64]);

    /// Rates and true outputs. The answer names the pieces of the laws of joints to which the state belongs. Where pieces are held, the laws follow those
    /// all the same.
    fn evaluate(
        &self,
        hooks: &Hooks,
        held: Option<u32>,
        inputs: &[f64; 3],
        x: &[f64],
        dx: &mut [f64],
        outputs: &mut [f64; 3],
    ) -> u32;

    /// How fast it moves at a state with these rates of its states, and during the span (s) that follows.
    fn rates(&self, hooks: &Hooks, x: &[f64], dx: &[f64], span: f64) -> Rates;

    /// The command of a controller that is part of the plant, from its measured output (this row and the two before).
    fn command(&self, _reference: f64, _x: &[f64], _positions: [f64; 3], _period: f64) -> f64 {
        0.0
    }
}

//! Runs a plant of equations with steps of constant length.
//!
//! In: a machine at its start, inputs at every row, the step length. Out: outputs at every row. Row r contains the outputs after r N steps, where N
//! steps are the mean time between two rows. The plant has its own clock, which small errors of a record's instants do not affect.

use rsm_core::run::Interpreter;

use super::machine::{Machine, Point};
use super::rows::{Inputs, Stopped};
use super::step::{Kept, Step};

/// The largest number of steps from one row to the next.
const MOST_STEPS: f64 = 1e6;

/// The number of steps in a period, if it is an integer.
#[must_use]
pub fn steps(length: f64, period: f64) -> Option<usize> {
    let steps = (period / length).round();
    // Instants of a record are decimals. If the difference is larger than this, the period is not a multiple of the step.
    let fits = length > 0.0 && (1.0..=MOST_STEPS).contains(&steps) && (period / length - steps).abs() < 1e-6 * steps;
    fits.then_some(steps as usize)
}

pub(super) fn run(machine: &Machine, start: &Point, inputs: Inputs<'_>, length: f64) -> Result<Vec<Vec<f64>>, Stopped> {
    let rows = inputs.time.len();
    let period = if rows < 2 { length } else { (inputs.time[rows - 1] - inputs.time[0]) / (rows - 1) as f64 };
    let Some(count) = steps(length, period) else {
        let what = format!(
            "found a step of {length} s, expected the period of the record, {period} s, or this period divided by a whole number"
        );
        return Err(Stopped::Step(what));
    };
    let step = Step::new(machine, length).map_err(Stopped::Step)?;
    let mut interpreter = Interpreter::<f64>::new(&step.tape);
    interpreter.set_states(&step.start(machine, start));
    let (names, states) = (machine.outputs(), machine.states());
    let mut outputs = vec![Vec::with_capacity(rows); names.len()];
    for row in 0..rows {
        let arguments = inputs.at(row);
        for k in 0..count {
            interpreter.step(&arguments);
            if k == 0 {
                for ((list, value), (name, _)) in outputs.iter_mut().zip(interpreter.results()).zip(&names) {
                    if !value.is_finite() {
                        return Err(Stopped::NotFinite { row, name: name.clone() });
                    }
                    list.push(value);
                }
            }
            if row + 1 == rows {
                break;
            }
        }
        for (kept, value) in step.kept.iter().zip(interpreter.states()) {
            if let Kept::State(k) = kept
                && !value.is_finite()
            {
                return Err(Stopped::NotFinite { row, name: states[*k].0.clone() });
            }
        }
    }
    Ok(outputs)
}

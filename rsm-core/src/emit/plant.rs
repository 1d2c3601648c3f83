//! A plant as code: one step of constant length, its state and its start.
//!
//! In: a tape whose arguments are the inputs, whose results are the outputs, and whose states are those of the plant. Out: a header and a source file
//! in C, or one module in Rust, with a type for the state, a type for the outputs, `init` and `step`. No decision about arithmetic is made here.

use super::plain;
use crate::number::decimal;
use crate::run::Interpreter;
use crate::tape::Tape;

/// The data of a plant to emit.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// The prefix of every C name; the module name in Rust.
    pub model: String,
    /// The description in its text, and the file it was read from.
    pub about: String,
    /// The length of the step in s.
    pub length: f64,
    /// The step, in f64. The names of inputs, outputs and states are valid in both languages.
    pub tape: Tape,
    /// The inputs, in order.
    pub inputs: Vec<Signal>,
    /// The outputs, in order.
    pub outputs: Vec<Signal>,
    /// The states, in order, with their start values.
    pub states: Vec<(Signal, f64)>,
    /// The numbers folded into the step: name, value and unit.
    pub parameters: Vec<(String, f64, String)>,
    /// The conditions of the start, in words.
    pub start: String,
}

/// Information about a number for readers of emitted code.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signal {
    /// Its unit as written in the text; empty if it has none.
    pub unit: String,
    /// Its description.
    pub words: String,
    /// For an input: the range of its values in a self-test.
    pub range: [f64; 2],
}

impl Signal {
    /// Unit and description, as in a comment.
    pub(super) fn comment(&self) -> String {
        let parts: Vec<String> =
            [&self.unit, &self.words].into_iter().filter(|it| !it.is_empty()).map(|it| plain(it)).collect();
        parts.join(", ")
    }
}

impl Plant {
    /// The names of the functions: in C with the prefix of the model.
    #[must_use]
    pub fn functions(&self, in_c: bool) -> Vec<String> {
        let prefix = if in_c { format!("{}_", self.model) } else { String::new() };
        ["init", "step"].map(|name| format!("{prefix}{name}")).to_vec()
    }

    /// The names of the states.
    pub(super) fn fields(&self) -> Vec<String> {
        self.tape.states.iter().map(|it| it.name.clone()).collect()
    }

    /// Rules for the caller of the step, one per line.
    pub(super) fn rules(&self) -> Vec<String> {
        let mut lines = vec![
            format!("One step of {} s.", decimal(self.length)),
            String::new(),
            "The inputs are constant during the step. First, the events at its beginning are executed (`when`, `sample`). Then the".to_string(),
            "outputs of this instant are computed. Then the classical Runge-Kutta method integrates the state over the step. At each".to_string(),
            "of its four stages the comparisons are evaluated again. The results have the bits of `rsm simulate --fixed-step`.".to_string(),
            String::new(),
        ];
        if !self.tape.inputs.is_empty() {
            lines.push("If an input is NaN or infinite, the state does not change, except for clocks; the outputs of that call are not valid.".to_string());
        }
        lines.push("If a state is no longer finite, the plant has diverged; only `init` makes it finite again.".to_string());
        lines.push(format!("{} operations, {} deep, no branch.", self.tape.operation_count(), self.tape.depth()));
        lines
    }

    /// The parameters, one per line.
    pub(super) fn numbers(&self) -> Vec<String> {
        let each = |(name, value, unit): &(String, f64, String)| {
            let unit = if unit.is_empty() || unit == "1" { String::new() } else { format!(" {}", plain(unit)) };
            format!("- {}: {}{unit}", plain(name), decimal(*value))
        };
        self.parameters.iter().map(each).collect()
    }

    /// Steps from the start: for each the bits of inputs and outputs; then the bits of the states after the last one.
    pub(super) fn sequence(&self) -> (Vec<Vec<u64>>, Vec<u64>) {
        let mut interpreter = Interpreter::<f64>::new(&self.tape);
        let start: Vec<f64> = self.states.iter().map(|it| it.1).collect();
        interpreter.set_states(&start);
        let mut random = super::points::SplitMix(0x5eed);
        let steps: Vec<Vec<u64>> = (0..SELF_TEST_STEPS)
            .map(|k| {
                let mut inputs: Vec<f64> = self
                    .inputs
                    .iter()
                    .map(|it| {
                        let share = random.next_share();
                        it.range[0] * (1.0 - share) + it.range[1] * share
                    })
                    .collect();
                // An invalid sample in between.
                if k == SELF_TEST_STEPS / 2
                    && let Some(first) = inputs.first_mut()
                {
                    *first = f64::NAN;
                }
                interpreter.step(&inputs);
                let outputs: Vec<f64> = interpreter.results().take(self.outputs.len()).collect();
                inputs.iter().chain(&outputs).map(|it| it.to_bits()).collect()
            })
            .collect();
        (steps, interpreter.states().iter().map(|it| it.to_bits()).collect())
    }
}

/// The number of steps of a self-test.
pub(super) const SELF_TEST_STEPS: usize = 24;

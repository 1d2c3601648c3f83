//! The numbers of a plant: its parameters, and the values that depend on them and are known before a run.
//!
//! In: parameters by name. Out: [`Numbers`]: their values, the instants of each `sample`, the delays of signals. A change of a parameter compiles
//! nothing. This file never uses a state.

use rsm_core::source::{Fault, Faults};
use rsm_model::expression::{Id, Symbol};
use rsm_model::flat::{Basic, Role};
use rsm_model::system::System;

use super::computed::{Computed, Functions};
use super::file::EquationFile;

/// The signal that a delayed input follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum DelaySource {
    /// Another input, by its index.
    Input(usize),
    /// A memory, by its index.
    Memory(usize),
}

/// An input that follows a signal with a delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DelayedInput {
    /// Its index among all inputs.
    pub input: usize,
    pub of: DelaySource,
    /// Its delay in s.
    pub delay: f64,
}

/// The numbers of one run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Numbers {
    /// The values of the parameters, in the order of the system.
    pub parameters: Vec<f64>,
    /// The first instant and the period of each `sample`, in s.
    pub samples: Vec<(f64, f64)>,
    /// Inputs that follow other signals; they come after the inputs of a record.
    pub delayed_inputs: Vec<DelayedInput>,
    /// Outputs that are read with a delay: the index and the delay in s.
    pub late_readings: Vec<(usize, f64)>,
}

impl Numbers {
    /// Whether any input or reading is delayed.
    pub(super) fn has_delayed_signals(&self) -> bool {
        !self.delayed_inputs.is_empty() || !self.late_readings.is_empty()
    }
}

/// The values that depend on parameters, as a program.
#[derive(Debug, Clone)]
pub(super) struct DerivedNumbers {
    /// The start and the period of each `sample`, then the delay of each delayed input, then the delay of each delayed reading.
    pub(super) program: Computed,
    samples: usize,
    delayed_inputs: Vec<(usize, DelaySource)>,
    /// For each delayed reading: the index of the output.
    late: Vec<usize>,
}

impl DerivedNumbers {
    pub(super) fn new(file: &EquationFile, system: &System, functions: &Functions) -> Result<DerivedNumbers, Faults> {
        let mut list: Vec<Id> = system.flat().samples.iter().flat_map(|it| [it.start, it.period]).collect();
        let inputs = system.inputs();
        let input = |symbol: Symbol| inputs.iter().position(|it| *it == symbol);
        let mut delayed_inputs = Vec::new();
        for delay in &file.delays {
            let memory = system.memories().iter().position(|it| it.variable == delay.of);
            let followed = input(delay.of).map(DelaySource::Input).or(memory.map(DelaySource::Memory));
            if let Some(found) = input(delay.late).zip(followed) {
                delayed_inputs.push(found);
                list.push(delay.delay);
            }
        }
        let outputs = system.outputs();
        let mut late = Vec::new();
        for reading in &file.late_readings {
            if let Some(place) = outputs.iter().position(|it| *it == reading.output) {
                late.push(place);
                list.push(reading.delay);
            }
        }
        let program = functions.compiled(file, system, &system.parameters(), &list)?;
        Ok(DerivedNumbers { program, samples: system.flat().samples.len(), delayed_inputs, late })
    }

    /// Computes the numbers from the parameters.
    ///
    /// # Errors
    /// A sentence: the period of a `sample` is not positive.
    pub(super) fn numbers(&self, parameters: Vec<f64>) -> Result<Numbers, String> {
        let found = self.program.values(&parameters);
        let (samples, delays) = found.split_at(2 * self.samples);
        let samples: Vec<(f64, f64)> = samples.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
        if let Some((_, period)) = samples.iter().find(|(_, period)| *period <= 0.0 || !period.is_finite()) {
            return Err(format!("`sample`: found a period of {period} s, expected a positive one"));
        }
        let (follow, read) = delays.split_at(self.delayed_inputs.len());
        let delayed_inputs = self.delayed_inputs.iter().zip(follow).map(|((input, of), delay)| DelayedInput {
            input: *input,
            of: *of,
            delay: *delay,
        });
        let mut late_readings: Vec<(usize, f64)> = Vec::new();
        for (output, delay) in self.late.iter().zip(read) {
            match late_readings.iter_mut().find(|it| it.0 == *output) {
                Some(known) => known.1 += delay,
                None => late_readings.push((*output, *delay)),
            }
        }
        late_readings.retain(|it| it.1 > 0.0);
        Ok(Numbers { delayed_inputs: delayed_inputs.collect(), samples, late_readings, parameters })
    }
}

impl EquationFile {
    /// The parameter that holds a number of an effect, with the name for `Machine::set`. `effect` is the index among the effects of the file; effects
    /// of `with_effects` come after them. `None` if the file uses the default of the number, which is not a parameter.
    #[must_use]
    pub fn parameter_of(&self, effect: usize, number: &str) -> Option<&str> {
        let (_, symbol) = self.placed.get(effect)?.1.iter().find(|it| it.0 == number)?;
        Some(self.system.name(*symbol))
    }
}

/// The index of a parameter among those that can be set, or the reason why it cannot have this value.
pub(super) fn place_of(system: &System, name: &str, value: f64) -> Result<usize, Faults> {
    let list = system.parameters();
    let fault = |what: String, help: String| Faults::one(Fault::whole_file(&system.flat().name, what).help(help));
    let Some(symbol) = system.find(name).filter(|it| system.flat().variable(*it).role == Role::Parameter) else {
        let names: Vec<String> = list.iter().map(|it| format!("`{}`", system.name(*it))).collect();
        return Err(fault(format!("no parameter is called `{name}`"), format!("the parameters are {}", names.join(", "))));
    };
    let variable = system.flat().variable(symbol);
    let Some(place) = list.iter().position(|it| *it == symbol) else {
        let why =
            if variable.is_structural { "changes the structure of the equations" } else { "is computed from other parameters" };
        let help = "set it under [parameters] of the plant file, and read the plant file again";
        return Err(fault(format!("`{name}` {why}: it cannot be set in a machine"), help.to_string()));
    };
    let fits = match variable.basic {
        Basic::Real => value.is_finite(),
        Basic::Integer => value.is_finite() && value.fract() == 0.0,
        Basic::Boolean => value == 0.0 || value == 1.0,
    };
    if !fits {
        let kind = match variable.basic {
            Basic::Real => "a finite number",
            Basic::Integer => "a whole number",
            Basic::Boolean => "0 or 1",
        };
        return Err(fault(
            format!("`{name}`: found {value}, expected {kind}"),
            "the value is in the unit of the text".to_string(),
        ));
    }
    Ok(place)
}

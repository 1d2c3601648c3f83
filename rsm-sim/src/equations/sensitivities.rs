//! Derivatives of the outputs of a plant with respect to its parameters and its start.
//!
//! In: a machine, the parameters and start values to differentiate by, the inputs of a record. Out: for each direction, the derivative of each output
//! at every row. Derivatives are exact: tangents of the tapes, not finite differences. Delayed signals are refused, because they have no derivative
//! here.

use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_core::tangent;

use super::carried::Along;
use super::computed::Computed;
use super::engine::{Method, Setting};
use super::lanes::{Block, Lanes, Outputs, allocate_outputs, period};
use super::late::DelayedSignals;
use super::machine::{MOST_ITERATIONS, Machine};
use super::numbers;
use super::part::MOST_STATES;
use super::rows::{Inputs, Stopped};
use super::speeds::Direction;
use super::starts::Starts;
use super::walk::{Lane, Walk};

/// A quantity to differentiate by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum By {
    /// A parameter, by name. Parts of the start that depend on it change with it.
    Parameter(String),
    /// A value of the start, by its index in the values of [`Starts::at`].
    Start(usize),
}

/// A run with its directions.
#[derive(Debug, Clone)]
pub struct Sensitive {
    lane: Lane,
    directions: Vec<Direction>,
}

/// Outputs along a record, and their derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivities {
    /// For each output, in the order of the text: the value at every row, in its unit. The bits are those of [`Lanes::run`] with
    /// the same setting.
    pub outputs: Outputs,
    /// For each direction, for each output: the derivative at every row, in the unit of the output over the unit of the direction.
    pub derivatives: Vec<Outputs>,
}

/// The directional derivatives of the results of a program.
fn moved(computed: &Computed, arguments: &[f64], speeds: &[f64]) -> Vec<f64> {
    let Some(tape) = &computed.tape else { return Vec::new() };
    let ports: Vec<usize> = (0..speeds.len()).filter(|port| speeds[*port] != 0.0).collect();
    let mut found = vec![0.0; tape.outputs.len()];
    if !ports.is_empty() {
        let all: Vec<f64> = arguments.iter().copied().chain(ports.iter().map(|port| speeds[*port])).collect();
        Interpreter::<f64>::new(&tangent::along(tape, &ports)).eval_all(&all, &mut found);
    }
    found
}

impl Sensitive {
    /// A run of a machine from its start, with its directions. The arguments of the start are those of [`Starts::at`].
    ///
    /// # Errors
    /// Those of [`Starts::at`]; a parameter that the machine does not have; a parameter that changes the instants of a `sample` or a delay; delayed
    /// signals.
    ///
    /// # Panics
    /// If [`Starts::at`] panics.
    pub fn new(
        machine: &Machine,
        starts: &Starts,
        time: f64,
        inputs: &[f64],
        values: &[f64],
        by: &[By],
    ) -> Result<Sensitive, Faults> {
        let refuse = |what: String| Err(Faults::one(Fault::whole_file(&machine.system().flat().name, what)));
        if !machine.delayed_inputs().is_empty() || !machine.late_readings().is_empty() {
            return refuse("a signal comes late: a delay has no derivative here".to_string());
        }
        let (start, guesses) = starts.solved(machine, time, inputs, values)?;
        let parameters = machine.values_of_parameters();
        let mut directions = Vec::with_capacity(by.len());
        for by in by {
            let mut speeds = vec![0.0; parameters.len()];
            let mut known = vec![0.0; values.len()];
            let mut parameter = None;
            match by {
                By::Parameter(name) => {
                    let of = machine.parameters().iter().find(|it| it.0 == *name).map_or(f64::NAN, |it| it.2);
                    let place = numbers::place_of(machine.system(), name, of)?;
                    speeds[place] = 1.0;
                    if moved(machine.derived_numbers(), parameters, &speeds).iter().any(|it| *it != 0.0) {
                        return refuse(format!(
                            "`{name}` moves the instants of a `sample` or a delay: it has no derivative here"
                        ));
                    }
                    parameter = Some(place);
                }
                By::Start(place) => known[*place] = 1.0,
            }
            let (states, memories) = starts.moved(machine, &start, (&guesses, values), (&speeds, &known));
            directions.push(Direction { parameter, states, memories });
        }
        Ok(Sensitive { lane: Lane::new(machine, start), directions })
    }
}

impl Starts {
    /// The derivatives of states and memories of a start with respect to parameters and known values.
    fn moved(
        &self,
        machine: &Machine,
        start: &super::machine::Point,
        (guesses, values): (&[f64], &[f64]),
        (parameters, known): (&[f64], &[f64]),
    ) -> (Vec<f64>, Vec<f64>) {
        let begins = moved(&self.first, machine.values_of_parameters(), parameters);
        let (mut states, mut memories) = (vec![0.0; start.states.len()], vec![0.0; start.memories.len()]);
        self.memories.iter().zip(&begins).for_each(|(k, value)| memories[*k] = *value);
        let arguments = self.arguments(machine, start, guesses, values);
        let before = self.before.len();
        let fixed = arguments.len() - values.len() - guesses.len() - before - start.held.len() - parameters.len();
        // The iterated values satisfy their own equations, so one more iteration of Newton's method from the solution gives the exact derivative.
        for _ in 0..MOST_ITERATIONS {
            let mut speeds = vec![0.0; fixed];
            speeds.extend_from_slice(parameters);
            speeds.resize(speeds.len() + start.held.len(), 0.0);
            speeds.extend(self.before.iter().map(|k| memories[*k]));
            speeds.resize(speeds.len() + guesses.len(), 0.0);
            speeds.extend_from_slice(known);
            let found = moved(&self.program, &arguments, &speeds);
            let last = (states.clone(), memories.clone());
            for ((state, memory), value) in self.places.iter().zip(found.iter().skip(self.iterated)) {
                state.iter().for_each(|k| states[*k] = *value);
                memory.iter().for_each(|k| memories[*k] = *value);
            }
            if last == (states.clone(), memories.clone()) {
                break;
            }
        }
        (states, memories)
    }
}

impl<'m> Lanes<'m> {
    /// Runs along inputs as [`Lanes::run`], and computes the derivatives along with it. They are the exact derivatives of the computed outputs: every
    /// step is differentiated as it is, also the matrices of steps by a linear part. Held constant are the lengths of the steps, and the instants at
    /// which linear parts are computed. Where a step of the series is too long for a derivative, because the states rest and the derivative does not,
    /// the derivative has shorter steps along the same solution; its error is then at most the tolerance, or 1e-4 of its size. A plant with more than
    /// 24 states has no steps by a linear part: it is run with [`Method::Explicit`] in place of [`Method::Automatic`], which needs many short steps
    /// if it is stiff.
    ///
    /// Where a comparison changes, the instant depends on the parameters, and the derivative has a jump. If two comparisons change at one instant for
    /// two different reasons, there is no derivative, and the first comparison is used. A comparison inside of `noEvent` is not located: the
    /// derivative is that of the selected side.
    ///
    /// ```
    /// use rsm_core::source::{Faults, Source};
    /// use rsm_sim::equations::{By, EquationFile, Inputs, Lanes, Machine, Sensitive, Setting};
    ///
    /// let text = "model Decay\n  parameter Real rate = 0.5;\n  output Real x(start = 2.0, fixed = true);\nequation\n  der(x) = -rate*x;\nend Decay;\n";
    /// let file = EquationFile::of_text(&Source::new("decay.mo", text))?;
    /// let mut machine = Machine::new(&file)?;
    /// let starts = machine.starts(&file, &[], &[])?;
    /// let run = Sensitive::new(&machine, &starts, 0.0, &[], &[], &[By::Parameter("rate".to_string())])?;
    /// let inputs = Inputs { time: &[0.0, 1.0, 2.0], values: &[] };
    /// let found = Lanes::new(&machine).sensitivities(&run, inputs, Setting { tolerance: 1e-14, ..Setting::default() }).unwrap();
    /// let exact = -2.0 * 2.0 * (-0.5_f64 * 2.0).exp(); // d/d rate of 2 exp(-rate t) at t = 2
    /// assert!((found.derivatives[0][0][2] - exact).abs() < 1e-13);
    /// # Ok::<(), Faults>(())
    /// ```
    ///
    /// # Errors
    /// The reason why the run ended early; a point without a derivative; fixed steps; the stiff method with more than 24 states.
    ///
    /// # Panics
    /// If an input has fewer rows than the time.
    pub fn sensitivities(&mut self, of: &Sensitive, inputs: Inputs<'_>, setting: Setting) -> Result<Sensitivities, Stopped> {
        let parameters: Vec<Option<usize>> = of.directions.iter().map(|it| it.parameter).collect();
        let (machine, way) = (self.machine, self.way);
        let kept = self.sensitive.take().filter(|it| it.parameters == parameters);
        let mut kept = kept.unwrap_or_else(|| Along { parameters, walk: Walk::new(machine, way), carried: None });
        let walk = &mut kept.walk;
        let method = match setting.method {
            Method::Explicit => Method::Explicit,
            Method::Automatic | Method::Stiff if walk.has_exponential() => setting.method,
            Method::Automatic => Method::Explicit,
            Method::Stiff | Method::Fixed { .. } => {
                return Err(Stopped::Step(format!(
                    "sensitivities need the series, or steps by a linear part of 1 to {MOST_STATES} states: take the method `explicit`"
                )));
            }
        };
        let setting = Setting { method, ..setting };
        walk.begin(std::slice::from_ref(&of.lane), setting, period(inputs));
        walk.carry(&of.directions, kept.carried.take(), way);
        let done = along(walk, of, inputs);
        kept.carried = kept.walk.carried.take();
        self.sensitive = Some(kept);
        done
    }
}

fn along(walk: &mut Walk<'_, 1>, of: &Sensitive, inputs: Inputs<'_>) -> Result<Sensitivities, Stopped> {
    let mut late = DelayedSignals::new(&of.lane.numbers, inputs.time, period(inputs));
    let mut outputs = [allocate_outputs(walk.machine, inputs)];
    let mut block = Block::new(walk.machine.outputs().len());
    let is_quiet = walk.is_quiet();
    let mut derivatives: Vec<Outputs> = of.directions.iter().map(|_| allocate_outputs(walk.machine, inputs)).collect();
    for (row, end) in inputs.time.iter().enumerate() {
        walk.row = row;
        if row > 0 {
            walk.reach_row(inputs.time[row - 1], *end, &mut late)?;
        }
        walk.set_inputs(inputs.values, row);
        if !is_quiet {
            walk.execute_events(*end)?;
        }
        block.read(walk, &mut outputs)?;
        walk.carry_outputs(&mut derivatives);
    }
    walk.finish_outputs(&mut derivatives);
    block.write(&mut outputs);
    let [outputs] = outputs;
    Ok(Sensitivities { outputs, derivatives })
}

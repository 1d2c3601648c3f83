//! How fast the outputs of a plant move with its parameters and its start.
//!
//! In: a machine, what moves, the inputs of a record. Out: by direction, the derivative of each output at every row. Exact: tangents of the tapes, no differences. What comes late (a delay) has no derivative here, and is refused.

use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_core::tangent;

use super::carried::Along;
use super::computed::Computed;
use super::engine::{Method, Setting};
use super::lanes::{Lanes, Outputs, period, room};
use super::late::Late;
use super::machine::{Machine, TURNS};
use super::numbers;
use super::rows::{Inputs, Stopped};
use super::series::Tried;
use super::speeds::Moving;
use super::starts::Starts;
use super::walk::{Lane, Walk};

/// What moves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum By {
    /// A parameter, by name: the start moves with it where it follows from it.
    Parameter(String),
    /// A value of the start: its place among those that [`Starts::at`] is given.
    Start(usize),
}

/// A run with what moves in it.
#[derive(Debug, Clone)]
pub struct Sensitive {
    lane: Lane,
    directions: Vec<Moving>,
}

/// Outputs along a record, and how fast they move.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivities {
    /// By output in the order of the text: the value at every row, in its unit. The bits are those of [`Lanes::run`] with [`Method::Explicit`].
    pub outputs: Outputs,
    /// By direction, by output: the derivative at every row, in the unit of the output over that of what moves.
    pub derivatives: Vec<Outputs>,
}

/// How fast the results of a program move, when some of its arguments do.
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
    /// A run of a machine from its start, of which [`Starts::at`] tells what the arguments are, and what moves in it.
    ///
    /// # Errors
    /// Those of [`Starts::at`]; a parameter that the machine does not have; a parameter that moves the instants of a `sample` or a delay; signals that come late.
    ///
    /// # Panics
    /// When [`Starts::at`] would.
    pub fn new(
        machine: &Machine,
        starts: &Starts,
        time: f64,
        inputs: &[f64],
        values: &[f64],
        by: &[By],
    ) -> Result<Sensitive, Faults> {
        let refuse = |what: String| Err(Faults::one(Fault::whole_file(&machine.system().flat().name, what)));
        if !machine.followers().is_empty() || !machine.late_readings().is_empty() {
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
                    if moved(machine.following(), parameters, &speeds).iter().any(|it| *it != 0.0) {
                        return refuse(format!(
                            "`{name}` moves the instants of a `sample` or a delay: it has no derivative here"
                        ));
                    }
                    parameter = Some(place);
                }
                By::Start(place) => known[*place] = 1.0,
            }
            let (states, memories) = starts.moved(machine, &start, (&guesses, values), (&speeds, &known));
            directions.push(Moving { parameter, states, memories });
        }
        Ok(Sensitive { lane: Lane::new(machine, start), directions })
    }
}

impl Starts {
    /// How fast states and memories of a start move when parameters and what is known do.
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
        // What is iterated stands still in its own equation: one more turn of Newton's method from the solution has its derivative.
        for _ in 0..TURNS {
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
    /// Runs along inputs with the series of the solution, and carries the derivatives in lanes beside it. A stiff plant takes many short steps; use [`Lanes::run`] and differences there.
    ///
    /// Where a comparison changes, the instant moves with the parameters, and the derivative jumps as it must. Two comparisons that change at one instant for two reasons have no derivative; the first counts. A comparison inside of
    /// `noEvent` is not located: the derivative is that of the side that was taken.
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
    /// Why the run ended early; a place at which there is no derivative; fixed steps, or the stiff method.
    ///
    /// # Panics
    /// When an input has fewer rows than the time.
    pub fn sensitivities(&mut self, of: &Sensitive, inputs: Inputs<'_>, setting: Setting) -> Result<Sensitivities, Stopped> {
        if !matches!(setting.method, Method::Automatic | Method::Explicit) {
            return Err(Stopped::Step(
                "sensitivities are carried along the series alone: take the method `explicit`".to_string(),
            ));
        }
        let setting = Setting { method: Method::Explicit, ..setting };
        let parameters: Vec<Option<usize>> = of.directions.iter().map(|it| it.parameter).collect();
        let (machine, way) = (self.machine, self.way);
        let kept = self.sensitive.take().filter(|it| it.parameters == parameters);
        let mut kept = kept.unwrap_or_else(|| Along { parameters, walk: Walk::new(machine, way), carried: None });
        let walk = &mut kept.walk;
        walk.begin([&of.lane], setting, period(inputs));
        walk.carry(&of.directions, kept.carried.take(), way);
        let done = along(walk, of, inputs);
        kept.carried = kept.walk.carried.take();
        self.sensitive = Some(kept);
        done
    }
}

fn along(walk: &mut Walk<'_, 1>, of: &Sensitive, inputs: Inputs<'_>) -> Result<Sensitivities, Stopped> {
    let mut late = Late::new(&of.lane.numbers, inputs.time, period(inputs));
    let mut outputs = [room(walk.machine, inputs)];
    let mut derivatives: Vec<Outputs> = of.directions.iter().map(|_| room(walk.machine, inputs)).collect();
    let can_be_plain = walk.can_be_plain();
    for (row, end) in inputs.time.iter().enumerate() {
        walk.row = row;
        let before = inputs.time[row.max(1) - 1];
        if row > 0 {
            let is_plain = can_be_plain && walk.is_free(before, *end);
            walk.remember();
            if is_plain && walk.plain(before, *end) {
                let order = walk.programs.first_part().map_or(0, |it| it.1);
                walk.carry_step(Tried { order, share: 1.0 }, 1.0, before);
            } else {
                walk.reach(*end, &mut late)?;
            }
        }
        walk.set_inputs(inputs.values, row);
        walk.happen(*end)?;
        super::lanes::read(walk, row, &mut outputs)?;
        walk.carry_look(&mut derivatives);
    }
    let [outputs] = outputs;
    Ok(Sensitivities { outputs, derivatives })
}

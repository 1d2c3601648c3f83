//! A system of equations with the values of its parameters, ready to be evaluated: rates, outputs, switches, events.
//!
//! In: an [`EquationFile`]. Out: [`Machine`], which computes everything at a [`Point`]. It never advances the time.

use rsm_core::number::Precision;
use rsm_core::source::{Fault, Faults};
use rsm_core::tape::{Tape, TapeBuilder};
use rsm_model::expression::{Id, Node, Symbol};
use rsm_model::system::{Start, System};

use super::computed::{Computed, Functions};
use super::file::{EquationFile, NamedValue};
use super::numbers::{self, DelaySource, DelayedInput, DerivedNumbers, Numbers};

/// Everything that changes during a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// The time in s.
    pub time: f64,
    /// The states, in the order of the text.
    pub states: Vec<f64>,
    /// The inputs, in the order of the text.
    pub inputs: Vec<f64>,
    /// The value of each comparison since the last event: 1 or 0.
    pub(super) held: Vec<f64>,
    /// The memories: values that change only at events.
    pub(super) memories: Vec<f64>,
    /// The last solution of nonlinear blocks.
    pub(super) guesses: Vec<f64>,
}

/// Results at a point besides the rates.
#[derive(Debug, Clone)]
pub(super) struct OutputsAndSolutions {
    pub outputs: Vec<f64>,
    /// Solutions of nonlinear blocks, started from the guesses of the point.
    pub solutions: Vec<f64>,
}

/// The number of arguments or results in each group.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    /// 1 if the system uses the time, else 0.
    pub time: usize,
    pub states: usize,
    pub inputs: usize,
    pub parameters: usize,
    pub held: usize,
    pub memories: usize,
    pub guesses: usize,
    pub acts: usize,
    pub due: usize,
    pub outputs: usize,
}

/// The tapes of a machine, from which code is generated.
pub(super) struct Tapes {
    pub counts: Counts,
    pub rates: Tape,
    /// Both sides of each switch.
    pub sides: Option<Tape>,
    /// Outputs, then solutions of nonlinear blocks.
    pub output_program: Option<Tape>,
    pub events: Option<Tape>,
    /// The derivative of each rate with respect to each state, row by row, then with respect to the time.
    pub slopes: Option<Tape>,
}

/// A system of equations with the values of its parameters.
#[derive(Debug, Clone)]
pub struct Machine {
    system: System,
    numbers: Numbers,
    derived_numbers: DerivedNumbers,
    functions: Functions,
    /// Rates, then both sides of each switch.
    rates: Computed,
    /// Outputs, then solutions of nonlinear blocks.
    output_program: Computed,
    /// The derivative of each rate with respect to each state, row by row, then with respect to the time.
    slopes: Computed,
    events: Computed,
    outputs: Vec<Symbol>,
    /// Outputs whose first reading helps to determine the start, each with the variable that it gives; the most direct first.
    starting: Vec<(usize, String)>,
    /// For each branch of a `when`: the indices of the states that it restarts.
    restarted: Vec<Vec<usize>>,
}

/// If the iteration of a nonlinear block has not converged after this number of iterations, it has no solution near its guess.
pub(super) const MOST_ITERATIONS: usize = 100;

/// An iteration has converged if no value changes by more than this share of 1 plus its magnitude. Rounding alone causes changes of about 1e-16.
const SETTLED: f64 = 1e-12;

impl Machine {
    /// Builds the machine of a plant file.
    ///
    /// # Errors
    /// Faults that the compiler can detect only now: a program needs a symbol that has no value.
    pub fn new(file: &EquationFile) -> Result<Machine, Faults> {
        let mut system = file.system.clone();
        let outputs = system.outputs();
        let arguments = arguments(&system, false);
        let states = system.states().to_vec();
        let mut rates = system.rates();
        let time = system.find("time");
        let mut slopes = Vec::with_capacity(states.len() * (states.len() + 1));
        for rate in rates.clone() {
            slopes.extend(states.iter().map(|state| system.derivative(rate, *state)));
        }
        for rate in rates.clone() {
            let slope = time.map(|time| system.derivative(rate, time));
            slopes.extend(slope);
        }
        rates.extend(system.switches().to_vec().iter().flat_map(|it| [it.left, it.right]));
        let mut output_program: Vec<Id> = outputs.iter().map(|output| system.value(*output)).collect();
        output_program.extend(system.iterated().iter().map(|it| it.value));
        let functions = Functions::of(file);
        let program =
            |system: &System, arguments: &[Symbol], results: &[Id]| functions.compiled(file, system, arguments, results);
        let mut happens: Vec<Id> = system.memories().iter().map(|it| it.next).collect();
        for event in system.events() {
            happens.extend(event.restarted.iter().map(|it| it.1));
            happens.extend(&event.conditions);
        }
        let events = program(&system, &self::arguments(&system, true), &happens)?;
        let place = |state: &Symbol| states.iter().position(|it| it == state).unwrap_or(usize::MAX);
        let restarted = system.events().iter().map(|it| it.restarted.iter().map(|(state, _)| place(state)).collect()).collect();
        let parameters = system.parameters().iter().filter_map(|it| system.parameter_value(*it)).collect();
        let derived_numbers = DerivedNumbers::new(file, &system, &functions)?;
        let numbers = derived_numbers.numbers(parameters).map_err(|what| Faults::one(Fault::whole_file(&file.file, what)))?;
        let starting = starting(file, &mut system, &outputs);
        Ok(Machine {
            rates: program(&system, &arguments, &rates)?,
            output_program: program(&system, &arguments, &output_program)?,
            slopes: program(&system, &arguments, &slopes)?,
            events,
            functions,
            outputs,
            starting,
            restarted,
            numbers,
            derived_numbers,
            system,
        })
    }

    /// Names, units and values of the parameters that can be set, in order. A parameter of an effect has the name `kind(site).number`.
    #[must_use]
    pub fn parameters(&self) -> Vec<(String, String, f64)> {
        let signals = self.system.parameters().into_iter().map(|it| self.signal(it));
        signals.zip(&self.numbers.parameters).map(|((name, unit), value)| (name, unit, *value)).collect()
    }

    /// Sets a parameter, in the unit of the text. Dependent parameters, instants of samples and delays are recomputed. The start is not: compute it
    /// again with [`Machine::start_along`] or from [`Machine::starts`]. Nothing is compiled: `Lanes` of a copy of this machine can run a `Lane` of it
    /// without change.
    ///
    /// ```
    /// use rsm_core::source::{Faults, Source};
    /// use rsm_sim::equations::{EquationFile, Inputs, Lane, Lanes, Machine, Setting};
    ///
    /// let text = "model Cart\n  parameter Real mass = 2;\n  parameter Real drag = 0.5*mass;\n  output Real speed(start = mass);\nequation\n  mass*der(speed) = -drag*speed;\nend Cart;\n";
    /// let file = EquationFile::of_text(&Source::new("cart.mo", text))?;
    /// let mut machine = Machine::new(&file)?;
    /// let compiled = machine.clone();
    /// let starts = machine.starts(&file, &[], &[])?;
    /// let mut code = Lanes::new(&compiled);
    ///
    /// machine.set("mass", 4.0)?;
    /// let lane = Lane::new(&machine, starts.at(&machine, 0.0, &[], &[])?);
    /// let inputs = Inputs { time: &[0.0, 1.0], values: &[] };
    /// let outputs = code.run(&[lane], inputs, Setting::default()).remove(0).unwrap();
    /// assert!((outputs[0][1] - 4.0 * (-0.5_f64).exp()).abs() < 1e-6);
    /// # Ok::<(), Faults>(())
    /// ```
    ///
    /// # Errors
    /// No parameter has this name; the parameter determines the structure of the equations or depends on other parameters; the parameter cannot have
    /// this value. In these cases nothing is set.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), Faults> {
        let place = numbers::place_of(&self.system, name, value)?;
        let mut parameters = self.numbers.parameters.clone();
        parameters[place] = value;
        self.take(parameters).map_err(|what| self.fault(format!("with `{name}` = {value}: {what}")))
    }

    fn fault(&self, what: String) -> Faults {
        Faults::one(Fault::whole_file(&self.system.flat().name, what))
    }

    /// Replaces the parameters, and recomputes dependent values if any bit differs. If that fails, nothing is set.
    fn take(&mut self, parameters: Vec<f64>) -> Result<(), String> {
        let is_same = parameters.iter().zip(&self.numbers.parameters).all(|(a, b)| a.to_bits() == b.to_bits());
        if !is_same {
            self.numbers = self.derived_numbers.numbers(parameters)?;
        }
        Ok(())
    }

    /// The index of a parameter, for [`Machine::set_at`].
    ///
    /// # Errors
    /// No parameter has this name, or it determines the structure of the equations or depends on other parameters.
    pub fn place_of(&self, name: &str) -> Result<usize, Faults> {
        // The value 1 is valid for every type of parameter.
        numbers::place_of(&self.system, name, 1.0)
    }

    /// Sets several parameters by their indices. Dependent values are recomputed once.
    ///
    /// # Errors
    /// Values that the plant cannot have. In this case nothing is set.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn set_at(&mut self, values: &[(usize, f64)]) -> Result<(), Faults> {
        let mut parameters = self.numbers.parameters.clone();
        for (place, value) in values {
            if !value.is_finite() {
                let name = self.system.name(self.system.parameters()[*place]).to_string();
                return Err(self.fault(format!("`{name}`: found {value}, expected a finite number")));
            }
            parameters[*place] = *value;
        }
        self.take(parameters).map_err(|what| self.fault(what))
    }

    /// All values that are constant during a run.
    pub(super) fn numbers(&self) -> &Numbers {
        &self.numbers
    }

    /// The program that computes instants of samples and delays from the parameters.
    pub(super) fn derived_numbers(&self) -> &Computed {
        &self.derived_numbers.program
    }

    /// Inputs that are delayed copies of other signals.
    pub(super) fn delayed_inputs(&self) -> &[DelayedInput] {
        &self.numbers.delayed_inputs
    }

    /// Outputs that are read with a delay, and the delay in s.
    pub(super) fn late_readings(&self) -> &[(usize, f64)] {
        &self.numbers.late_readings
    }

    /// Outputs whose first reading helps to determine the start, each with the variable that it gives; the most direct first.
    pub(super) fn starting(&self) -> &[(usize, String)] {
        &self.starting
    }

    /// If all outputs are recorded: the indices of those whose first readings determine the start, the most direct first.
    ///
    /// # Errors
    /// The start conditions of the text contradict each other.
    pub fn first_readings(&mut self) -> Result<Vec<usize>, Faults> {
        self.start_by(&|_| true).map(|it| it.0)
    }

    /// The same for the outputs that a record contains. Also returns the variables whose start is then taken from the text.
    ///
    /// # Errors
    /// The start conditions of the text contradict each other.
    pub fn start_by(&mut self, holds: &dyn Fn(usize) -> bool) -> Result<(Vec<usize>, Vec<String>), Faults> {
        let held: Vec<(usize, Symbol)> = self
            .starting
            .iter()
            .filter(|it| holds(it.0))
            .filter_map(|(output, name)| self.system.find(name).map(|symbol| (*output, symbol)))
            .collect();
        let symbols: Vec<Symbol> = held.iter().map(|it| it.1).collect();
        let start = self.system.start(&[], &symbols)?;
        let by_text = start.used.iter().map(|it| self.system.name(*it).to_string()).collect();
        Ok((held.into_iter().filter(|it| start.recorded.contains(&it.1)).map(|it| it.0).collect(), by_text))
    }

    /// All programs as tapes.
    pub(super) fn tapes(&self) -> Tapes {
        let system = &self.system;
        let counts = Counts {
            time: usize::from(system.find("time").is_some()),
            states: system.states().len(),
            inputs: system.inputs().len(),
            parameters: self.numbers.parameters.len(),
            held: system.switches().len(),
            memories: system.memories().len(),
            guesses: system.iterated().len(),
            acts: system.events().len(),
            due: system.flat().samples.len(),
            outputs: self.outputs.len(),
        };
        let part = |from: usize, to: usize| {
            let mut tape = self.rates.tape.clone()?;
            tape.outputs = tape.outputs[from..to].to_vec();
            (from < to).then_some(tape)
        };
        let rates = part(0, counts.states).unwrap_or_else(nothing);
        let sides = part(counts.states, counts.states + 2 * counts.held);
        Tapes {
            counts,
            rates,
            sides,
            output_program: self.output_program.tape.clone(),
            events: self.events.tape.clone(),
            slopes: self.slopes.tape.clone(),
        }
    }

    /// The system of equations.
    #[must_use]
    pub fn system(&self) -> &System {
        &self.system
    }

    /// Names and units of the inputs that a record must give, in order. The unit is empty if the text gives none.
    #[must_use]
    pub fn inputs(&self) -> Vec<(String, String)> {
        let follows = |place: usize| self.numbers.delayed_inputs.iter().any(|it| it.input == place);
        let own = self.system.inputs().into_iter().enumerate().filter(|(place, _)| !follows(*place)).map(|it| it.1);
        own.map(|it| self.signal(it)).collect()
    }

    /// Names and units of the outputs, in order.
    #[must_use]
    pub fn outputs(&self) -> Vec<(String, String)> {
        self.outputs.iter().map(|it| self.signal(*it)).collect()
    }

    /// Names and units of the states, in order.
    #[must_use]
    pub fn states(&self) -> Vec<(String, String)> {
        self.system.states().iter().map(|it| self.signal(*it)).collect()
    }

    fn signal(&self, symbol: Symbol) -> (String, String) {
        let variable = self.system.flat().variable(symbol);
        (variable.name.clone(), variable.unit.clone().unwrap_or_default())
    }

    /// The state with this name, or the state that a variable with this name is equal or opposite to.
    fn state_of(&self, name: &str) -> Option<Symbol> {
        self.system.state_of(self.system.find(name)?)
    }

    /// Whether two names refer to the same state.
    pub(super) fn is_same(&self, a: &str, b: &str) -> bool {
        a == b || self.state_of(a).is_some_and(|state| self.state_of(b) == Some(state))
    }

    /// For each state, whether its derivative is another state, as that of a position is its speed.
    pub(crate) fn kinematic_states(&self) -> Vec<bool> {
        let is_state = |id: &Id| {
            let node = self.system.flat().pool.node(*id);
            matches!(node, Node::Symbol(symbol) if self.system.states().contains(&symbol))
        };
        self.system.rates().iter().map(is_state).collect()
    }

    /// The typical magnitude of a state, if the text gives a nominal value.
    pub(super) fn nominal(&self, state: usize) -> Option<f64> {
        self.system.flat().variable(self.system.states()[state]).nominal.map(f64::abs).filter(|it| *it > 0.0)
    }

    pub(super) fn samples(&self) -> &[(f64, f64)] {
        &self.numbers.samples
    }

    /// Whether the system has nonlinear blocks, which are solved by iteration.
    pub(super) fn has_blocks(&self) -> bool {
        !self.system.iterated().is_empty()
    }

    /// The values of the parameters, in the order of the system.
    pub(super) fn values_of_parameters(&self) -> &[f64] {
        &self.numbers.parameters
    }

    /// For each branch of a `when`: the indices of the states that it restarts.
    pub(super) fn restarted(&self) -> &[Vec<usize>] {
        &self.restarted
    }

    /// Some of the machine's own expressions as a separate tape; `None` if there are none.
    pub(super) fn tape(&self, system: &System, arguments: &[Symbol], results: &[Id]) -> Option<Tape> {
        self.functions.tape(system, arguments, results).expect("the machine has it on a tape already")
    }

    /// The start as computed by the system.
    pub(super) fn solved_start(&mut self, given: &[Symbol], recorded: &[Symbol]) -> Result<Start, Faults> {
        self.system.start(given, recorded)
    }

    /// Compiles expressions of this machine's system to a program.
    pub(super) fn compiled(&self, file: &EquationFile, arguments: &[Symbol], results: &[Id]) -> Result<Computed, Faults> {
        self.functions.compiled(file, &self.system, arguments, results)
    }

    fn values(&self, computed: &Computed, point: &Point, further: &[f64]) -> Vec<f64> {
        let mut arguments = Vec::with_capacity(computed.arguments);
        arguments.push(point.time);
        for part in [&point.states, &point.inputs, &self.numbers.parameters, &point.held, &point.memories, &point.guesses] {
            arguments.extend_from_slice(part);
        }
        arguments.extend_from_slice(further);
        computed.values(&arguments)
    }

    /// Evaluates expressions of a system derived from this machine's system, at a point.
    ///
    /// # Errors
    /// A symbol without a value.
    pub(super) fn evaluated(
        &self,
        file: &EquationFile,
        system: &System,
        list: &[Id],
        point: &Point,
    ) -> Result<Vec<f64>, Faults> {
        Ok(self.values(&self.functions.compiled(file, system, &arguments(system, false), list)?, point, &[]))
    }

    /// The same at several points.
    ///
    /// # Errors
    /// A symbol without a value.
    pub(crate) fn evaluated_at(
        &self,
        file: &EquationFile,
        system: &System,
        list: &[Id],
        points: &[Point],
    ) -> Result<Vec<Vec<f64>>, Faults> {
        let computed = self.functions.compiled(file, system, &arguments(system, false), list)?;
        Ok(points.iter().map(|point| self.values(&computed, point, &[])).collect())
    }

    /// The time derivative of each state, in the unit of the state per s.
    #[must_use]
    pub fn rates(&self, point: &Point) -> Vec<f64> {
        let mut found = self.values(&self.rates, point, &[]);
        found.truncate(point.states.len());
        found
    }

    /// The rates, and the value of each comparison at this point.
    pub(super) fn rates_and_truths(&self, point: &Point) -> (Vec<f64>, Vec<f64>) {
        let mut rates = self.values(&self.rates, point, &[]);
        let sides = rates.split_off(point.states.len());
        (rates, sides.chunks(2).map(|pair| f64::from(u8::from(pair[0] < pair[1]))).collect())
    }

    /// The derivative of each rate with respect to each state, row by row.
    pub(crate) fn slopes_at(&self, point: &Point) -> Vec<f64> {
        let mut found = self.values(&self.slopes, point, &[]);
        found.truncate(point.states.len() * point.states.len());
        found
    }

    /// Whether an input or a reading is delayed.
    pub(crate) fn is_late(&self) -> bool {
        !self.numbers.delayed_inputs.is_empty() || !self.late_readings().is_empty()
    }

    /// Sets the value of each comparison at a point, and solves the nonlinear blocks there. A comparison may depend on another one through a switched
    /// law, so this is repeated as often as there are comparisons.
    pub(crate) fn compare(&self, point: &mut Point) {
        for _ in 0..point.held.len() {
            let truths = self.rates_and_truths(point).1;
            if truths == point.held {
                break;
            }
            point.held = truths;
        }
        self.settle(point);
    }

    pub(super) fn evaluate_outputs(&self, point: &Point) -> OutputsAndSolutions {
        let mut outputs = self.values(&self.output_program, point, &[]);
        let solutions = outputs.split_off(self.outputs.len());
        OutputsAndSolutions { outputs, solutions }
    }

    /// The outputs at a point.
    #[must_use]
    pub fn outputs_at(&self, point: &Point) -> Vec<f64> {
        self.evaluate_outputs(point).outputs
    }

    /// Uses the solutions of nonlinear blocks as the next guesses until they converge. Returns `false` if they do not converge.
    pub(super) fn settle(&self, point: &mut Point) -> bool {
        for _ in 0..MOST_ITERATIONS {
            if point.guesses.is_empty() {
                return true;
            }
            let found = self.evaluate_outputs(point).solutions;
            let moves = !has_converged(&point.guesses, &found);
            point.guesses = found;
            if !moves {
                return true;
            }
        }
        false
    }

    /// The conditions of the branches of each `when`, evaluated with no branch active and no instant of `sample` due: 1 if true, else 0.
    pub(super) fn conditions(&self, point: &Point) -> Vec<Vec<f64>> {
        let none = vec![0.0; self.system.events().len() + self.numbers.samples.len()];
        let mut rest = self.values(&self.events, point, &none).into_iter().skip(point.memories.len());
        let branches = self.system.events().iter().zip(&self.restarted);
        branches.map(|(event, places)| rest.by_ref().skip(places.len()).take(event.conditions.len()).collect()).collect()
    }

    /// The point at which the plant starts. It is computed from the given values, then from the initial equations and start values of the text.
    /// `inputs` are the inputs of the first row.
    ///
    /// # Errors
    /// The start conditions are too many, contradict each other, or leave a variable undetermined.
    pub fn start(&mut self, file: &EquationFile, time: f64, inputs: &[f64], given: &[NamedValue]) -> Result<Point, Faults> {
        self.start_along(file, time, inputs, given, &[])
    }

    /// The same, with recorded values of variables in the first row. They are used in their order, as long as a variable is undetermined.
    ///
    /// # Errors
    /// Those of [`Machine::start`].
    pub fn start_along(
        &mut self,
        file: &EquationFile,
        time: f64,
        inputs: &[f64],
        given: &[NamedValue],
        recorded: &[NamedValue],
    ) -> Result<Point, Faults> {
        let names = |list: &[NamedValue]| -> Vec<String> { list.iter().map(|it| it.name.clone()).collect() };
        let starts = self.starts(file, &names(given), &names(recorded))?;
        let values: Vec<f64> = given.iter().chain(recorded).map(|it| it.value).collect();
        starts.at(self, time, inputs, &values)
    }

    /// The inputs of a first row, and the inputs that follow them: before the record a signal had its first value.
    pub(super) fn with_followers(&self, inputs: &[f64]) -> Vec<f64> {
        let mut inputs = inputs.to_vec();
        for delayed_input in &self.numbers.delayed_inputs {
            let value = match delayed_input.of {
                DelaySource::Input(place) => inputs.get(place).copied().unwrap_or(0.0),
                // A controller computes its first value in the first row, after the start.
                DelaySource::Memory(_) => 0.0,
            };
            inputs.push(value);
        }
        inputs
    }
}

/// Outputs whose first reading helps to determine the start: those that depend on states or memories and not on inputs. Outputs that are equal to one
/// state come first, then outputs of few states.
fn starting(file: &EquationFile, system: &mut System, outputs: &[Symbol]) -> Vec<(usize, String)> {
    let mut list = Vec::new();
    for (place, output) in outputs.iter().enumerate() {
        let shown = file.read_of.iter().find(|it| it.0 == *output).map_or(*output, |it| it.1);
        let value = system.value(shown);
        let symbols = system.flat().pool.symbols(value);
        let states = symbols.iter().filter(|it| system.states().contains(it)).count();
        let held = symbols.iter().filter(|it| system.memories().iter().any(|memory| memory.variable == **it)).count();
        let is_input = |it: &Symbol| system.flat().variable(*it).role == rsm_model::flat::Role::Input;
        let is_allowed = file.rules.start.is_empty() || file.rules.start.iter().any(|it| *it == system.name(*output));
        if states + held > 0 && !symbols.iter().any(is_input) && is_allowed {
            let is_state = symbols.len() == 1;
            list.push((!is_state, states + held, place, system.name(shown).to_string()));
        }
    }
    list.sort();
    list.into_iter().map(|it| (it.2, it.3)).collect()
}

/// The rates of a plant without states.
fn nothing() -> Tape {
    let mut builder = TapeBuilder::sharing(Precision::F64);
    let zero = builder.constant(rsm_core::number::integer(0));
    let mut tape = builder.finish("nothing", Vec::new(), zero);
    tape.outputs.clear();
    tape
}

/// Whether an iteration has converged. NaN means that it has not.
pub(super) fn has_converged(old: &[f64], new: &[f64]) -> bool {
    old.iter().zip(new).all(|(old, new)| value_has_converged(*old, *new))
}

/// The same for one value.
pub(super) fn value_has_converged(old: f64, new: f64) -> bool {
    (new - old).abs() <= SETTLED * (1.0 + new.abs())
}

/// The arguments of all programs. Programs of events have some additional arguments.
pub(super) fn arguments(system: &System, at_events: bool) -> Vec<Symbol> {
    let mut list: Vec<Symbol> = system.find("time").into_iter().collect();
    list.extend(system.states());
    list.extend(system.inputs());
    list.extend(system.parameters());
    list.extend(system.switches().iter().map(|it| it.held));
    list.extend(system.memories().iter().map(|it| if at_events { it.before } else { it.held }));
    list.extend(system.iterated().iter().map(|it| it.guess));
    if at_events {
        list.extend(system.events().iter().map(|it| it.acts));
        let samples = (1..=system.flat().samples.len()).filter_map(|k| system.find(&format!("sample {k}")));
        list.extend(samples);
    }
    list
}

//! A system of equations with its numbers, ready to be evaluated: rates, outputs, switches, events.
//!
//! In: an [`EquationFile`]. Out: [`Machine`], which computes everything at a [`Point`]. It never moves time on.

use rsm_core::number::Precision;
use rsm_core::source::{Fault, Faults};
use rsm_core::tape::{Tape, TapeBuilder};
use rsm_model::expression::{Id, Symbol};
use rsm_model::system::{Start, System};

use super::computed::{Computed, Functions};
use super::file::{EquationFile, Given};
use super::numbers::{self, Followed, Follower, Following, Numbers};

/// Everything that changes while a plant runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// The time in s.
    pub time: f64,
    /// The states, in the order of the text.
    pub states: Vec<f64>,
    /// The inputs, in the order of the text.
    pub inputs: Vec<f64>,
    /// The value that each comparison has since the last event: 1 or 0.
    pub(super) held: Vec<f64>,
    /// What is kept from event to event.
    pub(super) memories: Vec<f64>,
    /// The last solution of nonlinear blocks.
    pub(super) guesses: Vec<f64>,
}

/// What is computed at a point, beside rates.
#[derive(Debug, Clone)]
pub(super) struct Look {
    pub outputs: Vec<f64>,
    /// Solutions of nonlinear blocks, from the point's guesses.
    pub solutions: Vec<f64>,
}

/// How many there are of each group of arguments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counts {
    /// 1 where the system has a time.
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

/// The tapes of a machine, for code of their own.
pub(super) struct Tapes {
    pub counts: Counts,
    pub rates: Tape,
    /// Both sides of each switch.
    pub sides: Option<Tape>,
    /// Outputs, then solutions of nonlinear blocks.
    pub looks: Option<Tape>,
    pub events: Option<Tape>,
    /// The derivative of each rate by each state, row by row, then by the time.
    pub slopes: Option<Tape>,
}

/// A system of equations with its numbers.
#[derive(Debug, Clone)]
pub struct Machine {
    system: System,
    numbers: Numbers,
    following: Following,
    functions: Functions,
    /// Rates, then both sides of each switch.
    rates: Computed,
    /// Outputs, then solutions of nonlinear blocks.
    looks: Computed,
    /// The derivative of each rate by each state, row by row, then by the time.
    slopes: Computed,
    events: Computed,
    outputs: Vec<Symbol>,
    /// Outputs whose first reading says something of the start, and the variable of which it says it; the surest first.
    starting: Vec<(usize, String)>,
    /// The places of states that a branch restarts.
    restarted: Vec<Vec<usize>>,
}

/// A nonlinear block whose iteration has not ended after so many turns has no solution nearby.
pub(super) const TURNS: usize = 100;

/// An iteration has ended where its numbers move by no more than this share of themselves: rounding moves them by some 1e-16.
const SETTLED: f64 = 1e-12;

impl Machine {
    /// A machine of a plant file.
    ///
    /// # Errors
    /// What the compiler finds only now: a program that needs what is not known.
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
        let mut looks: Vec<Id> = outputs.iter().map(|output| system.value(*output)).collect();
        looks.extend(system.iterated().iter().map(|it| it.value));
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
        let following = Following::new(file, &system, &functions)?;
        let numbers = following.numbers(parameters).map_err(|what| Faults::one(Fault::whole_file(&file.file, what)))?;
        let starting = starting(file, &mut system, &outputs);
        Ok(Machine {
            rates: program(&system, &arguments, &rates)?,
            looks: program(&system, &arguments, &looks)?,
            slopes: program(&system, &arguments, &slopes)?,
            events,
            functions,
            outputs,
            starting,
            restarted,
            numbers,
            following,
            system,
        })
    }

    /// Names, units and values of the parameters that can be set, in order. The number of an effect is called `kind(site).number`.
    #[must_use]
    pub fn parameters(&self) -> Vec<(String, String, f64)> {
        let signals = self.system.parameters().into_iter().map(|it| self.signal(it));
        signals.zip(&self.numbers.parameters).map(|((name, unit), value)| (name, unit, *value)).collect()
    }

    /// Sets a parameter, in the unit of the text. Parameters, instants of samples and delays that follow from it follow; a start is computed again by [`Machine::start_along`] or from [`Machine::starts`].
    /// Nothing is compiled: `Lanes` of a copy of this machine run a `Lane` of it as they are.
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
    /// No parameter of this name; one that shapes the equations or follows from others; a value that it cannot have. Nothing is set then.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), Faults> {
        let place = numbers::place_of(&self.system, name, value)?;
        let mut parameters = self.numbers.parameters.clone();
        parameters[place] = value;
        self.take(parameters).map_err(|what| self.fault(format!("with `{name}` = {value}: {what}")))
    }

    fn fault(&self, what: String) -> Faults {
        Faults::one(Fault::whole_file(&self.system.flat().name, what))
    }

    /// Takes other parameters, and computes what follows from them where any bit differs. Where that fails, nothing is set.
    fn take(&mut self, parameters: Vec<f64>) -> Result<(), String> {
        let is_same = parameters.iter().zip(&self.numbers.parameters).all(|(a, b)| a.to_bits() == b.to_bits());
        if !is_same {
            self.numbers = self.following.numbers(parameters)?;
        }
        Ok(())
    }

    /// Where a parameter stands for [`Machine::set_at`].
    ///
    /// # Errors
    /// No parameter of this name; one that shapes the equations or follows from others.
    pub fn place_of(&self, name: &str) -> Result<usize, Faults> {
        // Every kind of parameter may be 1.
        numbers::place_of(&self.system, name, 1.0)
    }

    /// Sets parameters by their places, together: what follows from them is computed once.
    ///
    /// # Errors
    /// Values that the plant cannot have. Nothing is set then.
    ///
    /// # Panics
    /// For a place that is none.
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

    /// All numbers of a run.
    pub(super) fn numbers(&self) -> &Numbers {
        &self.numbers
    }

    /// Instants and delays, from parameters.
    pub(super) fn following(&self) -> &Computed {
        &self.following.program
    }

    /// Inputs that follow other signals.
    pub(super) fn followers(&self) -> &[Follower] {
        &self.numbers.followers
    }

    /// Outputs that are read late, and by how much in s.
    pub(super) fn late_readings(&self) -> &[(usize, f64)] {
        &self.numbers.late_readings
    }

    /// Outputs whose first reading says something of the start, and of which variable; the surest first.
    pub(super) fn starting(&self) -> &[(usize, String)] {
        &self.starting
    }

    /// The outputs whose first readings say something of the start when all of them are recorded, by place, the surest first.
    ///
    /// # Errors
    /// What the text demands of the start contradicts itself.
    pub fn first_readings(&mut self) -> Result<Vec<usize>, Faults> {
        self.start_by(&|_| true).map(|it| it.0)
    }

    /// The same of those that a record holds, with the variables whose start is then that of the text.
    ///
    /// # Errors
    /// What the text demands of the start contradicts itself.
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

    /// Everything as tapes.
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
            looks: self.looks.tape.clone(),
            events: self.events.tape.clone(),
            slopes: self.slopes.tape.clone(),
        }
    }

    /// The system behind it.
    #[must_use]
    pub fn system(&self) -> &System {
        &self.system
    }

    /// Names and units of the inputs that a record gives, in order. A unit that the text does not give is empty.
    #[must_use]
    pub fn inputs(&self) -> Vec<(String, String)> {
        let follows = |place: usize| self.numbers.followers.iter().any(|it| it.input == place);
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

    /// The state that a name stands for: its own, or one that it is equal or opposite to.
    fn state_of(&self, name: &str) -> Option<Symbol> {
        self.system.state_of(self.system.find(name)?)
    }

    /// Whether two names stand for one state.
    pub(super) fn is_same(&self, a: &str, b: &str) -> bool {
        a == b || self.state_of(a).is_some_and(|state| self.state_of(b) == Some(state))
    }

    /// How large a state typically is, where the text says it.
    pub(super) fn nominal(&self, state: usize) -> Option<f64> {
        self.system.flat().variable(self.system.states()[state]).nominal.map(f64::abs).filter(|it| *it > 0.0)
    }

    pub(super) fn samples(&self) -> &[(f64, f64)] {
        &self.numbers.samples
    }

    /// Whether a nonlinear block is iterated.
    pub(super) fn has_blocks(&self) -> bool {
        !self.system.iterated().is_empty()
    }

    /// The values of the parameters, in the order of the system.
    pub(super) fn values_of_parameters(&self) -> &[f64] {
        &self.numbers.parameters
    }

    /// The places of states that each branch of a `when` restarts.
    pub(super) fn restarted(&self) -> &[Vec<usize>] {
        &self.restarted
    }

    /// Some of the expressions that the machine was made of, as a tape of their own; `None` of none.
    pub(super) fn tape(&self, system: &System, arguments: &[Symbol], results: &[Id]) -> Option<Tape> {
        self.functions.tape(system, arguments, results).expect("the machine has it on a tape already")
    }

    /// The start as the system solves it.
    pub(super) fn solved_start(&mut self, given: &[Symbol], recorded: &[Symbol]) -> Result<Start, Faults> {
        self.system.start(given, recorded)
    }

    /// Expressions of this machine's system as a program.
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

    /// Expressions of a system that was made from this machine's, at a point.
    ///
    /// # Errors
    /// A symbol that nothing gives.
    pub(super) fn evaluated(
        &self,
        file: &EquationFile,
        system: &System,
        list: &[Id],
        point: &Point,
    ) -> Result<Vec<f64>, Faults> {
        Ok(self.values(&self.functions.compiled(file, system, &arguments(system, false), list)?, point, &[]))
    }

    /// The same at many points.
    ///
    /// # Errors
    /// A symbol that nothing gives.
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

    /// The derivative of each state by time, in its unit over s.
    #[must_use]
    pub fn rates(&self, point: &Point) -> Vec<f64> {
        let mut found = self.values(&self.rates, point, &[]);
        found.truncate(point.states.len());
        found
    }

    /// Rates, and how each comparison goes at the point itself.
    pub(super) fn rates_and_truths(&self, point: &Point) -> (Vec<f64>, Vec<f64>) {
        let mut rates = self.values(&self.rates, point, &[]);
        let sides = rates.split_off(point.states.len());
        (rates, sides.chunks(2).map(|pair| f64::from(u8::from(pair[0] < pair[1]))).collect())
    }

    pub(super) fn look(&self, point: &Point) -> Look {
        let mut outputs = self.values(&self.looks, point, &[]);
        let solutions = outputs.split_off(self.outputs.len());
        Look { outputs, solutions }
    }

    /// The outputs at a point.
    #[must_use]
    pub fn outputs_at(&self, point: &Point) -> Vec<f64> {
        self.look(point).outputs
    }

    /// Takes the solutions of nonlinear blocks as the next guesses, until they stand still; `false` where they do not.
    pub(super) fn settle(&self, point: &mut Point) -> bool {
        for _ in 0..TURNS {
            if point.guesses.is_empty() {
                return true;
            }
            let found = self.look(point).solutions;
            let moves = !stand_still(&point.guesses, &found);
            point.guesses = found;
            if !moves {
                return true;
            }
        }
        false
    }

    /// The conditions of the branches of `when`, while none acts and no instant of `sample` is due: 1 where one is true.
    pub(super) fn conditions(&self, point: &Point) -> Vec<Vec<f64>> {
        let none = vec![0.0; self.system.events().len() + self.numbers.samples.len()];
        let mut rest = self.values(&self.events, point, &none).into_iter().skip(point.memories.len());
        let branches = self.system.events().iter().zip(&self.restarted);
        branches.map(|(event, places)| rest.by_ref().skip(places.len()).take(event.conditions.len()).collect()).collect()
    }

    /// The point at which the plant starts: what is given, then the text's initial equations and starts. `inputs` are those of the first row.
    ///
    /// # Errors
    /// What is demanded of the start is too much, contradicts itself, or leaves something open.
    pub fn start(&mut self, file: &EquationFile, time: f64, inputs: &[f64], given: &[Given]) -> Result<Point, Faults> {
        self.start_along(file, time, inputs, given, &[])
    }

    /// The same with what was recorded of variables in the first row: it counts in its order, as long as something is open.
    ///
    /// # Errors
    /// Those of [`Machine::start`].
    pub fn start_along(
        &mut self,
        file: &EquationFile,
        time: f64,
        inputs: &[f64],
        given: &[Given],
        recorded: &[Given],
    ) -> Result<Point, Faults> {
        let names = |list: &[Given]| -> Vec<String> { list.iter().map(|it| it.name.clone()).collect() };
        let starts = self.starts(file, &names(given), &names(recorded))?;
        let values: Vec<f64> = given.iter().chain(recorded).map(|it| it.value).collect();
        starts.at(self, time, inputs, &values)
    }

    /// The inputs of a first row with those that follow them: before a record a signal had its first value.
    pub(super) fn with_followers(&self, inputs: &[f64]) -> Vec<f64> {
        let mut inputs = inputs.to_vec();
        for follower in &self.numbers.followers {
            let value = match follower.of {
                Followed::Input(place) => inputs.get(place).copied().unwrap_or(0.0),
                // A controller says its first value in the first row, behind the start.
                Followed::Memory(_) => 0.0,
            };
            inputs.push(value);
        }
        inputs
    }
}

/// Outputs whose first reading says something of the start: those that follow from states alone. First those that are a state, then those of few.
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

/// Whether an iteration has ended: NaN moves.
pub(super) fn stand_still(old: &[f64], new: &[f64]) -> bool {
    old.iter().zip(new).all(|(old, new)| stands_still(*old, *new))
}

/// The same of one number.
pub(super) fn stands_still(old: f64, new: f64) -> bool {
    (new - old).abs() <= SETTLED * (1.0 + new.abs())
}

/// The arguments of all programs that run; those of events have some more.
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

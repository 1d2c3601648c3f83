//! A step of constant length as one tape: `--fixed-step` runs it, and `rsm emit` prints it for a plant of equations.
//!
//! In: a machine, the step length H. Out: [`Step`], a tape. Its arguments are the inputs, its results are the outputs, and its states are all values
//! that the plant keeps from step to step. It has no loop and no branch.
//!
//! Step k, from 0, does the following, in this order:
//!
//! 1. The time is start + k H. The inputs are read, and are constant during the step.
//! 2. The events that are due are executed in two rounds: `when` clauses whose condition has become true, and instants of `sample` since the
//!    previous step. An event that only a third round would detect is executed in the next step.
//! 3. The outputs of this instant are computed.
//! 4. The classical method of Runge and Kutta integrates to start + (k + 1) H (W. Kutta, 1901). Comparisons are evaluated at each of its four
//!    points. Only a comparison that affects its own sides (an ideal diode) keeps its value from step 2.
//!
//! A nonlinear block is iterated a fixed number of times at each point, from its solution at the previous point. If an input is NaN or infinite, the
//! clock and the counts of samples continue, and all other states keep their values.

use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::tape::{Note, Op, Reg, Tape, TapeBuilder};
use rsm_model::expression::{Id, Symbol};
use rsm_model::system::System;

use super::machine::{Machine, Point, arguments};
use super::sampling::{self, SAME};

/// The number of rounds of events at one instant.
const ROUNDS: usize = 2;

/// The meaning of a state of the tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// A state of the equations, by its index.
    State(usize),
    /// A memory, which changes only at events.
    Memory(usize),
    /// The last solution of a nonlinear block.
    Solution(usize),
    /// The value of a comparison that affects its own sides: 1 or 0.
    Held(usize),
    /// Whether a condition of a `when` was true: the index of the clause, then of the condition.
    Condition(usize, usize),
    /// The number of past instants of a `sample`.
    Samples(usize),
    /// The number of steps so far.
    Steps,
    /// The time of the first step in s.
    Start,
}

/// A step of constant length.
#[derive(Debug, Clone)]
pub struct Step {
    /// The tape. Its arguments are the inputs, its results the outputs. A plant without outputs has one result with the value 0.
    pub tape: Tape,
    /// The meaning of each state of the tape, in order.
    pub kept: Vec<Kept>,
    /// The step length in s.
    pub length: f64,
}

impl Step {
    /// The step of a machine.
    ///
    /// # Errors
    /// A sentence: the length is not a positive number, two instants of a `sample` could be in one step, or an effect delays a signal.
    pub fn new(machine: &Machine, length: f64) -> Result<Step, String> {
        if !(length > 0.0 && length.is_finite()) {
            return Err(format!("found a step of {length} s, expected a positive length"));
        }
        if !machine.delayed_inputs().is_empty() || !machine.late_readings().is_empty() {
            return Err("an effect delays a signal, and fixed steps know no delays".to_string());
        }
        // A period that differs from the step only by the rounding of decimals is equal to the step.
        if let Some((_, period)) = machine.samples().iter().find(|(_, period)| *period < length * (1.0 - 1e-9)) {
            return Err(format!("a step of {length} s is longer than a `sample` of the text, every {period} s"));
        }
        Ok(Writer::new(machine, length).write())
    }

    /// The states of the tape at the start of a plant.
    #[must_use]
    pub fn start(&self, machine: &Machine, point: &Point) -> Vec<f64> {
        let conditions = machine.conditions(point);
        let value = |kept: &Kept| match *kept {
            Kept::State(k) => point.states[k],
            Kept::Memory(k) => point.memories[k],
            Kept::Solution(k) => point.guesses[k],
            Kept::Held(k) => point.held[k],
            Kept::Condition(event, k) => conditions[event][k],
            Kept::Samples(k) => sampling::instants_before(machine.samples()[k], point.time),
            Kept::Steps => 0.0,
            Kept::Start => point.time,
        };
        self.kept.iter().map(value).collect()
    }
}

/// The values of all arguments of the programs, as registers.
#[derive(Debug, Clone)]
struct At {
    time: Reg,
    states: Vec<Reg>,
    held: Vec<Reg>,
    memories: Vec<Reg>,
    guesses: Vec<Reg>,
}

/// Programs of a machine, one for each group of results.
struct Writer<'m> {
    machine: &'m Machine,
    length: f64,
    tape: TapeBuilder,
    inputs: Vec<Reg>,
    parameters: Vec<Reg>,
    rates: Option<Tape>,
    outputs: Option<Tape>,
    solutions: Option<Tape>,
    events: Option<Tape>,
    /// The two sides of each comparison.
    switches: Vec<Tape>,
    /// Comparisons in an order in which each one depends only on those before it and on circular ones.
    direct: Vec<usize>,
    /// Circular comparisons: they affect their own sides.
    circular: Vec<usize>,
}

impl<'m> Writer<'m> {
    fn new(machine: &'m Machine, length: f64) -> Self {
        let mut system: System = machine.system().clone();
        let list = arguments(&system, false);
        let program = |system: &System, list: &[Symbol], results: &[Id]| machine.tape(system, list, results);
        let rates = program(&system, &list, &system.rates());
        let outputs: Vec<Id> = system.outputs().into_iter().map(|it| system.value(it)).collect();
        let outputs = program(&system, &list, &outputs);
        let solutions: Vec<Id> = system.iterated().iter().map(|it| it.value).collect();
        let solutions = program(&system, &list, &solutions);
        let mut happens: Vec<Id> = system.memories().iter().map(|it| it.next).collect();
        for event in system.events() {
            happens.extend(event.restarted.iter().map(|it| it.1));
            happens.extend(&event.conditions);
        }
        let events = program(&system, &arguments(&system, true), &happens);
        let switches: Vec<Tape> =
            system.switches().iter().filter_map(|it| program(&system, &list, &[it.left, it.right])).collect();
        let first = list.len() - system.iterated().len() - system.memories().len() - switches.len();
        let (direct, circular) = ordered(&switches, first);
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let inputs = (0..system.inputs().len()).map(|k| tape.input(k as u32)).collect();
        let parameters = system.parameters().into_iter().zip(machine.values_of_parameters()).map(|(symbol, value)| {
            let variable = system.flat().variable(symbol);
            let constant = tape.constant(exact(*value));
            let unit = variable.unit.clone().unwrap_or_default();
            tape.note(&exact(*value), Note { term: variable.name.clone(), coefficient: *value, unit });
            constant
        });
        let parameters = parameters.collect();
        Writer { machine, length, tape, inputs, parameters, rates, outputs, solutions, events, switches, direct, circular }
    }

    fn constant(&mut self, value: f64) -> Reg {
        self.tape.constant(exact(value))
    }

    fn write(mut self) -> Step {
        let kept = self.kept();
        let old: Vec<Reg> = (0..kept.len()).map(|k| self.tape.state(k as u32)).collect();
        let of = |wanted: &dyn Fn(Kept) -> bool| -> Vec<Reg> {
            kept.iter().zip(&old).filter(|(it, _)| wanted(**it)).map(|it| *it.1).collect()
        };
        let zero = self.constant(0.0);
        let (steps, start) = (of(&|it| it == Kept::Steps).first().copied(), of(&|it| it == Kept::Start).first().copied());
        let clock = steps.zip(start);
        let time = |writer: &mut Self, share: Rational| writer.time(clock, share);
        let now = time(&mut self, integer(0));
        let mut held = vec![zero; self.switches.len()];
        for (k, reg) in self.circular.clone().into_iter().zip(of(&|it| matches!(it, Kept::Held(_)))) {
            held[k] = reg;
        }
        let mut at = At {
            time: now,
            states: of(&|it| matches!(it, Kept::State(_))),
            held,
            memories: of(&|it| matches!(it, Kept::Memory(_))),
            guesses: of(&|it| matches!(it, Kept::Solution(_))),
        };
        let past = of(&|it| matches!(it, Kept::Samples(_)));
        let due = self.due(now, &past);
        let mut before = of(&|it| matches!(it, Kept::Condition(..)));
        for round in 0..ROUNDS {
            self.compare(&mut at);
            self.update_circular(&mut at);
            let due = if round == 0 { due.clone() } else { vec![zero; due.len()] };
            self.execute_events(&mut at, &mut before, &due);
        }
        self.compare(&mut at);
        self.update_circular(&mut at);
        let outputs = self.evaluate(&self.outputs.clone(), &at, &[]);
        let (states, solutions) = self.runge_kutta(&at, clock);
        let new: Vec<Reg> = states
            .into_iter()
            .chain(at.memories.clone())
            .chain(solutions)
            .chain(self.circular.clone().into_iter().map(|k| at.held[k]))
            .chain(before)
            .collect();
        let mut next = self.kept_on_bad_inputs(&new, &old);
        for (past, due) in past.iter().zip(&due) {
            next.push(self.tape.add(*past, *due));
        }
        if let Some((steps, start)) = clock {
            let one = self.constant(1.0);
            next.push(self.tape.add(steps, one));
            next.push(start);
        }
        let names = |list: Vec<(String, String)>| list.into_iter().map(|it| it.0).collect::<Vec<String>>();
        let mut results: Vec<(String, Reg)> = names(self.machine.outputs()).into_iter().zip(outputs).collect();
        if results.is_empty() {
            results.push((String::new(), zero));
        }
        let states = next.into_iter().enumerate().map(|(k, reg)| (format!("s{k}"), reg));
        let tape = self.tape.finish_with_results("step", names(self.machine.inputs()), results, states).folded();
        Step { tape, kept, length: self.length }
    }

    /// The values that the plant keeps. The clock is included only if something uses the time.
    fn kept(&self) -> Vec<Kept> {
        let system = self.machine.system();
        let mut kept: Vec<Kept> = (0..system.states().len()).map(Kept::State).collect();
        kept.extend((0..system.memories().len()).map(Kept::Memory));
        kept.extend((0..system.iterated().len()).map(Kept::Solution));
        kept.extend(self.circular.iter().map(|k| Kept::Held(*k)));
        for (event, it) in system.events().iter().enumerate() {
            kept.extend((0..it.conditions.len()).map(|k| Kept::Condition(event, k)));
        }
        kept.extend((0..self.machine.samples().len()).map(Kept::Samples));
        let has_time = system.find("time").is_some();
        let all = [&self.rates, &self.outputs, &self.solutions, &self.events];
        let programs = all.into_iter().flatten().chain(&self.switches);
        // The time is the first argument.
        let is_read =
            has_time && programs.into_iter().any(|it| it.ops.iter().any(|op| matches!(op, Op::Input(port) if port.0 == 0)));
        if is_read || !self.machine.samples().is_empty() {
            kept.extend([Kept::Steps, Kept::Start]);
        }
        kept
    }

    /// The time of a point that is a share of a step after its start.
    fn time(&mut self, clock: Option<(Reg, Reg)>, share: Rational) -> Reg {
        let Some((steps, start)) = clock else { return self.constant(0.0) };
        let count = if share == integer(0) {
            steps
        } else {
            let share = self.tape.constant(share);
            self.tape.add(steps, share)
        };
        let length = self.constant(self.length);
        let passed = self.tape.multiply(count, length);
        self.tape.add(start, passed)
    }

    /// For each `sample`, whether an instant is due: 1 or 0.
    fn due(&mut self, now: Reg, past: &[Reg]) -> Vec<Reg> {
        let (one, zero, same) = (self.constant(1.0), self.constant(0.0), self.constant(SAME));
        let samples = self.machine.samples().to_vec();
        let magnitude = self.tape.absolute(now);
        let allowed = self.tape.multiply(same, magnitude);
        let limit = self.tape.add(now, allowed);
        samples
            .iter()
            .zip(past)
            .map(|((first, period), past)| {
                let (first, period) = (self.constant(*first), self.constant(*period));
                let passed = self.tape.multiply(*past, period);
                let instant = self.tape.add(first, passed);
                self.tape.select_less(limit, instant, zero, one)
            })
            .collect()
    }

    /// The results of a program. `further` are the additional arguments of events.
    fn evaluate(&mut self, program: &Option<Tape>, at: &At, further: &[Reg]) -> Vec<Reg> {
        let Some(program) = program else { return Vec::new() };
        let has_time = self.machine.system().find("time").is_some();
        let mut list: Vec<Reg> = has_time.then_some(at.time).into_iter().collect();
        for part in [&at.states, &self.inputs, &self.parameters, &at.held, &at.memories, &at.guesses] {
            list.extend_from_slice(part);
        }
        list.extend_from_slice(further);
        self.tape.inline(program, &list)
    }

    /// Evaluates the comparisons at a point, except the circular ones.
    fn compare(&mut self, at: &mut At) {
        for k in self.direct.clone() {
            at.held[k] = self.truth(k, at);
        }
    }

    /// Updates all circular comparisons together with their current values, then the comparisons that depend on them.
    fn update_circular(&mut self, at: &mut At) {
        let circular = self.circular.clone();
        let new: Vec<Reg> = circular.iter().map(|k| self.truth(*k, at)).collect();
        circular.iter().zip(&new).for_each(|(k, reg)| at.held[*k] = *reg);
        if !circular.is_empty() {
            self.compare(at);
        }
    }

    fn truth(&mut self, switch: usize, at: &At) -> Reg {
        let sides = self.evaluate(&Some(self.switches[switch].clone()), at, &[]);
        let (one, zero) = (self.constant(1.0), self.constant(0.0));
        self.tape.select_less(sides[0], sides[1], one, zero)
    }

    /// One round of events at an instant.
    fn execute_events(&mut self, at: &mut At, before: &mut [Reg], due: &[Reg]) {
        if self.events.is_none() {
            return;
        }
        let (one, zero, half) = (self.constant(1.0), self.constant(0.0), self.constant(0.5));
        let events = self.machine.system().events().to_vec();
        let program = self.events.clone();
        let none = vec![zero; events.len()];
        let found = self.evaluate(&program, at, &[&none[..], due].concat());
        let conditions = split(&found, at.memories.len(), &events).into_iter().flat_map(|it| it.1).collect::<Vec<Reg>>();
        let mut acts: Vec<Reg> = Vec::new();
        let mut place = 0;
        for event in &events {
            let mut any = zero;
            for k in place..place + event.conditions.len() {
                // The condition is true and was false before.
                let fresh = self.tape.select_less(half, before[k], zero, one);
                let rises = self.tape.select_less(half, conditions[k], fresh, zero);
                any = self.tape.select_less(half, rises, one, any);
            }
            place += event.conditions.len();
            for other in &event.unless {
                any = self.tape.select_less(half, acts[*other], zero, any);
            }
            acts.push(any);
        }
        before.copy_from_slice(&conditions);
        let found = self.evaluate(&program, at, &[&acts[..], due].concat());
        let places = self.machine.restarted().to_vec();
        let branches = split(&found, at.memories.len(), &events);
        at.memories = found[..at.memories.len()].to_vec();
        for ((values, _), (acts, places)) in branches.into_iter().zip(acts.iter().zip(&places)) {
            for (value, place) in values.into_iter().zip(places) {
                at.states[*place] = self.tape.select_less(half, *acts, value, at.states[*place]);
            }
        }
        at.guesses = self.evaluate(&self.solutions.clone(), at, &[]);
    }

    /// The states after a step, and the last solutions of nonlinear blocks.
    fn runge_kutta(&mut self, at: &At, clock: Option<(Reg, Reg)>) -> (Vec<Reg>, Vec<Reg>) {
        let length = exact(self.length);
        let (whole, sixth) = (self.tape.constant(length.clone()), self.tape.constant(length.clone() / integer(6)));
        let half = self.tape.constant(length / integer(2));
        let program = self.rates.clone();
        let mut slopes: Vec<Vec<Reg>> = Vec::new();
        let mut point = at.clone();
        for stage in 0..4 {
            if let Some(last) = slopes.last() {
                let reach = if stage == 3 { whole } else { half };
                point.states = at
                    .states
                    .iter()
                    .zip(last)
                    .map(|(state, slope)| {
                        let moved = self.tape.multiply(reach, *slope);
                        self.tape.add(*state, moved)
                    })
                    .collect();
                point.time = self.time(clock, integer(if stage == 3 { 2 } else { 1 }) / integer(2));
                self.compare(&mut point);
            }
            slopes.push(self.evaluate(&program, &point, &[]));
            point.guesses = self.evaluate(&self.solutions.clone(), &point, &[]);
        }
        let states = (0..at.states.len())
            .map(|k| {
                let outer = self.tape.add(slopes[0][k], slopes[3][k]);
                let inner = self.tape.add(slopes[1][k], slopes[2][k]);
                let sum = self.tape.add(outer, inner);
                let sum = self.tape.add(sum, inner);
                let moved = self.tape.multiply(sixth, sum);
                self.tape.add(at.states[k], moved)
            })
            .collect();
        (states, point.guesses)
    }

    /// The new values, or the old ones if an input is NaN or infinite.
    fn kept_on_bad_inputs(&mut self, new: &[Reg], old: &[Reg]) -> Vec<Reg> {
        let mut sum: Option<Reg> = None;
        for input in self.inputs.clone() {
            // 0 if the input is finite, otherwise NaN.
            let nothing = self.tape.subtract(input, input);
            sum = Some(sum.map_or(nothing, |sum| self.tape.add(sum, nothing)));
        }
        let Some(nothing) = sum else { return new.to_vec() };
        let one = self.constant(1.0);
        new.iter().zip(old).map(|(new, old)| self.tape.select_less(nothing, one, *new, *old)).collect()
    }
}

/// Splits the results of the event program after the memories: for each branch, the new values of the states that it restarts, and its conditions.
fn split(found: &[Reg], memories: usize, events: &[rsm_model::system::Event]) -> Vec<(Vec<Reg>, Vec<Reg>)> {
    let mut rest = found[memories..].iter().copied();
    let mut take = |count: usize| -> Vec<Reg> { rest.by_ref().take(count).collect() };
    events.iter().map(|it| (take(it.restarted.len()), take(it.conditions.len()))).collect()
}

/// Comparisons in an order in which each one depends only on those before it, and the circular ones, which have no such order. `first` is the
/// argument of the first comparison.
fn ordered(switches: &[Tape], first: usize) -> (Vec<usize>, Vec<usize>) {
    let needs: Vec<Vec<usize>> = switches
        .iter()
        .map(|tape| {
            let ports = tape.ops.iter().filter_map(|op| if let Op::Input(port) = op { Some(port.0 as usize) } else { None });
            ports.filter(|port| (first..first + switches.len()).contains(port)).map(|port| port - first).collect()
        })
        .collect();
    // Everything that a comparison depends on, directly or through others.
    let reached = |from: usize| {
        let mut seen = vec![false; switches.len()];
        let mut open = needs[from].clone();
        while let Some(k) = open.pop() {
            if !std::mem::replace(&mut seen[k], true) {
                open.extend(&needs[k]);
            }
        }
        seen
    };
    let circular: Vec<usize> = (0..switches.len()).filter(|k| reached(*k)[*k]).collect();
    let mut direct: Vec<usize> = Vec::new();
    while direct.len() + circular.len() < switches.len() {
        let is_done = |k: &usize| direct.contains(k) || circular.contains(k);
        let next: Vec<usize> = (0..switches.len()).filter(|k| !is_done(k) && needs[*k].iter().all(&is_done)).collect();
        direct.extend(next);
    }
    (direct, circular)
}

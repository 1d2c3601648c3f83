//! The start of a plant as a program: compiled once for the names of the known variables, evaluated for any parameters and readings.
//!
//! In: a machine, the names of given and of recorded variables. Out: [`Starts`], which computes a [`Point`]. It never advances the time.

use rsm_core::source::{Fault, Faults};
use rsm_model::expression::{Id, Symbol};
use rsm_model::system::Iterated;

use super::computed::Computed;
use super::file::EquationFile;
use super::machine::{MOST_ITERATIONS, Machine, Point, has_converged};

/// A start whose bits continue to change is accepted after this number of iterations with changes no larger than rounding, because Newton's method
/// can alternate between two neighbouring numbers for ever. If the bits become constant, they do so one iteration after the digits are final.
const STABLE_ITERATIONS: usize = 3;

/// Whether two points of one instant differ only by rounding.
fn is_near(old: &Point, new: &Point) -> bool {
    let pairs = [(&old.states, &new.states), (&old.memories, &new.memories), (&old.guesses, &new.guesses)];
    old.held == new.held && pairs.iter().all(|(old, new)| has_converged(old, new))
}

/// The start of a machine, computed from known values.
#[derive(Debug, Clone)]
pub struct Starts {
    file: String,
    /// From parameters: start values of memories for which the text gives one, of iterated blocks, and of the unknowns that are iterated at the
    /// start.
    pub(super) first: Computed,
    /// For each memory value in `first`: the index of the memory.
    pub(super) memories: Vec<usize>,
    blocks: usize,
    /// From known values: solutions of the iterated unknowns, then states and memories.
    pub(super) program: Computed,
    /// Memories whose value before the start is an argument.
    pub(super) before: Vec<usize>,
    pub(super) iterated: usize,
    /// For each further result: the index of the state, or else of the memory.
    pub(super) places: Vec<(Option<usize>, Option<usize>)>,
    known: usize,
}

impl Machine {
    /// The program of the start if variables with these names are known. All `given` variables are used; `recorded` variables are used in their
    /// order, as long as a variable is undetermined.
    ///
    /// # Errors
    /// The start conditions are too many, contradict each other, or leave a variable undetermined.
    pub fn starts(&mut self, file: &EquationFile, given: &[String], recorded: &[String]) -> Result<Starts, Faults> {
        let find = |list: &[String]| -> Vec<Option<Symbol>> { list.iter().map(|it| self.system().find(it)).collect() };
        let all = [find(given), find(recorded)].concat();
        if let Some(name) = given.iter().chain(recorded).zip(&all).find(|it| it.1.is_none()).map(|it| it.0) {
            return Err(Faults::one(Fault::whole_file(&file.file, format!("the start: no variable is called `{name}`"))));
        }
        let symbols: Vec<Symbol> = all.into_iter().flatten().collect();
        let (own, further) = symbols.split_at(given.len());
        let start = self.solved_start(own, further)?;
        let system = self.system();
        let memories = system.memories();
        let begins: Vec<(usize, Id)> = memories
            .iter()
            .enumerate()
            .filter_map(|(k, memory)| Some((k, system.flat().variable(memory.variable).start?)))
            .collect();
        let begin = |list: &[Iterated]| -> Vec<Id> { list.iter().map(|it| it.start).collect() };
        let first: Vec<Id> =
            begins.iter().map(|it| it.1).chain(begin(system.iterated())).chain(begin(&start.iterated)).collect();
        let mut known: Vec<Symbol> = system.find("time").into_iter().collect();
        known.extend(system.inputs());
        known.extend(system.parameters());
        known.extend(system.switches().iter().map(|it| it.held));
        let before: Vec<usize> = (0..memories.len()).filter(|k| memories[*k].held != memories[*k].variable).collect();
        known.extend(before.iter().map(|k| memories[*k].before));
        known.extend(start.iterated.iter().map(|it| it.guess));
        known.extend(&symbols);
        let mut results: Vec<Id> = start.iterated.iter().map(|it| it.value).collect();
        results.extend(start.values.iter().map(|it| it.1));
        let places = start.values.iter().map(|(symbol, _)| {
            (system.states().iter().position(|it| it == symbol), memories.iter().position(|it| it.held == *symbol))
        });
        Ok(Starts {
            file: file.file.clone(),
            first: self.compiled(file, &system.parameters(), &first)?,
            memories: begins.into_iter().map(|it| it.0).collect(),
            blocks: system.iterated().len(),
            program: self.compiled(file, &known, &results)?,
            before,
            iterated: start.iterated.len(),
            places: places.collect(),
            known: symbols.len(),
        })
    }
}

impl Starts {
    /// The point at which a machine with its parameters starts. `inputs` are the inputs of the first row. `values` are the values of the given and
    /// then of the recorded variables, in the order of their names.
    ///
    /// # Errors
    /// The iteration of the start does not converge.
    ///
    /// # Panics
    /// If the number of values or of inputs differs from the number of names or inputs.
    pub fn at(&self, machine: &Machine, time: f64, inputs: &[f64], values: &[f64]) -> Result<Point, Faults> {
        self.solved(machine, time, inputs, values).map(|it| it.0)
    }

    /// The arguments of the program at a point.
    pub(super) fn arguments(&self, machine: &Machine, point: &Point, guesses: &[f64], values: &[f64]) -> Vec<f64> {
        let time = point.time;
        let mut arguments: Vec<f64> = machine.system().find("time").map(|_| time).into_iter().collect();
        for part in [&point.inputs[..], machine.values_of_parameters(), &point.held] {
            arguments.extend_from_slice(part);
        }
        arguments.extend(self.before.iter().map(|k| point.memories[*k]));
        arguments.extend_from_slice(guesses);
        arguments.extend_from_slice(values);
        arguments
    }

    /// The same as [`Starts::at`], with the solutions of the iterated unknowns.
    pub(super) fn solved(
        &self,
        machine: &Machine,
        time: f64,
        inputs: &[f64],
        values: &[f64],
    ) -> Result<(Point, Vec<f64>), Faults> {
        assert_eq!(values.len(), self.known, "one value for each name");
        let system = machine.system();
        let memories = system.memories().len();
        let parameters = machine.values_of_parameters();
        let first = self.first.values(parameters);
        let (begins, rest) = first.split_at(self.memories.len());
        let (blocks, guesses) = rest.split_at(self.blocks);
        let mut point = Point {
            time,
            states: vec![0.0; system.states().len()],
            inputs: machine.with_followers(inputs),
            held: vec![0.0; system.switches().len()],
            memories: vec![0.0; memories],
            guesses: blocks.to_vec(),
        };
        self.memories.iter().zip(begins).for_each(|(k, value)| point.memories[*k] = *value);
        let mut guesses = guesses.to_vec();
        // The start depends on comparisons and these depend on the start: a few iterations determine both, or the start is not found.
        let mut stable = 0;
        for _ in 0..MOST_ITERATIONS {
            let last = point.clone();
            let found = self.program.values(&self.arguments(machine, &point, &guesses, values));
            let moves = !has_converged(&guesses, &found);
            guesses.copy_from_slice(&found[..self.iterated]);
            for ((state, memory), value) in self.places.iter().zip(&found[self.iterated..]) {
                if let Some(k) = state {
                    point.states[*k] = *value;
                }
                if let Some(k) = memory {
                    point.memories[*k] = *value;
                }
            }
            machine.settle(&mut point);
            point.held = machine.rates_and_truths(&point).1;
            stable = if moves || !is_near(&last, &point) { 0 } else { stable + 1 };
            if stable == STABLE_ITERATIONS || point == last && !moves {
                return Ok((point, guesses));
            }
        }
        let what = "the start has no solution near the starts of the text: its equations do not settle";
        Err(Faults::one(
            Fault::whole_file(&self.file, what).help("give nearer starts under [initial], or `start = ...` in the text"),
        ))
    }
}

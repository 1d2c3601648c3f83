//! One step of an exponential Runge-Kutta method as a tape. The linear part is solved exactly, so only the remainder limits the step length.
//!
//! ```text
//! x' = f(x) = f0 + L (x - x0) + r:  D(1/2), D(1) = r at the middle and at the end, a = 4 D(1/2) - D(1), b = D(1) - a
//! x1 = x0 + h phi_1 f0 + 2 h phi_3 D(1) + h (phi_2 - 2 phi_3) a,  the last term is the estimate of the error
//! ```
//!
//! This is the exact solution if r is a parabola a s + b s^2 over the step. The order is 3 for any L (S. M. Cox, P. C. Matthews, "Exponential time
//! differencing for stiff systems", 2002, equations 23 to 25), and 4 if L is the Jacobian. The estimate is the difference from a method that has
//! order 3 only if L is the Jacobian (M. Hochbruck, A. Ostermann, "Exponential integrators", 2010, example 2.25), so it also shows when L is out of
//! date. But then it contains the slope g = h (J - L) f0 of r at the start of the step, with the Jacobian J there, which is no error of x1. The
//! better estimate h (phi_2 - 2 phi_3) (a - g) does not contain it. It needs a derivative of the rates along f0, so it is computed only if the first
//! estimate is too large.
//!
//! In: the tape of the rates, and the dependencies of each derivative. Out: the tape, and the slots of the matrices that it uses. A
//! rate whose derivatives depend only on parameters and held comparisons has no remainder, so its columns of the last two terms are omitted. This
//! file never decides whether a step is valid.

use rsm_core::held;
use rsm_core::number::{exact, integer};
use rsm_core::series::Argument;
use rsm_core::tangent;
use rsm_core::tape::{Op, Reg, Tape, TapeBuilder};

use super::part::{MOST_STATES, Part};
use super::phi::{by_stride, times};
use super::placed::Placed;
use crate::code::{Slot, Work, vectorised};

/// The slots of the matrices of a step, and of its results.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    states: usize,
    begin: Slot,
}

/// The number of matrices of a block, each stored column by column.
const MATRICES: usize = 5;
/// The number of vectors for the dependence on time; after them comes half the step length.
const TIMES: usize = 4;
/// Groups of results of a step: the states after it, the error, the rates at the start, a, D(1), the hidden change.
const OF_STEP: usize = 6;
/// Further groups: the two changes of the end in [`confirmed`].
const RESULTS: usize = OF_STEP + 2;

impl Block {
    pub(super) fn new(states: usize, begin: Slot) -> Block {
        Block { states, begin }
    }

    /// The number of slots of the block.
    pub(super) fn slots(&self) -> usize {
        let n = self.states;
        if n > MOST_STATES { 0 } else { MATRICES * n * n + (TIMES + RESULTS) * n + 1 }
    }

    /// The slot of an entry of a matrix: h/2 phi_1 of the half, h phi_1, 2 h phi_3, h (phi_2 - 2 phi_3), the Jacobian.
    pub(super) fn matrix(&self, place: usize, i: usize, j: usize) -> usize {
        self.begin as usize + (place * self.states + j) * self.states + i
    }

    /// The slot of the dependence on time: (h/2)^2 phi_2 of the half and h^2 phi_2 times the derivative of the rates, h/2 and h times it.
    pub(super) fn time(&self, place: usize, i: usize) -> usize {
        self.begin as usize + MATRICES * self.states * self.states + place * self.states + i
    }

    fn half_step(&self) -> usize {
        self.time(TIMES, 0)
    }

    /// The slot of the first state in a group of results.
    fn result(&self, place: usize) -> usize {
        self.half_step() + 1 + place * self.states
    }

    pub(super) fn end(&self) -> usize {
        self.result(0)
    }

    pub(super) fn error(&self) -> usize {
        self.result(1)
    }

    /// Rates at the start, a, D(1): from these the solution inside of the step is computed.
    pub(super) fn inside(&self) -> [usize; 3] {
        [self.result(2), self.result(3), self.result(4)]
    }

    /// The hidden change: h (4 D(1/2) + D(1))/6, the integral of the remainder by Simpson's rule, minus the change of the end by the remainder.
    pub(super) fn hidden(&self) -> usize {
        self.result(5)
    }

    /// The next and the last change of the end, by [`confirmed`].
    pub(super) fn changes(&self) -> [usize; 2] {
        [self.result(OF_STEP), self.result(OF_STEP + 1)]
    }

    /// All slots of the linear part.
    pub(super) fn loaded(&self) -> std::ops::Range<usize> {
        self.begin as usize..self.half_step() + 1
    }

    /// Copies the matrices of a linear part, for a step of a level, into the slots of a lane. The level and the next one must be computed.
    pub(super) fn load<const L: usize>(&self, slots: &mut [[f64; L]], lane: usize, part: &Part, level: usize) {
        by_stride!(self.states, S => vectorised(Load::<S, L> { block: self, slots, lane, part, level }));
    }
}

/// A copy of a linear part into the slots of a lane.
struct Load<'a, const S: usize, const L: usize> {
    block: &'a Block,
    slots: &'a mut [[f64; L]],
    lane: usize,
    part: &'a Part,
    level: usize,
}

impl<const S: usize, const L: usize> Work for Load<'_, S, L> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Load { block, slots, lane, part, level } = self;
        let n = block.states;
        let h = part.length_of(level);
        let ([one, two, three], [half, half_two, _]) = (part.chain.at::<S>(level), part.chain.at(level + 1));
        for ((matrix, factor), place) in [(half, 0.5 * h), (one, h), (part.columns(), 1.0)].into_iter().zip([0, 1, 4]) {
            for (j, column) in matrix.iter().enumerate() {
                put(slots, lane, block.matrix(place, 0, j), &column.map(|it| factor * it)[..n]);
            }
        }
        for j in part.chain.columns().iter().copied() {
            let (two, three) = (&two[j], &three[j]);
            put(slots, lane, block.matrix(2, 0, j), &three.map(|it| 2.0 * h * it)[..n]);
            let off: [f64; S] = std::array::from_fn(|i| h * (two[i] - 2.0 * three[i]));
            put(slots, lane, block.matrix(3, 0, j), &off[..n]);
        }
        let by_time: &[f64; S] = part.by_time.first_chunk().expect("as many as a column has");
        let vectors = [
            times(half_two, by_time).map(|it| 0.25 * h * h * it),
            times(two, by_time).map(|it| h * h * it),
            by_time.map(|it| 0.5 * h * it),
            by_time.map(|it| h * it),
        ];
        for (place, values) in vectors.iter().enumerate() {
            put(slots, lane, block.time(place, 0), &values[..n]);
        }
        slots[block.half_step()][lane] = 0.5 * h;
    }
}

/// Writes values into the slots of a lane, from slot `begin`.
#[inline(always)]
fn put<const L: usize>(slots: &mut [[f64; L]], lane: usize, begin: usize, values: &[f64]) {
    slots[begin..begin + values.len()].iter_mut().zip(values).for_each(|(slot, value)| slot[lane] = *value);
}

/// The inputs from which the tape is written.
pub(super) struct StepInputs<'a> {
    /// The rates, and the kind and slot of each of their arguments.
    pub rates: &'a Tape,
    pub arguments: &'a [Argument],
    /// The derivatives of the rates with respect to each state, row by row, then with respect to the time; and which of their arguments are
    /// parameters or held comparisons.
    pub slopes: &'a Tape,
    pub is_fixed: &'a [bool],
    pub step: Slot,
    pub block: Block,
}

/// The number of sums that are computed side by side.
const SIDE_BY_SIDE: usize = 8;

/// The writer of the tape.
struct Writer<'a> {
    given: &'a StepInputs<'a>,
    builder: TapeBuilder,
    slots: Vec<Slot>,
}

impl Writer<'_> {
    fn slot(&mut self, slot: usize) -> Reg {
        let port = self.slots.iter().position(|it| *it == slot as Slot).unwrap_or_else(|| {
            self.slots.push(slot as Slot);
            self.slots.len() - 1
        });
        self.builder.input(port as u32)
    }

    /// The product of a row of a matrix and a sparse vector.
    fn line(&mut self, matrix: usize, i: usize, by: &[(usize, Reg)]) -> Option<Reg> {
        self.lines(matrix, &[i], by)[0]
    }

    /// The products of some rows of a matrix and a sparse vector, column by column: the sums do not wait for each other.
    fn lines(&mut self, matrix: usize, rows: &[usize], by: &[(usize, Reg)]) -> Vec<Option<Reg>> {
        let mut sums = vec![None; rows.len()];
        for (sums, rows) in sums.chunks_mut(SIDE_BY_SIDE).zip(rows.chunks(SIDE_BY_SIDE)) {
            for (j, value) in by {
                for (sum, i) in sums.iter_mut().zip(rows) {
                    let entry = self.slot(self.given.block.matrix(matrix, *i, *j));
                    let product = self.builder.multiply(entry, *value);
                    *sum = Some(self.plus(*sum, product));
                }
            }
        }
        sums
    }

    /// The remainder of a rate: its change without that of the linear part. `lists`: the rates at moved states, half a step or a whole step later,
    /// the rates at the start, and by how much each state moved.
    fn remainder(&mut self, shape: &Shape, i: usize, lists: [&[Reg]; 3], half: bool) -> Reg {
        let [found, rates, moved] = lists;
        let mut left = self.builder.subtract(found[i], rates[i]);
        let by: Vec<(usize, Reg)> = shape.nonzero[i].iter().map(|j| (*j, moved[*j])).collect();
        if let Some(linear) = self.line(4, i, &by) {
            left = self.builder.subtract(left, linear);
        }
        if shape.timed.contains(&i) {
            let time = self.slot(self.given.block.time(if half { 2 } else { 3 }, i));
            left = self.builder.subtract(left, time);
        }
        left
    }

    fn plus(&mut self, sum: Option<Reg>, value: Reg) -> Reg {
        match sum {
            Some(sum) => self.builder.add(sum, value),
            None => value,
        }
    }
}

/// Which derivatives of the rates exist, and which of them change during a run.
#[derive(Debug)]
pub(super) struct Shape {
    /// For each rate: the states that it depends on.
    nonzero: Vec<Vec<usize>>,
    /// The rates that have a remainder.
    pub bent: Vec<usize>,
    /// The rates that depend on time.
    pub timed: Vec<usize>,
}

impl Shape {
    pub(super) fn new(given: &StepInputs<'_>) -> Shape {
        let n = given.block.states;
        let fixed = held::of_held(given.slopes, given.is_fixed);
        let is_zero = |reg: Reg| matches!(&given.slopes.ops[reg.0 as usize], Op::Constant(it) if it.value == 0.0);
        let entry = |i: usize, j: usize| given.slopes.outputs[i * n + j].reg;
        let by_time = |i: usize| given.slopes.outputs.get(n * n + i).map(|it| it.reg).filter(|it| !is_zero(*it));
        let changes = |i: &usize| (0..n).map(|j| entry(*i, j)).chain(by_time(*i)).any(|reg| !fixed[reg.0 as usize]);
        Shape {
            nonzero: (0..n).map(|i| (0..n).filter(|j| !is_zero(entry(i, *j))).collect()).collect(),
            bent: (0..n).filter(changes).collect(),
            timed: (0..n).filter(|i| by_time(*i).is_some()).collect(),
        }
    }

    /// The columns in which a step reads phi_2 and phi_3: those of the rates that are not linear or depend on time.
    pub(super) fn columns(&self) -> Vec<usize> {
        let mut columns: Vec<usize> = self.bent.iter().chain(&self.timed).copied().collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }
}

/// The step of a system with states.
pub(super) fn step(given: &StepInputs<'_>) -> Placed {
    write(given, &Shape::new(given), true)
}

/// The step for its derivatives: without the estimate of the error, whose derivative nothing needs.
pub(super) fn without_estimate(given: &StepInputs<'_>, shape: &Shape) -> Placed {
    write(given, shape, false)
}

/// A better estimate of the error of the last step, from its start, its rates there and its a. For a linear part from an earlier point, a contains
/// the slope that the remainder has at the start of the step. The step takes this slope into account, so it is no error: it is subtracted.
pub(super) fn refined(given: &StepInputs<'_>) -> Placed {
    let Shape { nonzero, bent, timed } = &Shape::new(given);
    let (n, block) = (given.block.states, given.block);
    let mut w = Writer { given, builder: TapeBuilder::sharing(given.rates.precision), slots: Vec::new() };
    let start: Vec<Reg> = given.arguments.iter().map(|it| w.slot(slot_of(it) as usize)).collect();
    let [rates, a, _] = block.inside();
    let rates: Vec<Reg> = (0..n).map(|i| w.slot(rates + i)).collect();
    let a: Vec<Reg> = bent.iter().map(|i| w.slot(a + i)).collect();
    // The derivative of the rates with respect to time, along the solution.
    let (mut ports, mut speeds) = (Vec::new(), Vec::new());
    for (port, argument) in given.arguments.iter().enumerate() {
        let speed = match argument {
            Argument::Held(_) => continue,
            Argument::Time(_) => w.builder.constant(integer(1)),
            Argument::State(_, k) => rates[*k],
        };
        ports.push(port);
        speeds.push(speed);
    }
    let along = w.builder.inline(&tangent::along(given.rates, &ports), &[start, speeds].concat());
    let half = w.slot(block.half_step());
    let length = w.builder.add(half, half);
    let left: Vec<(usize, Reg)> = bent
        .iter()
        .zip(a)
        .map(|(i, a)| {
            let by: Vec<(usize, Reg)> = nonzero[*i].iter().map(|j| (*j, rates[*j])).collect();
            let slope = w.line(4, *i, &by).map_or(along[*i], |linear| w.builder.subtract(along[*i], linear));
            let mut slope = w.builder.multiply(length, slope);
            if timed.contains(i) {
                let time = w.slot(block.time(3, *i));
                slope = w.builder.subtract(slope, time);
            }
            (*i, w.builder.subtract(a, slope))
        })
        .collect();
    let zero = w.builder.constant(integer(0));
    let errors = (0..n).map(|i| (format!("r{i}"), w.line(3, i, &left).unwrap_or(zero))).collect::<Vec<_>>();
    let inputs = (0..w.slots.len()).map(|k| format!("a{k}")).collect();
    let tape = w.builder.finish_with_results("refined", inputs, errors, [] as [(String, Reg); 0]);
    Placed { tape, arguments: w.slots, results: (0..n).map(|i| (block.error() + i) as Slot).collect() }
}

/// How much the end of the last step would change if D(1) were evaluated there, and how much it changed since D(1) was evaluated.
///
/// A step evaluates the remainder at points that it computed with a smaller part of the remainder. If the remainder changes the end little, these
/// points are right. A linear part that is stiff where the plant is stiff no more holds the states near its own rest, and both functions phi make the
/// estimate of the error small. Then the second change is as large as the first: the iteration that the step begins does not converge.
pub(super) fn confirmed(given: &StepInputs<'_>) -> Placed {
    let shape = &Shape::new(given);
    let Shape { bent, timed, .. } = shape;
    let (n, block) = (given.block.states, given.block);
    let mut w = Writer { given, builder: TapeBuilder::sharing(given.rates.precision), slots: Vec::new() };
    let [rates, a, last] = block.inside();
    let rates: Vec<Reg> = (0..n).map(|i| w.slot(rates + i)).collect();
    let ends: Vec<Reg> = (0..n).map(|i| w.slot(block.end() + i)).collect();
    let mut moved = ends.clone();
    let mut arguments = Vec::with_capacity(given.arguments.len());
    for argument in given.arguments {
        let start = w.slot(slot_of(argument) as usize);
        arguments.push(match argument {
            Argument::Held(_) => start,
            Argument::Time(_) => {
                let step = w.slot(given.step as usize);
                w.builder.add(start, step)
            }
            Argument::State(_, k) => {
                moved[*k] = w.builder.subtract(ends[*k], start);
                ends[*k]
            }
        });
    }
    let found = w.builder.inline(given.rates, &arguments);
    let (mut straight, mut changes) = (rates.iter().copied().enumerate().collect::<Vec<_>>(), Vec::new());
    let half = w.builder.constant(exact(0.5));
    for i in bent {
        let left = w.remainder(shape, *i, [&found, &rates, &moved], false);
        let [a, last] = [a, last].map(|group| w.slot(group + i));
        changes.push((*i, w.builder.subtract(left, last)));
        // D(1) was evaluated where the rates at the start and twice D(1/2), which is (a + D(1))/4, lead.
        let sum = w.builder.add(a, last);
        let twice = w.builder.multiply(half, sum);
        straight[*i].1 = w.builder.add(rates[*i], twice);
    }
    let rows: Vec<usize> = (0..n).collect();
    let [by_last, by_slope, there] =
        [(2, &changes), (3, &changes), (1, &straight)].map(|(matrix, by)| w.lines(matrix, &rows, by));
    let zero = w.builder.constant(integer(0));
    let mut results = vec![zero; 2 * n];
    for i in 0..n {
        if let Some((last, slope)) = by_last[i].zip(by_slope[i]) {
            results[i] = w.builder.subtract(last, slope);
        }
        let mut there = there[i].unwrap_or(zero);
        if !timed.is_empty() {
            let time = w.slot(block.time(1, i));
            there = w.builder.add(there, time);
        }
        results[n + i] = w.builder.subtract(moved[i], there);
    }
    let named = results.iter().enumerate().map(|(k, reg)| (format!("r{k}"), *reg)).collect::<Vec<_>>();
    let inputs = (0..w.slots.len()).map(|k| format!("a{k}")).collect();
    let tape = w.builder.finish_with_results("confirmed", inputs, named, [] as [(String, Reg); 0]);
    let places = block.changes().into_iter().flat_map(|begin| (0..n).map(move |i| (begin + i) as Slot)).collect();
    Placed { tape, arguments: w.slots, results: places }
}

/// The slot of an argument of the rates.
fn slot_of(argument: &Argument) -> Slot {
    match argument {
        Argument::Held(slot) | Argument::Time(slot) | Argument::State(slot, _) => *slot,
    }
}

/// Writes the tape of a step.
fn write(given: &StepInputs<'_>, shape: &Shape, has_estimate: bool) -> Placed {
    let n = given.block.states;
    let Shape { nonzero, bent, timed } = shape;
    let mut w = Writer { given, builder: TapeBuilder::sharing(given.rates.precision), slots: Vec::new() };
    let start: Vec<Reg> = given.arguments.iter().map(|it| w.slot(slot_of(it) as usize)).collect();
    let mut states = vec![None; n];
    for (argument, reg) in given.arguments.iter().zip(&start) {
        if let Argument::State(_, rate) = argument {
            states[*rate] = Some(*reg);
        }
    }
    let states: Vec<Reg> = states.into_iter().flatten().collect();
    let rates = w.builder.inline(given.rates, &start);
    let rows: Vec<usize> = (0..n).collect();
    let all: Vec<(usize, Reg)> = rates.iter().copied().enumerate().collect();
    // The remainder of these rates at the moved states, half a step or a whole step later.
    let remainder = |w: &mut Writer<'_>, moved: &[Reg], half: bool| -> Vec<(usize, Reg)> {
        let arguments: Vec<Reg> = given
            .arguments
            .iter()
            .zip(&start)
            .map(|(argument, reg)| match argument {
                Argument::Held(_) => *reg,
                Argument::Time(_) => {
                    let step = w.slot(if half { given.block.half_step() } else { given.step as usize });
                    w.builder.add(*reg, step)
                }
                Argument::State(_, k) => w.builder.add(*reg, moved[*k]),
            })
            .collect();
        let found = w.builder.inline(given.rates, &arguments);
        bent.iter().map(|i| (*i, w.remainder(shape, *i, [&found, &rates, moved], half))).collect()
    };
    let zero = w.builder.constant(integer(0));
    // The way to the middle or to the end, without the remainder; 0 for states that are not asked for.
    let moved = |w: &mut Writer<'_>, half: bool, is_wanted: &dyn Fn(usize) -> bool| -> Vec<Reg> {
        let wanted: Vec<usize> = (0..n).filter(|i| is_wanted(*i)).collect();
        let sums = w.lines(usize::from(!half), &wanted, &all);
        let mut moved = vec![zero; n];
        for (i, sum) in wanted.into_iter().zip(sums) {
            let sum = sum.expect("a system with states has rates");
            moved[i] = if timed.is_empty() {
                sum
            } else {
                let time = w.slot(given.block.time(usize::from(!half), i));
                w.builder.add(sum, time)
            };
        }
        moved
    };
    let straight = moved(&mut w, false, &|_| true);
    let mut end: Vec<Reg> = straight.clone();
    let (mut error, mut a, mut last, mut hidden) = (vec![zero; n], vec![zero; n], vec![zero; n], vec![zero; n]);
    if !bent.is_empty() {
        let middle = moved(&mut w, true, &|k| bent.iter().any(|i| nonzero[*i].contains(&k)));
        let at_middle = remainder(&mut w, &middle, true);
        let two = w.builder.constant(integer(2));
        let four = w.builder.constant(exact(4.0));
        let doubled: Vec<(usize, Reg)> = at_middle.iter().map(|(i, it)| (*i, w.builder.multiply(two, *it))).collect();
        let further = w.lines(1, &rows, &doubled);
        let there: Vec<Reg> = straight
            .iter()
            .zip(further)
            .map(|(straight, it)| it.map_or(*straight, |it| w.builder.add(*straight, it)))
            .collect();
        let at_end = remainder(&mut w, &there, false);
        let slopes: Vec<(usize, Reg)> = at_middle
            .iter()
            .zip(&at_end)
            .map(|((i, middle), (_, end))| {
                let four = w.builder.multiply(four, *middle);
                (*i, w.builder.subtract(four, *end))
            })
            .collect();
        let (bents, offs) = (w.lines(2, &rows, &at_end), w.lines(3, &rows, &slopes));
        for (i, (bent, off)) in bents.into_iter().zip(offs).enumerate() {
            if let Some((bent, off)) = bent.zip(off) {
                error[i] = off;
                let sum = w.builder.add(bent, off);
                end[i] = w.builder.add(end[i], sum);
                hidden[i] = sum;
            }
        }
        if has_estimate {
            let step = w.slot(given.step as usize);
            let sixth = w.builder.constant(exact(1.0 / 6.0));
            let sixth = w.builder.multiply(sixth, step);
            let integrals: Vec<(usize, Reg)> = (at_middle.iter().zip(&at_end))
                .map(|((i, middle), (_, end))| {
                    let middle = w.builder.multiply(four, *middle);
                    let sum = w.builder.add(middle, *end);
                    (*i, w.builder.multiply(sixth, sum))
                })
                .collect();
            let changed = std::mem::replace(&mut hidden, vec![zero; n]);
            for (i, integral) in integrals {
                hidden[i] = w.builder.subtract(integral, changed[i]);
            }
        }
        slopes.iter().for_each(|(i, it)| a[*i] = *it);
        at_end.iter().for_each(|(i, it)| last[*i] = *it);
    }
    let end: Vec<Reg> = end.iter().zip(&states).map(|(moved, state)| w.builder.add(*state, *moved)).collect();
    let results = [end, error, rates.clone(), a, last, hidden];
    let groups: Vec<usize> = (0..OF_STEP).filter(|place| ![1, 5].contains(place) || has_estimate).collect();
    let places: Vec<Slot> = groups
        .iter()
        .flat_map(|place| (0..n).map(move |i| (*place, i)))
        .map(|(place, i)| (given.block.result(place) + i) as Slot)
        .collect();
    let named = groups.iter().flat_map(|place| &results[*place]).copied().enumerate().map(|(k, reg)| (format!("r{k}"), reg));
    let inputs = (0..w.slots.len()).map(|k| format!("a{k}")).collect();
    let tape = w.builder.finish_with_results("exponential", inputs, named, [] as [(String, Reg); 0]);
    Placed { tape, arguments: w.slots, results: places }
}

//! One step of an exponential Runge-Kutta method as a tape: what is linear is solved exactly, so only what is not asks for small steps.
//!
//! ```text
//! x' = f(x) = f0 + L (x - x0) + r:  D(1/2), D(1) = r at the middle and at the end, a = 4 D(1/2) - D(1), b = D(1) - a
//! x1 = x0 + h phi_1 f0 + 2 h phi_3 D(1) + h (phi_2 - 2 phi_3) a,  the last term is the estimate of the error
//! ```
//!
//! That is the solution when r is a parabola a s + b s^2 over the step: order 3 whatever L is (S. M. Cox, P. C. Matthews, "Exponential time differencing for stiff systems", 2002, equations 23 to 25), and 4 where L is the
//! Jacobian. The estimate is the difference from a method of order 3 for the Jacobian alone (M. Hochbruck, A. Ostermann, "Exponential integrators", 2010, example 2.25), so it also tells when L is too old.
//!
//! In: the tape of the rates, what each derivative depends on. Out: [`Exponential`]: the tape, which matrices it reads in which slots. A rate whose derivatives depend on parameters and held comparisons alone has no
//! remainder: its columns of the last two terms fall away. Never judges a step.

use rsm_core::held;
use rsm_core::number::{exact, integer};
use rsm_core::series::Argument;
use rsm_core::tape::{Op, Reg, Tape, TapeBuilder};

use super::phi::{Chain, stride};
use crate::code::{Code, Slot, Way};

/// States at most: the matrices of more cost more than small steps.
pub(super) const MOST_STATES: usize = 24;

/// Where the matrices of a step stand, and its results.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    states: usize,
    begin: Slot,
}

/// Matrices of a block, each row by row.
const MATRICES: usize = 5;
/// Vectors of what the time does, then half a step.
const TIMES: usize = 4;
/// Results: the states behind the step, the error, the rates at the start, a, D(1).
const RESULTS: usize = 5;

impl Block {
    pub(super) fn new(states: usize, begin: Slot) -> Block {
        Block { states, begin }
    }

    /// Slots that it takes.
    pub(super) fn slots(&self) -> usize {
        let n = self.states;
        if n > MOST_STATES { 0 } else { MATRICES * n * n + (TIMES + RESULTS) * n + 1 }
    }

    fn matrix(&self, place: usize, i: usize, j: usize) -> usize {
        self.begin as usize + (place * self.states + i) * self.states + j
    }

    fn time(&self, place: usize, i: usize) -> usize {
        self.begin as usize + MATRICES * self.states * self.states + place * self.states + i
    }

    fn half_step(&self) -> usize {
        self.time(TIMES, 0)
    }

    /// The slot of a result of the first state.
    fn result(&self, place: usize) -> usize {
        self.half_step() + 1 + place * self.states
    }

    pub(super) fn end(&self) -> usize {
        self.result(0)
    }

    pub(super) fn error(&self) -> usize {
        self.result(1)
    }

    /// Rates at the start, a, D(1): what the solution inside of the step is made of.
    pub(super) fn inside(&self) -> [usize; 3] {
        [self.result(2), self.result(3), self.result(4)]
    }

    /// All slots that belong to the linear part.
    pub(super) fn loaded(&self) -> std::ops::Range<usize> {
        self.begin as usize..self.half_step() + 1
    }

    /// Puts the matrices of a linear part for a step of a level in the place of a lane.
    pub(super) fn load<const L: usize>(&self, slots: &mut [[f64; L]], lane: usize, part: &Part, level: usize) {
        let (n, row) = (self.states, stride(self.states));
        let h = part.length_of(level);
        let ([one, two, three], [half, half_two, _]) = (part.chain.at(level), part.chain.at(level + 1));
        let shares = [(half, 0.5 * h), (one, h), (three, 2.0 * h)];
        let linear = part.linear.chunks_exact(n);
        for (i, linear) in linear.enumerate() {
            let of = i * row..i * row + n;
            for (place, (matrix, factor)) in shares.iter().enumerate() {
                put(slots, lane, self.matrix(place, i, 0), matrix[of.clone()].iter().map(|it| factor * it));
            }
            let off = two[of.clone()].iter().zip(&three[of]).map(|(two, three)| h * (two - 2.0 * three));
            put(slots, lane, self.matrix(3, i, 0), off);
            put(slots, lane, self.matrix(4, i, 0), linear.iter().copied());
            let moved =
                |matrix: &[f64], h: f64| -> f64 { h * h * (0..n).map(|j| matrix[i * row + j] * part.by_time[j]).sum::<f64>() };
            let times = [moved(half_two, 0.5 * h), moved(two, h), 0.5 * h * part.by_time[i], h * part.by_time[i]];
            for (place, value) in times.into_iter().enumerate() {
                slots[self.time(place, i)][lane] = value;
            }
        }
        slots[self.half_step()][lane] = 0.5 * h;
    }
}

/// A linear part with its functions over a span.
#[derive(Debug, Clone, Default)]
pub(super) struct Part {
    /// Comparisons as they were held.
    pub held: Vec<f64>,
    /// The span.
    pub length: f64,
    /// The Jacobian, row by row.
    pub linear: Vec<f64>,
    /// The derivative of the rates by the time.
    pub by_time: Vec<f64>,
    pub chain: Chain,
    /// Its number in the run of its lane.
    pub version: u64,
    /// When it was used last.
    pub used: u64,
}

impl Part {
    /// The length of a step of a level.
    pub(super) fn length_of(&self, level: usize) -> f64 {
        self.length * 0.5_f64.powi(level as i32)
    }

    /// L y
    fn times(&self, y: &[f64], to: &mut [f64]) {
        for (to, row) in to.iter_mut().zip(self.linear.chunks_exact(y.len())) {
            *to = line(row, y);
        }
    }

    /// From one share of a step of a level to a later one, on the solution for a remainder a s + b s^2: `y` is what the states have moved by; `forcing` is, for each
    /// state, the rate at the start of the step, a, D(1). Exact but for rounding.
    pub(super) fn within(&self, level: usize, (from, to): (f64, f64), forcing: &[[f64; 3]], y: &mut [f64]) {
        let n = y.len();
        let h = self.length_of(level);
        let mut at = from;
        let mut space = [[0.0; MOST_STATES]; 3];
        let [v, first, second] = &mut space;
        let (v, first, second) = (&mut v[..n], &mut first[..n], &mut second[..n]);
        let mut share = 1.0;
        for deeper in 1..self.chain.levels() - level {
            share *= 0.5;
            if at + share > to {
                continue;
            }
            self.forced(forcing, (h, at, share), y, [v, first, second]);
            let ([one, two, three], length, row) = (self.chain.at(level + deeper), h * share, stride(n));
            for (i, y) in y.iter_mut().enumerate() {
                let of = |matrix: &[f64], by: &[f64]| line(&matrix[i * row..i * row + n], by);
                *y += length * (of(one, v) + of(two, first) + 2.0 * of(three, second));
            }
            at += share;
        }
        let share = to - at;
        if share <= 0.0 {
            return;
        }
        // What is left is so short that the series of the exponential falls by a factor of 2 k a term. It ends where a term is rounded away.
        self.forced(forcing, (h, at, share), y, [v, first, second]);
        let length = h * share;
        v.iter_mut().for_each(|it| *it *= length);
        let mut moved = [0.0; MOST_STATES];
        let moved = &mut moved[..n];
        for k in 1..=TAYLOR {
            let mut moves = false;
            for (y, term) in y.iter_mut().zip(&*v) {
                let next = *y + term;
                moves |= next != *y;
                *y = next;
            }
            // Terms 1 to 3 bring the forcing.
            if !moves && k > 3 {
                return;
            }
            self.times(v, moved);
            for i in 0..n {
                let forcing = match k {
                    1 => first[i],
                    2 => second[i],
                    _ => 0.0,
                };
                v[i] = length * (moved[i] + forcing) / (k + 1) as f64;
            }
        }
    }

    /// At a share of a step of length h: the rates, and the first and second derivative of what forces them, over a share from there.
    fn forced(&self, forcing: &[[f64; 3]], (h, at, share): (f64, f64, f64), y: &[f64], [v, first, second]: [&mut [f64]; 3]) {
        self.times(y, v);
        for (i, [rate, a, end]) in forcing.iter().enumerate() {
            let b = end - a;
            let slope = a + h * self.by_time[i];
            v[i] += rate + (slope + b * at) * at;
            (first[i], second[i]) = ((slope + 2.0 * b * at) * share, b * share * share);
        }
    }
}

/// Puts values into the slots of a lane, from one on.
fn put<const L: usize>(slots: &mut [[f64; L]], lane: usize, begin: usize, values: impl Iterator<Item = f64>) {
    slots[begin..].iter_mut().zip(values).for_each(|(slot, value)| slot[lane] = value);
}

fn line(row: &[f64], by: &[f64]) -> f64 {
    row.iter().zip(by).fold(0.0, |sum, (a, b)| sum + a * b)
}

/// Terms of the series behind the last level.
const TAYLOR: usize = 18;

/// The step as code.
#[derive(Debug)]
pub(super) struct Exponential {
    pub code: Code,
}

/// What the tape is made of.
pub(super) struct Given<'a> {
    /// The rates, and where each argument of theirs stands.
    pub rates: &'a Tape,
    pub arguments: &'a [Argument],
    /// The derivatives of the rates by each state, row by row, then by the time; which of its arguments are parameters or held comparisons.
    pub slopes: &'a Tape,
    pub is_fixed: &'a [bool],
    pub step: Slot,
    pub block: Block,
}

/// The writer of the tape.
struct Writer<'a> {
    given: &'a Given<'a>,
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

    /// The sum of the products of a row of a matrix and some numbers.
    fn line(&mut self, matrix: usize, i: usize, by: &[(usize, Reg)]) -> Option<Reg> {
        let mut sum = None;
        for (j, value) in by {
            let entry = self.slot(self.given.block.matrix(matrix, i, *j));
            let product = self.builder.multiply(entry, *value);
            sum = Some(self.plus(sum, product));
        }
        sum
    }

    fn plus(&mut self, sum: Option<Reg>, value: Reg) -> Reg {
        match sum {
            Some(sum) => self.builder.add(sum, value),
            None => value,
        }
    }
}

impl Exponential {
    /// The step of a system with states.
    pub(super) fn new(given: &Given<'_>, lanes: usize, way: Way) -> Exponential {
        let n = given.block.states;
        let fixed = held::of_held(given.slopes, given.is_fixed);
        let is_zero = |reg: Reg| matches!(&given.slopes.ops[reg.0 as usize], Op::Constant(it) if it.value == 0.0);
        let entry = |i: usize, j: usize| given.slopes.outputs[i * n + j].reg;
        let by_time = |i: usize| given.slopes.outputs.get(n * n + i).map(|it| it.reg).filter(|it| !is_zero(*it));
        let nonzero: Vec<Vec<usize>> = (0..n).map(|i| (0..n).filter(|j| !is_zero(entry(i, *j))).collect()).collect();
        // The rates that have a remainder.
        let bent: Vec<usize> =
            (0..n).filter(|i| (0..n).map(|j| entry(*i, j)).chain(by_time(*i)).any(|reg| !fixed[reg.0 as usize])).collect();
        let has_time = (0..n).any(|i| by_time(i).is_some());
        let mut w = Writer { given, builder: TapeBuilder::sharing(given.rates.precision), slots: Vec::new() };
        let slots: Vec<Slot> = given
            .arguments
            .iter()
            .map(|it| match it {
                Argument::Held(slot) | Argument::Time(slot) | Argument::State(slot, _) => *slot,
            })
            .collect();
        let start: Vec<Reg> = slots.iter().map(|slot| w.slot(*slot as usize)).collect();
        let mut states = vec![None; n];
        for (argument, reg) in given.arguments.iter().zip(&start) {
            if let Argument::State(_, rate) = argument {
                states[*rate] = Some(*reg);
            }
        }
        let states: Vec<Reg> = states.into_iter().flatten().collect();
        let rates = w.builder.inline(given.rates, &start);
        let all: Vec<(usize, Reg)> = rates.iter().copied().enumerate().collect();
        // The remainder of the bent rates where the states have moved, a share of the step later.
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
            bent.iter()
                .map(|i| {
                    let mut left = w.builder.subtract(found[*i], rates[*i]);
                    let by: Vec<(usize, Reg)> = nonzero[*i].iter().map(|j| (*j, moved[*j])).collect();
                    if let Some(linear) = w.line(4, *i, &by) {
                        left = w.builder.subtract(left, linear);
                    }
                    if by_time(*i).is_some() {
                        let time = w.slot(given.block.time(if half { 2 } else { 3 }, *i));
                        left = w.builder.subtract(left, time);
                    }
                    (*i, left)
                })
                .collect()
        };
        let moved = |w: &mut Writer<'_>, half: bool| -> Vec<Reg> {
            (0..n)
                .map(|i| {
                    let sum = w.line(usize::from(!half), i, &all).expect("a system with states has rates");
                    if !has_time {
                        return sum;
                    }
                    let time = w.slot(given.block.time(usize::from(!half), i));
                    w.builder.add(sum, time)
                })
                .collect()
        };
        let straight = moved(&mut w, false);
        let mut end: Vec<Reg> = straight.clone();
        let zero = w.builder.constant(integer(0));
        let (mut error, mut a, mut last) = (vec![zero; n], vec![zero; n], vec![zero; n]);
        if !bent.is_empty() {
            let middle = moved(&mut w, true);
            let at_middle = remainder(&mut w, &middle, true);
            let two = w.builder.constant(integer(2));
            let four = w.builder.constant(exact(4.0));
            let doubled: Vec<(usize, Reg)> = at_middle.iter().map(|(i, it)| (*i, w.builder.multiply(two, *it))).collect();
            let there: Vec<Reg> = (0..n)
                .map(|i| {
                    let further = w.line(1, i, &doubled);
                    further.map_or(straight[i], |it| w.builder.add(straight[i], it))
                })
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
            for i in 0..n {
                let (bent, off) = (w.line(2, i, &at_end), w.line(3, i, &slopes));
                if let Some((bent, off)) = bent.zip(off) {
                    error[i] = off;
                    let sum = w.builder.add(bent, off);
                    end[i] = w.builder.add(end[i], sum);
                }
            }
            slopes.iter().for_each(|(i, it)| a[*i] = *it);
            at_end.iter().for_each(|(i, it)| last[*i] = *it);
        }
        let end: Vec<Reg> = end.iter().zip(&states).map(|(moved, state)| w.builder.add(*state, *moved)).collect();
        let results = [end, error, rates.clone(), a, last];
        let places: Vec<Slot> = (0..RESULTS)
            .flat_map(|place| (0..n).map(move |i| (place, i)))
            .map(|(place, i)| (given.block.result(place) + i) as Slot)
            .collect();
        let named = results.into_iter().flatten().enumerate().map(|(k, reg)| (format!("r{k}"), reg));
        let inputs = (0..w.slots.len()).map(|k| format!("a{k}")).collect();
        let tape = w.builder.finish_with_results("exponential", inputs, named, [] as [(String, Reg); 0]);
        Exponential { code: Code::new(&tape, &w.slots, &places, lanes, way) }
    }
}

//! An exponential Runge-Kutta method of fourth order (S. M. Cox, P. C. Matthews, "Exponential time differencing for stiff systems", 2002): what is
//! linear in the equations is solved exactly, so that only what is not asks for small steps.
//!
//! In: a system, its state with the rates there, a span with held inputs. Out: the state at its end. The linear part is the Jacobian matrix under held pieces of the
//! laws, taken again where a plant says that its rates have moved. A step in which pieces change is halved until the classical method may cross
//! in it. Never needs the linear part to be exact: what it misses is in the differences, at fourth order.

use super::phi::{self, Matrix};
use super::{System, Work, explicit};
use crate::plants::{Plant, Rates};

/// States at most; a plant with more takes small steps.
pub(super) const MOST_STATES: usize = 16;

/// Differences for the Jacobian matrix, relative to a state: the root of the rounding of f64.
const DIFFERENCE: f64 = 1e-8;

/// The linear part is taken again when the rates that vary have moved by this share: what it misses is then a tenth of them, which
/// [`Rates::nonlinear`] answers for.
const STALE: f64 = 0.1;

/// The matrices of a step: h phi_1(A h), 2 h (phi_2 - 2 phi_3)(A h), h (4 phi_3 - phi_2)(A h).
#[derive(Debug)]
struct Step<const N: usize> {
    whole: Matrix<N>,
    middle: Matrix<N>,
    last: Matrix<N>,
}

/// A linear part and the matrices for a span and its halves, quarters and so on.
#[derive(Debug)]
struct Part<const N: usize> {
    span: f64,
    pieces: u32,
    varying: f64,
    a: Matrix<N>,
    steps: Vec<Step<N>>,
}

impl<const N: usize> Part<N> {
    fn new<P: Plant>(
        system: &System<'_, P>,
        work: &mut Work,
        rates: &Rates,
        pieces: u32,
        time: f64,
        span: f64,
        levels: usize,
    ) -> Self {
        let n = work.x.len();
        let mut a = Matrix::<N>::zero();
        let Work { x, trial, k: [here, there, ..], outputs, .. } = &mut *work;
        for j in 0..n {
            trial.copy_from_slice(x);
            // An angle or a speed of 1 is neither large nor small on any plant of ours.
            trial[j] += DIFFERENCE * x[j].abs().max(1.0);
            let moved = trial[j] - x[j];
            system.rates(Some(pieces), time, trial, there, outputs);
            for i in 0..n {
                a.0[j][i] = (there[i] - here[i]) / moved;
            }
        }
        let functions = phi::functions(&a, span, levels + 1);
        let steps = functions.into_iter().enumerate().map(|(level, it)| {
            let h = span * 0.5_f64.powi(level as i32);
            Step {
                whole: it.one.scaled(h, 0.0),
                middle: it.two.combined(2.0 * h, &it.three, -2.0),
                last: it.three.scaled(4.0, 0.0).combined(h, &it.two, -1.0),
            }
        });
        Part { span, pieces, varying: rates.varying, a, steps: steps.collect() }
    }
}

/// Linear parts by span and pieces.
#[derive(Debug, Default)]
pub(super) struct Parts {
    eight: Vec<Part<8>>,
    twelve: Vec<Part<12>>,
    sixteen: Vec<Part<16>>,
}

impl Parts {
    /// Forgets all: another plant, or another start.
    pub(super) fn clear(&mut self) {
        *self = Parts::default();
    }
}

/// How a span is stepped: in 2^`first` steps, halved down to 2^`deepest` where pieces change.
#[derive(Debug, Clone, Copy)]
pub(super) struct Levels {
    pub first: usize,
    pub deepest: usize,
}

/// Over a span, from and to a state with its rates in place under the pieces that are at work. Answers the pieces at the end.
pub(super) fn over<P: Plant>(
    system: &System<'_, P>,
    work: &mut Work,
    rates: &Rates,
    pieces: u32,
    (time, span): (f64, f64),
    levels: Levels,
) -> u32 {
    let mut parts = std::mem::take(&mut work.parts);
    let pieces = match work.x.len() {
        0..=8 => Walk { system, work, rates, list: &mut parts.eight, start: time, span, levels }.all(pieces),
        9..=12 => Walk { system, work, rates, list: &mut parts.twelve, start: time, span, levels }.all(pieces),
        _ => Walk { system, work, rates, list: &mut parts.sixteen, start: time, span, levels }.all(pieces),
    };
    work.parts = parts;
    pieces
}

struct Walk<'a, 's, P: Plant, const N: usize> {
    system: &'a System<'s, P>,
    work: &'a mut Work,
    rates: &'a Rates,
    list: &'a mut Vec<Part<N>>,
    start: f64,
    span: f64,
    levels: Levels,
}

impl<P: Plant, const N: usize> Walk<'_, '_, P, N> {
    fn all(&mut self, mut pieces: u32) -> u32 {
        let count = 1usize << self.levels.first;
        for k in 0..count {
            let time = self.start + self.span * (k as f64 / count as f64);
            pieces = self.step(pieces, time, self.levels.first, k + 1 == count);
        }
        pieces
    }

    /// One step of span/2^level, or two of its halves where pieces change.
    fn step(&mut self, pieces: u32, time: f64, level: usize, end: bool) -> u32 {
        let h = self.span * 0.5_f64.powi(level as i32);
        let place = self.part(pieces, time);
        self.work.before.copy_from_slice(&self.work.x);
        self.work.first.copy_from_slice(&self.work.k[0]);
        if self.tried(place, pieces, time, level, end) {
            return pieces;
        }
        self.work.x.copy_from_slice(&self.work.before);
        self.work.k[0].copy_from_slice(&self.work.first);
        if level >= self.levels.deepest {
            return explicit::across(self.system, self.work, pieces, time, h);
        }
        let pieces = self.step(pieces, time, level + 1, false);
        self.step(pieces, time + 0.5 * h, level + 1, end)
    }

    /// The linear part under these pieces.
    fn part(&mut self, pieces: u32, time: f64) -> usize {
        let found = self.list.iter().position(|it| it.pieces == pieces && it.span == self.span);
        let deepest = self.levels.deepest.max(self.levels.first);
        // A step needs the matrices of its half.
        let stale = |it: &Part<N>| (self.rates.varying - it.varying).abs() > STALE * it.varying || it.steps.len() < deepest + 2;
        match found {
            Some(place) if !stale(&self.list[place]) => place,
            _ => {
                let part = Part::new(self.system, self.work, self.rates, pieces, time, self.span, deepest);
                match found {
                    Some(place) => {
                        self.list[place] = part;
                        place
                    }
                    None => {
                        self.list.push(part);
                        self.list.len() - 1
                    }
                }
            }
        }
    }

    /// Takes the step; false where its middle or its end belongs to other pieces. At the `end` of a span the rates are not needed, nor computed where laws have
    /// no pieces.
    fn tried(&mut self, place: usize, pieces: u32, time: f64, level: usize, end: bool) -> bool {
        let Part { a, steps, .. } = &self.list[place];
        let (Step { whole, middle, last }, half) = (&steps[level], &steps[level + 1].whole);
        let h = self.span * 0.5_f64.powi(level as i32);
        let Work { x, trial, k, outputs, .. } = &mut *self.work;
        let [here, there, ..] = k;
        let system = self.system;
        let n = x.len();
        let mut f = [0.0; N];
        f[..n].copy_from_slice(here);
        // With D(y) = g(y) - g(x) = f(y) - f(x) - A (y - x): a = x + (h/2) phi_1(A h/2) f(x), b = a + (h/2) phi_1(A h/2) D(a),
        // c = x + h phi_1(A h) f(x) + h phi_1(A h/2) D(b).
        let mut difference = |moved: &[f64; N], share: f64| {
            for i in 0..n {
                trial[i] = x[i] + moved[i];
            }
            let found = system.rates(Some(pieces), time + share * h, trial, there, outputs);
            let linear = a.times(moved);
            let mut d = [0.0; N];
            for i in 0..n {
                d[i] = there[i] - f[i] - linear[i];
            }
            (d, found == pieces)
        };
        let to_a = half.times(&f);
        let (d_a, a_keeps) = difference(&to_a, 0.5);
        let to_b = plus(&to_a, &half.times(&d_a), 1.0);
        let (d_b, b_keeps) = difference(&to_b, 0.5);
        let straight = whole.times(&f);
        let (d_c, _) = difference(&plus(&straight, &half.times(&d_b), 2.0), 1.0);
        let moved = plus(&plus(&straight, &middle.times(&plus(&d_a, &d_b, 1.0)), 1.0), &last.times(&d_c), 1.0);
        for (x, moved) in x.iter_mut().zip(&moved) {
            *x += moved;
        }
        // The rates at the end of the span are those of other inputs.
        if end && !system.hooks.have_pieces() {
            return true;
        }
        let found = system.rates(Some(pieces), time + h, x, here, outputs);
        a_keeps && b_keeps && found == pieces
    }
}

#[inline]
fn plus<const N: usize>(one: &[f64; N], other: &[f64; N], share: f64) -> [f64; N] {
    let mut sum = *one;
    for (sum, other) in sum.iter_mut().zip(other) {
        *sum += share * other;
    }
    sum
}

//! A linear part of the rates of a plant, and the solution inside of a step that uses it.
//!
//! In: the Jacobian, the held values of comparisons, a span. Out: [`Part`]: the functions of the Jacobian over the span, its half, its quarter and so
//! on; and the states at any share of a step, from the results of the step ([`super::exponential`]).

use super::phi::{Chain, by_stride, stride, times};
use crate::code::{Work, vectorised};

/// The largest number of states: with more states the matrices cost more than small steps.
pub(super) const MOST_STATES: usize = 24;

/// Terms of the series that covers the time after the last level.
const TAYLOR: usize = 18;

/// A linear part with its functions over a span.
#[derive(Debug, Clone, Default)]
pub(super) struct Part {
    /// The values of the comparisons for which it was computed.
    pub held: Vec<f64>,
    /// The span.
    pub length: f64,
    /// The Jacobian, column by column with [`stride`] numbers in each column.
    columns: Vec<f64>,
    /// The derivative of the rates with respect to time, with the length of a column.
    pub by_time: Vec<f64>,
    pub chain: Chain,
    /// Its number within the run of its lane.
    pub version: u64,
    /// The time of its last use, counted in uses.
    pub used: u64,
}

/// The forcing of the states in a step, for each state: the rate at the start of the step, a, D(1).
struct Forcing<const S: usize> {
    rate: [f64; S],
    a: [f64; S],
    end: [f64; S],
}

impl Part {
    /// Takes the Jacobian, row by row, followed by the derivatives with respect to time, if there are any. Returns `false` if it has no functions
    /// over the span. `curved`: the columns in which steps read phi_2 and phi_3.
    pub(super) fn take(&mut self, n: usize, curved: &[usize], slopes: impl Iterator<Item = f64>) -> bool {
        let row = stride(n);
        self.columns.clear();
        self.columns.resize(n * row, 0.0);
        self.by_time.clear();
        self.by_time.resize(row, 0.0);
        for (k, slope) in slopes.enumerate() {
            if k < n * n {
                self.columns[k % n * row + k / n] = slope;
            } else {
                self.by_time[k - n * n] = slope;
            }
        }
        self.chain.set_matrix(n, &self.columns, self.length, curved)
    }

    /// Computes the functions for a step of a level. Returns `false` if they are not finite.
    pub(super) fn make(&mut self, level: usize) -> bool {
        self.chain.make(level) && self.chain.make(level + 1)
    }

    /// The length of a step of a level.
    pub(super) fn length_of(&self, level: usize) -> f64 {
        self.length * 0.5_f64.powi(level as i32)
    }

    /// Advances from one share of a step of a level to a later one, on the solution for a remainder a s + b s^2. `moved` is the change of the states.
    /// `forcing` are, for each state, the slots of the rate at the start of the step, of a and of D(1). Exact except for rounding.
    pub(super) fn within<const L: usize>(
        &self,
        level: usize,
        shares: (f64, f64),
        forcing: [&[[f64; L]]; 3],
        lane: usize,
        moved: &mut [f64; MOST_STATES],
    ) {
        by_stride!(forcing[0].len(), S => self.within_of::<S, L>(level, shares, forcing, lane, moved));
    }

    fn within_of<const S: usize, const L: usize>(
        &self,
        level: usize,
        shares: (f64, f64),
        forcing: [&[[f64; L]]; 3],
        lane: usize,
        moved: &mut [f64; MOST_STATES],
    ) {
        let n = forcing[0].len();
        let [rate, a, end] = forcing.map(|list| std::array::from_fn(|k| if k < n { list[k][lane] } else { 0.0 }));
        let moved: &mut [f64; S] = moved.first_chunk_mut().expect("no more than the most states");
        vectorised(Within { part: self, level, shares, forcing: Forcing { rate, a, end }, moved });
    }

    /// The Jacobian, column by column with [`stride`] numbers in each column.
    pub(super) fn jacobian(&self) -> &[f64] {
        &self.columns
    }

    /// The Jacobian.
    #[inline(always)]
    pub(super) fn columns<const S: usize>(&self) -> &[[f64; S]] {
        self.columns.as_chunks().0
    }

    /// The Jacobian times a vector.
    #[inline(always)]
    fn times<const S: usize>(&self, by: &[f64; S]) -> [f64; S] {
        times(self.columns(), by)
    }

    /// At a share of a step of length h: the rates, and the first and second derivative of their forcing, over a share from there.
    #[inline(always)]
    fn forced<const S: usize>(&self, forcing: &Forcing<S>, (h, at, share): (f64, f64, f64), y: &[f64; S]) -> [[f64; S]; 3] {
        let mut v = self.times(y);
        let (mut first, mut second) = ([0.0; S], [0.0; S]);
        let by_time: &[f64; S] = self.by_time.first_chunk().expect("as many as a column has");
        for i in 0..S {
            let b = forcing.end[i] - forcing.a[i];
            let slope = forcing.a[i] + h * by_time[i];
            v[i] += forcing.rate[i] + (slope + b * at) * at;
            (first[i], second[i]) = ((slope + 2.0 * b * at) * share, b * share * share);
        }
        [v, first, second]
    }
}

/// The way from one share of a step to a later one.
struct Within<'a, const S: usize> {
    part: &'a Part,
    level: usize,
    shares: (f64, f64),
    forcing: Forcing<S>,
    moved: &'a mut [f64; S],
}

impl<const S: usize> Work for Within<'_, S> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Within { part, level, shares: (mut at, to), forcing, moved: y } = self;
        let h = part.length_of(level);
        let mut share = 1.0;
        for deeper in level + 1..=part.chain.base() {
            share *= 0.5;
            if at + share > to {
                continue;
            }
            let [v, first, second] = part.forced(&forcing, (h, at, share), y);
            let [one, two, three] = part.chain.at::<S>(deeper);
            let (one, two, three) = (times(one, &v), times(two, &first), times(three, &second));
            let length = h * share;
            for i in 0..S {
                y[i] += length * (one[i] + two[i] + 2.0 * three[i]);
            }
            at += share;
        }
        let share = to - at;
        if share <= 0.0 {
            return;
        }
        // The rest is so short that the terms of the exponential series decrease by a factor of 2 k each. The series ends when a term no longer
        // changes the sum.
        let [v, first, second] = part.forced(&forcing, (h, at, share), y);
        let length = h * share;
        let mut term = v.map(|it| it * length);
        for k in 1..=TAYLOR {
            let mut moves = false;
            for (y, term) in y.iter_mut().zip(&term) {
                let next = *y + term;
                moves |= next != *y;
                *y = next;
            }
            // The forcing enters with terms 1 to 3.
            if !moves && k > 3 {
                return;
            }
            let moved = part.times(&term);
            let factor = length / (k + 1) as f64;
            for i in 0..S {
                let forcing = match k {
                    1 => first[i],
                    2 => second[i],
                    _ => 0.0,
                };
                term[i] = factor * (moved[i] + forcing);
            }
        }
    }
}

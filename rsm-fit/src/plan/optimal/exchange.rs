//! The search for the runs of an optimal design.
//!
//! In: a [`Space`], a criterion, fixed runs, and the block of each requested run. Out: the points of the requested runs. One run at a time moves to
//! the point with the best criterion, while the others stay (Fedorov 1972; Meyer, Nachtsheim 1995: coordinate by coordinate). Along a line the
//! determinant is a polynomial, and the mean variance is a quotient of two polynomials; their maxima are found exactly, without a grid. From a local
//! optimum some runs are drawn again and the search continues (Lourenco, Martin, Stuetzle 2003); then all runs are drawn again. The number of runs is
//! always the requested one.
//!
//! With M = X'X, its inverse D, a removed run f and an added run g (Fedorov 1972):
//!
//! ```text
//! |M - f f' + g g'| / |M| = (1 - f'D f) + g'[(1 - f'D f) D + D f f'D] g
//! ```
//!
//! and for the mean variance tr(D W), with h = f'D f, c = f'D g and P = D W D, the new one is
//!
//! ```text
//! tr(D W) + [(h - 1) g'P g - 2 c g'P f + (1 + g'D g) f'P f] / (that ratio)
//! ```

use super::line::Quotient;
use super::linear::{add_square, cholesky, dot, inverse, product, times};
use super::space::{ON_A_FACE, Space};
use crate::plan::design::Criterion;
use crate::random::Random;

/// A start ends when a sweep over all runs has a smaller relative gain than this.
const COARSE: f64 = 1e-5;

/// The same for a design that may be the best: far below the nine digits in which designs are compared.
const FINE: f64 = 1e-12;

/// The largest number of sweeps.
const SWEEPS: usize = 400;

/// A smaller gain of a move is rounding error.
const LEAST_GAIN: f64 = 1e-11;

/// The number of passes over the coordinates of one run before the next run.
const PASSES: usize = 4;

/// If the determinant falls by more than this factor, the new matrix counts as singular.
const LEAST_RATIO: f64 = 1e-9;

/// Coded settings are rounded to this many parts of 1. The criterion is flat at its optimum, and a bench cannot set finer values.
const GRID: f64 = 1e6;

/// The data of the search.
pub(in crate::plan) struct Task<'a> {
    pub space: &'a Space,
    pub criterion: Criterion,
    /// Fixed runs, each with its block.
    pub fixed: Vec<(Vec<f64>, usize)>,
    /// The block of each requested run.
    pub blocks: Vec<usize>,
    /// The number of blocks, including those of fixed runs.
    pub block_count: usize,
    /// The number of starts from random runs.
    pub restarts: usize,
    /// The number of redraws without a gain before a new start.
    pub kicks: usize,
}

/// Why there is no design.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::plan) enum Failure {
    /// No point fulfils the conditions.
    EmptyRegion,
    /// No runs were found that can estimate the terms.
    Singular,
}

impl Task<'_> {
    /// The number of terms and block contrasts.
    pub(in crate::plan) fn width(&self) -> usize {
        self.space.terms.len() + self.block_count.max(1) - 1
    }

    /// The row of a point in a block: the terms, then the contrasts of the blocks. The last block is minus the sum of the others.
    pub(in crate::plan) fn row(&self, point: &[f64], block: usize) -> Vec<f64> {
        let mut row = self.space.row(point);
        self.extend(&mut row, block);
        row
    }

    fn extend(&self, row: &mut Vec<f64>, block: usize) {
        let contrasts = self.block_count.max(1) - 1;
        let contrast = |k: usize| if block == contrasts { -1.0 } else { f64::from(u8::from(k == block)) };
        row.extend((0..contrasts).map(contrast));
    }

    /// The points of the requested runs, in the order of [`Task::blocks`].
    pub(in crate::plan) fn search(&self, random: &mut Random) -> Result<Vec<Vec<f64>>, Failure> {
        let moments = match self.criterion {
            Criterion::D => None,
            Criterion::I => Some(self.space.moments(self.block_count.max(1) - 1).ok_or(Failure::EmptyRegion)?),
            Criterion::A => {
                let q = self.width();
                let mut one = vec![0.0; q * q];
                // The terms, without the blocks.
                (0..self.space.terms.len()).for_each(|k| one[k * q + k] = 1.0);
                Some(one)
            }
        };
        let mut best: Option<State> = None;
        for _ in 0..self.restarts.max(1) {
            let Some(mut state) = self.start(moments.as_deref(), random)? else { continue };
            let mut misses = 0;
            while misses < self.kicks {
                let Some(kicked) = self.kicked(&state, moments.as_deref(), random)? else {
                    misses += 1;
                    continue;
                };
                // Ten times the gain that a sweep may leave.
                let gain = kicked.gain_over(&state);
                misses = if gain > 10.0 * self.coarse() { 0 } else { misses + 1 };
                if gain > 0.0 {
                    state = kicked;
                }
            }
            if best.as_ref().is_none_or(|best| state.gain_over(best) > -1e-3) {
                state.improve(self, moments.as_deref(), FINE);
                if best.as_ref().is_none_or(|best| state.gain_over(best) > 0.0) {
                    best = Some(state);
                }
            }
        }
        let best = best.ok_or(Failure::Singular)?;
        Ok(best.points.iter().map(|point| self.rounded(point)).collect())
    }

    /// With a finite set of points, a search terminates without this limit.
    fn coarse(&self) -> f64 {
        if self.space.is_continuous() { COARSE } else { LEAST_GAIN }
    }

    fn start(&self, moments: Option<&[f64]>, random: &mut Random) -> Result<Option<State>, Failure> {
        let mut points = Vec::with_capacity(self.blocks.len());
        for _ in &self.blocks {
            points.push(self.space.anywhere(random).ok_or(Failure::EmptyRegion)?);
        }
        Ok(self.settled(points, moments))
    }

    /// Redraws some runs.
    fn kicked(&self, state: &State, moments: Option<&[f64]>, random: &mut Random) -> Result<Option<State>, Failure> {
        let mut points = state.points.clone();
        if points.is_empty() {
            return Ok(None);
        }
        let most = (points.len() / 5).clamp(1, 6) as u64;
        for _ in 0..=random.below(most) {
            let place = random.below(points.len() as u64) as usize;
            points[place] = self.space.anywhere(random).ok_or(Failure::EmptyRegion)?;
        }
        Ok(self.settled(points, moments))
    }

    /// The local optimum from some points; `None` if it cannot estimate the terms.
    fn settled(&self, points: Vec<Vec<f64>>, moments: Option<&[f64]>) -> Option<State> {
        // A small multiple of the unit matrix makes any start regular. It is removed when the runs have moved apart.
        let mut state = State::new(self, points, 1e-6);
        if !state.refresh(self, None) {
            state.ridge = 1e-3;
            if !state.refresh(self, None) {
                return None;
            }
        }
        state.sweep(self, None);
        state.ridge = 0.0;
        if !state.refresh(self, None) {
            return None;
        }
        if moments.is_some() {
            state.improve(self, None, 1e-2);
        }
        state.improve(self, moments, self.coarse()).then_some(state)
    }

    /// Rounded to the grid if the conditions still hold; levels and candidates are not rounded.
    fn rounded(&self, point: &[f64]) -> Vec<f64> {
        if !self.space.is_continuous() {
            return point.to_vec();
        }
        let on_grid: Vec<f64> = point.iter().map(|x| (x * GRID).round() / GRID + 0.0).collect();
        let inside = self.space.conditions.iter().all(|condition| condition.holds(&on_grid));
        if inside { on_grid } else { point.to_vec() }
    }
}

/// The runs with the matrices computed from them.
#[derive(Clone)]
struct State {
    points: Vec<Vec<f64>>,
    rows: Vec<Vec<f64>>,
    /// The number added to the diagonal of X'X.
    ridge: f64,
    /// The diagonal of the Cholesky factor of X'X.
    diagonal: Vec<f64>,
    /// Its inverse D.
    inverse: Vec<f64>,
    /// D W D; empty for the determinant.
    weighted: Vec<f64>,
    /// tr(D W).
    trace: Option<f64>,
}

impl State {
    fn new(task: &Task<'_>, points: Vec<Vec<f64>>, ridge: f64) -> State {
        let rows = points.iter().zip(&task.blocks).map(|(point, block)| task.row(point, *block)).collect();
        State { points, rows, ridge, diagonal: Vec::new(), inverse: Vec::new(), weighted: Vec::new(), trace: None }
    }

    /// The relative gain over another state, per term; negative if it is worse.
    fn gain_over(&self, other: &State) -> f64 {
        if let (Some(own), Some(others)) = (self.trace, other.trace) {
            return others / own - 1.0;
        }
        let ratio: f64 = self.diagonal.iter().zip(&other.diagonal).map(|(own, others)| own / others).product();
        // |X'X|^(1/p) to first order: accurate near 1, where it matters.
        2.0 * (ratio - 1.0) / self.diagonal.len() as f64
    }

    /// Computes everything from the rows; false if they cannot estimate the terms.
    fn refresh(&mut self, task: &Task<'_>, moments: Option<&[f64]>) -> bool {
        let q = task.width();
        let mut m = vec![0.0; q * q];
        (0..q).for_each(|k| m[k * q + k] = self.ridge * self.rows.len() as f64);
        for (point, block) in &task.fixed {
            add_square(&mut m, 1.0, &task.row(point, *block));
        }
        for row in &self.rows {
            add_square(&mut m, 1.0, row);
        }
        let Some(l) = cholesky(&m, q) else { return false };
        self.diagonal = (0..q).map(|k| l[k * q + k]).collect();
        self.inverse = inverse(&l, q);
        self.weigh(moments, q);
        true
    }

    fn weigh(&mut self, moments: Option<&[f64]>, q: usize) {
        (self.weighted, self.trace) = match moments {
            None => (Vec::new(), None),
            Some(moments) => {
                let half = product(&self.inverse, moments, q);
                let trace = (0..q).map(|k| half[k * q + k]).sum();
                (product(&half, &self.inverse, q), Some(trace))
            }
        };
    }

    /// Sweeps until the relative gain is below `least`. False if the runs cannot estimate the terms.
    fn improve(&mut self, task: &Task<'_>, moments: Option<&[f64]>, least: f64) -> bool {
        for _ in 0..SWEEPS {
            if !self.refresh(task, moments) {
                return false;
            }
            if self.sweep(task, moments) < least {
                break;
            }
        }
        self.refresh(task, moments)
    }

    /// Moves every run once to its best point. Returns the relative gain per term.
    fn sweep(&mut self, task: &Task<'_>, moments: Option<&[f64]>) -> f64 {
        let before = self.trace;
        let mut ratio = 1.0;
        for run in 0..self.points.len() {
            ratio *= self.move_run(run, task, moments);
        }
        match (before, self.trace) {
            (Some(before), Some(now)) => before / now - 1.0,
            _ => (ratio - 1.0) / task.width() as f64,
        }
    }

    /// Moves one run to its best point. Returns the factor of the determinant.
    fn move_run(&mut self, run: usize, task: &Task<'_>, moments: Option<&[f64]>) -> f64 {
        let q = task.width();
        let old = self.rows[run].clone();
        let measure = Measure::of(self, &old, q);
        let block = task.blocks[run];
        let mut point = self.points[run].clone();
        let mut row = old.clone();
        let Some(start) = measure.value(&row) else { return 1.0 };
        let mut best = start;
        if let Some(candidates) = &task.space.candidates {
            for candidate in candidates {
                let other = task.row(candidate, block);
                if let Some(value) = measure.value(&other).filter(|value| *value > best + LEAST_GAIN * best.abs()) {
                    (point, row, best) = (candidate.clone(), other, value);
                }
            }
        } else {
            for _ in 0..PASSES {
                let before = best;
                for direction in directions(task.space, &point) {
                    if let Some((moved, value)) = measure.along(task, &point, &direction, block)
                        && value > best + LEAST_GAIN * best.abs()
                    {
                        (point, best) = (moved, value);
                    }
                }
                if best <= before + 1e-3 * before.abs() {
                    break;
                }
            }
            row = task.row(&point, block);
        }
        if best <= start {
            return 1.0;
        }
        let ratio = measure.ratio(&row);
        if !self.exchange(&old, &row, q) {
            return 1.0;
        }
        self.weigh(moments, q);
        self.points[run] = point;
        self.rows[run] = row;
        ratio
    }

    /// Updates D for an added and a removed run (Sherman, Morrison 1950). False, with D unchanged, if rounding would dominate.
    fn exchange(&mut self, old: &[f64], new: &[f64], q: usize) -> bool {
        let mut next = self.inverse.clone();
        let image = times(&next, new);
        add_square(&mut next, -1.0 / (1.0 + dot(new, &image)), &image);
        let image = times(&next, old);
        let left = 1.0 - dot(old, &image);
        if left.is_nan() || left <= LEAST_RATIO {
            return false;
        }
        add_square(&mut next, 1.0 / left, &image);
        debug_assert_eq!(next.len(), q * q);
        self.inverse = next;
        true
    }
}

/// The directions in which a run may move: along each factor, and along the faces of the region on which it lies.
pub(super) fn directions(space: &Space, point: &[f64]) -> Vec<Vec<f64>> {
    let unit = |k: usize| (0..point.len()).map(|j| f64::from(u8::from(j == k))).collect::<Vec<f64>>();
    let mut directions: Vec<Vec<f64>> = (0..point.len()).map(unit).collect();
    if !space.is_continuous() {
        return directions;
    }
    let faces = space.faces(point);
    let mut groups: Vec<Vec<&[f64]>> = faces.iter().map(|face| vec![*face]).collect();
    if faces.len() > 1 {
        groups.push(faces);
    }
    for group in groups {
        let normals = orthonormal(&group);
        for k in 0..point.len() {
            let mut along = unit(k);
            for normal in &normals {
                let share = dot(normal, &along);
                along.iter_mut().zip(normal).for_each(|(a, n)| *a -= share * n);
            }
            let size = dot(&along, &along).sqrt();
            // A shorter one is rounding error of an orthogonal direction.
            if size > 1e-6 {
                directions.push(along.iter().map(|a| if a.abs() < 1e-12 { 0.0 } else { a / size }).collect());
            }
        }
    }
    directions
}

/// An orthonormal basis of the normals (Gram, Schmidt).
fn orthonormal(normals: &[&[f64]]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for normal in normals {
        let mut rest = normal.to_vec();
        for known in &out {
            let share = dot(known, &rest);
            rest.iter_mut().zip(known).for_each(|(r, n)| *r -= share * n);
        }
        let size = dot(&rest, &rest).sqrt();
        if size > 1e-9 * dot(normal, normal).sqrt() {
            out.push(rest.iter().map(|r| r / size).collect());
        }
    }
    out
}

/// The value of replacing one row by another.
pub(super) struct Measure {
    /// The ratio of determinants is `rest + g' form g`,
    pub(super) rest: f64,
    pub(super) form: Vec<f64>,
    /// and the trace falls by `(loss - g' gain g)/ratio`; `None` for the determinant.
    pub(super) trace: Option<(f64, Vec<f64>)>,
}

impl Measure {
    fn of(state: &State, leaves: &[f64], q: usize) -> Measure {
        let image = times(&state.inverse, leaves);
        let rest = 1.0 - dot(leaves, &image);
        let mut form: Vec<f64> = state.inverse.iter().map(|d| rest * d).collect();
        add_square(&mut form, 1.0, &image);
        let trace = (!state.weighted.is_empty()).then(|| {
            let across = times(&state.weighted, leaves);
            let own = dot(leaves, &across);
            // -[(h - 1) P + own D - (u v' + v u')].
            let mut gain: Vec<f64> = state.weighted.iter().zip(&state.inverse).map(|(p, d)| rest * p - own * d).collect();
            for i in 0..q {
                for j in 0..q {
                    gain[i * q + j] += image[i] * across[j] + across[i] * image[j];
                }
            }
            (-own, gain)
        });
        Measure { rest, form, trace }
    }

    pub(super) fn ratio(&self, row: &[f64]) -> f64 {
        self.rest + dot(row, &times(&self.form, row))
    }

    /// The ratio of determinants, or the reduction of the trace; larger is better.
    fn value(&self, row: &[f64]) -> Option<f64> {
        let ratio = self.ratio(row);
        match &self.trace {
            None => Some(ratio),
            Some((loss, gain)) => (ratio > LEAST_RATIO).then(|| (loss + dot(row, &times(gain, row))) / ratio),
        }
    }

    /// The best point along a line, with its value.
    pub(super) fn along(&self, task: &Task<'_>, point: &[f64], direction: &[f64], block: usize) -> Option<(Vec<f64>, f64)> {
        let space = task.space;
        // Along a factor, the parameter is the setting itself, so that an end is exact and most of the rows are zero.
        let axis =
            (direction.iter().filter(|d| **d != 0.0).count() == 1).then(|| direction.iter().position(|d| *d == 1.0)).flatten();
        let mut base = point.to_vec();
        let [mut low, mut high] = space.reach(point, direction)?;
        if let Some(k) = axis {
            base[k] = 0.0;
            let (x, [least, most]) = (point[k], space.ends[k]);
            let at = |t: f64, end: f64| if (x + t - end).abs() <= ON_A_FACE { end } else { x + t };
            (low, high) = (at(low, least), at(high, most));
        }
        let mut rows = space.rows_along(&base, direction);
        task.extend(&mut rows[0], block);
        let more = rows[0].len() - space.terms.len();
        for row in &mut rows[1..] {
            row.extend(std::iter::repeat_n(0.0, more));
        }
        let ratio = polynomial(&self.form, &rows, self.rest);
        let quotient = match &self.trace {
            None => Quotient { top: ratio, bottom: None, least: 0.0 },
            Some((loss, gain)) => Quotient { top: polynomial(gain, &rows, *loss), bottom: Some(ratio), least: LEAST_RATIO },
        };
        let (t, value) = match axis.and_then(|k| space.levels[k].as_ref()) {
            Some(levels) => {
                let within: Vec<f64> =
                    levels.iter().copied().filter(|x| *x >= low - ON_A_FACE && *x <= high + ON_A_FACE).collect();
                quotient.largest_of(&within)?
            }
            None if low < high => quotient.largest(low, high)?,
            None => return None,
        };
        let mut moved = point.to_vec();
        match axis {
            Some(k) => moved[k] = t,
            None => moved.iter_mut().zip(direction).for_each(|(x, d)| *x += t * d),
        }
        Some((moved, value))
    }
}

/// `rest + g' A g` with g = sum t^k rows\[k\], as a polynomial of t.
fn polynomial(a: &[f64], rows: &[Vec<f64>], rest: f64) -> Vec<f64> {
    let q = rows[0].len();
    let mut out = vec![0.0; 2 * rows.len() - 1];
    out[0] = rest;
    let mut image = vec![0.0; q];
    for (k, row) in rows.iter().enumerate() {
        image.fill(0.0);
        for (x, line) in row.iter().zip(a.chunks_exact(q)) {
            if *x != 0.0 {
                image.iter_mut().zip(line).for_each(|(sum, a)| *sum += x * a);
            }
        }
        for (m, other) in rows.iter().enumerate().skip(k) {
            let twice = if m == k { 1.0 } else { 2.0 };
            out[k + m] += twice * dot(&image, other);
        }
    }
    out
}

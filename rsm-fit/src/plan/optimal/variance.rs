//! The variance of a prediction over the region: its value, and its maximum.
//!
//! In: a [`Space`] and the inverse of X'X for its terms. Out: f'(X'X)^-1 f, in units of the variance of the noise. Along a line it is a polynomial,
//! so the maximum along a line is exact. The maximum over the region is the best of many searches from different points; nothing proves it.

use super::exchange::{Measure, Task, directions};
use super::space::Space;
use crate::plan::design::Criterion;
use rsm_core::order;

/// The number of searches from the largest values at the runs and at random points, each, and of searches from points spread over the region. On the
/// 29 published designs of `tests/all/evaluation.rs`, whose maxima are certified, they find every maximum; 48 spread points along factors alone
/// missed one by 0.3 %.
const FROM_LARGEST: usize = 48;
const FROM_SPREAD: usize = 192;

/// The largest number of passes over all directions; a search needs about five.
const PASSES: usize = 100;

/// A pass with a smaller relative gain ends a search: the maximum is printed with about six digits.
const LEAST_GAIN: f64 = 1e-12;

/// The variance of predictions of a design.
pub(in crate::plan) struct Variance<'a> {
    task: Task<'a>,
    measure: Measure,
}

impl<'a> Variance<'a> {
    /// `inverse`: (X'X)^-1 for the terms, row by row, without block contrasts. A prediction is then the mean over the blocks.
    pub(in crate::plan) fn new(space: &'a Space, inverse: Vec<f64>) -> Self {
        let criterion = Criterion::D;
        let task = Task { space, criterion, fixed: Vec::new(), blocks: Vec::new(), block_count: 1, restarts: 1, kicks: 0 };
        Variance { task, measure: Measure { rest: 0.0, form: inverse, trace: None } }
    }

    /// The variance at a point.
    pub(in crate::plan) fn at(&self, point: &[f64]) -> f64 {
        self.measure.ratio(&self.task.space.row(point))
    }

    /// The largest variance over the region and its point, searched from the largest values at `points` and at a spread part of `sample`. `None` if
    /// neither has a point in the region.
    pub(in crate::plan) fn largest(&self, points: &[Vec<f64>], sample: &[Vec<f64>]) -> Option<(Vec<f64>, f64)> {
        let space = self.task.space;
        let valued = |points: &[Vec<f64>]| {
            let inside = points.iter().filter(|point| space.candidates.is_some() || space.holds(point));
            let mut all: Vec<(Vec<f64>, f64)> = inside.map(|point| (point.clone(), self.at(point))).collect();
            // The sort is stable: points of one value keep their order on every machine.
            order::descending(&mut all, |it| it.1);
            all.dedup_by(|a, b| a.0 == b.0);
            all
        };
        if space.candidates.is_some() {
            return valued(sample).into_iter().next();
        }
        let step = (sample.len() / FROM_SPREAD).max(1);
        let spread: Vec<Vec<f64>> = sample.iter().step_by(step).cloned().collect();
        let starts = [points, sample].map(valued).into_iter().flat_map(|all| all.into_iter().take(FROM_LARGEST));
        let found = starts.chain(valued(&spread)).map(|(point, value)| self.climbed(point, value));
        // The first of equal values.
        found.reduce(|best, next| if next.1 > best.1 * (1.0 + LEAST_GAIN) { next } else { best })
    }

    /// The local maximum from a point.
    fn climbed(&self, mut point: Vec<f64>, mut value: f64) -> (Vec<f64>, f64) {
        // A point that is best along each factor may still be a saddle: pairs of factors lead away from most of them.
        let pairs = if self.task.space.is_continuous() { diagonals(point.len()) } else { Vec::new() };
        for _ in 0..PASSES {
            let before = value;
            for direction in directions(self.task.space, &point).iter().chain(&pairs) {
                if let Some((moved, higher)) = self.measure.along(&self.task, &point, direction, 0)
                    && higher > value
                {
                    (point, value) = (moved, higher);
                }
            }
            if value <= before * (1.0 + LEAST_GAIN) {
                break;
            }
        }
        (point, value)
    }
}

/// The directions in which two factors change by the same amount.
fn diagonals(factors: usize) -> Vec<Vec<f64>> {
    let pairs = (0..factors).flat_map(|i| (0..i).map(move |j| (i, j)));
    let direction = |i: usize, j: usize, sign: f64| {
        let mut direction = vec![0.0; factors];
        (direction[i], direction[j]) = (1.0, sign);
        direction
    };
    pairs.flat_map(|(i, j)| [direction(i, j, 1.0), direction(i, j, -1.0)]).collect()
}

//! An explanation of a sample (causes, outlying runs, noise) with its least squares solution.
//!
//! In: a sample and an explanation. Out: the white space of its rows, the coefficients of its causes, its mean at all rows. Never changes which causes, outliers or noise there are.

use super::hypotheses::Hypothesis;
use super::noise::Growth;
use super::sample::Sample;
use super::whitening::{Shape, Space};
use crate::engine::columns::{Solved, solve};

/// The noise as it is taken to be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// How it grows; `None`: it is even.
    pub growth: Option<Growth>,
    /// Correlation of neighbours in the run order; `None`: there is none.
    pub rho: Option<f64>,
}

/// What explains a sample.
#[derive(Debug, Clone)]
pub struct Explained {
    /// The causes that move the mean.
    pub set: Vec<Hypothesis>,
    /// Rows that are left out, places in the sample, ascending.
    pub outliers: Vec<usize>,
    /// The noise.
    pub noise: Noise,
    /// How much less well the file knows its coefficients than `Sample::prior` says: a factor of the variance.
    pub looseness: f64,
    /// -2 ln likelihood plus costs.
    pub score: f64,
    /// What the mean becomes at all rows.
    pub fitted: Vec<f64>,
    /// Relative standard deviation of each row.
    pub scale: Vec<f64>,
}

impl Explained {
    /// The rows that count.
    pub fn kept(&self) -> Vec<usize> {
        (0..self.fitted.len()).filter(|row| !self.outliers.contains(row)).collect()
    }

    /// Scale and correlation of the noise.
    pub fn shape(&self) -> Shape {
        Shape { scale: self.scale.clone(), rho: self.noise.rho.unwrap_or(0.0) }
    }

    /// The white space of the rows that count.
    pub fn space(&self, sample: &Sample) -> Space {
        space_of(sample, &self.kept(), &self.shape(), self.looseness)
    }
}

/// The white space of some rows.
pub(super) fn space_of(sample: &Sample, kept: &[usize], shape: &Shape, looseness: f64) -> Space {
    let prior: Vec<Vec<f64>> = sample.prior.iter().map(|row| row.iter().map(|value| looseness * value).collect()).collect();
    Space::new(kept, shape, &sample.terms, &prior)
}

/// Least squares of the set at the rows that count: the fitted mean at all rows.
pub(super) fn settle(sample: &Sample, now: &mut Explained) {
    let space = now.space(sample);
    let solved = solved(sample, &now.set, &space);
    now.fitted = mean(sample, &now.set, &solved, &space);
}

/// The least-squares problem of a set.
pub(super) fn solved(sample: &Sample, set: &[Hypothesis], space: &Space) -> Solved {
    let columns: Vec<Vec<f64>> = set.iter().flat_map(|it| &it.columns).map(|column| space.carried(column)).collect();
    solve(&columns, &space.carried(&sample.residual()))
}

/// The nominal response with the causes, and with the coefficients moved by what the data say within their uncertainty.
fn mean(sample: &Sample, set: &[Hypothesis], solved: &Solved, space: &Space) -> Vec<f64> {
    let mut fitted = sample.nominal.clone();
    let all = set.iter().flat_map(|it| &it.columns).zip(&solved.coefficients);
    for (column, amplitude) in all {
        fitted.iter_mut().zip(column).for_each(|(f, x)| *f += amplitude * x);
    }
    let moves = calibration(sample, space, &fitted);
    for (column, amount) in sample.terms.iter().zip(moves) {
        fitted.iter_mut().zip(column).for_each(|(f, x)| *f += amount * x);
    }
    fitted
}

/// By how much the coefficients of the file move: what is left, against how well the file knows them (the posterior mean).
pub(super) fn calibration(sample: &Sample, space: &Space, fitted: &[f64]) -> Vec<f64> {
    let left: Vec<f64> = sample.response.iter().zip(fitted).map(|(y, f)| y - f).collect();
    space.calibration(&left, &sample.terms)
}

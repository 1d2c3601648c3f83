//! An explanation of a sample (causes, outlying runs, noise) with its least squares solution.
//!
//! In: a sample and an explanation. Out: the whitened space of its rows, the coefficients of its causes, its mean at all rows. Does not change
//! causes, outliers or noise.

use super::hypotheses::Hypothesis;
use super::noise::Growth;
use super::sample::Sample;
use super::whitening::{Shape, Space};
use crate::engine::columns::{LeastSquares, solve};

/// The noise model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// How it grows with the response; `None` if it is uniform.
    pub growth: Option<Growth>,
    /// The correlation of neighbours in the run order; `None` if there is none.
    pub rho: Option<f64>,
}

/// An explanation of a sample.
#[derive(Debug, Clone)]
pub struct Explained {
    /// The causes that change the mean.
    pub set: Vec<Hypothesis>,
    /// Rows that are left out, as ascending indices in the sample.
    pub outliers: Vec<usize>,
    /// The noise.
    pub noise: Noise,
    /// The factor of the variance by which the file's coefficients are less certain than `Sample::prior` says.
    pub variance_factor: f64,
    /// -2 ln(likelihood) plus costs.
    pub score: f64,
    /// The mean at all rows.
    pub fitted: Vec<f64>,
    /// Relative standard deviation of each row.
    pub scale: Vec<f64>,
}

impl Explained {
    /// The rows that count.
    pub fn kept(&self) -> Vec<usize> {
        (0..self.fitted.len()).filter(|row| !self.outliers.contains(row)).collect()
    }

    /// Relative standard deviations and correlation of the noise.
    pub fn shape(&self) -> Shape {
        Shape { scale: self.scale.clone(), rho: self.noise.rho.unwrap_or(0.0) }
    }

    /// The whitened space of the rows that count.
    pub fn space(&self, sample: &Sample) -> Space {
        space_of(sample, &self.kept(), &self.shape(), self.variance_factor)
    }
}

/// The whitened space of some rows.
pub(super) fn space_of(sample: &Sample, kept: &[usize], shape: &Shape, variance_factor: f64) -> Space {
    let prior: Vec<Vec<f64>> =
        sample.prior.iter().map(|row| row.iter().map(|value| variance_factor * value).collect()).collect();
    Space::new(kept, shape, &sample.terms, &prior)
}

/// Fits the set to the rows that count, by least squares, and stores the fitted mean at all rows.
pub(super) fn refit(sample: &Sample, now: &mut Explained) {
    let space = now.space(sample);
    let solved = solved(sample, &now.set, &space);
    now.fitted = mean(sample, &now.set, &solved, &space);
}

/// The least-squares problem of a set.
pub(super) fn solved(sample: &Sample, set: &[Hypothesis], space: &Space) -> LeastSquares {
    let columns: Vec<Vec<f64>> = set.iter().flat_map(|it| &it.columns).map(|column| space.in_whitened_space(column)).collect();
    solve(&columns, &space.in_whitened_space(&sample.residual()))
}

/// The nominal response plus the causes, with the coefficients changed within their uncertainty by the data.
fn mean(sample: &Sample, set: &[Hypothesis], solved: &LeastSquares, space: &Space) -> Vec<f64> {
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

/// The change of the file's coefficients: the posterior mean, from the residual and their uncertainty.
pub(super) fn calibration(sample: &Sample, space: &Space, fitted: &[f64]) -> Vec<f64> {
    let left: Vec<f64> = sample.response.iter().zip(fitted).map(|(y, f)| y - f).collect();
    space.calibration(&left, &sample.terms)
}

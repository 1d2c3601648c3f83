//! Robust fits of given terms: Huber's loss, and least absolute errors.
//!
//! In: the terms, the rows, a loss. Out: coefficients in double-double, the scale of the errors, the rows with low weight, standard errors where a
//! formula gives them. With weights w the error of a row is sqrt(w) (y - yhat). Chooses no terms: `response/loss.rs` does, with the weights of such
//! fits.
//!
//! ```text
//! scale     s = median |error|/0.6745: the standard deviation of normal errors
//! huber     minimises sum rho(error/s), rho(u) = u^2/2 up to k, k |u| - k^2/2 beyond
//! l1        minimises sum |error|
//! ```
//!
//! Sources: Huber 1981, Robust Statistics, 7.6 and 7.8 (the loss, the covariance), Holland, Welsch 1977, Robust regression using iteratively
//! reweighted least squares (k = 1.345); `l1.rs` for least absolute errors.

mod huber;
mod l1;
mod report;

use crate::dd::Dd;
use crate::design::Design;
use crate::observations::Observations;
use crate::qr::{Compressed, Dependent, Growing, Triangle};
use crate::spec::Loss;
use rsm_core::order;

pub use report::{LossReport, LowWeight};

/// Huber's k, in scales: 95 % of the efficiency of least squares with normal errors (Holland, Welsch 1977).
pub const K: f64 = 1.345;

/// The median of |u| for a standard normal u: the quantile at 3/4.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;

/// A scale below this share of the largest response is the rounding of f64 data: more than half of the rows lie on the surface.
const NO_SCALE: f64 = 1e-13;

/// A robust fit.
pub(crate) struct Robust {
    /// In the order of the design.
    pub coefficients: Vec<Dd>,
    /// sqrt(w) (y - yhat) of each row.
    pub errors: Vec<f64>,
    pub scale: f64,
    pub iterations: usize,
    pub has_converged: bool,
    /// Of l1: whether no other coefficients have the same sum. `None` for other losses.
    pub is_unique: Option<bool>,
    /// The standard error of each coefficient; empty if no formula gives it.
    pub standard_errors: Vec<f64>,
}

/// Fits all terms of a design. Linearly dependent terms are an outcome.
pub(crate) fn fit(design: &Design, fit: Observations<'_>, loss: Loss) -> Result<Robust, Dependent> {
    let rows = Rows { design, fit };
    let all: Vec<usize> = (0..design.width()).collect();
    let start = Growing::of(&rows.triangle(|_| 1.0), &all)?;
    Ok(match loss {
        Loss::L1 => l1::fit(&rows, &start),
        Loss::Huber | Loss::LeastSquares => huber::fit(&rows, &start),
    })
}

/// The rows with their weights in them.
struct Rows<'a> {
    design: &'a Design,
    fit: Observations<'a>,
}

impl Rows<'_> {
    fn count(&self) -> usize {
        self.fit.response.len()
    }

    /// The terms of a row and its response, times the root of its weight.
    fn row(&self, row: usize) -> (Vec<Dd>, Dd) {
        let (x, y) = (self.design.row_as_measured(&self.fit.point(row)), Dd::from(self.fit.response[row]));
        if self.fit.weights.is_empty() {
            return (x, y);
        }
        let root = self.fit.weight(row).sqrt();
        (x.into_iter().map(|x| x * root).collect(), y * root)
    }

    /// The triangle with a further weight for each row.
    fn triangle(&self, weight: impl Fn(usize) -> f64) -> Triangle {
        let mut compressed = Compressed::new(self.design.width() + 1);
        for row in 0..self.count() {
            let (x, y) = self.row(row);
            let root = Dd::from(weight(row)).sqrt();
            compressed.push(x.into_iter().chain([y]).map(|x| x * root));
        }
        compressed.finish()
    }

    fn errors(&self, coefficients: &[Dd]) -> Vec<Dd> {
        let error = |row: usize| {
            let (x, y) = self.row(row);
            y - product(&x, coefficients)
        };
        (0..self.count()).map(error).collect()
    }

    /// The scale below which errors are rounding.
    fn no_scale(&self) -> f64 {
        let largest = |row: usize| self.fit.response[row].abs() * self.fit.weight(row).sqrt().to_f64();
        NO_SCALE * (0..self.count()).map(largest).fold(0.0, f64::max)
    }
}

fn product(x: &[Dd], coefficients: &[Dd]) -> Dd {
    x.iter().zip(coefficients).map(|(x, b)| *x * *b).sum()
}

/// The scale of errors about 0.
fn scale_of(errors: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    order::sort(&mut sizes);
    let middle = sizes.len() / 2;
    let median = if sizes.len() % 2 == 1 { sizes[middle] } else { 0.5 * (sizes[middle - 1] + sizes[middle]) };
    median / NORMAL_MEDIAN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_the_median_of_magnitudes() {
        // The quantile of the normal distribution at 3/4 is 0.67449: five digits of any table.
        assert!((scale_of(&[-3.0, 1.0, 200.0]) - 3.0 / 0.67449).abs() < 1e-5);
        assert!((scale_of(&[-3.0, 1.0, 200.0, 0.0]) - 2.0 / 0.67449).abs() < 1e-5);
    }
}

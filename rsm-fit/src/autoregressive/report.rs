//! What is told about autoregressive noise.
//!
//! In: an [`Estimate`] with the standard deviation of its innovations. Out: a [`NoiseReport`] with sentences. Estimates nothing.

use nalgebra::DMatrix;
use serde::Serialize;

use super::{Estimate, autocovariances};
use crate::sequence::Sequence;

/// A random walk has the sum 1 of phi. It is excluded if the sum is below 1 by this number of standard errors (Dickey, Fuller 1979, with a constant:
/// 5 % for 100 rows).
const EXCLUDED: f64 = 2.89;

/// Autoregressive noise, for `rsm fit --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoiseReport {
    /// p, the number of rows before on which an error depends.
    pub order: usize,
    /// phi_1 to phi_p.
    pub coefficients: Vec<f64>,
    /// Their asymptotic standard errors.
    pub standard_errors: Vec<f64>,
    /// The standard error of their sum.
    #[serde(skip)]
    pub(crate) sum_error: f64,
    /// The standard deviation of the innovations.
    pub innovation_sd: f64,
    /// AICc of the orders 0, 1, ...; of the order alone if it was given.
    pub aicc: Vec<f64>,
    /// The number of series.
    pub series: usize,
    /// The number of places in them where rows are missing.
    pub gaps: usize,
    /// The Durbin-Watson statistic of the whitened errors, within the series.
    pub durbin_watson: Option<f64>,
    /// Bounds of the 95 % interval of each coefficient of the surface.
    pub intervals: Vec<[f64; 2]>,
    /// The largest ratio of a standard error to that of least squares, which takes the rows as independent.
    pub ratio: Option<f64>,
    /// The figures that are withheld, and why.
    pub withheld: &'static str,
}

impl NoiseReport {
    /// `whitened`: the whitened errors in the order of the sequence.
    pub(crate) fn of(estimate: &Estimate, sequence: &Sequence, innovation_sd: f64, whitened: &[f64]) -> Self {
        let order = estimate.partial.len();
        let covariances = autocovariances(&estimate.partial, order.max(1));
        let gamma = DMatrix::from_fn(order, order, |i, j| covariances[i.abs_diff(j)]);
        let rows = sequence.rows.len() as f64;
        let inverse = gamma.try_inverse().unwrap_or_else(|| DMatrix::zeros(order, order));
        let borders = (1..sequence.series.len()).filter(|k| sequence.series[*k] != sequence.series[*k - 1]);
        let is_gap =
            |k: &usize| sequence.series[*k] == sequence.series[*k - 1] && sequence.places[*k] != sequence.places[*k - 1] + 1;
        NoiseReport {
            order,
            coefficients: estimate.whitening.coefficients().to_vec(),
            standard_errors: (0..order).map(|k| (inverse[(k, k)] / rows).sqrt()).collect(),
            sum_error: (inverse.sum().max(0.0) / rows).sqrt(),
            innovation_sd,
            aicc: estimate.criteria.clone(),
            series: borders.count() + 1,
            gaps: (1..sequence.places.len()).filter(is_gap).count(),
            durbin_watson: durbin_watson(whitened, sequence),
            intervals: Vec::new(),
            ratio: None,
            withheld: "adjusted and predicted R2, PRESS, lack of fit and the analysis of variance need independent rows",
        }
    }

    /// The noise in words.
    #[must_use]
    pub fn words(&self) -> String {
        let numbers: Vec<String> = self.coefficients.iter().map(|phi| format!("{phi:.4}")).collect();
        let series = if self.series == 1 { "1 series".to_string() } else { format!("{} series", self.series) };
        if self.order == 0 {
            return format!("independent errors, order 0 by AICc, {series}");
        }
        let ratio = self
            .ratio
            .map_or(String::new(), |ratio| format!(", standard errors up to {ratio:.1} times those of independent rows"));
        let watson = self.durbin_watson.map_or(String::new(), |d| format!(", Durbin-Watson of the whitened errors {d:.3}"));
        format!("autoregressive of order {}: {}, {series}{ratio}{watson}", self.order, numbers.join(", "))
    }

    /// The warning if the errors may be a random walk, whose level is not known.
    pub(crate) fn near_walk(&self) -> Option<String> {
        let sum: f64 = self.coefficients.iter().sum();
        (self.order > 0 && 1.0 - sum < EXCLUDED * self.sum_error).then(|| {
            format!(
                "the errors of a series may be a random walk (sum of the noise's coefficients {sum:.3}, standard error {:.3}): then its level is unknown, and so are the standard errors of terms that hardly change within a series",
                self.sum_error
            )
        })
    }
}

/// The statistic over neighbours of one series, scaled to all rows as without borders and gaps.
fn durbin_watson(whitened: &[f64], sequence: &Sequence) -> Option<f64> {
    let seconds: Vec<usize> = (1..whitened.len()).filter(|k| sequence.places[*k] == sequence.places[*k - 1] + 1).collect();
    let neighbours: f64 = seconds.iter().map(|k| (whitened[*k] - whitened[*k - 1]).powi(2)).sum();
    let square: f64 = whitened.iter().map(|error| error * error).sum();
    let found = neighbours / seconds.len() as f64 * (whitened.len() - 1) as f64 / square;
    found.is_finite().then_some(found)
}

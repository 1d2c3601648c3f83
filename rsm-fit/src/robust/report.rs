//! What is told about a robust fit.
//!
//! In: a [`Robust`] and the rows. Out: a [`LossReport`] with sentences. Computes no coefficient.

use rsm_core::order;
use serde::Serialize;

use super::{K, Robust};
use crate::observations::{Named, Observations};
use crate::spec::Loss;

/// A row is listed if its weight is below this: its error is above 2.7 scales, which 0.7 % of normal errors are.
const LOW: f64 = 0.5;

/// The largest number of rows in words.
const MOST_NAMED: usize = 5;

/// A robust fit, for `rsm fit --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LossReport {
    /// "huber" or "l1".
    pub loss: &'static str,
    /// Huber's k, in scales; null for l1.
    pub k: Option<f64>,
    /// The scale of the errors: their median magnitude divided by 0.6745.
    pub scale: f64,
    /// The number of steps.
    pub iterations: usize,
    /// Whether the steps ended by their rule. For l1 the subgradient condition is then fulfilled.
    pub converged: bool,
    /// For l1: whether no other coefficients have the same sum of absolute errors. Null for Huber's loss.
    pub unique: Option<bool>,
    /// The rows with a weight below 0.5, the lowest first.
    pub low_weight: Vec<LowWeight>,
    /// The figures that are withheld, and why.
    pub withheld: &'static str,
}

/// A row with low weight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LowWeight {
    /// The fitted row, from 1.
    pub row: usize,
    /// Its inputs.
    pub at: Named<f64>,
    /// Response minus surface.
    pub residual: f64,
    /// The weight of Huber's loss: 1 up to k scales, then k scales divided by the error.
    pub weight: f64,
}

impl LossReport {
    pub(crate) fn of(found: &Robust, loss: Loss, fit: Observations<'_>, names: &[String]) -> Self {
        let weight = |row: usize| (K * found.scale / found.errors[row].abs()).min(1.0);
        let of_one = |row: usize| LowWeight {
            row: row + 1,
            at: Named(names.iter().zip(fit.inputs).map(|(name, column)| (name.clone(), column[row])).collect()),
            residual: found.errors[row] / fit.weight(row).sqrt().to_f64(),
            weight: weight(row),
        };
        let mut low_weight: Vec<LowWeight> = (0..found.errors.len()).filter(|row| weight(*row) < LOW).map(of_one).collect();
        order::ascending(&mut low_weight, |it| it.weight);
        LossReport {
            loss: loss.word(),
            k: (loss == Loss::Huber).then_some(K),
            scale: found.scale,
            iterations: found.iterations,
            converged: found.has_converged,
            unique: found.is_unique,
            low_weight,
            withheld: match loss {
                Loss::L1 => {
                    "R2, residual sd, PRESS, C, lack of fit and the analysis of variance are of squared errors, and standard errors need the density of the errors at 0"
                }
                _ => {
                    "R2, residual sd, PRESS, C, lack of fit and the analysis of variance are of squared errors; standard errors are asymptotic (Huber 1981)"
                }
            },
        }
    }

    /// The loss and its scale, in words.
    #[must_use]
    pub fn words(&self, unit: &str) -> String {
        let k = self.k.map_or(String::new(), |k| format!(" with k = {k}"));
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let unique = if self.unique == Some(false) { "; other coefficients have the same sum of absolute errors" } else { "" };
        format!(
            "{}{k}, scale {:.4e}{unit}, {} steps{unique}; withheld: {}",
            self.loss, self.scale, self.iterations, self.withheld
        )
    }

    /// The rows with low weight, in words; `None` if there is none.
    #[must_use]
    pub fn outliers(&self) -> Option<String> {
        let one = |it: &LowWeight| {
            let at: Vec<String> = it.at.0.iter().map(|(name, value)| format!("{name} = {value}")).collect();
            format!("row {} ({}): error {:.4e}, weight {:.2}", it.row, at.join(", "), it.residual, it.weight)
        };
        let named: Vec<String> = self.low_weight.iter().take(MOST_NAMED).map(one).collect();
        let more = self.low_weight.len().saturating_sub(MOST_NAMED);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        (!named.is_empty()).then(|| format!("{}{more}", named.join("; ")))
    }
}

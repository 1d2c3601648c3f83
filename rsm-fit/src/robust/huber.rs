//! Huber's loss by iteratively reweighted least squares.
//!
//! In: rows, the least-squares fit. Out: a [`Robust`]. Each step computes the scale from the errors, then weights min(1, k s/|error|), then weighted
//! least squares in double-double. The scale is part of the iteration (Huber's proposal with the median, as in most packages).

use super::{K, Robust, Rows, scale_of};
use crate::dd::Dd;
use crate::qr::Growing;

/// The steps end when the errors change by less than this share of them (root of sums of squares). A step reduces the distance by a factor, often a
/// half, so the distance that is left has the same size, far below any standard error.
const SETTLED: f64 = 1e-11;

/// The largest number of steps. Stackloss needs 22.
const MOST_STEPS: usize = 1000;

pub(super) fn fit(rows: &Rows<'_>, start: &Growing) -> Robust {
    let all: Vec<usize> = (0..rows.design.width()).collect();
    let no_scale = rows.no_scale();
    let mut coefficients = start.coefficients();
    let mut errors: Vec<f64> = rows.errors(&coefficients).into_iter().map(Dd::to_f64).collect();
    let (mut iterations, mut has_converged) = (0, false);
    let mut scale = scale_of(&errors);
    while iterations < MOST_STEPS && !has_converged {
        if scale <= no_scale {
            has_converged = true;
            break;
        }
        iterations += 1;
        let triangle = rows.triangle(|row| (K * scale / errors[row].abs()).min(1.0));
        // A weight is above 0, so the terms stay independent unless the weights differ by many powers of ten.
        let Ok(growing) = Growing::of(&triangle, &all) else { break };
        coefficients = growing.coefficients();
        let next: Vec<f64> = rows.errors(&coefficients).into_iter().map(Dd::to_f64).collect();
        let change: f64 = errors.iter().zip(&next).map(|(before, after)| (before - after).powi(2)).sum();
        let square: f64 = errors.iter().map(|error| error * error).sum();
        errors = next;
        scale = scale_of(&errors);
        has_converged = change.sqrt() <= SETTLED * square.sqrt();
    }
    let standard_errors =
        if has_converged && scale > no_scale { standard_errors(rows, start, &errors, scale) } else { Vec::new() };
    Robust { coefficients, errors, scale, iterations, has_converged, is_unique: None, standard_errors }
}

/// The asymptotic standard errors (Huber 1981, (6.5) in 7.6), from the variance factor v of each coefficient of least squares:
///
/// ```text
/// variance = kappa^2 sum(psi^2)/(n - p)/m^2 v,   kappa = 1 + p/n var(psi')/m^2,   m = mean(psi')
/// ```
///
/// psi is the error, limited to k s; psi' is 1 below the limit and 0 above. Empty without a degree of freedom or a row below the limit.
fn standard_errors(rows: &Rows<'_>, start: &Growing, errors: &[f64], scale: f64) -> Vec<f64> {
    let (n, p) = (errors.len() as f64, rows.design.width() as f64);
    let limit = K * scale;
    let inside = errors.iter().filter(|error| error.abs() <= limit).count() as f64;
    if n <= p || inside == 0.0 {
        return Vec::new();
    }
    let mean = inside / n;
    // The variance of n zeros and ones, with n - 1.
    let spread = n * mean * (1.0 - mean) / (n - 1.0);
    let kappa = 1.0 + p * spread / (n * mean * mean);
    let square: f64 = errors.iter().map(|error| error.clamp(-limit, limit).powi(2)).sum();
    let factor = kappa * (square / (n - p)).sqrt() / mean;
    start.variances().into_iter().map(|variance| factor * variance.sqrt().to_f64()).collect()
}

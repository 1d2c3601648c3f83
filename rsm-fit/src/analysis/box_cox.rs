//! The Box-Cox power of the response, for a linear model with normal noise.
//!
//! In: columns and a positive response. Out: the power with its interval. 1 is no transformation, 0.5 the square root, 0 the logarithm, -1 the
//! reciprocal. Nothing is transformed here.
//!
//! Source: Box, Cox 1964, An analysis of transformations.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::threads;

/// The range of powers that is searched.
const RANGE: [f64; 2] = [-3.0, 3.0];

/// Half of the 95 % point of chi squared with one degree of freedom.
const DROP: f64 = 1.920_729_410_347_062;

/// A power with its 95 % likelihood interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BoxCox {
    /// The power with the largest likelihood.
    pub power: f64,
    /// Its interval, limited to -3 and 3.
    pub interval: [f64; 2],
}

/// Finds the power from -3 to 3. `columns`: those of the model without the constant. `None` if a response is not above 0, if all are equal, if there
/// are too few rows, or if the columns have a different number of rows.
///
/// ```
/// // exp(x) with a little scatter asks for the logarithm.
/// let x: Vec<f64> = (0..20).map(|k| k as f64 / 10.0).collect();
/// let y: Vec<f64> = x.iter().enumerate().map(|(k, x)| (x + 0.02 * ((k * 7 % 5) as f64 - 2.0)).exp()).collect();
/// let found = rsm_fit::analysis::box_cox(&[x], &y).unwrap();
/// assert!(found.interval[0] < 0.0 && 0.0 < found.interval[1] && found.interval[1] < 1.0);
/// ```
#[must_use]
pub fn box_cox(columns: &[Vec<f64>], response: &[f64]) -> Option<BoxCox> {
    let rows = response.len();
    let width = columns.len() + 1;
    if rows <= width
        || columns.iter().any(|column| column.len() != rows)
        || response.iter().any(|y| !(y.is_normal() && *y > 0.0))
    {
        return None;
    }
    if response.iter().all(|y| *y == response[0]) {
        return None;
    }
    let x = DMatrix::from_fn(rows, width, |row, k| if k == 0 { 1.0 } else { columns[k - 1][row] });
    let q = x.qr().q();
    let mean_log = response.iter().map(|y| y.ln()).sum::<f64>() / rows as f64;
    // -n/2 ln of the residual sum of squares of (y^l - 1)/(l g^(l - 1)), with the geometric mean g. With y/g in place of y it differs only by a
    // constant.
    let likelihood = |power: f64| {
        let z = |y: &f64| {
            let log = y.ln() - mean_log;
            if (power * log).abs() < 1e-8 { log + 0.5 * power * log * log } else { (power * log).exp_m1() / power }
        };
        let z = DVector::from_iterator(rows, response.iter().map(z));
        let left = &z - &q * (q.transpose() * &z);
        -0.5 * rows as f64 * (left.norm_squared() / rows as f64).ln()
    };
    let grid: Vec<f64> = (0..=60).map(|k| RANGE[0] + 0.1 * f64::from(k)).collect();
    let each = threads::all(grid.len(), rows, |k| likelihood(grid[k]));
    let start = grid.iter().copied().zip(each).max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    let (mut low, mut high) = ((start - 0.1).max(RANGE[0]), (start + 0.1).min(RANGE[1]));
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        let both = threads::all(2, rows, |k| likelihood([a, b][k]));
        if both[0] < both[1] { low = a } else { high = b }
    }
    let power = 0.5 * (low + high);
    let least = likelihood(power) - DROP;
    let end = |far: f64| {
        if likelihood(far) >= least {
            return far;
        }
        let (mut inside, mut outside) = (power, far);
        for _ in 0..60 {
            let middle = 0.5 * (inside + outside);
            if likelihood(middle) >= least { inside = middle } else { outside = middle }
        }
        inside
    };
    likelihood(power).is_finite().then(|| {
        let ends = threads::all(2, rows, |k| end(RANGE[k]));
        BoxCox { power, interval: [ends[0], ends[1]] }
    })
}

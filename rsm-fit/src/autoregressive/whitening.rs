//! Rows with autoregressive errors, transformed into rows with independent errors.
//!
//! In: partial autocorrelations, the order of the rows with its series and gaps. Out: a [`Whitening`] that replaces each row by its innovation: the
//! row minus its best linear prediction from all earlier rows of its series, divided by the standard deviation of that prediction. It is exact at the
//! beginning of a series (the process is stationary) and behind gaps, by a Kalman filter. Least squares on the new rows is generalised least squares.
//!
//! ```text
//! e_t = phi_1 e_(t-1) + ... + phi_p e_(t-p) + u_t,   var u = 1 (the scale of u cancels)
//! state: the last p errors; P: their covariance given the earlier rows
//! ```
//!
//! Sources: Durbin 1960, The fitting of time-series models (partial autocorrelations to phi); Prais, Winsten 1954 (the first row of order 1); Jones
//! 1980, Maximum likelihood fitting of ARMA models to time series with missing observations (the filter).

use std::ops::{Add, Mul, Sub};

use crate::sequence::Sequence;

/// What a row needs: how many rows to advance, what it tells of the rows before, and one over its standard deviation.
#[derive(Debug, Clone)]
struct Step {
    /// Whether the row is the first of its series.
    is_first: bool,
    /// The number of rows since the row before; above 1 behind a gap.
    advance: usize,
    /// The share of an innovation by which each earlier error of the state changes; empty once all of them are known.
    gains: Vec<f64>,
    scale: f64,
}

/// The transformation of rows with autoregressive errors.
#[derive(Debug, Clone)]
pub(crate) struct Whitening {
    /// phi_1 to phi_p.
    coefficients: Vec<f64>,
    steps: Vec<Step>,
    /// The logarithm of the determinant of the errors' covariance, for innovations of variance 1.
    log_determinant: f64,
}

/// phi of partial autocorrelations (Durbin 1960). All of these between -1 and 1 is the condition of a stationary process.
pub(crate) fn coefficients(partial: &[f64]) -> Vec<f64> {
    let mut phi: Vec<f64> = Vec::with_capacity(partial.len());
    for own in partial {
        let before = phi.clone();
        for (k, entry) in phi.iter_mut().enumerate() {
            *entry -= own * before[before.len() - 1 - k];
        }
        phi.push(*own);
    }
    phi
}

/// The autocovariances of the errors at distances 0, 1, ... `count` - 1, for innovations of variance 1.
pub(crate) fn autocovariances(partial: &[f64], count: usize) -> Vec<f64> {
    let mut covariances = vec![1.0 / partial.iter().map(|r| 1.0 - r * r).product::<f64>()];
    let mut variance = covariances[0];
    for lag in 1..count {
        // Of the process of order `lag` - 1, as long as there are partial autocorrelations.
        let known = &partial[..partial.len().min(lag - 1)];
        let predicted: f64 = coefficients(known).iter().enumerate().map(|(k, phi)| phi * covariances[lag - 1 - k]).sum();
        let own = partial.get(lag - 1).copied().unwrap_or(0.0);
        covariances.push(predicted + own * variance);
        variance *= 1.0 - own * own;
    }
    covariances.truncate(count);
    covariances
}

impl Whitening {
    /// The transformation for the rows of a sequence. `partial`: partial autocorrelations, all between -1 and 1.
    pub(crate) fn new(partial: &[f64], sequence: &Sequence) -> Self {
        let order = partial.len();
        let phi = coefficients(partial);
        let stationary = autocovariances(partial, order.max(1));
        let start = |row: usize, column: usize| stationary[row.abs_diff(column)];
        let mut covariance: Vec<f64> = Vec::new();
        let mut steps = Vec::with_capacity(sequence.rows.len());
        let mut log_determinant = 0.0;
        for k in 0..sequence.rows.len() {
            let is_first = k == 0 || sequence.series[k] != sequence.series[k - 1];
            let advance = if is_first { 0 } else { sequence.places[k] - sequence.places[k - 1] };
            if is_first {
                covariance = (0..order * order).map(|at| start(at / order, at % order)).collect();
            }
            for _ in 0..advance {
                advanced(&mut covariance, &phi);
            }
            let variance = if order == 0 { 1.0 } else { covariance[0] };
            let gains: Vec<f64> = (1..order).map(|row| covariance[row * order] / variance).collect();
            for row in 1..order {
                for column in 1..order {
                    covariance[row * order + column] -= gains[row - 1] * covariance[column];
                }
            }
            // The row itself is known exactly.
            for row in 0..order {
                (covariance[row], covariance[row * order]) = (0.0, 0.0);
            }
            let gains = if gains.iter().all(|gain| *gain == 0.0) { Vec::new() } else { gains };
            log_determinant += variance.ln();
            steps.push(Step { is_first, advance, gains, scale: 1.0 / variance.sqrt() });
        }
        Whitening { coefficients: phi, steps, log_determinant }
    }

    pub(crate) fn log_determinant(&self) -> f64 {
        self.log_determinant
    }

    /// phi_1 to phi_p.
    pub(crate) fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Transforms a matrix in place. `rows`: row after row in the order of the sequence, each with `width` numbers.
    pub(crate) fn apply<T>(&self, rows: &mut [T], width: usize)
    where
        T: Copy + From<f64> + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
    {
        let zero = T::from(0.0);
        let order = self.coefficients.len();
        let phi: Vec<T> = self.coefficients.iter().map(|phi| T::from(*phi)).collect();
        // The errors of the last `order` rows, or their best estimates, the newest first.
        let mut state = vec![zero; order * width];
        let mut next = vec![zero; width];
        for (step, row) in self.steps.iter().zip(rows.chunks_exact_mut(width)) {
            if step.is_first {
                state.fill(zero);
            }
            let advance = if order == 0 { 0 } else { step.advance };
            for _ in 0..advance {
                next.fill(zero);
                for (phi, known) in phi.iter().zip(state.chunks_exact(width)) {
                    for (next, known) in next.iter_mut().zip(known) {
                        *next = *next + *phi * *known;
                    }
                }
                state.copy_within(..(order - 1) * width, width);
                state[..width].copy_from_slice(&next);
            }
            let scale = T::from(step.scale);
            for (column, entry) in row.iter_mut().enumerate() {
                let measured = *entry;
                let innovation = if order == 0 { measured } else { measured - state[column] };
                for (k, gain) in step.gains.iter().enumerate() {
                    let known = &mut state[(k + 1) * width + column];
                    *known = *known + T::from(*gain) * innovation;
                }
                if order > 0 {
                    state[column] = measured;
                }
                *entry = innovation * scale;
            }
        }
    }
}

/// The covariance of the last errors, one row later.
fn advanced(covariance: &mut [f64], phi: &[f64]) {
    let order = phi.len();
    if order == 0 {
        return;
    }
    let product = |row: usize| -> f64 { (0..order).map(|k| phi[k] * covariance[k * order + row]).sum() };
    let products: Vec<f64> = (0..order).map(product).collect();
    let newest = 1.0 + phi.iter().zip(&products).map(|(phi, product)| phi * product).sum::<f64>();
    for row in (1..order).rev() {
        for column in (1..order).rev() {
            covariance[row * order + column] = covariance[(row - 1) * order + column - 1];
        }
    }
    for k in 1..order {
        (covariance[k], covariance[k * order]) = (products[k - 1], products[k - 1]);
    }
    covariance[0] = newest;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(series: &[usize], places: &[usize]) -> Sequence {
        Sequence { rows: (0..places.len()).collect(), places: places.to_vec(), series: series.to_vec(), is_known: false }
    }

    #[test]
    fn coefficients_and_autocovariances_worked_by_hand() {
        // phi = (r1 (1 - r2), r2) = (0.5 * 1.4, -0.4) = (0.7, -0.4).
        let phi = coefficients(&[0.5, -0.4]);
        assert!((phi[0] - 0.7).abs() < 1e-15 && phi[1] == -0.4, "{phi:?}");
        // g0 = 1/(0.75 * 0.84); g1 = r1 g0; then the recurrence of Yule and Walker.
        let g = autocovariances(&[0.5, -0.4], 5);
        assert!((g[0] - 1.0 / 0.63).abs() < 1e-15 && (g[1] - 0.5 * g[0]).abs() < 1e-15);
        for lag in 2..5 {
            // A few roundings of numbers near 1.
            assert!((g[lag] - 0.7 * g[lag - 1] + 0.4 * g[lag - 2]).abs() < 1e-15, "{lag}");
        }
        assert_eq!(autocovariances(&[], 2), [1.0, 0.0]);
    }

    #[test]
    fn the_first_row_of_order_one_is_that_of_prais_and_winsten() {
        // sqrt(1 - 0.36) = 0.8; then differences 2 - 0.6 * 1, and behind one missing row 5 - 0.36 * 2 over sqrt(1 + 0.36).
        let mut rows = [1.0, 2.0, 5.0, 3.0];
        let whitening = Whitening::new(&[0.6], &sequence(&[0, 0, 0, 1], &[0, 1, 3, 5]));
        whitening.apply(&mut rows, 1);
        let expected = [0.8, 1.4, (5.0 - 0.72) / 1.36_f64.sqrt(), 2.4];
        // A few roundings of numbers near 1.
        assert!(rows.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{rows:?}");
        let logs = -2.0 * 0.64_f64.ln() + 1.36_f64.ln();
        assert!((whitening.log_determinant() - logs).abs() < 1e-14);
    }

    #[test]
    fn whitened_unit_rows_are_the_inverse_of_the_covariance() {
        // With W the whitened unit matrix, W'W is the inverse of the covariance of the errors: W'W V = 1 for the exact V of a stationary process of
        // order 3, in two series with gaps.
        let partial = [0.7, -0.5, 0.3];
        let (series, places) = ([0, 0, 0, 0, 0, 0, 1, 1, 1, 1], [0, 1, 3, 4, 9, 10, 12, 13, 14, 17]);
        let count = places.len();
        let mut unit: Vec<f64> = (0..count * count).map(|at| f64::from(u8::from(at % (count + 1) == 0))).collect();
        let whitening = Whitening::new(&partial, &sequence(&series, &places));
        whitening.apply(&mut unit, count);
        let covariances = autocovariances(&partial, 20);
        let v = |i: usize, j: usize| if series[i] == series[j] { covariances[places[i].abs_diff(places[j])] } else { 0.0 };
        for i in 0..count {
            for j in 0..count {
                let entry =
                    |k: usize| -> f64 { (0..count).map(|t| unit[t * count + i] * unit[t * count + k]).sum::<f64>() * v(k, j) };
                let sum: f64 = (0..count).map(entry).sum();
                // Some hundred roundings of numbers below 4.
                assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-13, "{i} {j} {sum}");
            }
        }
        // The same determinant as by elimination.
        let mut matrix: Vec<Vec<f64>> = (0..count).map(|i| (0..count).map(|j| v(i, j)).collect()).collect();
        let mut logs = 0.0;
        for k in 0..count {
            logs += matrix[k][k].ln();
            let pivot = matrix[k].clone();
            for line in &mut matrix[k + 1..] {
                let share = line[k] / pivot[k];
                line.iter_mut().zip(&pivot).for_each(|(entry, pivot)| *entry -= share * pivot);
            }
        }
        assert!((whitening.log_determinant() - logs).abs() < 1e-12, "{logs}");
    }
}

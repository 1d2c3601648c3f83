//! The noise of new data: whether it grows with the response, and whether successive errors are correlated.
//!
//! In: residuals, fitted values, places in the run order. Out: the maximum likelihood estimate, and 2 ln of its likelihood ratio against uniform,
//! independent noise. Does not change residuals.
//!
//! Sources: Cook and Weisberg 1983 and Carroll and Ruppert 1988 for variance functions; a first-order autoregression for correlated errors, as in
//! Durbin and Watson 1950, by exact likelihood.

use crate::engine::autoregression::innovations;
use rsm_core::order;

/// How the standard deviation of the noise depends on the response.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Growth {
    /// exp(rate u), where u goes from -1 to 1 over the range of fitted values.
    Exponential(f64),
    /// |fitted|^power.
    Power(f64),
}

impl Growth {
    /// The relative standard deviation at fitted values, with geometric mean 1.
    pub fn scale(self, fitted: &[f64]) -> Vec<f64> {
        let logs: Vec<f64> = match self {
            Growth::Exponential(rate) => centred(fitted).iter().map(|u| rate * u).collect(),
            Growth::Power(power) => logarithms(fitted).iter().map(|u| power * u).collect(),
        };
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        logs.iter().map(|log| (log - mean).exp()).collect()
    }

    /// The standard deviation at the highest fitted value divided by that at the lowest.
    pub fn ratio(self, fitted: &[f64]) -> f64 {
        match self {
            Growth::Exponential(rate) => (2.0 * rate).exp(),
            Growth::Power(power) => {
                let (low, high) = order::ends(fitted);
                (high / low).abs().powf(power)
            }
        }
    }

    /// The rate or the power.
    pub fn exponent(self) -> f64 {
        match self {
            Growth::Exponential(exponent) | Growth::Power(exponent) => exponent,
        }
    }
}

fn centred(fitted: &[f64]) -> Vec<f64> {
    let (low, high) = order::ends(fitted);
    let half = ((high - low) / 2.0).max(f64::MIN_POSITIVE);
    fitted.iter().map(|f| ((f - (low + high) / 2.0) / half).clamp(-1.0, 1.0)).collect()
}

/// ln |fitted|, with |fitted| limited to at least a thousandth of the largest. Nearer to zero, a power law is not plausible.
fn logarithms(fitted: &[f64]) -> Vec<f64> {
    let (low, high) = order::ends(fitted);
    let most = low.abs().max(high.abs()).max(f64::MIN_POSITIVE);
    fitted.iter().map(|f| f.abs().max(1e-3 * most).ln()).collect()
}

/// The minimum of a smooth function of one number between bounds: a grid, then golden section search.
fn least(low: f64, high: f64, value: &dyn Fn(f64) -> f64) -> (f64, f64) {
    const GRID: usize = 16;
    let at = |k: usize| low + (high - low) * k as f64 / GRID as f64;
    let best = (0..=GRID).map(|k| (value(at(k)), k)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |it| it.1);
    let (mut a, mut b) = (at(best.saturating_sub(1)), at((best + 1).min(GRID)));
    let golden = (5.0_f64.sqrt() - 1.0) / 2.0;
    // 0.618^20 = 7e-5 of the interval: far below any standard error.
    for _ in 0..20 {
        let (c, d) = (b - golden * (b - a), a + golden * (b - a));
        if value(c) < value(d) { b = d } else { a = c }
    }
    let x = (a + b) / 2.0;
    (x, value(x))
}

/// -2 ln(likelihood) of residuals with relative standard deviations, with the best common factor.
fn misfit(residual: &[f64], ln_scale: &dyn Fn(usize) -> f64) -> f64 {
    let rows = residual.len() as f64;
    let (mut square, mut logs) = (0.0, 0.0);
    for (row, e) in residual.iter().enumerate() {
        let ln_s = ln_scale(row);
        square += e * e * (-2.0 * ln_s).exp();
        logs += ln_s;
    }
    rows * (square / rows).max(f64::MIN_POSITIVE).ln() + 2.0 * logs
}

/// The largest rate: exp(2 * 3) = 400 from the lowest to the highest response.
const STEEPEST: f64 = 3.0;

/// The best growth model, and 2 ln of its likelihood ratio.
pub(super) fn growth(residual: &[f64], fitted: &[f64]) -> (Growth, f64) {
    let even = misfit(residual, &|_| 0.0);
    let u = centred(fitted);
    let (rate, after) = least(-STEEPEST, STEEPEST, &|rate| misfit(residual, &|row| rate * u[row]));
    let mut best = (Growth::Exponential(rate), even - after);
    let (low, high) = order::ends(fitted);
    // A power law needs a response of one sign whose range is large relative to its size.
    if low * high > 0.0 && (high / low).abs().max((low / high).abs()) > 1.5 {
        let logs = logarithms(fitted);
        let (power, after) = least(-1.0, STEEPEST, &|power| misfit(residual, &|row| power * logs[row]));
        if even - after > best.1 {
            best = (Growth::Power(power), even - after);
        }
    }
    best
}

/// 2 ln of the likelihood ratio of growth without the largest residuals (one in fifty, at least one). Growth of noise is visible in many runs,
/// outlying runs are few.
pub(super) fn growth_beyond_few(residual: &[f64], fitted: &[f64]) -> f64 {
    let few = (residual.len() / 50).max(1);
    let mut order: Vec<usize> = (0..residual.len()).collect();
    order::ascending(&mut order, |it| residual[*it].abs());
    order.truncate(residual.len().saturating_sub(few));
    order.sort_unstable();
    let of = |values: &[f64]| -> Vec<f64> { order.iter().map(|row| values[*row]).collect() };
    growth(&of(residual), &of(fitted)).1
}

/// The best correlation of neighbours in the run order, and 2 ln of its likelihood ratio. `places` must ascend.
pub(super) fn correlation(residual: &[f64], places: &[usize]) -> (f64, f64) {
    let rows = residual.len() as f64;
    let misfit = |rho: f64| {
        let (mut square, mut logs) = (0.0, 0.0);
        for new in innovations(rho, places.iter().copied().zip(residual.iter().copied())) {
            square += new.value.powi(2) / new.variance;
            logs += new.variance.ln();
        }
        rows * (square / rows).max(f64::MIN_POSITIVE).ln() + logs
    };
    // Only positive correlation: a negative one has no physical cause.
    let (rho, after) = least(0.0, 0.97, &misfit);
    (rho, misfit(0.0) - after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn a_power_and_a_correlation_are_found_and_their_absence_is() {
        let mut random = Random::new(3);
        let rows = 4000;
        let fitted: Vec<f64> = (0..rows).map(|k| 2.0 + (k % 40) as f64 / 4.0).collect();
        let even: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
        let places: Vec<usize> = (0..rows).collect();
        assert!(growth(&even, &fitted).1 < 9.0 && correlation(&even, &places).1 < 9.0);
        let grown: Vec<f64> = even.iter().zip(&fitted).map(|(e, f)| e * f * 0.1).collect();
        let (found, ratio) = growth(&grown, &fitted);
        // The standard error of a power is 1/sqrt(2 rows variance of ln f) = 0.025 here; four of them.
        assert!(matches!(found, Growth::Power(power) if (power - 1.0).abs() < 0.1) && ratio > 500.0, "{found:?} {ratio}");
        let mut last = 0.0;
        let following: Vec<f64> = even
            .iter()
            .map(|e| {
                last = 0.6 * last + 0.8 * e;
                last
            })
            .collect();
        let (rho, ratio) = correlation(&following, &places);
        // Standard error sqrt((1 - 0.36)/4000) = 0.013; four of them.
        assert!((rho - 0.6).abs() < 0.05 && ratio > 500.0, "{rho} {ratio}");
    }
}

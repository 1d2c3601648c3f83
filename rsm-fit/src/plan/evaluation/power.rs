//! The power of the t test of a coefficient.
//!
//! In: the noncentrality of the coefficient, the degrees of freedom of the residual, the level of the test. Out: the probability that the test finds
//! the effect. The square of Student's t has an F distribution, and a noncentral one is a mixture of beta distributions with weights of Poisson
//! (Johnson, Kotz, Balakrishnan, Continuous Univariate Distributions, volume 2, 1995, 30.2 and 31.2):
//!
//! ```text
//! P(|T| > t) = sum over j of e^-m m^j/j! I_{df/(df + t^2)}(df/2, j + 1/2),   m = noncentrality^2/2
//! ```
//!
//! All terms are positive, so the sum loses no digits.

use statrs::function::beta::beta_reg;
use statrs::function::gamma::ln_gamma;

use crate::distributions::quantile_t;

/// The level of the test: the probability to find an effect that does not exist.
pub(super) const LEVEL: f64 = 0.05;

/// Weights of Poisson beyond this many standard deviations from the largest one have a sum below 1e-15.
const REACH: f64 = 9.0;

/// A smaller mean would need more than REACH standard deviations for its tail of 1e-15.
const LEAST_REACH: f64 = 40.0;

/// The critical value of the two-sided test.
pub(super) fn critical_t(freedom: usize) -> f64 {
    quantile_t(1.0 - LEVEL, freedom)
}

/// The probability that |T| exceeds `critical` with this noncentrality.
pub(super) fn power(noncentrality: f64, critical: f64, freedom: usize) -> f64 {
    let mean = 0.5 * noncentrality * noncentrality;
    let freedom = freedom as f64;
    let share = freedom / (freedom + critical * critical);
    let reach = REACH * mean.sqrt() + LEAST_REACH;
    let (first, last) = ((mean - reach).max(0.0) as u64, (mean + reach) as u64);
    let weight = |j: f64| {
        // 0 ln 0 is 0: without an effect only the first term counts.
        let log = if j > 0.0 { j * mean.ln() } else { 0.0 };
        (log - mean - ln_gamma(j + 1.0)).exp()
    };
    let (mut sum, mut total) = (0.0, 0.0);
    for j in first..=last {
        let weight = weight(j as f64);
        if weight > 0.0 {
            sum += weight * beta_reg(0.5 * freedom, j as f64 + 0.5, share);
            total += weight;
        }
    }
    // The weights have a common error, 1e-16 of a logarithm that may be 1e6; their sum is 1.
    (sum / total).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// P(|Z + delta| > t s) with s^2 = chi^2/df, integrated over s by the trapezoidal rule: no beta function takes part.
    fn integrated(delta: f64, t: f64, freedom: f64) -> f64 {
        // erfc by its own series would be shared with nothing, but statrs' is from another function than beta_reg.
        let upper = |z: f64| 0.5 * statrs::function::erf::erfc(z / std::f64::consts::SQRT_2);
        let log_density = |s: f64| (freedom - 1.0) * s.ln() - 0.5 * freedom * s * s;
        let (mut sum, mut total) = (0.0, 0.0);
        for k in 1..200_000 {
            let s = f64::from(k) * 5e-5;
            let density = (log_density(s) - log_density(1.0)).exp();
            total += density;
            sum += density * (upper(t * s - delta) + upper(t * s + delta));
        }
        sum / total
    }

    #[test]
    fn powers_are_those_of_an_integral() {
        for freedom in [1, 3, 10, 126] {
            let t = critical_t(freedom);
            for delta in [0.0, 0.3, 1.0, 2.8, 6.0] {
                let (found, expected) = (power(delta, t, freedom), integrated(delta, t, freedom as f64));
                // The step of the rule is 5e-5; with one degree of freedom the density does not vanish at 0, where the rule errs by half a step.
                let bound = if freedom == 1 { 1e-4 } else { 1e-8 };
                assert!((found - expected).abs() < bound, "{freedom} {delta}: {found} {expected}");
            }
            // Without an effect the power is the level.
            assert!((power(0.0, t, freedom) - LEVEL).abs() < 1e-12);
        }
    }

    #[test]
    fn powers_are_those_of_published_tables() {
        // Two groups of 64 and a difference of half a standard deviation: 0.8015; of 26 and 0.8: 0.8075 (Cohen 1988; the manual of G*Power).
        for (group, difference, expected) in [(64, 0.5, 0.8015), (26, 0.8, 0.8075)] {
            let freedom = 2 * group - 2;
            let found = power(difference * (group as f64 / 2.0).sqrt(), critical_t(freedom), freedom);
            // Half a unit of the last digit.
            assert!((found - expected).abs() < 5e-5, "{found} {expected}");
        }
        // Large effects: no overflow, and one of many runs is found for certain.
        assert!((power(300.0, critical_t(20), 20) - 1.0).abs() < 1e-15);
    }
}

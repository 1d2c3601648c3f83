//! Student's t and Fisher's F: probabilities, and a quantile of t.
//!
//! In: a value with degrees of freedom. Out: a probability, or the value of one. By the regularised incomplete beta function.

use statrs::function::beta::beta_reg;

/// P(|T| > |t|) = I_{df/(df + t^2)}(df/2, 1/2).
pub(crate) fn two_sided_t(t: f64, freedom: f64) -> Option<f64> {
    let p = beta_reg(freedom / 2.0, 0.5, freedom / (freedom + t * t));
    p.is_finite().then_some(p)
}

/// The t for which |T| < t has this probability, by bisection to the last bit.
///
/// ```
/// // A table has 2.262 for 95 % and 9 degrees of freedom.
/// assert!((rsm_fit::distributions::quantile_t(0.95, 9) - 2.262).abs() < 1e-3);
/// ```
#[must_use]
pub fn quantile_t(level: f64, freedom: usize) -> f64 {
    let is_below = |t: f64| two_sided_t(t, freedom as f64).is_some_and(|p| 1.0 - p < level);
    let (mut low, mut high) = (0.0, 1.0);
    while is_below(high) && high < 1e300 {
        high *= 2.0;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if is_below(middle) { low = middle } else { high = middle }
    }
    high
}

/// P(F > f) = I_{d2/(d2 + d1 f)}(d2/2, d1/2).
pub(crate) fn upper_f(f: f64, [d1, d2]: [f64; 2]) -> Option<f64> {
    let p = beta_reg(d2 / 2.0, d1 / 2.0, d2 / (d2 + d1 * f));
    p.is_finite().then_some(p)
}

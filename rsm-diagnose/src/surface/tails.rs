//! Tails of the t, F and gamma distributions, and their inverses, far from the centre.
//!
//! In: a statistic with its degrees of freedom. Out: the logarithm of the probability of as much or more by chance, and the statistic of a given probability. Logarithms are used
//! because the probability may lie below the smallest f64. Never NaN for finite arguments and positive degrees of freedom.

use statrs::function::beta::{beta_reg, ln_beta};
use statrs::function::gamma::gamma_ur;

/// Below this an incomplete beta or gamma function is near the smallest f64, and its leading term takes over.
const SMALL: f64 = 1e-280;

/// ln I_x(a, b). Below [`SMALL`] the leading term x^a (1 - x)^b / (a B(a, b)) with the first step of its continued fraction (NIST DLMF 8.17.22): its relative error
/// there is nothing beside a logarithm of hundreds.
fn ln_beta_reg(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return f64::NEG_INFINITY;
    }
    if x >= 1.0 {
        return 0.0;
    }
    let value = beta_reg(a, b, x);
    if value > SMALL {
        return value.ln();
    }
    let first = 1.0 - x * (a + b) / (a + 1.0);
    a * x.ln() + b * (-x).ln_1p() - a.ln() - ln_beta(a, b) - first.max(SMALL).ln()
}

/// ln P(F >= f) with `d1` and `d2` degrees of freedom.
pub(super) fn ln_upper_f(f: f64, d1: f64, d2: f64) -> f64 {
    if f <= 0.0 { 0.0 } else { ln_beta_reg(d2 / 2.0, d1 / 2.0, d2 / (d2 + d1 * f)) }
}

/// ln P(|T| >= |t|).
pub(super) fn ln_two_sided_t(t: f64, freedom: f64) -> f64 {
    ln_upper_f(t * t, 1.0, freedom)
}

/// The F whose upper tail is `exp(ln_p)`: by bisection of ln F, which the tail falls along.
pub(super) fn f_of(ln_p: f64, d1: f64, d2: f64) -> f64 {
    // e^-60 to e^60 hold every F that a test can ask for.
    let (mut low, mut high) = (-60.0_f64, 60.0_f64);
    // 2^-60 of the interval: below the rounding of F.
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if ln_upper_f(middle.exp(), d1, d2) > ln_p { low = middle } else { high = middle }
    }
    ((low + high) / 2.0).exp()
}

/// The t with P(|T| >= t) = `p`.
pub(super) fn t_of(p: f64, freedom: f64) -> f64 {
    f_of(p.ln(), 1.0, freedom).sqrt()
}

/// ln of the upper tail of a distribution of which mean, variance and third central moment are known, as a shifted gamma distribution (Pearson's type III, which keeps all
/// three); a normal one where there is no skew to the right.
pub(super) fn ln_upper_of_moments(value: f64, mean: f64, variance: f64, third: f64) -> f64 {
    if variance <= 0.0 {
        return 0.0;
    }
    let sd = variance.sqrt();
    let skew = third / (variance * sd);
    // Below this skew the gamma distribution is normal to three digits of its tail.
    const NORMAL: f64 = 0.02;
    let z = (value - mean) / sd;
    let tail = if skew < NORMAL {
        0.5 * statrs::function::erf::erfc(z / std::f64::consts::SQRT_2)
    } else {
        let shape = 4.0 / (skew * skew);
        // Mean `shape`, variance `shape`: the standardised gamma variable.
        let x = shape + z * shape.sqrt();
        if x <= 0.0 { 1.0 } else { gamma_ur(shape, x) }
    };
    tail.max(SMALL).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_agree_with_closed_forms_also_where_a_probability_underflows() {
        // (2, d2): P(F >= f) = (1 + 2 f/d2)^(-d2/2), for any f.
        for (f, d2) in [(0.3_f64, 7.0), (4.0, 12.0), (1e3, 40.0), (1e9, 400.0)] {
            let exact = -d2 / 2.0 * (2.0 * f / d2).ln_1p();
            // Relative 1e-9: what statrs's incomplete beta function holds.
            assert!((ln_upper_f(f, 2.0, d2) / exact - 1.0).abs() < 1e-9, "{f} {d2}");
        }
        // t of 97.5 % with 10 degrees of freedom: 2.228139 (any table).
        assert!((t_of(0.05, 10.0) - 2.228139).abs() < 1e-6);
        assert!((ln_upper_f(f_of(-800.0, 3.0, 900.0), 3.0, 900.0) + 800.0).abs() < 1e-6);
        // A gamma distribution is its own: shape 3, scale 2 has mean 6, variance 12, third moment 48; P(X > 10) = e^-5 (1 + 5 + 12.5).
        let found = ln_upper_of_moments(10.0, 6.0, 12.0, 48.0);
        assert!((found.exp() - (-5.0_f64).exp() * 18.5).abs() < 1e-9);
    }
}

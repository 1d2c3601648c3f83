//! Significance: tail probabilities of test statistics, and their quantiles.
//!
//! In: a statistic with its degrees of freedom, or a probability; numbers of trials. Out: the logarithm of the probability that chance gives at least
//! this value, or the statistic. The probability may be smaller than the smallest f64, so its logarithm is used. Never NaN for finite arguments and
//! positive degrees of freedom.

use rsm_core::order;
use statrs::function::beta::{beta_reg, ln_beta};
use statrs::function::erf::{erfc, erfc_inv};
use statrs::function::gamma::{gamma_lr, gamma_ur, ln_gamma};

/// The probability that noise alone is taken for a cause of a plant. The tests of whiteness add as much. With the errors of noise models, false
/// alarms stay below 5 %.
pub(crate) const FALSE_ALARM: f64 = 0.01;

/// Below this, an incomplete beta or gamma function is near the smallest f64, and its leading term is used.
const SMALL: f64 = 1e-280;

/// P(a, x) for every argument: 0 for x below 0, 1 at infinity and for a of at most 0. The library function panics there.
pub(crate) fn lower_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        0.0
    } else if x == f64::INFINITY || a <= 0.0 {
        1.0
    } else if a == f64::INFINITY {
        0.0
    } else {
        gamma_lr(a, x)
    }
}

/// Q(a, x) = 1 - P(a, x), for every argument.
fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        1.0
    } else if x == f64::INFINITY || a <= 0.0 {
        0.0
    } else if a == f64::INFINITY {
        1.0
    } else {
        gamma_ur(a, x)
    }
}

/// ln I_x(a, b). Below [`SMALL`]: the leading term x^a (1 - x)^b / (a B(a, b)) and the first step of its continued fraction (NIST DLMF 8.17.22). The
/// relative error of that is negligible beside a logarithm of some hundreds.
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
pub(crate) fn ln_upper_f(f: f64, d1: f64, d2: f64) -> f64 {
    if f <= 0.0 { 0.0 } else { ln_beta_reg(d2 / 2.0, d1 / 2.0, d2 / (d2 + d1 * f)) }
}

/// The logarithm of the probability that `width` arbitrary columns explain at least this much of noise: an F test of the explained squares against
/// the remaining squares, each with its degrees of freedom.
pub(crate) fn ln_p_of_squares(taken: f64, width: f64, left: f64, freedom: f64) -> f64 {
    ln_upper_f(taken.max(0.0) / width / (left / freedom).max(f64::MIN_POSITIVE), width, freedom)
}

/// ln P(|T| >= |t|).
pub(crate) fn ln_two_sided_t(t: f64, freedom: f64) -> f64 {
    ln_upper_f(t * t, 1.0, freedom)
}

/// ln P(chi squared >= value). The degrees of freedom need not be an integer. Below [`SMALL`]: the first steps of the continued fraction (NIST DLMF
/// 8.9.2).
pub(crate) fn ln_upper_chi_squared(value: f64, freedom: f64) -> f64 {
    let (a, x) = (freedom / 2.0, value / 2.0);
    if x <= 0.0 {
        return 0.0;
    }
    let tail = upper_gamma(a, x);
    if tail > SMALL {
        return tail.ln().min(0.0);
    }
    if x == f64::INFINITY || a <= 0.0 {
        return f64::NEG_INFINITY;
    }
    a * x.ln() - x - ln_gamma(a) - (x + 1.0 - a - (1.0 - a) / (x + 3.0 - a)).ln()
}

/// The value of a positive statistic whose upper tail is `exp(ln_p)`, by bisection on the logarithm of the value.
fn of_tail(ln_p: f64, ln_upper: impl Fn(f64) -> f64) -> f64 {
    // All statistics of these tests are between e^-60 and e^60.
    let (mut low, mut high) = (-60.0_f64, 60.0_f64);
    // The interval shrinks by 2^-60, below the rounding of the statistic.
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if ln_upper(middle.exp()) > ln_p { low = middle } else { high = middle }
    }
    ((low + high) / 2.0).exp()
}

/// The F whose upper tail is `exp(ln_p)`.
pub(crate) fn f_of(ln_p: f64, d1: f64, d2: f64) -> f64 {
    of_tail(ln_p, |f| ln_upper_f(f, d1, d2))
}

/// The chi squared whose upper tail is `exp(ln_p)`.
pub(crate) fn chi_squared_of(ln_p: f64, freedom: f64) -> f64 {
    of_tail(ln_p, |value| ln_upper_chi_squared(value, freedom))
}

/// The distribution function of a normal variable.
pub(crate) fn normal(x: f64) -> f64 {
    0.5 * erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// The value that a normal variable exceeds with this probability.
pub(crate) fn quantile(probability: f64) -> f64 {
    std::f64::consts::SQRT_2 * erfc_inv(2.0 * probability)
}

/// The normal deviate with the same upper tail probability as chi squared at `value`. If that probability underflows, it follows from the leading
/// term of the normal tail, exp(-z^2/2)/(z sqrt(2 pi)).
pub(crate) fn deviate_of_chi_squared(value: f64, freedom: f64) -> f64 {
    let ln_p = ln_upper_chi_squared(value, freedom);
    if ln_p > -0.5 {
        // Near 1 the lower tail is more accurate.
        return -quantile(lower_gamma(freedom / 2.0, value / 2.0).max(SMALL));
    }
    if ln_p > SMALL.ln() {
        return quantile(ln_p.exp());
    }
    if ln_p == f64::NEG_INFINITY {
        return f64::INFINITY;
    }
    let z = (-2.0 * ln_p).sqrt();
    (-2.0 * ln_p - (std::f64::consts::TAU * z * z).ln()).sqrt()
}

/// The median. Sorts the values in place.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    order::sort(values);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
}

/// ln of the probability that the best of `trials` trials is at least this good by chance; `ln_p` is for one trial (C. E. Bonferroni, 1936).
pub(crate) fn ln_p_of_best(ln_p: f64, trials: f64) -> f64 {
    (ln_p + trials.max(1.0).ln()).min(0.0)
}

/// The trial with the smallest probability by chance (the first of equal ones), and ln of its probability corrected for the number of trials in
/// `series` series of trials.
pub(crate) fn most_significant<T>(tried: impl IntoIterator<Item = (f64, T)>, series: f64) -> Option<(f64, T)> {
    let mut count = 0_u32;
    let best = tried.into_iter().inspect(|_| count += 1).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(ln_p, what)| (ln_p_of_best(ln_p, series * f64::from(count)), what))
}

/// The gain that the best of `trials` on noise exceeds with the probability [`FALSE_ALARM`], if each fits `numbers` parameters: chi squared with
/// Bonferroni's bound (C. E. Bonferroni, 1936). This bound also covers what first-order draws miss: nonlinear parameters, and trials chosen after
/// looking at the residual.
pub(crate) fn best_gain_by_chance(trials: usize, numbers: usize) -> f64 {
    chi_squared_of((FALSE_ALARM / trials.max(1) as f64).ln(), numbers.max(1) as f64)
}

/// The value that the largest of many gains exceeds with the probability [`FALSE_ALARM`], estimated from some draws of the largest gain. A maximum
/// has a Gumbel distribution (E. J. Gumbel, 1958). Few draws give its mean and standard deviation; a percentile would need many more.
pub(crate) fn point_of_largest(largest: &[f64]) -> f64 {
    let n = largest.len().max(1) as f64;
    let mean = largest.iter().sum::<f64>() / n;
    let sd = (largest.iter().map(|gain| (gain - mean) * (gain - mean)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
    // The scale is sd sqrt(6)/pi. Mean minus mode is Euler's constant times the scale.
    let scale = sd * 6.0_f64.sqrt() / std::f64::consts::PI;
    mean + scale * (-(-(1.0 - FALSE_ALARM).ln()).ln() - statrs::consts::EULER_MASCHERONI)
}

/// The t with P(|T| >= t) = `p`.
pub(crate) fn t_of(p: f64, freedom: f64) -> f64 {
    f_of(p.ln(), 1.0, freedom).sqrt()
}

/// ln of the upper tail of a distribution with known mean, variance and third central moment. It is approximated by a shifted gamma distribution with
/// the same three moments (Pearson type III), or by a normal distribution if it is not skewed to the right.
pub(crate) fn ln_upper_of_moments(value: f64, mean: f64, variance: f64, third: f64) -> f64 {
    if variance <= 0.0 {
        return 0.0;
    }
    let sd = variance.sqrt();
    let skew = third / (variance * sd);
    // Below this skew, the gamma and the normal tail agree to three digits.
    const NORMAL: f64 = 0.02;
    let z = (value - mean) / sd;
    let tail = if skew < NORMAL {
        0.5 * erfc(z / std::f64::consts::SQRT_2)
    } else {
        let shape = 4.0 / (skew * skew);
        // The standardised gamma variable: its mean and its variance are both `shape`.
        let x = shape + z * shape.sqrt();
        upper_gamma(shape, x)
    };
    tail.max(SMALL).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn statistics_of_records_without_noise_have_a_probability_too() {
        let (infinite, never) = (f64::INFINITY, f64::NEG_INFINITY);
        assert_eq!([0.0, -1.0, infinite].map(|value| ln_upper_chi_squared(value, 4.0)), [0.0, 0.0, never]);
        assert_eq!([ln_upper_chi_squared(2.0, 0.0), ln_upper_chi_squared(2.0, infinite)], [never, 0.0]);
        assert_eq!(deviate_of_chi_squared(infinite, 4.0), infinite);
        // No energy at all is as rare as a probability can be: beyond 35 standard deviations below.
        assert!([0.0, -1.0].iter().all(|value| (-40.0..-35.0).contains(&deviate_of_chi_squared(*value, 4.0))));
        assert_eq!(
            [lower_gamma(2.0, infinite), lower_gamma(2.0, 0.0), lower_gamma(0.0, 1.0), lower_gamma(infinite, 1.0)],
            [1.0, 0.0, 1.0, 0.0]
        );
    }

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

    #[test]
    fn the_tail_of_chi_squared_is_that_of_tables_and_of_a_closed_form() {
        for (value, freedom, p) in
            [(3.841, 1.0, 0.05), (5.991, 2.0, 0.05), (9.488, 4.0, 0.05), (11.070, 5.0, 0.05), (18.307, 10.0, 0.05)]
        {
            // Tables have four digits.
            assert!((ln_upper_chi_squared(value, freedom).exp() / p - 1.0).abs() < 1e-3, "{freedom}");
        }
        // Four degrees of freedom: exp(-x) (1 + x) with x half the value, also where it underflows.
        for value in [3.0, 200.0, 1250.0, 1320.0, 1e5] {
            let x = value / 2.0_f64;
            assert!((ln_upper_chi_squared(value, 4.0) / (x.ln_1p() - x) - 1.0).abs() < 1e-9, "{value}");
        }
        // Both sides of the limit at which the leading term takes over, of many degrees of freedom: the slope of ln p there is -0.44.
        let near = |value| ln_upper_chi_squared(value, 400.0);
        let slopes: Vec<f64> = (0..300).map(|k| near(2190.0 + f64::from(k)) - near(2189.0 + f64::from(k))).collect();
        assert!(slopes.iter().all(|it| (-0.43..=-0.40).contains(it)), "{slopes:?}");
    }

    #[test]
    fn normal_deviates_are_those_of_tables() {
        // 97.5 % and 99.99 %.
        assert!((quantile(0.025) - 1.959_964).abs() < 1e-6 && (quantile(1e-4) - 3.719_016).abs() < 1e-6);
        assert!((normal(1.959_964) - 0.975).abs() < 1e-7);
        // Chi squared with one degree of freedom passes z^2 as rarely as |z| passes z: half of it is one side.
        assert!((deviate_of_chi_squared(3.841_459, 1.0) - 1.644_854).abs() < 1e-5);
        // Its median is no deviation, and what is below it one to the other side.
        assert!((deviate_of_chi_squared(2.0 * 2.0_f64.ln(), 2.0)).abs() < 1e-9);
        assert!((deviate_of_chi_squared(-2.0 * 0.975_f64.ln(), 2.0) + 1.959_964).abs() < 1e-5);
        // It goes on where the probability underflows: -2 ln p = 1288 is 35.7 deviations.
        let far: Vec<f64> = (0..40).map(|k| deviate_of_chi_squared(1280.0 + f64::from(k), 2.0)).collect();
        let steps = far.windows(2).map(|it| it[1] - it[0]);
        // d z = d value/(2 z), to a hundredth.
        assert!(steps.into_iter().all(|it| (it * 2.0 * 35.7 - 1.0).abs() < 0.02), "{far:?}");
    }

    #[test]
    fn squares_are_compared_by_their_degrees_of_freedom() {
        // 6 of 2 columns against 12 of 8: F = 3/1.5, of which (1 + 2 2/8)^-4 is the tail.
        assert!((ln_p_of_squares(6.0, 2.0, 12.0, 8.0) + 4.0 * 1.5_f64.ln()).abs() < 1e-9);
        assert_eq!(ln_p_of_squares(-1.0, 2.0, 12.0, 8.0), 0.0);
    }

    #[test]
    fn the_rarest_of_all_that_was_tried_pays_for_the_others() {
        let tried = [(-3.0, "a"), (-9.0, "b"), (-9.0, "c"), (0.0, "d")];
        assert_eq!(most_significant(tried, 2.0), Some((-9.0 + 8.0_f64.ln(), "b")));
        assert_eq!(most_significant([(-0.5, "a"), (-0.1, "b")], 1.0), Some((0.0, "a")));
        assert_eq!(most_significant(Vec::<(f64, ())>::new(), 1.0), None);
    }

    #[test]
    fn the_best_of_a_hundred_trials_with_two_numbers() {
        // Chi squared with two degrees of freedom passes x with the probability exp(-x/2).
        assert!((best_gain_by_chance(100, 2) / (2.0 * 1e4_f64.ln()) - 1.0).abs() < 1e-9, "{}", best_gain_by_chance(100, 2));
        // 99 % of one degree of freedom, any table.
        assert!((best_gain_by_chance(1, 1) - 6.6349).abs() < 1e-4, "{}", best_gain_by_chance(1, 1));
    }

    #[test]
    fn the_point_of_maxima_is_passed_once_in_a_hundred() {
        // The largest of 30 exponentials: its 99 % point is -ln(1 - 0.99^(1/30)) = 8.00.
        let mut random = Random::new(4);
        let largest: Vec<f64> = (0..4000).map(|_| (0..30).map(|_| -(1.0 - random.share()).ln()).fold(0.0, f64::max)).collect();
        // 4000 draws know the mean to 0.02 and the standard deviation of 1.28 to 0.03: 3.1 times that.
        assert!((point_of_largest(&largest) - 8.0).abs() < 0.15, "{}", point_of_largest(&largest));
    }
}

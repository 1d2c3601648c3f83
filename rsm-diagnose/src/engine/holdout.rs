//! The gain of an extension on holdout rows.
//!
//! In: mean squared errors over the variance of the noise. Out: the gain, as a share of the error above the noise.

/// An error above the noise that is smaller than this counts as no error. A thousandth of the noise energy is its random scatter over 10^6 rows.
const LEAST_ERROR: f64 = 1e-3;

/// The excess of a mean square over the noise. `ratio` is the mean square divided by the variance of the noise. Below the noise the excess is 0.
pub(crate) fn excess(ratio: f64) -> f64 {
    (ratio - 1.0).max(0.0)
}

/// The share of the excess that an extension removes. Both arguments are sums over outputs or responses. The result is at least -1.
pub(crate) fn removed_share(before: f64, after: f64) -> f64 {
    // mutant `< to <=`: equality cannot occur. A ratio of at least 1, minus 1, is a multiple of 2^-52, as is a sum of such numbers; 1e-3 is not.
    if before < LEAST_ERROR { 0.0 } else { (1.0 - after / before).max(-1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_is_what_is_gone_of_what_was_above_the_noise() {
        // 8 and 3 above the noise; 1.25 and nothing are left.
        let sum = |ratios: [f64; 2]| ratios.map(excess).iter().sum();
        assert_eq!(removed_share(sum([9.0, 4.0]), sum([2.25, 0.25])), 1.0 - 1.25 / 11.0);
        assert_eq!([removed_share(5e-4, 0.0), removed_share(1.5e-3, 0.0), removed_share(3.0, 99.0)], [0.0, 1.0, -1.0]);
    }
}

//! The gain of an extension on holdout rows.
//!
//! In: mean squared errors over the variance of the noise. Out: the gain, as a share of the error above the noise.

/// Less than this above the noise is nothing to gain: a thousandth of its energy is its scatter over 10^6 rows.
const LEAST_ERROR: f64 = 1e-3;

/// The energy above the noise of a mean square over that of the noise. What is below the noise counts as noise.
pub(crate) fn above(ratio: f64) -> f64 {
    (ratio - 1.0).max(0.0)
}

/// The share of the energy above the noise that is gone, of sums over outputs or responses. No less than -1: worse by far is worse by all.
pub(crate) fn gone(before: f64, after: f64) -> f64 {
    // mutant `< to <=`: a number of at least 1, less 1, is a multiple of 2^-52, and so is a sum of them; 1e-3 is none.
    if before < LEAST_ERROR { 0.0 } else { (1.0 - after / before).max(-1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_is_what_is_gone_of_what_was_above_the_noise() {
        // 8 and 3 above the noise; 1.25 and nothing are left.
        let sum = |ratios: [f64; 2]| ratios.map(above).iter().sum();
        assert_eq!(gone(sum([9.0, 4.0]), sum([2.25, 0.25])), 1.0 - 1.25 / 11.0);
        assert_eq!([gone(5e-4, 0.0), gone(1.5e-3, 0.0), gone(3.0, 99.0)], [0.0, 1.0, -1.0]);
    }
}

//! The minimum gain of a cause (effect size) while the model still has a large error.
//!
//! In: a squared residual in which the noise has one unit per row. Out: the gain below which a cause is not named. A real machine has effects that no
//! catalogue contains, and they leave structure in the residual. Among tens of hypotheses, one always explains a few per cent of any structure, far
//! above the noise and on holdout records as well.

/// A cause must remove a twentieth of the error that is left above the noise: 2.5 % of its root mean square. A right cause removes most of what is
/// left, except the effects of other causes, and the strongest cause is found first. On the measured axis, dry friction removes 80 % of the squared
/// error, an offset 60 % of the rest, an asymmetry of friction 20 % of that. The next best trace of the catalogue removes 1.5 %.
const LEAST_SHARE_OF_EXCESS: f64 = 0.05;

/// A simpler cause wins if it reaches this share of the gain, unless the better cause leaves only noise. Different smoothings and integrators of one
/// formula differ by a tenth of the noise; that is a share of this size if the cause changes the outputs by ten times the noise.
pub(super) const AS_GOOD: f64 = 0.995;

/// By how many standard deviations a squared residual may be above its rows without an error: 95 % of noise is below.
const BY_CHANCE: f64 = 2.0;

/// The smallest gain of a cause, for a squared residual of this many rows. What noise alone can leave is no error: the squares of n residuals have a
/// standard deviation of sqrt(2 n) about n.
#[must_use]
pub fn least_gain(squared: f64, rows: usize) -> f64 {
    let rows = rows as f64;
    LEAST_SHARE_OF_EXCESS * (squared - rows - BY_CHANCE * (2.0 * rows).sqrt()).max(0.0)
}

/// The difference that decides between two explanations: `threshold`, the gain by chance, or a twentieth of the error above the noise if that is
/// more. The same limit is used to name a cause, to remove it again, to compare rivals and to evaluate holdout records.
#[must_use]
pub fn deciding_difference(threshold: f64, squared: f64, rows: usize) -> f64 {
    threshold.max(least_gain(squared, rows))
}

/// How much worse a simpler cause may fit and still count as good: `tie`. If the better cause leaves more than twice the noise energy, at most the
/// gain that a separate cause would need.
#[must_use]
pub fn tie(tie: f64, squared: f64, rows: usize) -> f64 {
    if squared > 2.0 * rows as f64 { tie.min(least_gain(squared, rows)) } else { tie }
}

/// Rivals are equal if they fit worse by less than this share of the gain. Different integrators and smoothings of one formula differ by that much.
const EQUAL: f64 = 1e-5;

/// The limit below which a rival of a cause with this gain counts as equal; `decides` is the deciding difference between two explanations.
#[must_use]
pub fn equal(decides: f64, gain: f64) -> f64 {
    decides.max(EQUAL * gain)
}

/// The same for a rival that is still being fitted. One with fewer numbers wins if it is as good, so its fit goes on until that is decided.
#[must_use]
pub fn equal_rival(decides: f64, gain: f64, is_simpler: bool) -> f64 {
    if is_simpler { decides } else { equal(decides, gain) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_simpler_rival_is_decided_by_the_records_and_another_may_be_equal() {
        assert_eq!(
            [equal_rival(30.0, 1e8, true), equal_rival(30.0, 1e8, false), equal_rival(30.0, 1e5, false)],
            [30.0, 1e-5 * 1e8, 30.0]
        );
    }

    #[test]
    fn noise_asks_for_nothing_and_structure_for_its_twentieth() {
        // The squares of 800 residuals of noise have a standard deviation of 40.
        assert_eq!((least_gain(700.0, 800), least_gain(879.0, 800)), (0.0, 0.0));
        assert_eq!(least_gain(20_880.0, 800), 1000.0);
        assert_eq!((deciding_difference(30.0, 700.0, 800), deciding_difference(30.0, 20_880.0, 800)), (30.0, 1000.0));
        assert_eq!(tie(500.0, 1600.0, 800), 500.0);
        assert_eq!(tie(500.0, 4880.0, 800), 200.0);
    }
}

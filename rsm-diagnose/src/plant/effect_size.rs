//! The minimum gain of a cause (effect size) while the model still has a large error.
//!
//! In: a squared residual in which the noise has one unit a row. Out: the gain below which a cause is not named. A real machine has effects that no catalogue contains, and they leave structure in the residual.
//! Among tens of hypotheses, one always explains a few per cent of any structure, also on holdout records, and far above the noise.

/// A cause must remove a twentieth of the error that is left above the noise, 2.5 % of its root mean square: one that is right removes most of what is left, but for what
/// other causes do, and the strongest comes first. On the measured axis, dry friction removes 80 % of the squared error, its offset 60 % of what is then left, its
/// asymmetry 20 %; the next best trace of the catalogue 1.5 %.
const OF_WHAT_IS_LEFT: f64 = 0.05;

/// The least gain, for the error above the noise in a squared residual of this many rows.
#[must_use]
pub fn least(squared: f64, rows: usize) -> f64 {
    OF_WHAT_IS_LEFT * (squared - rows as f64).max(0.0)
}

/// What decides between two explanations: what chance does, `threshold`, and where more than noise is left, a twentieth of that. One scale for naming a cause, for leaving it out
/// again, for its rivals and for what a holdout record says.
#[must_use]
pub fn decides(threshold: f64, squared: f64, rows: usize) -> f64 {
    threshold.max(least(squared, rows))
}

/// By how much a simpler cause may do worse and still be as good: `tie`, but no more than what a cause of its own would have to be worth where the better one leaves more
/// than as much again as the noise.
#[must_use]
pub fn tie(tie: f64, squared: f64, rows: usize) -> f64 {
    if squared > 2.0 * rows as f64 { tie.min(least(squared, rows)) } else { tie }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_asks_for_nothing_and_structure_for_its_twentieth() {
        assert_eq!(least(900.0, 1000), 0.0);
        assert_eq!(least(21_000.0, 1000), 1000.0);
        assert_eq!((decides(30.0, 900.0, 1000), decides(30.0, 21_000.0, 1000)), (30.0, 1000.0));
        assert_eq!(tie(500.0, 1900.0, 1000), 500.0);
        assert_eq!(tie(500.0, 5000.0, 1000), 200.0);
    }
}

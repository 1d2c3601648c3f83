//! How sure a cause is: the probability that it is right.
//!
//! In: what a cause gains, what its fitted rivals fall short of it by, what is left unexplained, whether rivals were asked, the verdict. Out: a probability. Four things
//! speak against a cause: chance, each rival, a cause that is not in the catalogue, a rival that nobody asked. Its odds against the first two come from the records; the others are rates, counted on
//! hidden effects of seeds that the tables of `cargo xtask hidden-effects` do not use.

/// What the probability of a cause comes from.
pub struct Case<'a> {
    /// How much worse the fit is without it, in squared standard deviations of the noise.
    pub gain: f64,
    /// By how much each rival does worse, in the same unit.
    pub rivals: &'a [(String, f64)],
    /// What a cause has to gain.
    pub threshold: f64,
    /// What is left above the noise, in the same unit.
    pub left: f64,
    /// Whether the causes together leave noise.
    pub explained: bool,
    /// Whether rivals were looked for.
    pub asked: bool,
}

/// How often a cause is right that has neither chance nor rivals against it, where the causes leave noise. Hidden effects of seeds 211 to 213 (2500 rows): 99 of 100; with one of either kind still to come, as in Laplace's rule.
const EXPLAINED: f64 = 100.0 / 102.0;

/// The same where structure is left: something is at work that is not in the catalogue, and the nearest cause of the catalogue helps against it. Of the same seeds 1 of 49.
const UNEXPLAINED: f64 = 2.0 / 51.0;

/// No more than even odds for a cause whose rivals nobody asked.
const NOT_ASKED: f64 = 0.5;

/// The probability that a cause is right.
#[must_use]
pub fn confidence(case: &Case<'_>) -> f64 {
    // What does worse by the threshold has a tenth of the evidence: thresholds are where chance ends. Where structure is left, a wrong cause can win as much as that by following it.
    let unit = case.threshold + case.left.max(0.0);
    // A rival that does better and was not preferred has more numbers, or fails on validation records: it counts as one that does as well.
    let evidence = |behind: f64| (-behind.max(0.0) / unit * std::f64::consts::LN_10).exp();
    let rivals: f64 = case.rivals.iter().map(|it| evidence(it.1)).sum();
    let known = if case.explained { EXPLAINED } else { UNEXPLAINED };
    let found = known * (1.0 - evidence(case.gain)) / (1.0 + rivals);
    if case.asked { found } else { found.min(NOT_ASKED) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case<'a>(rivals: &'a [(String, f64)]) -> Case<'a> {
        Case { gain: 1e6, rivals, threshold: 30.0, left: 0.0, explained: true, asked: true }
    }

    #[test]
    fn each_thing_that_speaks_against_a_cause_counts() {
        let behind = |by: f64| [("rival".to_string(), by)];
        // Alone, and with a rival far behind: what the verdict's rate is.
        assert_eq!(confidence(&case(&[])), EXPLAINED);
        assert!((confidence(&case(&behind(1e5))) - EXPLAINED).abs() < 1e-12);
        // A rival that does as well has half; one that is behind by the threshold has a tenth as much evidence.
        assert!((confidence(&case(&behind(0.0))) - EXPLAINED / 2.0).abs() < 1e-12);
        assert!((confidence(&case(&behind(30.0))) - EXPLAINED / 1.1).abs() < 1e-12);
        // The same distance says less where structure of that size is left.
        let left = confidence(&Case { left: 970.0, ..case(&behind(30.0)) });
        assert!((left - EXPLAINED / (1.0 + 10_f64.powf(-0.03))).abs() < 1e-12);
        // No gain, no cause.
        assert_eq!(confidence(&Case { gain: 0.0, ..case(&[]) }), 0.0);
    }

    #[test]
    fn nobody_is_sure_of_what_was_not_asked_or_stands_beside_the_unknown() {
        assert_eq!(confidence(&Case { asked: false, ..case(&[]) }), NOT_ASKED);
        assert!(confidence(&Case { explained: false, ..case(&[]) }) < 0.1);
        assert!(confidence(&Case { asked: false, explained: false, ..case(&[]) }) < 0.1);
    }
}

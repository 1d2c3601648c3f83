//! The confidence of a cause: the probability that it is right.
//!
//! In: what a cause gains, by how much each fitted rival gains less, the unexplained error, whether rivals were fitted, the verdict. Out: a probability. Four things
//! can make a cause wrong: chance, a rival, a cause that is not in the catalogue, and a rival that was not fitted. The records give the odds against the first two. The other two are rates, counted on
//! hidden effects of seeds that the tables of `cargo xtask hidden-effects` do not use.

use crate::engine::probability::Probability;

/// What the probability of a cause comes from.
pub(super) struct Case<'a> {
    /// How much worse the fit is without it, in squared standard deviations of the noise.
    pub gain: f64,
    /// By how much each rival does worse, in the same unit.
    pub rivals: &'a [(String, f64)],
    /// A rival that does worse by less leaves the same trace, in the same unit.
    pub same: f64,
    /// How many leave the same trace and were not fitted: they would do as well.
    pub not_fitted: usize,
    /// What decides between two explanations, in the same unit: what chance does, or a twentieth of what is left.
    pub unit: f64,
    /// What is left above the noise, in the same unit.
    pub left: f64,
    /// Whether the causes together leave noise.
    pub explained: bool,
    /// Whether rivals were looked for.
    pub asked: bool,
}

/// How often a cause is right that has neither chance nor rivals against it, where the causes leave noise. Hidden effects of seeds 211 to 213 (2500 rows): 99 of 100; with one of either kind still to come, as in Laplace's rule.
pub(super) const EXPLAINED: f64 = 100.0 / 102.0;

/// The weight of "none of these" where structure is left, for a cause that removes half of it: something is at work that is not in the catalogue, and the nearest cause of the catalogue helps
/// against it. Of the same seeds 48 of 49 were such, and 1 was right. A cause that is right and stands beside something small removes nearly all, and an unknown of which the nearest trace
/// holds a share s of the r.m.s. is as probable for every s: the odds of the cause are s/(1 - s) of this.
const NONE_OF_THESE: f64 = 49.0 / 2.0;

/// At most even odds for a cause whose rivals were not fitted.
const NOT_ASKED: f64 = 0.5;

/// The probability that a cause is right.
#[must_use]
pub(super) fn confidence(case: &Case<'_>) -> Probability {
    // What does worse by what decides has a tenth of the evidence.
    let evidence = |behind: f64| (-behind.max(0.0) / case.unit * std::f64::consts::LN_10).exp();
    let fitted = case.rivals.iter().map(|it| (evidence(it.1), it.1 < case.same));
    let rivals = fitted.chain(std::iter::repeat_n((1.0, true), case.not_fitted));
    let known = if case.explained { EXPLAINED } else { beside_the_unknown(case) };
    let found = Probability::among(1.0 - evidence(case.gain), rivals).times(known);
    if case.asked { found } else { found.at_most(NOT_ASKED) }
}

/// How probable a cause is against none of the catalogue, by the share of the structure's r.m.s. that it removes on its own.
fn beside_the_unknown(case: &Case<'_>) -> f64 {
    let left = case.left.max(f64::MIN_POSITIVE);
    let times = ((case.gain.max(0.0) + left) / left).sqrt() - 1.0;
    if times.is_infinite() { EXPLAINED } else { EXPLAINED * times / (times + NONE_OF_THESE) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case<'a>(rivals: &'a [(String, f64)]) -> Case<'a> {
        Case { gain: 1e6, rivals, same: 30.0, not_fitted: 0, unit: 30.0, left: 0.0, explained: true, asked: true }
    }

    #[test]
    fn each_thing_that_speaks_against_a_cause_counts() {
        let behind = |by: f64| [("rival".to_string(), by)];
        // Alone, and with a rival far behind: what the verdict's rate is.
        let own = |case: &Case<'_>| confidence(case).own;
        assert_eq!(confidence(&case(&[])), Probability::plain(EXPLAINED));
        assert!((own(&case(&behind(1e5))) - EXPLAINED).abs() < 1e-12);
        // A rival that does as well has half, and one of the two is right; one that is behind by what decides has a tenth as much evidence, and is another.
        let half = confidence(&case(&behind(0.0)));
        assert!((half.own - EXPLAINED / 2.0).abs() < 1e-12 && (half.of_any - EXPLAINED).abs() < 1e-12);
        let behind_it = confidence(&case(&behind(30.0)));
        assert!((behind_it.own - EXPLAINED / 1.1).abs() < 1e-12 && behind_it.of_any == behind_it.own);
        // What leaves the same trace and was not fitted would do as well.
        let third = confidence(&Case { not_fitted: 2, ..case(&[]) });
        assert!((third.own - EXPLAINED / 3.0).abs() < 1e-12 && (third.of_any - EXPLAINED).abs() < 1e-12);
        // The same distance says less where more decides: a twentieth of what is left.
        let left = own(&Case { unit: 1000.0, ..case(&behind(30.0)) });
        assert!((left - EXPLAINED / (1.0 + 10_f64.powf(-0.03))).abs() < 1e-12);
        // No gain, no cause.
        assert_eq!(own(&Case { gain: 0.0, ..case(&[]) }), 0.0);
    }

    #[test]
    fn nobody_is_sure_of_what_was_not_asked_or_stands_beside_the_unknown() {
        assert_eq!(confidence(&Case { asked: false, ..case(&[]) }).own, NOT_ASKED);
        let beside = |left: f64| confidence(&Case { explained: false, left, ..case(&[]) }).own;
        // Of the r.m.s. three tenths of the structure are gone, two thirds, 94 %, and all but 0.1 %.
        let all = [1e6, 1.1e5, 4e3, 1.0].map(beside);
        assert!(all[0] < 0.02 && all[1] < 0.1 && all[2] < 0.4 && all[3] > 0.9, "{all:?}");
        assert!(confidence(&Case { asked: false, explained: false, left: 1e6, ..case(&[]) }).own < 0.05);
    }
}

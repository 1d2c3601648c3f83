//! The probability that a cause is right, including causes that are not in the catalogue.
//!
//! In: the probability among the known causes (against chance and against rivals), the verdict. Out: the probability among all causes. "None of these" has a rate, counted on hidden effects of seeds that the tables of
//! `cargo xtask hidden-effects surfaces` do not use.

use super::Verdict;
use crate::engine::probability::Probability;

/// How often a cause is right that has neither chance nor rivals against it, where the causes leave noise: hidden effects of seeds 641 to 648, 280 of 291.
const EXPLAINED: f64 = 0.96;

/// The same where structure is left, or the search was cut short: 2 of 92 of those seeds; with one of either kind still to come, as in Laplace's rule.
const UNEXPLAINED: f64 = 0.03;

/// The probability among all causes, known or not.
pub(super) fn beside_the_unknown(among_known: Probability, verdict: Verdict) -> Probability {
    let known = if verdict == Verdict::Unexplained { UNEXPLAINED } else { EXPLAINED };
    among_known.times(known)
}

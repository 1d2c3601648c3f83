//! The probability that a cause is right: Bayes' rule over a cause, chance and its rivals. Both diagnoses use it.
//!
//! In: the evidence of each rival relative to the cause, and whether the data distinguish the two. Out: the probability of the cause alone, and the
//! probability that the cause or an indistinguishable rival is right. Each diagnosis supplies the rate at which the true cause is not in the
//! catalogue.

/// How probable a cause is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Probability {
    /// That the cause itself is right. Causes with the same trace share the probability.
    pub(crate) own: f64,
    /// That the cause, or a rival that the data do not distinguish from it, is right.
    pub(crate) of_any: f64,
}

impl Probability {
    /// The probabilities of a cause. `not_chance` is the probability that the cause is not due to chance. Each rival has its evidence (1 if it
    /// explains the data as well as the cause) and a flag: true if the data do not distinguish it from the cause.
    #[must_use]
    pub(crate) fn among(not_chance: f64, rivals: impl IntoIterator<Item = (f64, bool)>) -> Self {
        let (mut same, mut others) = (1.0, 0.0);
        for (evidence, is_same) in rivals {
            *if is_same { &mut same } else { &mut others } += evidence;
        }
        let all = same + others;
        Probability { own: not_chance / all, of_any: not_chance * same / all }
    }

    /// The same probability for both.
    #[cfg(test)]
    pub(crate) fn plain(probability: f64) -> Self {
        Probability { own: probability, of_any: probability }
    }

    /// Multiplied by the probability `known` that the true cause is in the catalogue.
    #[must_use]
    pub(crate) fn times(self, known: f64) -> Self {
        Probability { own: known * self.own, of_any: known * self.of_any }
    }

    /// Limited to at most this.
    #[must_use]
    pub(crate) fn at_most(self, most: f64) -> Self {
        Probability { own: self.own.min(most), of_any: self.of_any.min(most) }
    }

    /// Limited to at least this.
    #[must_use]
    pub(crate) fn at_least(self, least: f64) -> Self {
        Probability { own: self.own.max(least), of_any: self.of_any.max(least) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_share_what_is_sure_of_all_of_them() {
        // Three of one trace, and a rival with a tenth of the evidence.
        let found = Probability::among(0.99, [(1.0, true), (1.0, true), (0.1, false)]);
        assert!((found.own - 0.99 / 3.1).abs() < 1e-15 && (found.of_any - 0.99 * 3.0 / 3.1).abs() < 1e-15);
        assert_eq!(Probability::among(0.5, []), Probability::plain(0.5));
        assert_eq!(found.times(0.5), Probability { own: 0.5 * found.own, of_any: 0.5 * found.of_any });
        assert_eq!(found.at_most(0.4), Probability { own: found.own, of_any: 0.4 });
        assert_eq!(found.at_least(0.4), Probability { own: 0.4, of_any: found.of_any });
    }
}

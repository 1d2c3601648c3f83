//! Rejected hypotheses, each with the reason.
//!
//! In: a diagnosis. Out: [`Rejected`]. Decides nothing: it only reads the results of the search.

use super::cause::Cause;
use super::diagnosis::Diagnosis;

/// Why a hypothesis was not accepted.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// It was accepted for a time and then rejected; the reason in words.
    Refused(String),
    /// The records do not distinguish it from this cause.
    Confounded(String),
    /// It was fitted in place of this cause. It gains less by this amount, in squared standard deviations of the noise.
    FitsWorse {
        /// The cause.
        cause: String,
        /// The difference of the gains.
        by: f64,
    },
    /// Its predicted gain is below the gain that a cause needs.
    LowPredictedGain,
    /// The accepted causes explain its first-order gain, except for this rest.
    Explained(f64),
    /// In a full fit it did not reach its predicted gain.
    NotKept,
}

/// A hypothesis that was not accepted.
#[derive(Debug, Clone, PartialEq)]
pub struct Rejected {
    /// Its name in lists.
    pub label: String,
    /// The gain that the screen of the calibrated plant predicted.
    pub predicted_gain: f64,
    /// The gain that the last screen predicted, with the causes in the plant.
    pub remaining: Option<f64>,
    /// The reason.
    pub why: Reason,
}

impl Diagnosis {
    /// Hypotheses that were not accepted, sorted by predicted gain, the largest first.
    #[must_use]
    pub fn rejected(&self) -> Vec<Rejected> {
        let causes: Vec<String> = self.entries().map(Cause::label).collect();
        let others = self.ranking.iter().filter(|(name, _)| !causes.contains(name));
        let rejected = others.map(|(name, predicted)| {
            let remaining = self.remaining.iter().find(|(label, _)| label == name).map(|it| it.1);
            let refused = self.refused.iter().find(|it| it.cause == *name).map(|it| Reason::Refused(it.why.clone()));
            let as_rival = |cause: &Cause| {
                let by = cause.rivals.iter().find(|(rival, _)| rival == name)?.1;
                let is_alike = cause.indistinguishable_from.contains(name);
                Some(if is_alike { Reason::Confounded(cause.label()) } else { Reason::FitsWorse { cause: cause.label(), by } })
            };
            let otherwise = || match remaining {
                _ if *predicted < self.threshold => Reason::LowPredictedGain,
                Some(left) if !causes.is_empty() && left < self.threshold => Reason::Explained(left),
                _ => Reason::NotKept,
            };
            let why = refused.or_else(|| self.entries().find_map(as_rival)).unwrap_or_else(otherwise);
            Rejected { label: name.clone(), predicted_gain: *predicted, remaining, why }
        });
        rejected.collect()
    }
}

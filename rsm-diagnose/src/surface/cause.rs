//! A cause in a report: kind, parameters, sentence, rivals.

use crate::engine::probability::Probability;

/// A number of a cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// The estimate.
    pub value: f64,
    /// The 95 % interval.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Its unit.
    pub unit: String,
}

/// A run that is left out.
#[derive(Debug, Clone, PartialEq)]
pub struct OutlyingRun {
    /// Its place in the run order, from 0.
    pub place: usize,
    /// Measured less what the explanation says.
    pub residual: f64,
    /// That over its standard deviation, which it has no part in.
    pub studentised: f64,
    /// Probability of as much among this many runs.
    pub p: f64,
}

/// A cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind.
    pub kind: &'static str,
    /// KIND, or KIND:NAME.
    pub label: String,
    /// What it is of, as (key, name): a term, a column, an input or a response.
    pub subject: Option<(&'static str, String)>,
    /// Its numbers.
    pub parameters: Vec<Parameter>,
    /// Further words for whoever reads JSON: shape, order, weights.
    pub details: Vec<(&'static str, String)>,
    /// Runs, of outlying ones.
    pub runs: Vec<OutlyingRun>,
    /// The probability that it is right.
    pub confidence: f64,
    /// The probability that it, or one of those that the data do not rule out, is right.
    pub confidence_of_any: f64,
    /// By how much 2 ln of the likelihood falls without it.
    pub gain: f64,
    /// ln of the probability of as much by chance.
    pub ln_p: f64,
    /// Rivals that do nearly as well, best first: label and by how much they do worse (2 ln of the likelihood, unknowns counted).
    pub rivals: Vec<(String, f64)>,
    /// Those that the data do not rule out.
    pub indistinguishable_from: Vec<String>,
    /// In plain words.
    pub sentence: String,
    /// Its places in the explanation; none for what does not move the mean.
    pub(super) members: Vec<usize>,
}

impl Cause {
    /// Takes a probability.
    pub(super) fn believe(&mut self, it: Probability) {
        (self.confidence, self.confidence_of_any) = (it.own, it.of_any);
    }

    /// How probable it is.
    pub(super) fn probability(&self) -> Probability {
        Probability { own: self.confidence, of_any: self.confidence_of_any }
    }
}

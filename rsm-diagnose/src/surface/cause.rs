//! A cause in a report: kind, parameters, sentence, rivals.

use crate::engine::probability::Probability;

/// A parameter of a cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// The estimate.
    pub value: f64,
    /// The lower end of the 95 % interval.
    pub low: f64,
    /// The upper end of the interval.
    pub high: f64,
    /// Its unit.
    pub unit: String,
}

/// A run that is left out as an outlier.
#[derive(Debug, Clone, PartialEq)]
pub struct OutlyingRun {
    /// Its index in the run order, from 0.
    pub place: usize,
    /// The measured value minus the value of the explanation.
    pub residual: f64,
    /// The same divided by its standard deviation, which is estimated without this run.
    pub studentised: f64,
    /// The probability of a residual this large among this many runs.
    pub p: f64,
}

/// A cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind.
    pub kind: &'static str,
    /// KIND, or KIND:NAME.
    pub label: String,
    /// What it refers to, as (key, name): a term, a column, an input or a response.
    pub subject: Option<(&'static str, String)>,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// Further details for JSON: shape, order, weights.
    pub details: Vec<(&'static str, String)>,
    /// The runs, for a cause of outlying runs.
    pub runs: Vec<OutlyingRun>,
    /// The probability that it is right.
    pub confidence: f64,
    /// The probability that it, or a rival that the data do not rule out, is right.
    pub confidence_of_any: f64,
    /// The decrease of 2 ln(likelihood) without it.
    pub gain: f64,
    /// ln of the probability that chance gives as much.
    pub ln_p: f64,
    /// Rivals that fit nearly as well, best first: the label, and how much worse it fits, in 2 ln(likelihood) corrected for the number of unknowns.
    pub rivals: Vec<(String, f64)>,
    /// The rivals that the data do not rule out.
    pub indistinguishable_from: Vec<String>,
    /// A plain sentence.
    pub sentence: String,
    /// Its indices in the explanation; empty for a cause that does not change the mean.
    pub(super) members: Vec<usize>,
}

impl Cause {
    /// Sets the probability.
    pub(super) fn set_probability(&mut self, it: Probability) {
        (self.confidence, self.confidence_of_any) = (it.own, it.of_any);
    }

    /// The probability.
    pub(super) fn probability(&self) -> Probability {
        Probability { own: self.confidence, of_any: self.confidence_of_any }
    }
}

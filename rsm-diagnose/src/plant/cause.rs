//! A cause, with the data that a report shows.
//!
//! In: the accepted causes of a diagnosis. Out: [`Cause`], with its parameters and its evidence. Makes no decision.

use super::hypotheses::label;
use super::regions::Region;
use rsm_core::order;
use rsm_sim::configurations;
use rsm_sim::effect::Subject;

/// A number with its 95 % interval.
#[derive(Debug, Clone, PartialEq)]
pub struct Interval {
    /// Its name.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// The unit.
    pub unit: String,
}

impl Interval {
    /// Whether the records say anything about the number: an interval without an end means that no simulated row depends on it.
    ///
    /// ```
    /// use rsm_diagnose::plant::cause::Interval;
    ///
    /// let limit = Interval { name: "high", value: 112.6, low: f64::NEG_INFINITY, high: f64::INFINITY, unit: "W".to_string() };
    /// assert!(!limit.is_determined());
    /// ```
    #[must_use]
    pub fn is_determined(&self) -> bool {
        (self.high - self.low).is_finite()
    }
}

/// A cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind of the catalogue.
    pub kind: &'static str,
    /// The parameter or output that it refers to, if any.
    pub subject: Option<String>,
    /// What `subject` is.
    pub of: Subject,
    /// Its parameters.
    pub parameters: Vec<Interval>,
    /// The probability that it is right.
    pub confidence: f64,
    /// The probability that it, or a cause with the same trace, is right.
    pub confidence_of_any: f64,
    /// Causes with the same trace in these records.
    pub indistinguishable_from: Vec<String>,
    /// How much the squared residual grows without it, in squared standard deviations of the noise.
    pub gain: f64,
    /// Its rivals, and how much worse they fit, in the same unit.
    pub rivals: Vec<(String, f64)>,
    /// Whether rivals were tested; false if the work limit was reached first.
    pub rivals_tested: bool,
    /// A sentence that describes it.
    pub sentence: String,
    /// What to measure or inspect to confirm it.
    pub check: &'static str,
    /// Its effect on the evaluation records; only for the strongest causes.
    pub contribution: Option<Contribution>,
    /// The file of the only record in which it acts; `None` if it acts in all.
    pub only_in: Option<String>,
    /// The configurations of the plant file in which it acts; empty if it acts in all.
    pub acts_in: Vec<String>,
    /// Its numbers that the validation records give, because no training row depends on them.
    pub by_holdout: Vec<&'static str>,
}

impl Cause {
    /// Its name in lists: the kind and the subject.
    #[must_use]
    pub fn label(&self) -> String {
        let name = label(self.kind, self.subject.as_deref());
        let is_own = self.parameters.iter().any(|it| configurations::parts(it.name).is_some());
        if is_own && !self.acts_in.is_empty() { configurations::name_in(&name, &self.acts_in.join(",")) } else { name }
    }

    /// Half of a number's interval as a share of its value. `None` if that means nothing: for a phase, for 0, and for a number that was not
    /// estimated.
    #[must_use]
    pub fn relative_error(number: &Interval) -> Option<f64> {
        let half = 0.5 * (number.high - number.low);
        let has_one = half > 0.0 && half.is_finite() && number.value != 0.0 && number.name != "phase";
        has_one.then(|| half / number.value.abs())
    }
}

/// The effect of a cause on the evaluation records, compared with the plant without it.
#[derive(Debug, Clone, PartialEq)]
pub struct Contribution {
    /// For each output: its place, and the root mean square error over the noise without and with the cause.
    pub outputs: Vec<(usize, f64, f64)>,
    /// For each record: its name, and its squared residual without and with the cause, in squared standard deviations of the noise.
    pub records: Vec<(String, f64, f64)>,
    /// Regions in which the plant without it is wrong.
    pub wrong_regions: Vec<Region>,
}

/// The smallest reported change of an output's error, in multiples of the noise.
const LEAST_CHANGE: f64 = 0.01;

/// Outputs with their error without and with a cause, in multiples of the noise.
pub type Changes = Vec<(usize, f64, f64)>;

impl Contribution {
    /// Outputs whose error the cause lowers, and outputs whose error it raises. The largest decrease, or the smallest increase, comes first.
    #[must_use]
    pub fn changes(&self) -> [Changes; 2] {
        let mut outputs = self.outputs.clone();
        order::descending(&mut outputs, |it| it.1 - it.2);
        let by = |sign: f64| outputs.iter().filter(|it| sign * (it.1 - it.2) > LEAST_CHANGE).copied().collect();
        [by(1.0), by(-1.0)]
    }

    /// Names of the records in which the cause gains nothing.
    #[must_use]
    pub fn without_gain(&self) -> Vec<&str> {
        self.records.iter().filter(|(_, without, with)| with >= without).map(|it| it.0.as_str()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_told_by_their_size_and_records_by_whether_they_gain() {
        let outputs = vec![(0, 2.0, 1.0), (1, 1.0, 1.005), (2, 9.0, 1.0), (3, 1.0, 1.5)];
        let records = [("a", 9.0, 4.0), ("b", 4.0, 4.0), ("c", 3.0, 5.0)];
        let records = records.map(|(name, without, with)| (name.to_string(), without, with)).to_vec();
        let it = Contribution { outputs, records, wrong_regions: Vec::new() };
        assert_eq!(it.changes(), [vec![(2, 9.0, 1.0), (0, 2.0, 1.0)], vec![(3, 1.0, 1.5)]]);
        assert_eq!(it.without_gain(), ["b", "c"]);
    }

    #[test]
    fn a_number_is_known_to_a_share_of_itself() {
        let number = |name, value, low, high| Interval { name, value, low, high, unit: "N".to_string() };
        assert_eq!(Cause::relative_error(&number("force", -4.0, -5.0, -3.0)), Some(0.25));
        let none = [number("force", 0.0, -1.0, 1.0), number("force", 2.0, 2.0, 2.0), number("phase", 2.0, 1.0, 3.0)];
        assert!(none.iter().all(|it| Cause::relative_error(it).is_none()));
    }
}

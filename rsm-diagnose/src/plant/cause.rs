//! A cause, with the data that a report shows.
//!
//! In: the accepted causes of a diagnosis. Out: [`Cause`], with its parameters and its evidence. No decision is taken here.

use super::hypotheses::label;
use super::regions::Region;
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

/// A cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind of the catalogue.
    pub kind: &'static str,
    /// The named parameter or output.
    pub subject: Option<String>,
    /// Which of the two it is.
    pub of: Subject,
    /// Its numbers.
    pub parameters: Vec<Interval>,
    /// The probability that it is right.
    pub confidence: f64,
    /// The probability that it, or one of those that leave the same trace, is right.
    pub confidence_of_any: f64,
    /// Causes that leave the same trace in these records.
    pub indistinguishable_from: Vec<String>,
    /// How much worse the fit is without it, in squared standard deviations of the noise.
    pub gain: f64,
    /// Its rivals and how much worse they do, in the same unit.
    pub rivals: Vec<(String, f64)>,
    /// Whether rivals were looked for; false where the limit of work came first.
    pub asked: bool,
    /// A sentence of plain words.
    pub sentence: String,
    /// What to measure or look at to be sure.
    pub check: &'static str,
    /// What it does on the evaluation records; of the strongest causes.
    pub witness: Option<Witness>,
    /// The only record in which it acts, by its file; absent where it acts in all.
    pub only_in: Option<String>,
}

impl Cause {
    /// Its name in lists: the kind, and what it is of.
    #[must_use]
    pub fn label(&self) -> String {
        label(self.kind, self.subject.as_deref())
    }

    /// Half of the interval of a number as a share of its value; `None` where there is none to speak of: of a phase, of 0, of a number that was not estimated.
    #[must_use]
    pub fn relative_error(number: &Interval) -> Option<f64> {
        let half = 0.5 * (number.high - number.low);
        let has_one = half > 0.0 && half.is_finite() && number.value != 0.0 && number.name != "phase";
        has_one.then(|| half / number.value.abs())
    }
}

/// What a cause does on the evaluation records, against the plant without it.
#[derive(Debug, Clone, PartialEq)]
pub struct Witness {
    /// Root mean square error over the noise of each output: its place, without the cause, with it.
    pub outputs: Vec<(usize, f64, f64)>,
    /// Of each record: its name, squared residual without and with the cause, in squared standard deviations of the noise.
    pub records: Vec<(String, f64, f64)>,
    /// Where the plant without it is wrong.
    pub places: Vec<Region>,
}

/// What a cause changes of the error of an output, in multiples of the noise, is worth a word from here on.
const LEAST_CHANGE: f64 = 0.01;

/// Outputs with their error without and with a cause, in multiples of the noise.
pub type Changes = Vec<(usize, f64, f64)>;

impl Witness {
    /// Outputs whose error the cause lowers, and those whose error it raises; those that it lowers most, or raises least, first.
    #[must_use]
    pub fn changes(&self) -> [Changes; 2] {
        let mut outputs = self.outputs.clone();
        outputs.sort_by(|a, b| (b.1 - b.2).total_cmp(&(a.1 - a.2)));
        let by = |sign: f64| outputs.iter().filter(|it| sign * (it.1 - it.2) > LEAST_CHANGE).copied().collect();
        [by(1.0), by(-1.0)]
    }

    /// Names of the records that gain nothing by the cause.
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
        let it = Witness { outputs, records, places: Vec::new() };
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

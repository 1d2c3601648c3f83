//! Checks that intervals contain the true value as often as stated: of 100 intervals of 95 %, 93 to 97 must.
//!
//! In: cases and the JSON of `rsm diagnose` about them. Out: a table of counts by plant and by kind of number, each with its binomial interval.
//! Numbers are counted only for answers that name exactly the true causes: in another explanation they have another meaning.

use std::fmt;

use serde_json::Value;

use crate::case::Case;
use crate::judge;
use crate::plant::Kind;
use crate::reliability::wilson;

/// The permitted shares of intervals of 95 % that contain the true value.
const WANTED: (f64, f64) = (0.93, 0.97);

/// The width of an interval of 95 %, relative to one of one standard deviation.
const OF_ONE_DEVIATION: f64 = 1.96;

/// The kind of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// A calibrated parameter of the plant file with a tolerance.
    Parameter,
    /// A number of a cause.
    Cause,
}

/// An interval and the true value.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    /// `coulomb-friction.force`
    pub name: String,
    /// The plant.
    pub kind: Kind,
    /// See [`Of`].
    pub of: Of,
    /// Whether the interval contains the true value.
    pub held: bool,
    /// Whether an interval of one standard deviation on either side would contain it.
    pub held_by_one_deviation: bool,
    /// The true value minus the estimate, in half widths of the interval.
    pub off: f64,
}

/// The numbers of an answer; `None` if it is wrong, or names a cause by another name.
pub fn numbers(case: &Case, answer: &Value) -> Option<Vec<Number>> {
    let mut given: Vec<(String, Of, f64, &Value)> = vec![];
    let causes = answer["causes"].as_array()?;
    if !judge::judge(case, answer, "").right || causes.len() != case.causes.len() {
        return None;
    }
    for cause in &case.causes {
        let this = judge::name(cause);
        let found = causes.iter().find(|found| judge::named(found) == this)?;
        for (parameter, truth) in &cause.values {
            given.push((format!("{this}.{parameter}"), Of::Cause, *truth, &found["parameters"][parameter]));
        }
    }
    for (name, _) in &case.nominal.tolerance {
        let found = &answer["calibration"][name];
        // A parameter that is a cause was not calibrated.
        if found.is_object() {
            given.push(((*name).to_string(), Of::Parameter, case.truth.parameters.get(name), found));
        }
    }
    let one = |(name, of, truth, given): (String, Of, f64, &Value)| {
        let (value, low, high) = (given["value"].as_f64()?, given["low"].as_f64()?, given["high"].as_f64()?);
        let parameter = name.rsplit('.').next().unwrap_or_default();
        let narrow = |end: f64| value + (end - value) / OF_ONE_DEVIATION;
        let held_by_one_deviation =
            judge::covers(parameter, truth, &serde_json::json!({ "low": narrow(low), "high": narrow(high) }));
        let off = (truth - value) / if truth < value { value - low } else { high - value };
        Some(Number {
            held: judge::covers(parameter, truth, given),
            held_by_one_deviation,
            off,
            kind: case.truth.kind,
            of,
            name,
        })
    };
    given.into_iter().map(one).collect()
}

/// All numbers of a run.
#[derive(Debug, Clone, Default)]
pub struct Coverage {
    /// The numbers.
    pub numbers: Vec<Number>,
    /// The number of answers without numbers.
    pub without: usize,
}

impl Coverage {
    fn groups(&self) -> Vec<(&'static str, Vec<&Number>)> {
        let of = |which: &dyn Fn(&Number) -> bool| self.numbers.iter().filter(|it| which(it)).collect::<Vec<_>>();
        let kinds = [
            ("motor", Kind::Motor),
            ("car", Kind::Car),
            ("axis, open loop", Kind::OpenAxis),
            ("axis, closed loop", Kind::ClosedAxis),
        ];
        let mut groups: Vec<_> = kinds.iter().map(|(name, kind)| (*name, of(&|it| it.kind == *kind))).collect();
        groups.push(("parameters", of(&|it| it.of == Of::Parameter)));
        groups.push(("causes' numbers", of(&|it| it.of == Of::Cause)));
        groups.push(("all", of(&|_| true)));
        groups.retain(|group| !group.1.is_empty());
        groups
    }

    /// Whether the count of every group is compatible with a wanted share, and, if a thousand were drawn, the share of all is a wanted one.
    pub fn held(&self) -> bool {
        let may = |numbers: &[&Number]| {
            let (low, high) = wilson(numbers.iter().filter(|it| it.held).count(), numbers.len());
            low <= WANTED.1 && WANTED.0 <= high
        };
        let share = self.numbers.iter().filter(|it| it.held).count() as f64 / self.numbers.len().max(1) as f64;
        let is_exact = self.numbers.len() < 1000 || (WANTED.0..=WANTED.1).contains(&share);
        is_exact && self.groups().iter().all(|(_, numbers)| may(numbers))
    }
}

impl fmt::Display for Coverage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "intervals of 95 %     numbers  held   share  95 % of it          by one standard deviation")?;
        for (name, numbers) in self.groups() {
            let held = numbers.iter().filter(|it| it.held).count();
            let narrow = numbers.iter().filter(|it| it.held_by_one_deviation).count();
            let (low, high) = wilson(held, numbers.len());
            let share = |count: usize| 100.0 * count as f64 / numbers.len() as f64;
            writeln!(
                f,
                "{name:<20} {:>8} {held:>5} {:>5.1} %  {:.1} to {:.1} % {:>20.1} %",
                numbers.len(),
                share(held),
                100.0 * low,
                100.0 * high,
                share(narrow)
            )?;
        }
        let missed = self.numbers.iter().filter(|it| !it.held).map(|it| format!("{} {:.1}", it.name, it.off));
        let missed: Vec<String> = missed.collect();
        writeln!(f, "\nmissed, in half widths: {}", missed.join(", "))?;
        writeln!(f, "answers that were wrong or named a cause by another name, not counted: {}", self.without)?;
        let held = if self.held() { "coverage is as wanted" } else { "coverage is not as wanted" };
        write!(f, "{held} ({:.0} to {:.0} %)", 100.0 * WANTED.0, 100.0 * WANTED.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::{Choice, cases};
    use serde_json::json;

    #[test]
    fn numbers_of_a_right_answer_count_and_those_of_another_do_not() {
        let choice =
            Choice { name: Some("symmetry-gain-closed".to_string()), rows: Some(400), normal: true, ..Choice::default() };
        let case = cases(3, choice).next().expect("a case of this name");
        let around = |truth: f64| json!({ "value": 1.01 * truth, "low": 0.995 * truth, "high": 1.025 * truth });
        let (gain, force) = (case.causes[0].values[0].1, case.causes[1].values[0].1);
        let parameter = |name: &str| around(case.truth.parameters.get(name));
        let answer = |second: &str| {
            json!({
                "verdict": "explained",
                "causes": [
                    { "kind": "input-gain", "parameters": { "gain": around(gain) } },
                    { "kind": second, "parameters": { "force": around(force) } },
                ],
                "calibration": { "mass": parameter("mass"), "viscous_friction": around(1.0) },
            })
        };
        let found = numbers(&case, &answer("coulomb-friction")).expect("a right answer");
        let told: Vec<(&str, bool, bool)> =
            found.iter().map(|it| (it.name.as_str(), it.held, it.held_by_one_deviation)).collect();
        assert_eq!(
            told,
            [
                ("input-gain.gain", true, false),
                ("coulomb-friction.force", true, false),
                ("mass", true, false),
                ("viscous_friction", false, false)
            ]
        );
        assert_eq!(numbers(&case, &answer("stribeck-friction")), None);
    }

    #[test]
    fn intervals_that_are_too_short_or_too_long_fail() {
        let of = |held: usize, missed: usize| {
            let one = |held| Number {
                name: String::new(),
                kind: Kind::Motor,
                of: Of::Cause,
                held,
                held_by_one_deviation: false,
                off: 0.0,
            };
            Coverage { numbers: (0..held + missed).map(|k| one(k < held)).collect(), without: 0 }.held()
        };
        assert!(of(950, 50) && of(57, 3));
        // One standard deviation contains 68 of 100, also if few were drawn; an interval that is far too wide is also detected.
        assert!(!of(680, 320) && !of(41, 19) && !of(1000, 0));
        // For a thousand, the share itself must be a wanted one.
        assert!(!of(920, 80) && of(92, 8));
    }
}

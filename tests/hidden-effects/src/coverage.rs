//! Do intervals hold the truth as often as they say? Of intervals of 95 %, 93 to 97 of 100 must.
//!
//! In: cases and the JSON of `rsm diagnose` about them. Out: a table of counts by plant and by kind of number, each with its binomial interval. Numbers are counted of answers that
//! name the true causes and nothing else: in another explanation they are other numbers.

use std::fmt;

use serde_json::Value;

use crate::case::Case;
use crate::judge;
use crate::plant::Kind;
use crate::reliability::wilson;

/// Shares that intervals of 95 % may hold.
const WANTED: (f64, f64) = (0.93, 0.97);

/// An interval of 95 % is so many times as wide as one of one standard deviation.
const OF_ONE_DEVIATION: f64 = 1.96;

/// What a number is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// A parameter of the plant file with a tolerance, as it was calibrated.
    Parameter,
    /// A number of a cause.
    Cause,
}

/// An interval and what is true.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    /// `coulomb-friction.force`
    pub name: String,
    /// Of which plant.
    pub kind: Kind,
    /// See [`Of`].
    pub of: Of,
    /// Whether the interval holds the truth.
    pub held: bool,
    /// Whether it would, were it one standard deviation wide on either side.
    pub held_by_one_deviation: bool,
    /// The truth less the value given, in half widths of the interval.
    pub off: f64,
}

/// The numbers of an answer; `None` where it is wrong, or names a cause by another name.
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
        // A parameter that is a cause is none that was calibrated.
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
    /// Answers that had none.
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

    /// Whether no group's count rules out every share that is wanted, and the share of all lies among them where a thousand were drawn.
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
        // One standard deviation holds 68 of 100, also where few were drawn; and what is far too wide says nothing.
        assert!(!of(680, 320) && !of(41, 19) && !of(1000, 0));
        // Of a thousand the share itself counts.
        assert!(!of(920, 80) && of(92, 8));
    }
}

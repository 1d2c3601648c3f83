//! Decides whether an answer is correct.
//!
//! In: a case and the JSON of `rsm diagnose` (docs/book/src/reference/formats.md 4.3). Out: correct or wrong with the reason, and errors of
//! parameters. It uses the truth, and the causes with the same effect on the records. A missing key is a wrong answer, never a crash.

use serde_json::Value;

use crate::bench;
use crate::case::{Case, Family};
use crate::plant::{Effect, Kind};
use crate::reliability::Named;

/// The evaluation of an answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// Whether verdict and causes are both correct.
    pub right: bool,
    /// `explained: backlash, headwind`
    pub answer: String,
    /// Relative errors of the parameters of correctly named causes, with their names.
    pub errors: Vec<(String, f64)>,
    /// The number of these whose true value is within the given interval.
    pub covered: usize,
    /// The named causes, each with its confidence.
    pub named: Vec<Named>,
}

/// The name of a cause in lists: KIND, parameter-error:NAME or sensor-...:OUTPUT.
pub fn name(effect: &Effect) -> String {
    effect.which.map_or_else(|| effect.kind.to_string(), |(_, which)| format!("{}:{which}", effect.kind))
}

/// Other sets of causes with the same effect on the records as this one: docs/book/src/reference/plants.md 3, last part, and consequences of the
/// equations.
fn aliases(kind: Kind, effect: &Effect) -> Vec<Vec<&'static str>> {
    let this = name(effect);
    // A torque against the wheel, a climb and rolling resistance are one term while the car rolls forward, which it does in every case.
    let rolling = ["brake-drag", "road-grade", "parameter-error:grade", "parameter-error:rolling_resistance_1"];
    // The command acts only through the product of gain and force_gain. In open loop the plant is linear and starts at rest, so the gain of the
    // position has the same effect.
    let pushing: &[&str] = match kind {
        Kind::OpenAxis => &["input-gain", "parameter-error:force_gain", "sensor-gain:position"],
        Kind::ClosedAxis => &["input-gain", "parameter-error:force_gain"],
        _ => &[],
    };
    let mut sets: Vec<Vec<&'static str>> = vec![];
    for group in [if kind == Kind::Car { &rolling[..] } else { &[] }, pushing] {
        if group.contains(&this.as_str()) {
            sets.extend(group.iter().filter(|other| **other != this).map(|other| vec![*other]));
        }
    }
    // An axis shows only the ratios of forces and mass: an error of the mass is equivalent to an error of the command's gain, with frictions that
    // change by calibration or by their own number.
    if this == "parameter-error:mass" {
        sets.push(vec!["input-gain"]);
        sets.push(vec!["parameter-error:force_gain"]);
    }
    if matches!(kind, Kind::OpenAxis | Kind::ClosedAxis) && pushing.contains(&this.as_str()) {
        sets.push(vec!["parameter-error:mass"]);
    }
    // Two levels are equivalent to their mean and half their difference, as long as the viscous part is the nominal one.
    if effect.kind == "asymmetric-friction" && effect.values.iter().all(|(name, _)| !name.starts_with("viscous")) {
        sets.push(vec!["constant-load", "coulomb-friction"]);
    }
    sets
}

/// The name in lists of a cause in an answer.
pub(crate) fn named(cause: &Value) -> String {
    let kind = cause["kind"].as_str().unwrap_or("?");
    let which = cause["parameter"].as_str().or(cause["output"].as_str());
    which.map_or_else(|| kind.to_string(), |which| format!("{kind}:{which}"))
}

/// A named cause, with the names of the causes that cannot be distinguished from it.
struct Found<'j> {
    name: String,
    twins: Vec<&'j str>,
    parameters: &'j Value,
    /// The whole entry of the answer.
    cause: &'j Value,
    /// The files of the records, if it acts only in these.
    only_in: Vec<&'j str>,
}

fn found(answer: &Value) -> Vec<Found<'_>> {
    let causes = answer["causes"].as_array().map(Vec::as_slice).unwrap_or_default();
    let one = |cause| {
        let cause: &Value = cause;
        let twins = cause["indistinguishable_from"].as_array().map(Vec::as_slice).unwrap_or_default();
        Found {
            name: named(cause),
            twins: twins.iter().filter_map(Value::as_str).collect(),
            parameters: &cause["parameters"],
            cause,
            only_in: cause["only_in"].as_array().into_iter().flatten().filter_map(Value::as_str).collect(),
        }
    };
    causes.iter().map(one).collect()
}

/// The largest useful number of indistinguishable causes. docs/book/src/reference/plants.md names at most three.
const TWINS: usize = 3;

/// Whether these causes are the truth: for each true cause, it is named, or a set of its aliases is named, or a named cause lists it among its few
/// equivalents; and nothing else is named.
fn same(case: &Case, found: &[Found<'_>]) -> bool {
    let mut open: Vec<&Found<'_>> = found.iter().collect();
    for cause in &case.causes {
        let this = name(cause);
        let mut sets = vec![vec![this.as_str()]];
        sets.extend(aliases(case.truth.kind, cause));
        let named = sets.into_iter().find(|set| set.iter().all(|name| open.iter().any(|found| found.name == *name)));
        if let Some(set) = named {
            open.retain(|found| !set.contains(&found.name.as_str()));
            continue;
        }
        let twin = open.iter().position(|found| found.twins.len() <= TWINS && found.twins.contains(&this.as_str()));
        match twin {
            Some(place) => {
                open.remove(place);
            }
            None => return false,
        }
    }
    open.is_empty()
}

/// Whether a cause is the effect of the one record that has it, and is reported for that record: by its name, by a name with the same effect, or as
/// one of few equivalents.
fn is_own(case: &Case, found: &Found<'_>) -> bool {
    let Some((file, effect)) = &case.own else { return false };
    let this = name(effect);
    let sets = aliases(case.truth.kind, effect);
    let of = |other: &str| other == this || sets.iter().any(|set| set == &[other]);
    let named = of(&found.name) || found.twins.len() <= TWINS && found.twins.iter().any(|twin| of(twin));
    named && found.only_in.len() == 1 && found.only_in[0].ends_with(file.as_str())
}

/// Whether a named cause is in the truth by its own name, or is one of several that are the truth together. Causes with the same effect share the
/// probability: a cause that is named instead of another one does not count as correct.
fn is_true(case: &Case, cause: &Found<'_>, all: &[Found<'_>]) -> bool {
    let is_named = |name: &&str| all.iter().any(|found| found.name == *name);
    if case.own.is_some() {
        return is_own(case, cause);
    }
    case.causes.iter().any(|truth| {
        let together = aliases(case.truth.kind, truth).into_iter().filter(|set| set.len() > 1);
        name(truth) == cause.name
            || together.into_iter().any(|set| set.contains(&cause.name.as_str()) && set.iter().all(&is_named))
    })
}

/// Evaluates an answer. `words` is the whole output of the command, including the JSON.
pub fn judge(case: &Case, answer: &Value, words: &str) -> Judgement {
    let verdict = answer["verdict"].as_str().unwrap_or("no verdict");
    let found = found(answer);
    let right = match case.family {
        Family::Nulls | Family::Far => verdict == "no-discrepancy" && found.is_empty(),
        Family::Faults => {
            let told = case.fault.is_some_and(|fault| words.to_lowercase().contains(fault.word()));
            verdict == "no-discrepancy" && found.is_empty() && told
        }
        Family::Noise => verdict == "no-discrepancy" && found.is_empty(),
        Family::Data => {
            let names: Vec<&str> = case.truth.kind.outputs().iter().map(|it| it.0).collect();
            let told = case.damage.as_ref().is_some_and(|damage| bench::is_told(damage, &names, answer));
            verdict != "unexplained" && told && found.iter().all(|it| it.cause["kind"] == "data-fault")
        }
        // Causes that contribute may also be named (docs/book/src/reference/formats.md 4.3).
        Family::Outside => verdict == "unexplained",
        Family::Records => verdict == "explained" && found.len() == 1 && is_own(case, &found[0]),
        _ => verdict == "explained" && same(case, &found),
    };
    let mut errors = vec![];
    let mut covered = 0;
    for cause in &case.causes {
        let this = name(cause);
        let Some(found) = found.iter().find(|found| found.name == this) else { continue };
        for (parameter, truth) in &cause.values {
            let given = &found.parameters[parameter];
            let Some(value) = given["value"].as_f64() else {
                errors.push((format!("{this}.{parameter}"), f64::INFINITY));
                continue;
            };
            errors.push((format!("{this}.{parameter}"), error(cause, parameter, *truth, value, found.parameters)));
            covered += usize::from(covers(parameter, *truth, given));
        }
    }
    let names: Vec<&str> = found.iter().map(|found| found.name.as_str()).collect();
    let answer = if names.is_empty() { verdict.to_string() } else { format!("{verdict}: {}", names.join(", ")) };
    let named = found.iter().map(|cause| {
        let right = is_true(case, cause, &found);
        let is_twin = |truth: &Effect| cause.twins.contains(&name(truth).as_str());
        let any_right = right || case.causes.iter().any(is_twin) || case.own.is_some() && is_own(case, cause);
        Named::of(cause.cause, right, any_right)
    });
    Judgement { right, answer, errors, covered, named: named.collect() }
}

/// The kinds of effects in an extended plant file that the answer names neither as causes nor as helpers.
pub fn unnamed(extended: &str, answer: &Value) -> Vec<String> {
    let mut named: Vec<String> = ["causes", "helpers"]
        .iter()
        .flat_map(|list| answer[list].as_array().into_iter().flatten())
        .filter_map(|cause| cause["kind"].as_str().map(str::to_string))
        .collect();
    let held = extended.lines().filter_map(|line| line.strip_prefix("kind = \"")?.strip_suffix('"'));
    held.filter(|kind| match named.iter().position(|it| it == kind) {
        Some(place) => {
            named.remove(place);
            false
        }
        None => true,
    })
    .map(str::to_string)
    .collect()
}

/// Whether the true value is within the given interval; for a phase, modulo a full turn.
pub(crate) fn covers(parameter: &str, truth: f64, given: &Value) -> bool {
    let (Some(low), Some(high)) = (given["low"].as_f64(), given["high"].as_f64()) else { return false };
    let turns: &[f64] = if parameter == "phase" { &[-1.0, 0.0, 1.0] } else { &[0.0] };
    turns.iter().any(|turn| {
        let truth = truth + turn * std::f64::consts::TAU;
        low <= truth && truth <= high
    })
}

/// The relative error; for a phase the angle in radians, for an amplitude its magnitude (a negative amplitude is half a turn of the phase).
fn error(cause: &Effect, parameter: &str, truth: f64, value: f64, all: &Value) -> f64 {
    if cause.kind == "cogging-torque" {
        let half_turn =
            if all["amplitude"]["value"].as_f64().is_some_and(|value| value < 0.0) { std::f64::consts::PI } else { 0.0 };
        if parameter == "phase" {
            let apart = (value + half_turn - truth).rem_euclid(std::f64::consts::TAU);
            return apart.min(std::f64::consts::TAU - apart);
        }
        return (value.abs() - truth.abs()).abs() / truth.abs();
    }
    (value - truth).abs() / truth.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_that_nobody_named_is_seen() {
        let answer = serde_json::json!({
            "causes": [{ "kind": "windage" }], "helpers": [{ "kind": "sensor-bias" }, { "kind": "sensor-bias" }]
        });
        let file =
            |kinds: &[&str]| kinds.iter().fold(String::new(), |all, kind| all + &format!("[[effects]]\nkind = \"{kind}\"\n"));
        assert!(unnamed(&file(&["windage", "sensor-bias", "sensor-bias"]), &answer).is_empty());
        assert_eq!(unnamed(&file(&["sensor-bias", "windage", "windage", "backlash"]), &answer), ["windage", "backlash"]);
    }
    use crate::case::{Choice, cases};
    use serde_json::json;

    fn case(name: &str) -> Case {
        let choice = Choice { name: Some(name.to_string()), ..Choice::default() };
        cases(7, choice).next().unwrap_or_else(|| panic!("no case {name}"))
    }

    fn judged(case: &Case, verdict: &str, causes: &Value) -> bool {
        judge(case, &json!({ "verdict": verdict, "causes": causes }), "").right
    }

    #[test]
    fn verdict_and_cause_count_only_together() {
        let case = case("driveline-brake-drag");
        let brake = json!([{ "kind": "brake-drag" }]);
        assert!(judged(&case, "explained", &brake));
        assert!(!judged(&case, "unexplained", &brake));
        assert!(!judged(&case, "explained", &json!([])));
        assert!(!judged(&case, "explained", &json!([{ "kind": "headwind" }])));
        assert!(!judged(&case, "explained", &json!([{ "kind": "brake-drag" }, { "kind": "headwind" }])));
        assert!(!judge(&case, &json!({}), "").right);
    }

    #[test]
    fn what_leaves_the_same_trace_counts_and_a_list_of_everything_does_not() {
        let case = case("driveline-brake-drag");
        assert!(judged(&case, "explained", &json!([{ "kind": "parameter-error", "parameter": "rolling_resistance_1" }])));
        assert!(judged(&case, "explained", &json!([{ "kind": "headwind", "indistinguishable_from": ["brake-drag"] }])));
        let everything = ["backlash", "headwind", "tyre-slip", "brake-drag"];
        assert!(!judged(&case, "explained", &json!([{ "kind": "clutch-slip", "indistinguishable_from": everything }])));
    }

    #[test]
    fn a_cause_is_right_by_its_own_name_or_as_one_of_a_sum() {
        let right = |name: &str, causes: &Value| -> Vec<bool> {
            let answer = json!({ "verdict": "unexplained", "causes": causes });
            judge(&case(name), &answer, "").named.iter().map(|it| it.right).collect()
        };
        let causes = json!([{ "kind": "headwind", "confidence": 0.5 }, { "kind": "brake-drag", "confidence": 0.2 }]);
        assert_eq!(right("driveline-brake-drag", &causes), [false, true]);
        // Another name with the same effect: the confidence must allow for it.
        let grade = json!([{ "kind": "parameter-error", "parameter": "grade", "indistinguishable_from": ["brake-drag"] }]);
        assert_eq!(right("driveline-brake-drag", &grade), [false]);
    }

    #[test]
    fn errors_are_relative_to_the_truth_and_intervals_are_counted() {
        let case = case("driveline-brake-drag");
        let truth = case.causes[0].values[0].1;
        let torque = json!({ "value": 1.02 * truth, "low": 0.99 * truth, "high": 1.05 * truth, "unit": "N*m" });
        let answer =
            json!({ "verdict": "explained", "causes": [{ "kind": "brake-drag", "parameters": { "torque": torque } }] });
        let judgement = judge(&case, &answer, "");
        assert!((judgement.errors[0].1 - 0.02).abs() < 1e-12 && judgement.covered == 1, "{judgement:?}");
    }

    #[test]
    fn a_phase_lies_in_an_interval_across_half_a_turn() {
        let interval = json!({ "low": 3.1, "high": 3.2 });
        assert!(covers("phase", -3.12, &interval) && covers("phase", 3.15, &interval));
        assert!(!covers("phase", 3.0, &interval) && !covers("angle", -3.12, &interval));
    }

    #[test]
    fn a_fault_of_the_data_must_be_told() {
        let case = case("fault-stuck-driveline");
        let answer = json!({ "verdict": "no-discrepancy", "causes": [] });
        assert!(judge(&case, &answer, "rows 900 to 950 of acceleration are stuck").right);
        assert!(!judge(&case, &answer, "nothing to say").right);
    }
}

//! Decides whether an answer about a plant of `examples/plants/` is correct.
//!
//! In: a case and the JSON of `rsm diagnose` (docs/book/src/reference/formats.md 4.3). Out: correct or wrong with the reason, and errors of numbers.
//! A cause is expected with its kind and its place. Another set of causes is also correct if it has the same effect on the records: it is simulated
//! and refitted, not looked up in a list.

use serde_json::Value;

use super::cases::Case;
use super::refit::{Trace, refit};
use super::{Cause, Outside, System, draw};
use crate::bench;
use crate::case::Family;
use crate::judge::{Judgement, covers};
use crate::reliability::Named;

/// Two explanations are equivalent if their records differ by less than this, in units of noise: root mean square over all records at the output
/// where they differ most.
///
/// A fifth of the noise is below the accuracy in a sensor's data sheet. A cause that is visible at 1 to 30 times the noise is well above it.
pub const SAME: f64 = 0.2;

/// The share of the error above the noise that a law must remove on validation records.
const LAW: f64 = 0.95;

/// The largest useful number of equivalent causes in a list.
const EQUALS: usize = 4;

/// A cause of an answer, with its numbers, its equivalents, and the whole entry of the answer.
struct Found<'j> {
    cause: Cause,
    equals: Vec<&'j str>,
    said: &'j Value,
}

/// The place that an answer names, with any of the possible keys; if it names none, the only place of this plant where the kind is possible.
fn place(system: &System, said: &Value, kind: &str) -> String {
    let named = ["at", "site", "output", "parameter", "input"].iter().find_map(|key| said[*key].as_str());
    let mut possible = draw::everywhere(system).into_iter().filter(|it| it.0 == kind).map(|it| it.1);
    let only = match (possible.next(), possible.next()) {
        (Some(one), None) => one,
        _ => "?",
    };
    named.unwrap_or(only).to_string()
}

fn found<'j>(system: &System, answer: &'j Value) -> Vec<Found<'j>> {
    let one = |said: &'j Value| {
        let kind = said["kind"].as_str().unwrap_or("?");
        let numbers = said["parameters"].as_object().or(said["numbers"].as_object());
        let numbers = numbers.into_iter().flatten();
        let value = |(name, it): (&String, &Value)| Some((name.clone(), it["value"].as_f64().or(it.as_f64())?));
        let equals = ["indistinguishable_from", "equals"].iter().find_map(|key| said[*key].as_array());
        Found {
            cause: Cause {
                kind: kind.to_string(),
                at: place(system, said, kind),
                numbers: numbers.filter_map(value).collect(),
            },
            equals: equals.into_iter().flatten().filter_map(|it| it.as_str().or(it["name"].as_str())).collect(),
            said,
        }
    };
    answer["causes"].as_array().into_iter().flatten().map(one).collect()
}

/// Whether a list of equivalents names a cause, by kind and place, or only by its kind if that has one place only.
fn names(system: &System, equals: &[&str], cause: &Cause) -> bool {
    let places = draw::everywhere(system).iter().filter(|it| it.0 == cause.kind).count();
    let full = cause.name();
    equals.iter().any(|it| *it == full || places == 1 && *it == cause.kind)
}

/// Whether two causes are the same law with two names.
fn is_one(one: &Cause, other: &Cause) -> bool {
    let kind = |it: &Cause| if it.kind == "windage" { "quadratic-drag".to_string() } else { it.kind.clone() };
    kind(one) == kind(other) && one.at == other.at
}

/// Whether the answer names each true cause, or lists it as an equivalent, and names nothing else.
fn is_named(case: &Case, found: &[Found<'_>]) -> bool {
    let system = case.truth.system;
    let mut open: Vec<&Found<'_>> = found.iter().collect();
    for cause in &case.truth.causes {
        let by_name = open.iter().position(|it| is_one(&it.cause, cause));
        let by_equal = || open.iter().position(|it| it.equals.len() <= EQUALS && names(system, &it.equals, cause));
        let Some(place) = by_name.or_else(by_equal) else { return false };
        open.remove(place);
    }
    open.is_empty()
}

/// The misfit of the causes of an answer, refitted to the true training records, if it is so small that the two explanations are equivalent. `None`
/// if it is larger, or if the answer has more causes than the truth.
fn is_same_trace(case: &Case, found: &[Found<'_>]) -> Option<f64> {
    if found.is_empty() || found.len() > case.truth.causes.len() {
        return None;
    }
    let system = case.truth.system;
    let everywhere = draw::everywhere(system);
    let stands = |it: &Found<'_>| everywhere.iter().any(|(kind, at)| *kind == it.cause.kind && *at == it.cause.at);
    if !found.iter().all(stands) {
        return None;
    }
    let causes: Vec<Cause> = found.iter().map(|it| it.cause.clone()).collect();
    let traces: Vec<Trace> = case.train.iter().map(|it| it.exact.clone()).collect();
    let misfit = refit(&case.file, &causes, &traces, &case.seen, 0.5 * SAME).misfit;
    (misfit < SAME).then_some(misfit)
}

/// Whether an answer reports the damage by the logger.
fn is_told(case: &Case, answer: &Value) -> bool {
    let names: Vec<&str> = case.truth.system.outputs.iter().map(|it| it.name).collect();
    case.damage.as_ref().is_some_and(|damage| bench::is_told(damage, &names, answer))
}

/// Whether an answer reports every true cause as a finding about the data: a reading with a limit is clipped, whatever the reason.
fn is_told_as_data(case: &Case, answer: &Value) -> bool {
    let is_told = |cause: &Cause| {
        let findings = answer["data"].as_array();
        let clips =
            |it: &&Value| it["channel"] == cause.at.as_str() && it["what"].as_str().is_some_and(|what| what.contains("clip"));
        cause.kind == "sensor-limit" && findings.is_some_and(|list| list.iter().any(|it| clips(&it)))
    };
    !case.truth.causes.is_empty() && case.truth.causes.iter().all(is_told)
}

fn list(found: &[Found<'_>]) -> String {
    found.iter().map(|it| it.cause.name()).collect::<Vec<_>>().join(", ")
}

/// The share of the points of a law's curve whose band contains the true law, if the law is at the true site and depends on one variable.
fn bands(case: &Case, answer: &Value) -> String {
    let truth = case.truth.outside.iter().find(|it| it.kind == "law");
    let curves = answer["law"]["curves"].as_array();
    let (Some(truth), Some([curve])) = (truth, curves.map(Vec::as_slice)) else { return "no curve to compare".to_string() };
    if answer["law"]["at"] != truth.at.as_str() {
        return "at another site".to_string();
    }
    let law = Outside::new(&case.truth);
    let points = curve["points"].as_array().map_or(&[][..], Vec::as_slice);
    let is_inside = |it: &&Value| {
        let [at, low, high] = [0, 2, 3].map(|k| it[k].as_f64().unwrap_or(f64::NAN));
        (low..=high).contains(&law.law(at))
    };
    let inside = points.iter().filter(is_inside).count();
    format!("{:.0} % of the curve in its band", 100.0 * inside as f64 / points.len().max(1) as f64)
}

/// Evaluates an answer.
pub fn judge(case: &Case, answer: &Value) -> Judgement {
    let verdict = answer["verdict"].as_str().unwrap_or("no verdict");
    let found = found(case.truth.system, answer);
    let mut words = if found.is_empty() { verdict.to_string() } else { format!("{verdict}: {}", list(&found)) };
    let mut is_equal = false;
    let right = match case.family {
        Family::Data => {
            verdict != "unexplained" && is_told(case, answer) && found.iter().all(|it| it.cause.kind == "data-fault")
        }
        _ if case.truth.causes.is_empty() && case.truth.outside.is_empty() => verdict == "no-discrepancy" && found.is_empty(),
        Family::Outside => {
            let has_law = case.truth.outside.iter().any(|it| it.kind == "law");
            let gain = answer["law"]["gain"].as_f64().unwrap_or(0.0);
            if has_law {
                let at = answer["law"]["at"].as_str().unwrap_or("no site");
                words.push_str(&format!(" (law at {at}, gain {gain:.3}, {})", bands(case, answer)));
            }
            verdict == "unexplained" && (!has_law || gain >= LAW)
        }
        _ if found.is_empty() && verdict == "no-discrepancy" && is_told_as_data(case, answer) => true,
        _ if verdict != "explained" => false,
        _ if is_named(case, &found) => true,
        _ => {
            let misfit = is_same_trace(case, &found);
            is_equal = misfit.is_some();
            misfit.iter().for_each(|misfit| words.push_str(&format!(" (the same trace to {misfit:.2} of the noise)")));
            is_equal
        }
    };
    if !right {
        let truth: Vec<String> = case.truth.causes.iter().chain(&case.truth.outside).map(Cause::name).collect();
        if let Some(damage) = &case.damage {
            let names: Vec<&str> = damage.outputs.iter().map(|place| case.truth.system.outputs[*place].name).collect();
            words.push_str(&format!(" (spoiled: {:?} {})", damage.what, names.join(", ")));
        }
        if !truth.is_empty() {
            words.push_str(&format!(" (hidden: {})", truth.join(", ")));
        }
    }
    let (mut errors, mut covered) = (vec![], 0);
    for cause in &case.truth.causes {
        let Some(it) = found.iter().find(|it| is_one(&it.cause, cause)) else { continue };
        for (number, truth) in &cause.numbers {
            let name = format!("{}.{number}", cause.name());
            let Some(value) = it.cause.get(number) else {
                errors.push((name, f64::INFINITY));
                continue;
            };
            // A phase is compared with a turn, and a rest with the distance that they shift: they have no scale of their own.
            let error = match number.as_str() {
                "phase" => {
                    let turn = (value - truth + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
                    turn.abs() / std::f64::consts::PI
                }
                _ => (value - truth).abs() / scale(case, cause, number, *truth),
            };
            errors.push((name, error));
            let given = if it.said["parameters"].is_object() { &it.said["parameters"] } else { &it.said["numbers"] };
            covered += usize::from(covers(number, *truth, &given[number]));
        }
    }
    let named = found.iter().map(|it| {
        let by_name = case.truth.causes.iter().any(|cause| is_one(&it.cause, cause)) || is_equal;
        let by_equal = case.truth.causes.iter().any(|cause| names(case.truth.system, &it.equals, cause));
        Named::of(it.said, by_name, by_name || by_equal)
    });
    Judgement { right, answer: words, errors, covered, named: named.collect() }
}

/// The scale of an error: the number itself; for a position or a temperature the range of its site; for a gain or an exponent its difference from 1.
fn scale(case: &Case, cause: &Cause, number: &str, truth: f64) -> f64 {
    match (number, case.truth.system.site(&cause.at)) {
        ("rest" | "ambient" | "level_limit", Some(site)) => site.speed.max(site.position.min(10.0)),
        _ => truth.abs().max(f64::MIN_POSITIVE),
    }
}

#[cfg(test)]
mod tests {
    use super::super::cases::{Choice, cases};
    use super::*;
    use serde_json::json;

    fn case(name: &str) -> Case {
        let choice = Choice { name: Some(name.to_string()), rows: Some(800), ..Choice::default() };
        cases(1, choice, |_| {}).next().expect("a case of this name")
    }

    fn number(value: f64) -> Value {
        json!({ "value": value, "low": 0.9 * value, "high": 1.1 * value })
    }

    #[test]
    fn a_cause_is_right_at_its_own_place_only() {
        let case = case("gear-motor-coulomb-friction");
        let torque = case.truth.causes[0].numbers[0].1;
        let right = |verdict: &str, causes: Value| judge(&case, &json!({ "verdict": verdict, "causes": causes })).right;
        let cause = |at: &str| json!([{ "kind": "coulomb-friction", "at": at, "parameters": { "torque": number(torque) } }]);
        assert!(
            right("explained", cause("shaft"))
                && !right("unexplained", cause("shaft"))
                && !right("explained", cause("armature"))
        );
        // The only possible place, and the key of the site.
        assert!(right("explained", json!([{ "kind": "coulomb-friction", "parameters": { "torque": number(torque) } }])));
        assert!(right(
            "explained",
            json!([{ "kind": "coulomb-friction", "site": "shaft", "parameters": { "torque": number(torque) } }])
        ));
        assert!(right("explained", json!([{ "kind": "load-drift", "at": "shaft", "equals": ["coulomb-friction:shaft"] }])));
        // Another law, simulated and refitted, does not reproduce the records.
        assert!(!right(
            "explained",
            json!([{ "kind": "constant-load", "at": "shaft", "parameters": { "torque": number(torque) } }])
        ));
        assert!(!right("explained", json!([])));
    }

    #[test]
    fn what_leaves_the_same_trace_is_right() {
        let case = case("gear-motor-constant-load");
        let torque = case.truth.causes[0].numbers[0].1;
        let offset = json!([{ "kind": "input-bias", "at": "load", "parameters": { "bias": number(1.2*torque) } }]);
        let judgement = judge(&case, &json!({ "verdict": "explained", "causes": offset }));
        assert!(judgement.right && judgement.answer.contains("the same trace"), "{}", judgement.answer);
        assert!(judgement.named[0].right && judgement.errors.is_empty());
    }

    #[test]
    fn nothing_and_a_force_of_no_file_have_verdicts_of_their_own() {
        let answer = |verdict: &str, causes: Value| json!({ "verdict": verdict, "causes": causes });
        let nothing = case("heated-block-null-0");
        assert!(judge(&nothing, &answer("no-discrepancy", json!([]))).right);
        assert!(!judge(&nothing, &answer("explained", json!([{ "kind": "leak", "at": "block" }]))).right);
        assert!(!judge(&nothing, &json!({})).right);
        let gusts = case("road-vehicle-outside-gusts");
        assert!(judge(&gusts, &answer("unexplained", json!([]))).right);
        assert!(!judge(&gusts, &answer("no-discrepancy", json!([]))).right);
    }

    #[test]
    fn what_a_logger_did_must_be_told_with_its_column_and_blamed_on_nothing() {
        let case = case("coupled-tanks-data-stuck");
        let place = case.damage.as_ref().expect("it is spoiled").outputs[0];
        let outputs = case.truth.system.outputs;
        let (this, other) = (outputs[place].name, outputs[1 - place].name);
        let answer = |channel: &str, what: &str, causes: Value| {
            let data = json!([{ "record": "train-1.csv", "channel": channel, "what": what, "rows": [1, 2] }]);
            judge(&case, &json!({ "verdict": "no-discrepancy", "causes": causes, "data": data })).right
        };
        assert!(answer(this, "hangs at one value", json!([])));
        assert!(!answer(other, "hangs at one value", json!([])) && !answer(this, "is clipped", json!([])));
        assert!(!answer(this, "hangs at one value", json!([{ "kind": "leak", "at": "first_tank" }])));
        let fault = json!([{ "kind": "data-fault", "what": "stuck", "column": this, "rows": [1, 2] }]);
        assert!(judge(&case, &json!({ "verdict": "explained", "causes": fault })).right);
        assert!(!judge(&case, &json!({ "verdict": "no-discrepancy", "causes": [] })).right);
    }

    #[test]
    fn a_limit_of_a_sensor_may_be_told_as_clipped_rows_of_its_column() {
        let case = case("gear-motor-sensor-limit");
        let at = case.truth.causes[0].at.clone();
        let right = |channel: &str, verdict: &str| {
            let data = json!([{ "record": "train-1.csv", "channel": channel, "what": "clipped", "rows": [1, 2] }]);
            judge(&case, &json!({ "verdict": verdict, "causes": [], "data": data })).right
        };
        assert!(right(&at, "no-discrepancy") && !right(&at, "unexplained") && !right("voltage", "no-discrepancy"));
        assert!(!judge(&case, &json!({ "verdict": "no-discrepancy", "causes": [] })).right);
    }

    #[test]
    fn errors_are_relative_and_intervals_are_counted() {
        let case = case("gear-motor-coulomb-friction");
        let torque = case.truth.causes[0].numbers[0].1;
        let causes = json!([{ "kind": "coulomb-friction", "at": "shaft", "parameters": { "torque": number(1.02*torque) } }]);
        let judgement = judge(&case, &json!({ "verdict": "explained", "causes": causes }));
        assert!((judgement.errors[0].1 - 0.02).abs() < 1e-9 && judgement.covered == 1, "{judgement:?}");
    }
}

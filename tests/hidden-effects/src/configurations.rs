//! Cases of one plant in two configurations: a carriage with and without its payload, a car with two loads, a drive with two flywheels.
//!
//! In: a seed. Out: plant files with `[configurations]`, records of both configurations, and the right answer. A case depends only on the seed and on
//! its own name. Every parameter with a tolerance is off within it: one deviation for both configurations, but for the parameters that a
//! configuration sets or that stand under `differ`, which have one for each.

use std::fmt::Write;

use serde_json::Value;

use crate::draw;
use crate::excitation::excitation;
use crate::files;
use crate::judge::Judgement;
use crate::plant::{self, Effect, Kind};
use crate::random::Random;
use crate::reliability::Named;
use crate::systems::{self, Cause, System};

/// Training records of each configuration, and validation records.
const RUNS: [usize; 2] = [2, 1];

/// The number of a cause in the second configuration, as a multiple of that in the first one: apart by more than any tolerance.
const APART: (f64, f64) = (1.7, 2.5);

/// What is hidden.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hidden {
    /// Nothing but what the plant file says.
    Nothing,
    /// A cause with the same number in both configurations.
    Shared,
    /// A cause with another number in each configuration.
    Differing,
    /// A cause in the second configuration alone.
    InOne,
    /// A parameter under `differ`, off in the second configuration alone.
    Parameter,
}

impl Hidden {
    const ALL: [(Hidden, &'static str); 5] = [
        (Hidden::Nothing, "null"),
        (Hidden::Shared, "shared"),
        (Hidden::Differing, "differing"),
        (Hidden::InOne, "in-one"),
        (Hidden::Parameter, "parameter"),
    ];
}

/// The quick subset.
const QUICK: [&str; 2] = ["configurations-servo-axis-in-one", "configurations-two-mass-drive-differing"];

/// A plant in two configurations.
struct Bench {
    /// The name of the plant.
    name: &'static str,
    /// The plant: of format 1 or of equations.
    plant: Which,
    /// The names of the configurations.
    configurations: [&'static str; 2],
    /// The parameter that the second configuration sets; with `both` the first one too.
    sets: &'static str,
    both: bool,
    /// Its value in the second configuration, as a multiple.
    times: f64,
    /// The parameter under `differ`, and its error where it is the cause.
    differs: (&'static str, f64),
    /// The effect: its kind, its place if it has one, its number and its range.
    effect: (&'static str, Option<&'static str>, &'static str, (f64, f64)),
}

#[derive(Clone, Copy)]
enum Which {
    First(Kind),
    Equations(&'static System),
}

/// The benches. A payload of half the carriage; a van with half a ton; a flywheel of two thirds of the load.
fn benches() -> [Bench; 3] {
    [
        Bench {
            name: "servo-axis",
            plant: Which::First(Kind::ClosedAxis),
            configurations: ["unloaded", "loaded"],
            sets: "mass",
            both: false,
            times: 1.5,
            differs: ("viscous_friction", 1.4),
            effect: ("coulomb-friction", None, "force", (6.0, 20.0)),
        },
        Bench {
            name: "driveline",
            plant: Which::First(Kind::Car),
            configurations: ["light", "heavy"],
            sets: "mass",
            both: true,
            times: 1.35,
            differs: ("drag_area", 1.3),
            effect: ("brake-drag", None, "torque", (40.0, 90.0)),
        },
        Bench {
            name: "two-mass-drive",
            plant: Which::Equations(
                systems::ALL.into_iter().find(|it| it.name == "two-mass-drive").expect("a plant of the examples"),
            ),
            configurations: ["small-wheel", "large-wheel"],
            sets: "load_inertia",
            both: false,
            times: 1.7,
            differs: ("load_friction", 2.0),
            effect: ("coulomb-friction", Some("load"), "torque", (0.05, 0.2)),
        },
    ]
}

/// The cause of a right answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// The kind.
    pub kind: &'static str,
    /// The parameter or the site, if it has one.
    pub at: Option<String>,
    /// The only configuration in which it acts.
    pub only_in: Option<&'static str>,
    /// Its numbers, by the names of an answer.
    pub numbers: Vec<(String, f64)>,
}

/// One case.
#[derive(Debug, Clone)]
pub struct Case {
    /// `configurations-servo-axis-shared`
    pub name: String,
    /// The plant file, and the files that it names.
    pub files: Vec<(String, String)>,
    /// Training records, then validation records: names and texts.
    pub records: [Vec<(String, String)>; 2],
    /// The right answer.
    pub expected: Vec<Expected>,
}

/// The cases of a seed. `rows` replaces the number of rows of a record.
pub fn cases(seed: u64, name: Option<&str>, quick: bool, rows: Option<usize>) -> Vec<Case> {
    let mut list = vec![];
    for bench in benches() {
        for (hidden, word) in Hidden::ALL {
            let its = format!("configurations-{}-{word}", bench.name);
            let is_asked =
                name.is_none_or(|name| name.strip_suffix('*').map_or(name == its, |beginning| its.starts_with(beginning)));
            if is_asked && (!quick || QUICK.contains(&its.as_str())) {
                list.push(case(its.clone(), &bench, hidden, Random::new(seed, &its), rows));
            }
        }
    }
    list
}

/// The true values of one configuration.
struct Own {
    /// Values in place of those that both configurations have.
    parameters: Vec<(&'static str, f64)>,
    /// The number of the effect, if it acts.
    effect: Option<f64>,
}

fn case(name: String, bench: &Bench, hidden: Hidden, mut random: Random, rows: Option<usize>) -> Case {
    let nominal = match bench.plant {
        Which::First(kind) => Some(draw::nominal(kind, &mut random)),
        Which::Equations(_) => None,
    };
    let tolerances: Vec<(&'static str, f64)> = match (&nominal, bench.plant) {
        (Some(nominal), _) => nominal.tolerance.clone(),
        (None, Which::Equations(system)) => system.tolerance.to_vec(),
        (None, Which::First(_)) => vec![],
    };
    let (differs, error) = bench.differs;
    let drawn = |name: &str| match (&nominal, bench.plant) {
        (Some(nominal), _) => nominal.parameters.get(name),
        (None, Which::Equations(system)) => systems::Truth::nominal(system).get(name),
        (None, Which::First(_)) => f64::NAN,
    };
    // The values of the file: the drawn ones.
    let filed = [drawn(bench.sets), bench.times * drawn(bench.sets)];
    let mut off = |name: &str| {
        let sd = tolerances.iter().find(|it| it.0 == name).map_or(0.0, |it| it.1);
        1.0 + sd * random.uniform(-1.5, 1.5)
    };
    // One deviation for both configurations.
    let common: Vec<(&'static str, f64)> = tolerances
        .iter()
        .filter(|(name, _)| *name != bench.sets && *name != differs)
        .map(|(name, _)| (*name, drawn(name) * off(name)))
        .collect();
    let sets = filed.map(|value| value * off(bench.sets));
    let of_differs = [0, 1].map(|_| drawn(differs) * off(differs));
    let (kind, at, number, (low, high)) = bench.effect;
    let size = random.uniform(low, high);
    let apart = size * random.uniform(APART.0, APART.1);
    let numbers = match hidden {
        Hidden::Nothing | Hidden::Parameter => [None, None],
        Hidden::Shared => [Some(size); 2],
        Hidden::Differing => [Some(size), Some(apart)],
        Hidden::InOne => [None, Some(size)],
    };
    let wrong = error * drawn(differs);
    let own: Vec<Own> = (0..2)
        .map(|k| {
            let friction = if hidden == Hidden::Parameter && k == 1 { wrong } else { of_differs[k] };
            let mut parameters = common.clone();
            parameters.extend([(bench.sets, sets[k]), (differs, friction)]);
            Own { parameters, effect: numbers[k] }
        })
        .collect();
    let mut records = [vec![], vec![]];
    for (k, own) in own.iter().enumerate() {
        for (set, count) in RUNS.into_iter().enumerate() {
            for run in 0..count {
                let stream = Random::new(random.whole(0, u64::from(u32::MAX)), "run");
                let text = match bench.plant {
                    Which::First(_) => {
                        first(nominal.as_ref().expect("a plant of format 1"), own, bench, stream, 2 * k + run + set, rows)
                    }
                    Which::Equations(system) => equations(system, own, bench, stream, rows),
                };
                let word = ["", "validate-"][set];
                records[set].push((format!("{}-{word}{}.csv", bench.configurations[k], run + 1), text));
            }
        }
    }
    let in_second = |name: &str| format!("{name}[{}]", bench.configurations[1]);
    let expected = match hidden {
        Hidden::Nothing => vec![],
        Hidden::Shared => vec![(kind, at, None, vec![(number.to_string(), size)])],
        Hidden::Differing => {
            let each = [size, apart].into_iter().zip(bench.configurations);
            vec![(kind, at, None, each.map(|(value, its)| (format!("{number}[{its}]"), value)).collect())]
        }
        Hidden::InOne => vec![(kind, at, Some(bench.configurations[1]), vec![(in_second(number), size)])],
        Hidden::Parameter => vec![("parameter-error", None, Some(bench.configurations[1]), vec![("value".to_string(), wrong)])],
    };
    let expected = expected.into_iter().map(|(kind, at, only_in, numbers)| Expected {
        kind,
        at: if kind == "parameter-error" { Some(in_second(differs)) } else { at.map(str::to_string) },
        only_in,
        numbers,
    });
    Case { name, files: plant_files(bench, nominal.as_ref(), filed), records, expected: expected.collect() }
}

/// A record of a plant of format 1.
fn first(nominal: &draw::Nominal, own: &Own, bench: &Bench, stream: Random, run: usize, rows: Option<usize>) -> String {
    let mut parameters = nominal.parameters.clone();
    own.parameters.iter().for_each(|(name, value)| parameters.set(name, *value));
    let (kind, _, number, _) = bench.effect;
    let effects = own.effect.map(|value| Effect::new(kind, &[(number, value)])).into_iter().collect();
    let truth = plant::Truth { kind: nominal.kind, parameters, effects, outside: vec![] };
    // Records of a car have different gears.
    let gear = [2, 3, 4][run % 3];
    let mut noise = stream.clone();
    let (start, mut drive) = excitation(nominal, gear, stream);
    let mut record = plant::run(&truth, start, nominal.period, rows.unwrap_or(nominal.rows), &mut drive);
    for (column, sigma) in record.outputs.iter_mut().zip(&nominal.noise) {
        let noise = noise.noise(column.len(), *sigma, 0.0);
        column.iter_mut().zip(noise).for_each(|(value, noise)| *value += noise);
    }
    files::record(nominal.kind, &record, &[], &[])
}

/// A record of a plant of equations.
fn equations(system: &'static System, own: &Own, bench: &Bench, stream: Random, rows: Option<usize>) -> String {
    let mut truth = systems::Truth::nominal(system);
    for (name, value) in &own.parameters {
        let place = truth.place(name);
        truth.parameters[place] = *value;
    }
    let (kind, at, number, _) = bench.effect;
    let cause = |value| Cause {
        kind: kind.to_string(),
        at: at.unwrap_or_default().to_string(),
        numbers: vec![(number.to_string(), value)],
    };
    truth.causes.extend(own.effect.map(cause));
    let mut noise = stream.clone();
    let (start, mut drive) = (system.drive)(stream, system.period);
    let mut record = systems::run::run(&truth, &start, rows.unwrap_or(system.rows), &mut drive);
    for (column, output) in record.outputs.iter_mut().zip(system.outputs) {
        let noise = noise.noise(column.len(), output.noise, 0.0);
        column.iter_mut().zip(noise).for_each(|(value, noise)| *value += noise);
    }
    systems::files::record(system, &record, None, &[], &[])
}

/// The plant file, and the text that it names.
fn plant_files(bench: &Bench, nominal: Option<&draw::Nominal>, filed: [f64; 2]) -> Vec<(String, String)> {
    let (mut text, more) = match (bench.plant, nominal) {
        (Which::First(kind), Some(it)) => (files::plant_file(kind, &it.parameters, &it.tolerance, &it.noise, None, &[]), None),
        (Which::Equations(system), _) => {
            let noise: Vec<f64> = system.outputs.iter().map(|it| it.noise).collect();
            let text = systems::files::plant_file(&systems::Truth::nominal(system), &noise, None, &[]);
            (text, Some((format!("{}.mo", system.name), system.text.to_string())))
        }
        (Which::First(_), None) => unreachable!("a plant of format 1 was drawn"),
    };
    write!(text, "\n[configurations]\ndiffer = [\"{}\"]\n", bench.differs.0).expect("a string takes text");
    for (k, name) in bench.configurations.into_iter().enumerate() {
        write!(text, "\n[configurations.{name}]\nrecords = [\"{name}-*.csv\"]\n").expect("a string takes text");
        if k == 1 || bench.both {
            writeln!(text, "parameters = {{ {} = {:?} }}", bench.sets, filed[k]).expect("a string takes text");
        }
    }
    std::iter::once(("plant.toml".to_string(), text)).chain(more).collect()
}

/// The largest error of a number of a right answer, relative to the number.
const NEAR: f64 = 0.25;

/// The largest useful number of causes that the records do not distinguish.
const EQUALS: usize = 3;

impl Expected {
    /// The names in lists of the cause, and of causes that leave the same trace.
    fn names(&self) -> Vec<String> {
        let label = |kind: &str, at: Option<&str>| at.map_or(kind.to_string(), |at| format!("{kind}:{at}"));
        let in_one = |name: String| match self.only_in {
            Some(its) if self.kind != "parameter-error" => format!("{name}[{its}]"),
            _ => name,
        };
        let mut names = vec![in_one(label(self.kind, self.at.as_deref()))];
        // A torque against the wheel, a climb and rolling resistance are one term while a car rolls forward.
        if self.kind == "brake-drag" {
            let rolling = ["road-grade", "parameter-error:grade", "parameter-error:rolling_resistance_1"];
            names.extend(rolling.map(|name| in_one(name.to_string())));
        }
        names
    }

    /// Whether a cause of an answer is this one.
    fn is(&self, cause: &Value) -> bool {
        let kind = cause["kind"].as_str().unwrap_or_default();
        let at = ["parameter", "output", "at"].iter().find_map(|key| cause[*key].as_str());
        let acts: Vec<&str> = cause["configurations"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let name = at.map_or(kind.to_string(), |at| format!("{kind}:{at}"));
        let is_own = kind != "parameter-error" || at.is_none_or(|at| !at.ends_with(']'));
        let name = if acts.is_empty() || !is_own { name } else { format!("{name}[{}]", acts.join(",")) };
        let names = self.names();
        let equals: Vec<&str> =
            cause["indistinguishable_from"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let by_equal = || equals.len() <= EQUALS && equals.iter().any(|it| names.iter().any(|name| name == it));
        let is_named = names.contains(&name) || by_equal();
        // Another name has other numbers, but also one for each configuration where the truth has.
        let differs = self.numbers.iter().any(|it| it.0.contains('[')) && self.only_in.is_none();
        let told: Vec<&String> = cause["parameters"].as_object().into_iter().flatten().map(|it| it.0).collect();
        is_named && told.iter().any(|name| name.ends_with(']')) == (differs || self.only_in.is_some() && is_own)
    }
}

/// Compares an answer with the truth.
pub fn judge(case: &Case, answer: &Value) -> Judgement {
    let verdict = answer["verdict"].as_str().unwrap_or("no verdict");
    let causes = answer["causes"].as_array().map_or(&[][..], Vec::as_slice);
    let wanted = if case.expected.is_empty() { "no-discrepancy" } else { "explained" };
    let found: Vec<Option<&Value>> = case.expected.iter().map(|it| causes.iter().find(|cause| it.is(cause))).collect();
    let (mut errors, mut covered) = (vec![], 0);
    let mut are_near = true;
    for (expected, cause) in case.expected.iter().zip(&found) {
        let Some(cause) = cause else { continue };
        for (name, truth) in &expected.numbers {
            let number = &cause["parameters"][name];
            // A cause that leaves the same trace has numbers of its own.
            let Some(value) = number["value"].as_f64().filter(|_| cause["kind"] == expected.kind) else { continue };
            let error = (value / truth - 1.0).abs();
            are_near &= error < NEAR;
            errors.push((format!("{}.{name}", expected.kind), error));
            let ends = number["low"].as_f64().zip(number["high"].as_f64());
            covered += usize::from(ends.is_some_and(|(low, high)| low <= *truth && *truth <= high));
        }
    }
    let right = verdict == wanted && causes.len() == case.expected.len() && found.iter().all(Option::is_some) && are_near;
    let named = causes.iter().map(|cause| {
        let is_right = case.expected.iter().any(|it| it.is(cause));
        Named::of(cause, is_right, is_right)
    });
    let mut words = verdict.to_string();
    for cause in causes {
        let numbers: Vec<String> = cause["parameters"]
            .as_object()
            .into_iter()
            .flatten()
            .map(|(name, it)| format!("{name} {:.4}", it["value"].as_f64().unwrap_or(f64::NAN)))
            .collect();
        let at = ["parameter", "output", "at"].iter().find_map(|key| cause[*key].as_str()).unwrap_or_default();
        write!(words, ", {} {at} {}", cause["kind"].as_str().unwrap_or("?"), numbers.join(" ")).expect("a string takes text");
    }
    if !right {
        write!(words, " (hidden: {:?})", case.expected).expect("a string takes text");
    }
    Judgement { right, answer: words, errors, covered, named: named.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_case_has_records_of_both_configurations_and_a_file_that_names_them() {
        for case in cases(1, None, false, Some(200)) {
            let names: Vec<&String> = case.records.iter().flatten().map(|it| &it.0).collect();
            assert_eq!(names.len(), 6, "{}", case.name);
            assert!(case.files[0].1.contains("[configurations]\ndiffer"));
            let lines = case.records.iter().flatten().map(|it| it.1.lines().count());
            assert!(lines.into_iter().all(|it| it == 201), "{}", case.name);
        }
        let quick: Vec<String> = cases(1, None, true, Some(200)).into_iter().map(|it| it.name).collect();
        assert_eq!(quick, QUICK);
    }

    #[test]
    fn a_right_answer_has_the_cause_its_configurations_and_its_numbers() {
        let case = |name: &str| cases(1, Some(name), false, Some(200)).pop().expect("a case of this name");
        let in_one = case("configurations-servo-axis-in-one");
        let force = in_one.expected[0].numbers[0].1;
        let answer = |name: &str, value: f64, configurations: Value| {
            let numbers = json!({ name: { "value": value, "low": 0.9 * value, "high": 1.1 * value } });
            let cause = json!({ "kind": "coulomb-friction", "parameters": numbers, "configurations": configurations });
            json!({ "verdict": "explained", "causes": [cause] })
        };
        let right = |answer: &Value| judge(&in_one, answer).right;
        assert!(right(&answer("force[loaded]", force, json!(["loaded"]))));
        assert!(!right(&answer("force[loaded]", 2.0 * force, json!(["loaded"]))));
        assert!(!right(&answer("force[unloaded]", force, json!(["unloaded"]))));
        assert!(!right(&answer("force", force, Value::Null)));
        assert!(!right(&json!({ "verdict": "no-discrepancy", "causes": [] })));
        let shared = case("configurations-servo-axis-shared");
        let force = shared.expected[0].numbers[0].1;
        assert!(judge(&shared, &answer("force", force, Value::Null)).right);
        assert!(!judge(&shared, &answer("force[loaded]", force, json!(["loaded"]))).right);
        let null = case("configurations-driveline-null");
        assert!(judge(&null, &json!({ "verdict": "no-discrepancy", "causes": [] })).right);
        assert!(!judge(&null, &answer("force", 1.0, Value::Null)).right);
    }
}

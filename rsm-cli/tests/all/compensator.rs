//! The command for models with a compensator: a sequence through it, its certificate, its files, and a refusal that names the point.

use std::path::Path;

use serde_json::json;

use crate::calls::{folder, json, keys, rsm, text};
use crate::shell::published;

/// Damping from the gear; frequency and target fixed.
const MODEL: &str = r#"format = 1
model = "car"

[inputs.gear]
unit = "1"
range = [1.0, 5.0]

[surfaces.damping]
unit = "1"
inputs = ["gear"]
terms = [{ powers = [0], coefficient = 0.15 }, { powers = [1], coefficient = 0.05 }]

[compensators.tip_in]
sample_time = 0.001
natural_frequency = 20.0
zero_damping = { surface = "damping" }
pole_damping = 0.7
"#;

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

#[test]
fn eval_runs_a_compensator_over_a_sequence() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    // Columns in any order; the signal in any unit, or without a unit.
    write(here.path(), "sequence.csv", "gear[1],input\n1,0\n1,1\n2,1\n2,1\n");
    let arguments = ["eval", "car.toml", "--compensator", "tip_in", "--data", "sequence.csv"];
    let output = rsm(&arguments, here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    assert_eq!(printed.lines().next(), Some("input,gear[1],tip_in"));
    assert_eq!(printed.lines().nth(3).map(|line| line.starts_with("1.0,2.0,")), Some(true), "{printed}");
    let lines: Vec<f64> = printed.lines().skip(1).map(|line| line.rsplit(',').next().unwrap().parse().unwrap()).collect();
    // With g = 0.01, the first step of the demand gives u = 2 g/(1 + g (g + 1.4)) = 0.0197220, y = 1 + (0.1 - 0.7) u.
    let u = 0.02 / (1.0 + 0.01 * 1.41);
    assert!(lines.len() == 4 && lines[0] == 0.0 && (lines[1] - (1.0 - 0.6 * u)).abs() < 1e-15, "{lines:?}");
    // Then s1 = u, s2 = g u; the damping is 0.125 in gear 2.
    let next = 2.0 * (u + 0.01 * (1.0 - 0.01 * u)) / (1.0 + 0.01 * 1.41);
    assert!((lines[2] - (1.0 - 0.575 * next)).abs() < 1e-15, "{lines:?}");

    let with = |more: &[&str]| rsm(&[&arguments[..], more].concat(), here.path());
    let bits = text(&with(&["--bits"]).stdout);
    assert_eq!(bits.lines().nth(1), Some(format!("{:016x}", lines[1].to_bits()).as_str()));
    let narrow = text(&with(&["--bits", "--precision", "f32"]).stdout);
    assert!(narrow.lines().count() == 4 && narrow.lines().all(|line| line.len() == 8), "{narrow}");
    let found = json(&with(&["--json"]));
    assert_eq!(keys(&found), ["bits", "compensator", "precision", "values"]);
    assert_eq!((found["values"].as_array().unwrap().len(), &found["compensator"]), (4, &json!("tip_in")));

    for (bad, says) in [
        (
            &["eval", "car.toml", "--compensator", "nothing", "--data", "sequence.csv"][..],
            "the compensators of car.toml are tip_in",
        ),
        (&["eval", "car.toml", "--compensator", "tip_in", "--at", "gear=1"], "cannot be used with"),
        (&["eval", "car.toml", "--compensator", "tip_in"], "give the sequence of the compensator with --data"),
    ] {
        let output = rsm(bad, here.path());
        assert!(output.status.code() == Some(2) && text(&output.stderr).contains(says), "{}", text(&output.stderr));
    }
}

#[test]
fn check_certifies_a_compensator() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    let output = rsm(&["check", "car.toml", "--json"], here.path());
    assert_eq!(output.status.code(), Some(0));
    let found = json(&output);
    assert_eq!((&found["ok"], &found["problems"]), (&json!(true), &json!([])));
    let certified = &found["compensators"]["tip_in"];
    assert_eq!(keys(certified), ["natural_frequency", "pole_damping", "stable", "zero_damping"]);
    assert_eq!((&certified["stable"], &certified["natural_frequency"]), (&json!(true), &json!([20.0, 20.0])));
    // The range of 0.15 -+ 0.05.
    let [low, high] = [0, 1].map(|k| certified["zero_damping"][k].as_f64().unwrap());
    assert!(low <= 0.1 && low > 0.1 - 1e-12 && (0.2..0.2 + 1e-12).contains(&high), "{low} {high}");
    let printed = text(&rsm(&["check", "car.toml"], here.path()).stdout);
    assert!(printed.contains("tip_in: stable over the whole range of its inputs, in exact arithmetic"), "{printed}");
}

#[test]
fn emit_writes_the_names_of_the_contract() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    for language in ["c", "rust"] {
        let output = rsm(&["emit", "car.toml", "--lang", language, "--out", "out"], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    }
    let read = |name: &str| std::fs::read_to_string(here.path().join("out").join(name)).unwrap();
    let header = read("car.h");
    for declared in [
        "} car_tip_in_state;",
        "void car_tip_in_init(car_tip_in_state *state);",
        "double car_tip_in_step(car_tip_in_state *state, double input, double gear);",
        "} car_tip_in_state_f32;",
        "void car_tip_in_init_f32(car_tip_in_state_f32 *state);",
        "float car_tip_in_step_f32(car_tip_in_state_f32 *state, float input, float gear);",
    ] {
        assert!(header.contains(declared), "{declared}\n{header}");
    }
    let module = read("car.rs");
    for declared in [
        "pub struct TipInState {",
        "pub fn tip_in_init() -> TipInState {",
        "pub fn tip_in_step(state: &mut TipInState, input: f64, gear: f64) -> f64 {",
        "pub fn tip_in_step_f32(state: &mut TipInStateF32, input: f32, gear: f32) -> f32 {",
    ] {
        assert!(module.contains(declared), "{declared}\n{module}");
    }
}

#[test]
fn a_damping_that_goes_negative_is_a_problem_with_its_point() {
    let here = folder();
    let compensator = "\n[compensators.tip_in]\nsample_time = 0.001\nnatural_frequency = 20.0\n\
                       zero_damping = { surface = \"damping_ratio\" }\npole_damping = 0.7\n";
    write(here.path(), "throttle.toml", &(std::fs::read_to_string(published("throttle.toml")).unwrap() + compensator));
    write(here.path(), "sequence.csv", "input[1],speed[mph],gear[1]\n0,10,1\n");
    let output = rsm(&["check", "throttle.toml", "--json"], here.path());
    assert_eq!(output.status.code(), Some(1));
    let found = json(&output);
    assert_eq!((&found["ok"], &found["compensators"]["tip_in"]["stable"]), (&json!(false), &json!(false)));
    let what = "found -0.7559 at speed = 70, gear = 1, expected more than 0";
    let problem = json!({ "where": "compensators.tip_in.zero_damping", "what": what, "at": { "speed": 70.0, "gear": 1.0 } });
    assert_eq!(found["problems"], json!([problem]));
    for refused in [
        &["emit", "throttle.toml", "--lang", "c", "--out", "out"][..],
        &["eval", "throttle.toml", "--compensator", "tip_in", "--data", "sequence.csv"],
    ] {
        let output = rsm(refused, here.path());
        let message = text(&output.stderr);
        assert_eq!((output.status.code(), text(&output.stdout).as_str()), (Some(2), ""));
        assert!(
            message.starts_with(&format!("throttle.toml:40:16: compensator `tip_in`: `zero_damping`: {what}")),
            "{message}"
        );
    }
    assert!(!here.path().join("out").exists());
    // The surface alone can still be evaluated.
    let output = rsm(&["eval", "throttle.toml", "--at", "speed=70,gear=1"], here.path());
    assert_eq!(output.status.code(), Some(0));
}

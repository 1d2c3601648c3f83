//! `rsm diagnose MODEL.toml --data` as a command: refused input, its keys, and the use of its files in other commands.

use std::path::Path;

use super::calls::{folder, json, keys, rsm, text};

pub(crate) const MODEL: &str = r#"format = 1
model = "pump"

[inputs.speed]
unit = "rad/s"
range = [0.0, 400.0]
outside = "clamp"

[inputs.valve]
unit = "1"
range = [0.0, 1.0]
outside = "clamp"

[surfaces.flow]
unit = "l/min"
inputs = ["speed", "valve"]
terms = [
  { powers = [0, 0], coefficient = 50.0 },
  { powers = [1, 0], coefficient = 30.0 },
  { powers = [0, 1], coefficient = 12.0 },
]
"#;

/// Pseudo-random numbers in -1..1, and noise of variance one from twelve of them. Constants: D. E. Knuth's MMIX.
struct Draws(u64);

impl Draws {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() / 2.0
    }
}

/// 60 runs of a pump whose flow also depends on the oil temperature, by -4 l/min from the middle of its range to the end, and whose model lacks the
/// product of its inputs, 5 l/min. The speed is in rpm. Run 41 has an error of 20 l/min, and run 8 is above the range of the speed.
pub(crate) fn runs(file: &Path, hidden: bool) {
    let mut draws = Draws(7);
    let mut table = String::from("run,speed[rpm],valve[%],oil_temperature[degC],rig,flow[l/min]\n");
    for run in 1..=60 {
        let (x, v, z) = (draws.uniform(), draws.uniform(), draws.uniform());
        let x = if run == 8 { 1.5 } else { x };
        let mut flow = 50.0 + 30.0 * x + 12.0 * v + 0.5 * draws.normal();
        if hidden {
            flow += 5.0 * x * v - 4.0 * z + if run == 41 { 20.0 } else { 0.0 };
        }
        let rpm = (200.0 + 200.0 * x) * 30.0 / std::f64::consts::PI;
        table += &format!("{run},{rpm:?},{:?},{:?},{},{flow:?}\n", 50.0 + 50.0 * v, 40.0 + 20.0 * z, ["a", "b"][run % 2]);
    }
    std::fs::write(file, table).unwrap();
}

#[test]
fn what_a_pump_lacks_is_named_and_its_extension_goes_through_the_compiler() {
    let here = folder();
    std::fs::write(here.path().join("pump.toml"), MODEL).unwrap();
    runs(&here.path().join("new.csv"), true);
    let output = rsm(&["diagnose", "pump.toml", "--data", "new.csv", "--json", "--out", "found"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let value = json(&output);
    for key in ["verdict", "causes", "nominal", "extended", "gain", "where"] {
        assert!(keys(&value).contains(&key), "{key}");
    }
    assert_eq!(value["verdict"], "explained", "{}", text(&output.stderr));
    let causes = value["causes"].as_array().unwrap();
    let of =
        |kind: &str| causes.iter().find(|cause| cause["kind"] == kind).unwrap_or_else(|| panic!("no {kind} in {causes:?}"));
    assert_eq!(causes.len(), 3, "{causes:?}");
    let term = of("missing-term");
    assert_eq!(term["term"], "speed*valve");
    let within = |number: &serde_json::Value, truth: f64, error: f64| (number["value"].as_f64().unwrap() - truth).abs() < error;
    // The standard error of a coefficient of 58 runs: 0.5 sd of noise over sqrt(58/9) = 0.2; the limit is four of them. For the
    // slope: 0.5/sqrt(58/3)/20 = 0.006.
    assert!(within(&term["parameters"]["coefficient"], 5.0, 0.8), "{term}");
    let input = of("missing-input");
    assert_eq!(input["input"], "oil_temperature");
    assert!(within(&input["parameters"]["slope"], -0.2, 0.024), "{input}");
    assert_eq!(input["parameters"]["slope"]["unit"], "l/min/(degC)");
    let outlying = of("outlying-runs");
    let runs = outlying["runs"].as_array().unwrap();
    assert_eq!((runs.len(), &runs[0]["run"], &runs[0]["line"]), (1, &41.into(), &42.into()), "{runs:?}");
    assert_eq!(value["responses"]["flow"]["rows_outside"], serde_json::json!(["new.csv:9"]));
    assert!(value["gain"].as_f64().unwrap() > 0.95, "{}", value["gain"]);
    let written = std::fs::read_to_string(here.path().join("found/diagnosis.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&written).unwrap(), value);
    let report = std::fs::read_to_string(here.path().join("found/report.html")).unwrap();
    assert!(report.contains("<svg") && report.contains("oil_temperature"));
    for arguments in [
        &["check", "found/extended.toml"][..],
        &["emit", "found/extended.toml", "--lang", "c", "--out", "c"],
        &["eval", "found/extended.toml", "--at", "speed=300,valve=0.75,oil_temperature=40"],
    ] {
        let output = rsm(arguments, here.path());
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    }
    // At (0.5, 0.5) coded and the middle of the temperature: 50 + 15 + 6 + 1.25, to five standard errors of a mean value, 0.5/sqrt(58/4).
    let output = rsm(&["eval", "found/extended.toml", "--at", "speed=300,valve=0.75,oil_temperature=40"], here.path());
    let flow: f64 = text(&output.stdout).trim().parse().unwrap();
    assert!((flow - 72.25).abs() < 0.7, "{flow}");
    // The same command gives the same output twice.
    let again = rsm(&["diagnose", "pump.toml", "--data", "new.csv", "--json"], here.path());
    assert_eq!(text(&again.stdout), text(&output_of(here.path())));
}

fn output_of(folder: &Path) -> Vec<u8> {
    rsm(&["diagnose", "pump.toml", "--data", "new.csv", "--json"], folder).stdout
}

#[test]
fn a_pump_without_an_error_keeps_its_file() {
    let here = folder();
    std::fs::write(here.path().join("pump.toml"), MODEL).unwrap();
    runs(&here.path().join("new.csv"), false);
    let output =
        rsm(&["diagnose", "pump.toml", "--data", "new.csv", "--validate", "new.csv", "--json", "--out", "found"], here.path());
    let value = json(&output);
    assert_eq!(value["verdict"], "no-discrepancy", "{}", text(&output.stderr));
    assert_eq!((value["causes"].as_array().unwrap().len(), value["gain"].as_f64()), (0, Some(0.0)));
    assert_eq!(value["nominal"], value["extended"]);
    let extended = std::fs::read_to_string(here.path().join("found/extended.toml")).unwrap();
    assert_eq!(extended.trim(), MODEL.trim());
}

#[test]
fn files_and_flags_that_do_not_belong_together_are_refused() {
    let here = folder();
    std::fs::write(here.path().join("pump.toml"), MODEL).unwrap();
    std::fs::write(here.path().join("other.toml"), "format = 1\n").unwrap();
    std::fs::write(here.path().join("broken.toml"), "model = \n").unwrap();
    runs(&here.path().join("new.csv"), false);
    std::fs::write(here.path().join("strange.csv"), "speed[rpm],valve[%],torque[N*m]\n1,2,3\n").unwrap();
    std::fs::write(here.path().join("unit.csv"), "speed[K],valve[%],flow[l/min]\n1,2,3\n").unwrap();
    std::fs::write(here.path().join("short.csv"), "speed[rpm],valve[%],flow[l/min]\n1,2,3\n2,3,4\n").unwrap();
    let cases: [(&[&str], &str); 8] = [
        (&["pump.toml"], "--data: found none, and pump.toml is a model file"),
        (&["pump.toml", "--data", "new.csv", "--record", "new.csv"], "--record: pump.toml is a model file"),
        (&["other.toml", "--data", "new.csv"], "other.toml: found neither `model` (a model file) nor `plant` (a plant file)"),
        (&["broken.toml", "--data", "new.csv"], "broken.toml:1:"),
        (&["pump.toml", "--data", "strange.csv"], "strange.csv:1: no column is a response of model `pump`"),
        (&["pump.toml", "--data", "unit.csv"], "unit.csv:1: column 1 `speed`: `K` cannot be converted to `rad/s`"),
        (&["pump.toml", "--data", "short.csv"], "pump.toml: `flow`: 2 of 2 rows are inside the ranges"),
        (&["pump.toml", "--data", "nowhere.csv"], "nowhere.csv: cannot be read"),
    ];
    for (arguments, message) in cases {
        let output = rsm(&[&["diagnose"], arguments, &["--out", "found"]].concat(), here.path());
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}");
        assert!(text(&output.stderr).contains(message), "{arguments:?}: {}", text(&output.stderr));
        assert!(!here.path().join("found").exists(), "{arguments:?}");
    }
}

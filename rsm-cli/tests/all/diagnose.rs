//! `rsm diagnose` as a command: what it refuses, and the keys of what it says.

use super::command::{folder, json, keys, rsm, text};

fn shipped(name: &str) -> String {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-lab/plants").join(name).display().to_string()
}

#[test]
fn a_diagnosis_without_a_record_of_a_surface_or_of_an_extended_plant_is_refused() {
    let here = folder();
    let plant = shipped("pmac.toml");
    let record = shipped("pmac.csv");
    let without = rsm(&["diagnose", &plant], here.path());
    assert_eq!((without.status.code(), without.stdout.len()), (Some(2), 0));
    assert!(text(&without.stderr).contains("--record: found none"));
    let surface = rsm(&["diagnose", &plant, "--data", &record], here.path());
    assert_eq!(surface.status.code(), Some(2));
    assert!(text(&surface.stderr).contains("not surfaces from --data"));
    let effects =
        std::fs::read_to_string(&plant).unwrap() + "\n[[effects]]\nkind = \"windage\"\nparameters = { coefficient = 1e-6 }\n";
    std::fs::write(here.path().join("extended.toml"), effects).unwrap();
    let extended = rsm(&["diagnose", "extended.toml", "--record", &record], here.path());
    assert_eq!(extended.status.code(), Some(2));
    assert!(text(&extended.stderr).contains("a diagnosis begins with a nominal plant"));
}

#[test]
fn a_diagnosis_writes_its_json_the_extended_plant_and_a_report() {
    let here = folder();
    // What the shipped plant does along its shipped record, noise from a linear congruence: nothing is wrong with it.
    let simulated =
        rsm(&["simulate", &shipped("pmac.toml"), "--record", &shipped("pmac.csv"), "--out", "clean.csv"], here.path());
    assert_eq!(simulated.status.code(), Some(0));
    let clean = std::fs::read_to_string(here.path().join("clean.csv")).unwrap();
    let mut state = 1_u64;
    let mut noise = || {
        // Twelve uniform numbers less six have variance one. Constants: D. E. Knuth's MMIX.
        (0..12)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    };
    let mut noisy = String::new();
    for (k, line) in clean.lines().enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        if k == 0 {
            noisy += line;
        } else {
            let [i_d, i_q, speed] = [4, 5, 6].map(|k| cells[k].parse::<f64>().unwrap());
            noisy +=
                &format!("{},{},{},{}", cells[..4].join(","), i_d + 0.2 * noise(), i_q + 0.2 * noise(), speed + 0.3 * noise());
        }
        noisy.push('\n');
    }
    std::fs::write(here.path().join("noisy.csv"), noisy).unwrap();
    let output = rsm(&["diagnose", &shipped("pmac.toml"), "--record", "noisy.csv", "--json", "--out", "found"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let value = json(&output);
    for key in ["verdict", "causes", "nominal", "extended", "gain", "where"] {
        assert!(keys(&value).contains(&key), "{key}");
    }
    assert_eq!(value["verdict"], "no-discrepancy");
    assert_eq!(value["causes"].as_array().unwrap().len(), 0);
    let written = std::fs::read_to_string(here.path().join("found/diagnosis.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&written).unwrap(), value);
    assert!(std::fs::read_to_string(here.path().join("found/report.html")).unwrap().contains("<svg"));
    let again = rsm(&["simulate", "found/extended.toml", "--record", "noisy.csv", "--out", "again.csv"], here.path());
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
}

#[test]
fn a_refit_without_a_designed_experiment_is_refused_before_any_work() {
    let here = folder();
    // The records do not exist: nobody has looked for them when the refusal comes.
    let axis =
        rsm(&["diagnose", &shipped("servo-axis.toml"), "--record", "none.csv", "--refit", "--out", "found"], here.path());
    assert_eq!((axis.status.code(), axis.stdout.len()), (Some(2), 0));
    let said = text(&axis.stderr);
    assert!(
        said.contains("--refit: found the plant \"servo-axis\"") && said.contains("no experiment is designed for an axis"),
        "{said}"
    );
    let (motor, car) = (shipped("pmac.toml"), shipped("driveline.toml"));
    let other = rsm(&["diagnose", &motor, "--record", "none.csv", "--refit", "--truth", &car, "--out", "found"], here.path());
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("--truth: found the plant \"driveline\", expected \"pmac\""));
    // Evaluators need a place.
    let nowhere = rsm(&["diagnose", &motor, "--record", "none.csv", "--refit"], here.path());
    assert_eq!(nowhere.status.code(), Some(2));
    assert!(text(&nowhere.stderr).contains("--out"));
    assert!(!here.path().join("found").exists());
}

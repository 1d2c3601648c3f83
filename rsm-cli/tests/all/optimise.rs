//! `rsm optimise` as programs outside the project call it, on the shipped example.

use std::path::Path;

use crate::calls::{folder, json, keys, rsm, text};

fn example(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/tyre").join(name).display().to_string()
}

#[test]
fn the_tyre_has_its_published_optimum_in_words_as_json_and_as_csv() {
    let here = folder();
    let optimise = |words: &[&str]| {
        rsm(&[&["optimise", &example("tyre.toml"), "--goals", &example("goals.toml")], words].concat(), here.path())
    };
    let output = optimise(&["--json", "--out", "best.csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found = json(&output);
    assert_eq!(
        keys(&found),
        ["active", "agreeing", "desirability", "model", "out", "responses", "settings", "starts", "study", "violated"]
    );
    // Derringer, Suich 1980: 0.583, at (-0.05, 0.145, -0.868).
    assert!((found["desirability"].as_f64().unwrap() - 0.583).abs() < 1.5e-3, "{found}");
    assert_eq!(keys(&found["settings"]), ["silane", "silica", "sulphur"]);
    assert!((found["settings"]["sulphur"].as_f64().unwrap() + 0.868).abs() < 0.02, "{found}");
    assert_eq!(keys(&found["responses"][0]), ["desirability", "goal", "response", "unit", "value"]);
    let csv = std::fs::read_to_string(here.path().join("best.csv")).unwrap();
    let rows: Vec<&str> = csv.lines().collect();
    assert_eq!(rows[0], "silica[1],silane[1],sulphur[1],abrasion[1],modulus[psi],elongation[%],hardness[1],desirability[1]");
    let cells: Vec<f64> = rows[1].split(',').map(|cell| cell.parse().unwrap()).collect();
    // The same bits in the table.
    assert_eq!((rows.len(), cells[7]), (2, found["desirability"].as_f64().unwrap()));
    // The prediction is that of `rsm eval`, bit for bit.
    let at = format!("silica={:?},silane={:?},sulphur={:?}", cells[0], cells[1], cells[2]);
    let evaluated = rsm(&["eval", &example("tyre.toml"), "--surface", "modulus", "--at", &at], here.path());
    assert_eq!(text(&evaluated.stdout).trim().parse::<f64>().unwrap(), cells[4]);
    let words = text(&optimise(&[]).stdout);
    assert!(words.starts_with("tread: silica = -0.0") && words.contains("target    desirability"), "{words}");
}

#[test]
fn a_front_has_its_points_and_no_dominated_one() {
    let here = folder();
    let goals = "format = 1\nstudy = \"s\"\nseed = 1\nstarts = 8\n\
        [responses.abrasion]\ngoal = \"maximise\"\nlow = 0\nhigh = 200\n\
        [responses.elongation]\ngoal = \"maximise\"\nlow = 0\nhigh = 600\n\
        [responses.hardness]\ngoal = \"range\"\nlow = 60\nhigh = 75\n";
    std::fs::write(here.path().join("goals.toml"), goals).unwrap();
    let words = ["optimise", &example("tyre.toml"), "--goals", "goals.toml", "--pareto", "7", "--json", "--out", "front.csv"];
    let output = rsm(&words, here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found = json(&output);
    assert_eq!(keys(&found), ["best", "model", "objectives", "out", "points", "searched", "study", "worst"]);
    let points = found["points"].as_array().unwrap();
    assert!((4..=9).contains(&points.len()), "{}", points.len());
    let value = |point: &serde_json::Value, k: usize| point["responses"][k]["value"].as_f64().unwrap();
    for pair in points.windows(2) {
        assert!(value(&pair[0], 0) > value(&pair[1], 0) && value(&pair[0], 1) < value(&pair[1], 1), "{pair:?}");
    }
    assert!(points.iter().all(|point| (60.0..=75.0).contains(&value(point, 2))));
    let csv = std::fs::read_to_string(here.path().join("front.csv")).unwrap();
    assert_eq!(csv.lines().count(), points.len() + 1);
}

#[test]
fn what_cannot_be_reached_is_a_negative_answer_and_bad_studies_are_refused() {
    let here = folder();
    let optimise = |goals: &str, words: &[&str]| {
        std::fs::write(here.path().join("goals.toml"), format!("format = 1\nstudy = \"s\"\nseed = 1\nstarts = 4\n{goals}"))
            .unwrap();
        rsm(&[&["optimise", &example("tyre.toml"), "--goals", "goals.toml"], words].concat(), here.path())
    };
    let output = optimise("[responses.hardness]\ngoal = \"range\"\nlow = 500\n", &[]);
    assert_eq!(output.status.code(), Some(1));
    let words = text(&output.stdout);
    assert!(
        words.contains("violated: response `hardness` at its low limit 500") && words.contains("no settings were found"),
        "{words}"
    );
    let output = optimise("[responses.hardness]\ngoal = \"maximise\"\nlow = 500\nhigh = 600\n", &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("at which every response is acceptable; here not: hardness"));
    let output = optimise("[responses.softness]\ngoal = \"range\"\nlow = 1\n", &["--out", "best.csv"]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0));
    let words = text(&output.stderr);
    assert!(words.starts_with("goals.toml:5:12: ") && words.contains("has no surface `softness`"), "{words}");
    assert!(!here.path().join("best.csv").exists());
    let output = optimise("[responses.hardness]\ngoal = \"range\"\nlow = 1\n", &["--pareto", "5"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("a front needs two or more responses"));
}

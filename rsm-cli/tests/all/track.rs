//! `rsm track` and `rsm emit --recursive` as programs outside the project call them.

use std::fmt::Write as _;
use std::path::Path;

use crate::calls::{folder, json, keys, rsm, text};

const MODEL: &str = "format = 1\nmodel = \"car\"\n\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n\n[surfaces.drag]\nunit = \"N\"\n\
    inputs = [\"speed\"]\nterms = [\n  { powers = [0], coefficient = 35.0 },\n  { powers = [1], coefficient = 30.0 },\n]\n\n\
    [surfaces.drag.evidence]\nrows = 40\nresidual_sd = 0.5\n";

/// Rows in km/h, with the drag of the file plus what a drift adds; the noise is a pattern of +-0.5 N.
fn rows(count: usize, drift: impl Fn(usize) -> f64) -> String {
    let mut csv = String::from("speed[km/h],drag[N]\n");
    for k in 0..count {
        let speed = (k * 7) % 28 + 1;
        let noise = [0.5, -0.5, -0.5, 0.5, 0.5, -0.5][k % 6];
        writeln!(csv, "{},{}", 3.6 * speed as f64, 5.0 + 2.0 * speed as f64 + drift(k) + noise).unwrap();
    }
    csv
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

#[test]
fn a_surface_follows_rows_in_words_as_json_and_as_a_model_file() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    // 8 N more at the end of 2000 rows, at every speed: 0.004 N a row.
    write(here.path(), "day.csv", &rows(2000, |k| 0.004 * k as f64));
    let words = ["track", "car.toml", "--data", "day.csv", "--forgetting", "0.99", "--out", "now.toml"];
    let output = rsm(&[&words[..], &["--json"]].concat(), here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found = json(&output);
    assert_eq!(
        keys(&found),
        [
            "coefficients",
            "error_ratio",
            "frozen",
            "longest_beyond_gate",
            "model",
            "out",
            "parts",
            "rows",
            "settings",
            "surface",
            "unit",
            "used"
        ]
    );
    assert_eq!((found["rows"].as_u64(), found["used"].as_u64()), (Some(2000), Some(2000)));
    assert_eq!(keys(&found["frozen"]), ["beyond_gate", "not_finite", "outside", "state"]);
    assert_eq!(keys(&found["settings"]), ["forgetting", "gate", "limit", "noise", "precision", "start"]);
    assert_eq!(found["settings"]["noise"].as_f64(), Some(0.5), "the residual_sd of the file");
    let parts = found["parts"].as_array().unwrap();
    assert_eq!((parts.len(), keys(&parts[0])), (4, vec!["rmse", "rmse_of_file", "rows", "used"]));
    // With a memory of 100 rows the surface is 0.4 N behind; the file's is up to 8 N wrong, 7 N in the last part.
    assert!(parts[3]["rmse"].as_f64().unwrap() < 0.8 && parts[3]["rmse_of_file"].as_f64().unwrap() > 6.9, "{found}");
    let constant = &found["coefficients"][0];
    assert_eq!(keys(constant), ["after", "before", "powers", "standard_error", "term"]);
    let after = constant["after"].as_f64().unwrap();
    assert!((after - 42.6).abs() < 0.3, "{found}");
    let error = constant["standard_error"].as_f64().unwrap();
    // 100 rows: 0.05 N for evenly spread speeds.
    assert!((0.03..0.08).contains(&error), "{error}");
    // The file has the same coefficients, bit for bit, and is a model like any other.
    let evaluated = rsm(&["eval", "now.toml", "--at", "speed=15"], here.path());
    assert_eq!(text(&evaluated.stdout).trim().parse::<f64>().unwrap(), after);
    let written = std::fs::read_to_string(here.path().join("now.toml")).unwrap();
    assert!(written.contains("recursive least squares") && written.contains("file = \"day.csv\""), "{written}");
    assert_eq!(rsm(&["check", "now.toml"], here.path()).status.code(), Some(0));
    // It is a start for the next day: --noise comes from it.
    let words = text(&rsm(&["track", "now.toml", "--data", "day.csv"], here.path()).stdout);
    assert!(words.starts_with("drag: ") && words.contains("rmse of the file") && words.contains("standard error"), "{words}");
}

#[test]
fn bad_rows_are_counted_by_their_reason_and_change_nothing() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    let good = rows(300, |_| 3.0);
    // Between them: a missing cell, a speed outside the range, a stuck reading.
    let mut bad: Vec<String> = good.lines().map(str::to_string).collect();
    bad.insert(100, "NaN,30".to_string());
    bad.insert(150, "36,".to_string());
    bad.insert(200, "999,30".to_string());
    (0..12).for_each(|_| bad.insert(250, "36,5000".to_string()));
    write(here.path(), "good.csv", &good);
    write(here.path(), "bad.csv", &(bad.join("\n") + "\n"));
    let track = |data: &str| {
        let output = rsm(&["track", "car.toml", "--data", data, "--json"], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        json(&output)
    };
    let (good, bad) = (track("good.csv"), track("bad.csv"));
    assert_eq!(good["coefficients"], bad["coefficients"]);
    assert_eq!(bad["used"], good["used"]);
    let frozen = serde_json::json!({ "not_finite": 2, "outside": 1, "beyond_gate": 12, "state": 0 });
    assert_eq!(bad["frozen"], frozen);
    assert_eq!(bad["longest_beyond_gate"], serde_json::json!({ "rows": 12, "file": "bad.csv", "line": 251 }));
    let words = text(&rsm(&["track", "car.toml", "--data", "bad.csv"], here.path()).stdout);
    assert!(words.contains("300 of 315 rows used; frozen: 2 not finite, 1 outside"), "{words}");
    assert!(words.contains("12 error above 5 standard deviations") && words.contains("12 rows in a run"), "{words}");
    // Two files in order are one.
    let lines: Vec<&str> = std::fs::read_to_string(here.path().join("good.csv")).unwrap().leak().lines().collect();
    write(here.path(), "a.csv", &(lines[..120].join("\n") + "\n"));
    write(here.path(), "b.csv", &format!("{}\n{}\n", lines[0], lines[120..].join("\n")));
    let output = rsm(&["track", "car.toml", "--data", "a.csv", "--data", "b.csv", "--json"], here.path());
    assert_eq!(json(&output)["coefficients"], good["coefficients"]);
    // None of the rows is used: a negative answer.
    write(here.path(), "out.csv", "speed[m/s],drag[N]\n31,4\n32,5\n");
    let output = rsm(&["track", "car.toml", "--data", "out.csv", "--out", "same.toml"], here.path());
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
}

#[test]
fn bad_input_is_refused_with_its_place_and_nothing_is_written() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    write(here.path(), "bare.toml", MODEL.split("\n[surfaces.drag.evidence]").next().unwrap());
    write(here.path(), "good.csv", &rows(30, |_| 0.0));
    write(here.path(), "text.csv", "speed[m/s],drag[N]\n1,7\nfast,9\n");
    write(here.path(), "column.csv", "speed[m/s],force[N]\n1,7\n");
    write(here.path(), "unit.csv", "speed[kg],drag[N]\n1,7\n");
    for (words, expected) in [
        (&["car.toml", "--data", "text.csv"][..], "text.csv:3: column 1 `speed`: found `fast`"),
        (&["car.toml", "--data", "column.csv"], "column.csv:1: there is no column `drag`"),
        (&["car.toml", "--data", "unit.csv"], "unit.csv:1: column 1 `speed`: "),
        (&["car.toml", "--data", "good.csv", "--data", "text.csv"], "text.csv:3: column 1 `speed`: found `fast`"),
        (&["car.toml", "--data", "none.csv"], "none.csv: "),
        (&["car.toml", "--data", "good.csv", "--surface", "lift"], "--surface: found lift"),
        (&["car.toml", "--data", "good.csv", "--forgetting", "1.5"], "forgetting: found 1.5, expected 0.5 to 1"),
        (&["car.toml", "--data", "good.csv", "--start", "3"], "start: found 3, expected at most the limit 0.5"),
        (&["bare.toml", "--data", "good.csv"], "found no `residual_sd` in its evidence"),
    ] {
        let output = rsm(&[&["track"], words, &["--out", "now.toml"]].concat(), here.path());
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{words:?}");
        assert!(text(&output.stderr).contains(expected), "{words:?}: {}", text(&output.stderr));
        assert!(!here.path().join("now.toml").exists(), "{words:?}");
    }
    // Its own input is not replaced.
    let output = rsm(&["track", "car.toml", "--data", "good.csv", "--out", "car.toml"], here.path());
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(std::fs::read_to_string(here.path().join("car.toml")).unwrap(), MODEL);
}

#[test]
fn the_update_is_emitted_in_both_languages() {
    let here = folder();
    write(here.path(), "car.toml", MODEL);
    for (lang, functions) in
        [("c", ["car_drag", "car_drag_update", "car_drag_adapted"]), ("rust", ["drag", "drag_update", "drag_adapted"])]
    {
        let words = ["emit", "car.toml", "--lang", lang, "--recursive", "--precision", "f64", "--out", "src", "--json"];
        let output = rsm(&words, here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(json(&output)["functions"], serde_json::json!(functions));
    }
    let header = std::fs::read_to_string(here.path().join("src/car.h")).unwrap();
    for line in [
        "    double b1; /* coefficient of speed, in N */",
        "void car_drag_init(car_drag_state *state);",
        "void car_drag_update(car_drag_state *state, double speed, double measured, double update[3]);",
        "double car_drag_adapted(const car_drag_state *state, double speed);",
        "Forgetting factor 0.999, noise 0.5 in `N`. No coefficient has a standard deviation above 0.5",
    ] {
        assert!(header.contains(line), "{line}\n{header}");
    }
    for (words, expected) in [
        (&["--forgetting", "0.9"][..], "--forgetting: found without --recursive"),
        (&["--surface", "drag"], "--surface: found without --recursive"),
        (&["--recursive", "--noise", "-1"], "noise: found -1, expected a finite number above 0"),
    ] {
        let output = rsm(&[&["emit", "car.toml", "--lang", "c", "--out", "other"], words].concat(), here.path());
        assert_eq!(output.status.code(), Some(2), "{words:?}");
        assert!(text(&output.stderr).contains(expected), "{words:?}: {}", text(&output.stderr));
        assert!(!here.path().join("other").exists());
    }
    // Names that would be given twice.
    let twice = MODEL.replace("[surfaces.drag.evidence]", "[surfaces.drag_update]\nunit = \"N\"\ninputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 1.0 }]\n\n[surfaces.drag.evidence]");
    write(here.path(), "twice.toml", &twice);
    let output = rsm(&["emit", "twice.toml", "--lang", "c", "--recursive", "--surface", "drag", "--out", "other"], here.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("would both have a function `drag_update`"), "{}", text(&output.stderr));
}

//! The command as programs outside the project call it: names, flags, JSON keys, exit statuses, whole outputs.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::calls::{folder, json, keys, rsm, text};
use crate::shell::published;

fn files_in(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// A specification and its data (`made_up_runs.rs`), with a change.
fn fit_folder(change: impl Fn(String) -> String) -> tempfile::TempDir {
    let folder = folder();
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/weakening");
    for name in ["dyno.csv", "dyno-unseen.csv"] {
        std::fs::copy(cases.join(name), folder.path().join(name)).unwrap();
    }
    let specification = std::fs::read_to_string(cases.join("fit.toml")).unwrap();
    std::fs::write(folder.path().join("fit.toml"), change(specification)).unwrap();
    folder
}

#[test]
fn eval_prints_a_value_or_its_bits_a_line_a_point() {
    let here = folder();
    let model = published("pmac.toml");
    // The value at the centre of the surface is its constant term, 38.19.
    let point = ["eval", &model, "--surface", "current_advance", "--at", "torque=10.8,speed=400"];
    let output = rsm(&point, here.path());
    assert_eq!((text(&output.stdout).as_str(), output.status.code()), ("38.19\n", Some(0)));
    let output = rsm(&[&point[..], &["--bits"]].concat(), here.path());
    assert_eq!(text(&output.stdout), format!("{:016x}\n", 38.19f64.to_bits()));
    let output = rsm(&[&point[..], &["--bits", "--precision", "f32"]].concat(), here.path());
    assert_eq!(text(&output.stdout), format!("{:08x}\n", 38.19f32.to_bits()));

    // A table with other units and another order of columns: without conversion, 0.4 krad/s would be wrong by a factor of 1000.
    std::fs::write(here.path().join("points.csv"), "speed[rpm],torque[N*m]\n0,21.6\n3819.718634205488,10.8\n").unwrap();
    let output = rsm(&["eval", &model, "--surface", "current_advance", "--data", "points.csv"], here.path());
    let printed = text(&output.stdout);
    let mut lines = printed.lines();
    // The points in the order and in the units of the model, with the result in the last column.
    assert_eq!(lines.next(), Some("torque[N*m],speed[rad/s],current_advance[deg]"));
    let rows: Vec<Vec<f64>> = lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    assert!(rows.len() == 2 && rows[0][..2] == [21.6, 0.0] && rows.iter().all(|row| row.len() == 3), "{rows:?}");
    let values: Vec<f64> = rows.iter().map(|row| row[2]).collect();
    // The corner (1, -1) of (26), by hand 71.97; and 3819.7186 rpm = 400 rad/s, to the rounding of the conversion.
    assert!((values[0] - 71.97).abs() < 1e-12 && (values[1] - 38.19).abs() < 1e-9, "{values:?}");
    let output = rsm(&["eval", &model, "--data", "points.csv", "--json"], here.path());
    assert_eq!(keys(&json(&output)), ["bits", "precision", "surface", "unit", "values"]);
}

#[test]
fn emit_writes_surfaces_without_clamps_and_what_an_input_gives_once() {
    let here = folder();
    let model = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[inputs.load]\nunit = \"t\"\nrange = [0.0, 2.0]\n\
                 [surfaces.drag]\nunit = \"N\"\ninputs = [\"speed\", \"load\"]\noutput_range = [0.0, 30.0]\n\
                 terms = [{ powers = [0, 0], coefficient = 5.0 }, { powers = [1, 0], coefficient = 30.0 }, { powers = [0, 1], coefficient = 2.0 }]\n";
    std::fs::write(here.path().join("car.toml"), model).unwrap();
    for (lang, file, wanted) in [
        ("c", "car.h", ["double car_drag_once(double load);", "float car_drag_inside_f32(float speed, float drag_once);"]),
        (
            "rust",
            "car.rs",
            ["pub fn drag_once(load: f64) -> f64 {", "pub fn drag_inside_f32(speed: f32, drag_once: f32) -> f32 {"],
        ),
    ] {
        let emit = ["emit", "car.toml", "--lang", lang, "--out", ".", "--inside"];
        assert_eq!(rsm(&emit, here.path()).status.code(), Some(0));
        let whole = std::fs::read_to_string(here.path().join(file)).unwrap();
        assert!(whole.contains("drag_inside") && !whole.contains("drag_once"), "{whole}");
        assert_eq!(rsm(&[&emit[..], &["--once", "load"]].concat(), here.path()).status.code(), Some(0));
        let parts = std::fs::read_to_string(here.path().join(file)).unwrap();
        assert!(wanted.iter().all(|wanted| parts.contains(wanted)), "{parts}");
    }
    let refused = |more: &[&str], text: &str, wanted: &str| {
        std::fs::write(here.path().join("other.toml"), text).unwrap();
        let emit = ["emit", "other.toml", "--lang", "c", "--out", "other"];
        let output = rsm(&[&emit[..], more].concat(), here.path());
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains(wanted), "{message}");
        assert!(!here.path().join("other").exists());
    };
    refused(&["--inside", "--once", "lod"], model, "no surface has the input `lod`");
    let crossed = model.replace(
        "{ powers = [1, 0], coefficient = 30.0 }",
        "{ powers = [1, 1], coefficient = 30.0 }, { powers = [0, 2], coefficient = 1.5 }",
    );
    refused(
        &["--inside", "--once", "load"],
        &crossed,
        "surface `drag`: the part that depends on load alone gives 2 numbers, expected one",
    );
    let clash = model.to_string()
        + "[surfaces.drag_inside]\nunit = \"N\"\ninputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 5.0 }]\n";
    refused(&["--inside"], &clash, "`drag_inside` would both have a function `drag_inside`");
}

#[test]
fn eval_prints_gradients_with_the_bits_that_emitted_code_has() {
    let here = folder();
    // The surface is y = 5 + 30 x + 2 x z with x = (speed - 15)/15 and z = (load - 1)/1.
    let model = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[inputs.load]\nunit = \"t\"\nrange = [0.0, 2.0]\n\
                 [surfaces.drag]\nunit = \"N\"\ninputs = [\"speed\", \"load\"]\n\
                 terms = [{ powers = [0, 0], coefficient = 5.0 }, { powers = [1, 0], coefficient = 30.0 }, { powers = [1, 1], coefficient = 2.0 }]\n";
    std::fs::write(here.path().join("car.toml"), model).unwrap();
    let point = ["eval", "car.toml", "--gradient", "--at", "speed=30,load=1.5"];
    // The derivatives are (30 + 2 z)/15 and 2 x/1.
    let (by_speed, by_load) = (31.0 / 15.0, 2.0);
    let printed = text(&rsm(&point, here.path()).stdout);
    let values: Vec<f64> = printed.trim().split(',').map(|cell| cell.parse().unwrap()).collect();
    assert!((values[0] - by_speed).abs() < 1e-14 && values[1] == by_load, "{printed}");
    let bits = text(&rsm(&[&point[..], &["--bits"]].concat(), here.path()).stdout);
    assert_eq!(bits, format!("{:016x},{:016x}\n", values[0].to_bits(), values[1].to_bits()));
    let of_f32 = text(&rsm(&[&point[..], &["--bits", "--precision", "f32"]].concat(), here.path()).stdout);
    assert!(of_f32.len() == 18 && of_f32.ends_with(&format!(",{:08x}\n", 2f32.to_bits())), "{of_f32}");
    // Outside the range of the speed, the derivative with respect to speed is 0.
    let outside = text(&rsm(&["eval", "car.toml", "--gradient", "--at", "speed=31,load=1.5"], here.path()).stdout);
    assert_eq!(outside, "0.0,2.0\n");

    let object = json(&rsm(&[&point[..], &["--json"]].concat(), here.path()));
    assert_eq!(keys(&object), ["bits", "gradient", "precision", "surface", "unit", "values"]);
    assert_eq!(object["gradient"], serde_json::json!(["speed", "load"]));
    assert_eq!(object["values"], serde_json::json!([[values[0], 2.0]]));
    assert_eq!(object["bits"][0][1], format!("{:016x}", 2f64.to_bits()));
    std::fs::write(here.path().join("points.csv"), "speed,load\n30,1.5\n").unwrap();
    let table = text(&rsm(&["eval", "car.toml", "--gradient", "--data", "points.csv"], here.path()).stdout);
    let begin = "speed[m/s],load[t],d_drag_d_speed[(N)/(m/s)],d_drag_d_load[(N)/(t)]\n30.0,1.5,";
    assert!(table.starts_with(begin) && table.ends_with(",2.0\n"), "{table}");

    for (lang, file, wanted) in [
        ("c", "car.h", "void car_drag_gradient(double speed, double load, double gradient[2]);"),
        ("rust", "car.rs", "pub fn drag_gradient_f32(speed: f32, load: f32) -> [f32; 2] {"),
    ] {
        let emit = ["emit", "car.toml", "--lang", lang, "--out", "."];
        assert_eq!(rsm(&emit, here.path()).status.code(), Some(0));
        let without = std::fs::read_to_string(here.path().join(file)).unwrap();
        assert_eq!(rsm(&[&emit[..], &["--gradient"]].concat(), here.path()).status.code(), Some(0));
        let with = std::fs::read_to_string(here.path().join(file)).unwrap();
        assert!(!without.contains("gradient") && with.contains(wanted), "{with}");
        // The certified range: from 28/15 to 32/15, within some units in the last place.
        assert!(with.contains("- derivative by `speed`: 1.866 to 2.134, within "), "{with}");
        assert!(with.contains("- `speed` in `m/s`: 0.0 to 30.0; outside the derivative by it is 0"), "{with}");
    }
}

#[test]
fn eval_lets_nan_through_and_clamps_infinities() {
    let here = folder();
    let model = published("pmac.toml");
    let at = |point: &str| text(&rsm(&["eval", &model, "--at", point], here.path()).stdout);
    assert_eq!(at("torque=nan,speed=1"), "NaN\n");
    assert_eq!(at("torque=inf,speed=-inf"), at("torque=21.6,speed=0"));
}

#[test]
fn check_prints_the_certificate_of_the_contract() {
    let here = folder();
    let output = rsm(&["check", &published("throttle.toml"), "--json"], here.path());
    assert_eq!(output.status.code(), Some(0));
    let found = json(&output);
    assert_eq!(keys(&found), ["compensators", "ok", "problems", "surfaces"]);
    let surface = &found["surfaces"]["damping_ratio"];
    assert_eq!(keys(surface), ["depth", "error", "operations", "range"]);
    for key in ["depth", "error", "operations"] {
        assert_eq!(keys(&surface[key]), ["f32", "f64"]);
    }
    // (32) as printed: smallest at high speed and low gear, -0.7559 by hand: 0.4079 - 0.804 - 0.3809 + 0.0519 - 0.0429 + 0.0121.
    let low = surface["range"][0].as_f64().unwrap();
    assert!(low <= -0.7559 && low > -0.7559 - 1e-9, "{low}");
    // The largest value is at the corner of low speed and high gear: 0.4079 + 0.804 + 0.3809 + 0.0519 - 0.0429 + 0.0121 = 1.6139.
    let high = surface["range"][1].as_f64().unwrap();
    assert!((1.6139..1.6139 + 1e-9).contains(&high), "{high}");
}

#[test]
fn check_fails_where_a_precision_cannot_hold_the_model() {
    let here = folder();
    let model = "format = 1\nmodel = \"m\"\n[inputs.a]\nunit = \"1\"\nrange = [1e6, 1000000.01]\n[surfaces.s]\nunit = \"1\"\ninputs = [\"a\"]\n\
                 terms = [{ powers = [1], coefficient = 1.0 }]\n";
    std::fs::write(here.path().join("m.toml"), model).unwrap();
    // If it is requested by name, this is a failure; otherwise it is omitted with a message.
    let output = rsm(&["check", "m.toml", "--precision", "f32", "--json"], here.path());
    assert_eq!((output.status.code(), &json(&output)["ok"]), (Some(1), &Value::Bool(false)));
    let output = rsm(&["check", "m.toml", "--json"], here.path());
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(keys(&json(&output)["surfaces"]["s"]["error"]), ["f64"]);
    assert!(
        text(&output.stderr).contains("m.toml:5:9: input `a`: f32 has fewer than two numbers in the range"),
        "{}",
        text(&output.stderr)
    );
}

#[test]
fn emit_writes_the_files_of_the_contract() {
    let here = folder();
    let model = published("pmac.toml");
    let output = rsm(&["emit", &model, "--lang", "c", "--out", "out"], here.path());
    assert_eq!(output.status.code(), Some(0));
    let out = here.path().join("out");
    assert_eq!(files_in(&out), [out.join("pmac.c"), out.join("pmac.h")]);
    let header = std::fs::read_to_string(out.join("pmac.h")).unwrap();
    assert!(header.contains("double pmac_current_advance(double torque, double speed);"), "{header}");
    assert!(header.contains("float pmac_current_advance_f32(float torque, float speed);"), "{header}");
    let output = rsm(&["emit", &model, "--lang", "rust", "--precision", "f32", "--out", "out", "--json"], here.path());
    assert_eq!(json(&output)["functions"], serde_json::json!(["current_advance_f32"]));
    let module = std::fs::read_to_string(out.join("pmac.rs")).unwrap();
    assert!(module.contains("pub fn current_advance_f32(torque: f32, speed: f32) -> f32 {") && !module.contains("f64"));
}

#[test]
fn bad_input_leaves_everything_as_it_was() {
    let here = folder();
    std::fs::create_dir(here.path().join("out")).unwrap();
    std::fs::write(here.path().join("out/m.h"), "old").unwrap();
    std::fs::write(here.path().join("m.toml"), "format = 1\nmodel = \"m\"\n[inputs.a]\nunit = \"1\"\nrange = [1.0, 0.0]\n")
        .unwrap();
    let output = rsm(&["emit", "m.toml", "--lang", "c", "--out", "out", "--json"], here.path());
    assert_eq!((output.status.code(), text(&output.stdout).as_str()), (Some(2), ""));
    let expected = "m.toml:1:1: `surfaces` is missing\nm.toml:5:9: input `a`: low 1 is above high 0\n  help: swap them, or give the range as [0, 1]\n";
    assert_eq!(text(&output.stderr), expected);
    assert_eq!(files_in(&here.path().join("out")).len(), 1);
    assert_eq!(std::fs::read_to_string(here.path().join("out/m.h")).unwrap(), "old");

    for bad in [
        &["eval", "missing.toml", "--at", "a=1"][..],
        &["eval", &published("pmac.toml"), "--at", "torque=1"],
        &["eval", &published("pmac.toml"), "--at", "torque=1,speed=two"],
        &["eval", &published("pmac.toml"), "--surface", "nothing", "--at", "torque=1,speed=2"],
        &["check", &published("pmac.toml"), "--precision", "fixed"],
        &["check", "-"],
        &["emit", &published("pmac.toml"), "--lang", "fmu", "--out", "out"],
        &["emit", &published("pmac.toml"), "--lang", "cobol", "--out", "out"],
        &["fit", "missing.toml"],
        &["nonsense"],
    ] {
        let output = rsm(bad, here.path());
        assert_eq!(output.status.code(), Some(2), "{bad:?}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{bad:?}");
    }
}

#[test]
fn fit_writes_a_model_that_every_other_command_reads() {
    let here = fit_folder(|specification| specification);
    let output = rsm(&["fit", "fit.toml", "--out", "model.toml", "--report", "report", "--json"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found = json(&output);
    assert_eq!(keys(&found), ["model", "responses"]);
    let response = &found["responses"]["i_d"];
    let expected = [
        "analysis",
        "canonical",
        "confidence_c",
        "cross_validation",
        "lack_of_fit",
        "press",
        "r2",
        "r2_adjusted",
        "r2_predicted",
        "residual_sd",
        "rows",
        "rows_used",
        "terms",
        "test",
        "validation",
        "warnings",
    ];
    assert_eq!(keys(response), expected);
    assert_eq!(keys(&response["terms"][0]), ["coefficient", "p", "powers", "standard_error", "t"]);
    assert_eq!(keys(&response["validation"]), ["confidence_c", "max_abs_error", "mean_abs_error", "rmse", "rows"]);
    assert_eq!(response["rows"], 64);
    // The sensor's noise is 0.12 A. The mean of its magnitude is 0.8 of that, so a surface whose error is more than twice as large lacks something.
    assert!(response["validation"]["mean_abs_error"].as_f64().unwrap() < 0.2);
    for command in [&["check", "model.toml"][..], &["emit", "model.toml", "--lang", "c", "--out", "out"]] {
        assert_eq!(rsm(command, here.path()).status.code(), Some(0));
    }
    let report = std::fs::read_to_string(here.path().join("report/report.html")).unwrap();
    assert!(report.contains("<svg") && report.contains("<td>torque^2</td>") && !report.contains("http://localhost"));
}

#[test]
fn a_confidence_that_is_not_reached_is_status_1_and_still_writes_the_best() {
    let here = fit_folder(|specification| specification.replace("99.98", "99.9999"));
    let output = rsm(&["fit", "fit.toml", "--out", "model.toml"], here.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("i_d: confidence 99.9999 % not reached, best 99.99"), "{}", text(&output.stdout));
    assert!(here.path().join("model.toml").exists());
}

#[test]
fn faults_of_specification_and_data_are_status_2() {
    let here = fit_folder(|specification| specification.replace("unit = \"N*m\"", "unit = \"kg\""));
    let output = rsm(&["fit", "fit.toml", "--out", "model.toml"], here.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("dyno.csv:2"), "{}", text(&output.stderr));
    assert!(!here.path().join("model.toml").exists());
}

#[test]
fn the_same_fit_gives_the_same_bytes() {
    let here = fit_folder(|specification| specification);
    for out in ["one.toml", "two.toml"] {
        rsm(&["fit", "fit.toml", "--out", out], here.path());
    }
    let read = |name: &str| std::fs::read(here.path().join(name)).unwrap();
    assert!(read("one.toml") == read("two.toml") && !read("one.toml").is_empty());
}

#[test]
fn simulate_writes_a_record_that_it_reads_again() {
    let here = folder();
    let plants = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants");
    let file = |name: &str| plants.join(name).canonicalize().unwrap().display().to_string();
    for plant in ["pmac", "driveline", "servo-axis"] {
        let (model, record) = (file(&format!("{plant}.toml")), file(&format!("{plant}.csv")));
        let output = rsm(&["simulate", &model, "--record", &record, "--out", "one.csv", "--json"], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(keys(&json(&output)), ["effects", "out", "outputs", "period", "plant", "rows"]);
        // The written record has the same inputs and the same start: its simulation gives the same file, byte for byte.
        let output = rsm(&["simulate", &model, "--record", "one.csv", "--out", "two.csv"], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let read = |name: &str| std::fs::read_to_string(here.path().join(name)).unwrap();
        assert_eq!(read("one.csv"), read("two.csv"), "{plant}");
        assert!(read("one.csv").lines().count() > 100);
    }
    // How it integrates is an option for every plant. A sixteenth of the period divides it, a third of a period and a bit does not.
    let (axis, record) = (file("servo-axis.toml"), file("servo-axis.csv"));
    let with = |more: &[&str]| {
        let arguments: Vec<&str> = ["simulate", axis.as_str(), "--record", record.as_str(), "--out", "three.csv", "--force"]
            .iter()
            .chain(more)
            .copied()
            .collect();
        rsm(&arguments, here.path())
    };
    for more in
        [&["--method", "explicit"][..], &["--method", "stiff"], &["--tolerance", "1e-10"], &["--fixed-step", "0.0000625"]]
    {
        let output = with(more);
        assert_eq!(output.status.code(), Some(0), "{more:?}: {}", text(&output.stderr));
    }
    for (more, expected) in [
        (&["--fixed-step", "0.00037"][..], "--fixed-step: found 0.00037 s"),
        (&["--tolerance", "1"], "--tolerance: found 1, expected 1e-14 to 0.1"),
        (&["--effects", "."], "a plant file of format 1, which has built-in effects only"),
    ] {
        let output = with(more);
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(expected), "{}", text(&output.stderr));
    }
    let output = rsm(&["simulate", &file("pmac.toml"), "--record", &file("driveline.csv"), "--out", "bad.csv"], here.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(!here.path().join("bad.csv").exists() && output.stdout.is_empty());
}

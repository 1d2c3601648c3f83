//! `rsm design` as programs outside the project call it, with the shipped specifications.

use std::path::Path;

use crate::calls::{folder, json, keys, rsm, text};

fn shipped(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("demo").join(name).display().to_string()
}

#[test]
fn the_shipped_plans_have_the_points_of_the_experiments() {
    let here = folder();
    for (name, points) in [
        ("motor/dyno-180.toml", 180),
        ("motor/dyno-90.toml", 90),
        ("driveline/tip-in.toml", 25),
        ("driveline/tip-in-unseen.toml", 20),
        ("driveline/tip-in-load.toml", 75),
    ] {
        let output = rsm(&["design", &shipped(name), "--out", "plan.csv", "--json"], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let found = json(&output);
        assert_eq!(
            keys(&found),
            ["blocks", "design", "factors", "fraction", "left_out", "out", "plan", "points", "runs", "seed"]
        );
        assert_eq!((&found["points"], &found["runs"]), (&points.into(), &points.into()), "{name}");
        // A header, and one line for each run.
        let csv = std::fs::read_to_string(here.path().join("plan.csv")).unwrap();
        assert_eq!(csv.lines().count(), points + 1);
    }
}

#[test]
fn the_points_that_where_removes_are_reported() {
    let here = folder();
    let written = |rest: &str| {
        let factor = |name: &str| format!("[factors.{name}]\nunit = \"1\"\nrange = [-1, 1]\n");
        let text = format!("format = 1\nplan = \"p\"\nseed = 1\ncentre_points = 2\n{rest}\n{}{}", factor("a"), factor("b"));
        std::fs::write(here.path().join("plan.toml"), text).unwrap();
    };
    let design = |options: &[&str]| rsm(&[&["design", "plan.toml", "--out", "plan.csv"], options].concat(), here.path());
    // The corner (1, 1) is omitted: 7 of 8 points. Calculated by hand in `plan/kept.rs`.
    written("design = \"central-composite\"\nalpha = \"rotatable\"\nwhere = [{ sum = { a = 1, b = 1 }, at_most = 1.5 }]");
    let found = json(&design(&["--json"]));
    let left_out = &found["left_out"];
    assert_eq!(keys(left_out), ["correlation", "correlation_of_whole", "of", "points", "was_rotatable"]);
    assert_eq!((&left_out["points"], &left_out["of"], &left_out["was_rotatable"]), (&1.into(), &8.into(), &true.into()));
    assert!((left_out["correlation"].as_f64().unwrap() - 1.0 / 6.0).abs() < 1e-14, "{left_out}");
    let output = design(&[]);
    let message = text(&output.stderr);
    assert!(message.contains("warning: `where` keeps only 7 of the 8 points of the central-composite design"), "{message}");
    // A `where` that removes no point is not reported.
    written("design = \"central-composite\"\nalpha = \"rotatable\"\nwhere = [{ sum = { a = 1, b = 1 }, at_most = 3 }]");
    assert!(json(&design(&["--json"]))["left_out"].is_null());
    assert!(!text(&design(&[]).stderr).contains("warning"));
    // Too few points for this design: b has only one value.
    written(
        "design = \"central-composite\"\nalpha = \"rotatable\"\nwhere = [{ sum = { a = 1, b = 10 }, at_most = 2 }, { sum = { b = -10 }, at_most = 1 }]",
    );
    let output = design(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("3 of the terms of second order that the complete design can estimate"),
        "{}",
        text(&output.stderr)
    );
}

#[test]
fn a_refused_design_leaves_the_plan_as_it_was() {
    let here = folder();
    std::fs::write(here.path().join("plan.csv"), "old").unwrap();
    std::fs::write(here.path().join("bad.toml"), "format = 1\nplan = \"p\"\n[factors.a]\nunit = \"1\"\nlevels = [0, 1]\n")
        .unwrap();
    let output = rsm(&["design", "bad.toml", "--out", "plan.csv"], here.path());
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(2), "bad.toml:1:1: `seed` is missing\n"));
    assert_eq!(std::fs::read_to_string(here.path().join("plan.csv")).unwrap(), "old");
}

#[test]
fn an_optimal_design_has_the_wanted_runs_and_adds_to_those_that_were_made() {
    let here = folder();
    let written = |rest: &str| {
        let factor = |name: &str, high: u32| format!("[factors.{name}]\nunit = \"1\"\nrange = [0, {high}]\n");
        let text =
            format!("format = 1\nplan = \"p\"\nseed = 1\ndesign = \"optimal\"\n{rest}\n{}{}", factor("a", 10), factor("b", 4));
        std::fs::write(here.path().join("plan.toml"), text).unwrap();
    };
    let design = |options: &[&str]| rsm(&[&["design", "plan.toml", "--out", "plan.csv"], options].concat(), here.path());
    let rows = || -> Vec<Vec<f64>> {
        let csv = std::fs::read_to_string(here.path().join("plan.csv")).unwrap();
        csv.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
    };
    // A half-space, blocks, and a mandatory point: 40 runs.
    written(
        "runs = 40\norder = 3\nblock_sizes = [24, 16]\nmandatory = [{ a = 3.5, b = 1.25 }]\nwhere = [{ sum = { a = 1, b = 1 }, at_most = 11 }]",
    );
    let found = json(&design(&["--json"]));
    assert_eq!((&found["runs"], &found["blocks"]), (&40.into(), &2.into()));
    let (found, again) = (rows(), {
        design(&[]);
        rows()
    });
    assert_eq!((found.len(), &found), (40, &again));
    assert!(found.iter().all(|row| row[2] + row[3] <= 11.0));
    assert_eq!(found.iter().filter(|row| row[1] == 2.0).count(), 16);
    assert!(found.iter().any(|row| row[2..] == [3.5, 1.25]));
    // First order with three corners done: the fourth corner is the best additional run, and it gets the next number.
    written("runs = 1\norder = 1");
    std::fs::write(here.path().join("done.csv"), "run[1],a[1],b[1],y[V]\n1,0,0,3\n2,10,0,4\n3,0,4,5\n").unwrap();
    let output = design(&["--augment", "done.csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(rows(), [[4.0, 10.0, 4.0]]);
    // Without them it is not possible, and the message gives the reason.
    let output = design(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("1 runs cannot estimate the 3 terms of the model: at least 3 runs are needed"));
    // The terms of a fit specification, and candidates from a table.
    std::fs::write(here.path().join("points.csv"), "a,b\n0,0\n10,0\n0,4\n10,4\n5,2\n").unwrap();
    std::fs::write(
        here.path().join("fit.toml"),
        "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n[inputs.a]\n[inputs.b]\n[responses.y]\ninputs = [\"b\", \"a\"]\nselect = { method = \"fixed\" }\nterms = [[0, 0], [0, 1], [1, 1]]\n",
    )
    .unwrap();
    written("runs = 7\ncriterion = \"I\"\nterms_of = { file = \"fit.toml\" }\ncandidates = \"points.csv\"");
    let output = design(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(rows().len(), 7);
    assert!(
        rows()
            .iter()
            .all(|row| [[0.0, 0.0], [10.0, 0.0], [0.0, 4.0], [10.0, 4.0], [5.0, 2.0]].iter().any(|it| row[1..] == *it))
    );
}

#[test]
fn a_fraction_reports_its_aliases_and_screening_and_sobol_have_their_runs() {
    let here = folder();
    let written = |rest: &str, factors: &[&str]| {
        let factors: String = factors.iter().map(|name| format!("[factors.{name}]\nunit = \"1\"\nrange = [-1, 1]\n")).collect();
        std::fs::write(here.path().join("plan.toml"), format!("format = 1\nplan = \"p\"\nseed = 1\n{rest}\n{factors}"))
            .unwrap();
    };
    let design = |options: &[&str]| rsm(&[&["design", "plan.toml", "--out", "plan.csv"], options].concat(), here.path());
    // The half fraction with d = abc: resolution 4, each pair of factors is aliased with the other pair.
    written("design = \"fractional-factorial\"\ngenerators = { d = \"a*b*c\" }", &["a", "b", "c", "d"]);
    let found = json(&design(&["--json"]));
    assert_eq!((&found["runs"], &found["fraction"]["resolution"]), (&8.into(), &4.into()));
    assert_eq!(found["fraction"]["words"], serde_json::json!(["a*b*c*d"]));
    assert_eq!(found["fraction"]["aliases"], serde_json::json!([["a*b", "c*d"], ["a*c", "b*d"], ["a*d", "b*c"]]));
    assert!(text(&design(&[]).stderr).contains("resolution 4; aliased effects:\n  a*b = c*d\n"));
    written("design = \"fractional-factorial\"\nruns = 12", &["a", "b", "c", "d", "e"]);
    let message = text(&design(&[]).stderr);
    assert!(
        message.contains("no fraction of the two-level factorial of 5 factors has 12 runs")
            && message.contains("8, 16, 32 runs"),
        "{message}"
    );
    written("design = \"definitive-screening\"", &["a", "b", "c", "d", "e", "f"]);
    assert_eq!(json(&design(&["--json"]))["runs"], 13);
    written("design = \"sobol\"\nruns = 40\nwhere = [{ sum = { a = 1, b = 1 }, at_most = 0 }]", &["a", "b"]);
    assert_eq!(json(&design(&["--json"]))["runs"], 40);
    written("design = \"latin-hypercube\"\ncriterion = \"maximin\"\nruns = 20", &["a", "b", "c"]);
    assert_eq!(json(&design(&["--json"]))["runs"], 20);
}

#[test]
fn a_design_is_evaluated_in_words_and_as_json() {
    let here = folder();
    let factor = |name: &str| format!("[factors.{name}]\nunit = \"1\"\nrange = [-1, 1]\n");
    let specification = format!(
        "format = 1\nplan = \"p\"\nseed = 1\ndesign = \"central-composite\"\nalpha = \"rotatable\"\ncentre_points = 5\n{}{}",
        factor("a"),
        factor("b")
    );
    std::fs::write(here.path().join("plan.toml"), specification).unwrap();
    let design = |options: &[&str]| rsm(&[&["design", "plan.toml"], options].concat(), here.path());
    let output = design(&["--evaluate"]);
    assert_eq!(output.status.code(), Some(0), "{}", text_of(&output));
    let printed = text(&output.stdout);
    for expected in [
        "p, central-composite: 13 runs of 9 points, 6 parameters\n",
        "7 of the residual, 3 of lack of fit, 4 of pure error\n",
        "leverage: mean 0.462, largest 0.625 of runs",
        "a^2      0.14375     1.017",
        "a: +1.50 a^3, +0.50 a*b^2\n",
    ] {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
    let found = json(&design(&["--evaluate", "--json"]));
    assert_eq!(
        keys(&found),
        [
            "aliases",
            "dependent",
            "design",
            "efficiency",
            "file",
            "freedom",
            "leverage",
            "parameters",
            "plan",
            "points",
            "prediction",
            "rank",
            "runs",
            "runs_outside",
            "terms",
            "terms_of_model"
        ]
    );
    assert_eq!(keys(&found["efficiency"]), ["a", "d", "g", "i"]);
    assert_eq!(keys(&found["prediction"]), ["at", "max", "mean", "quantiles", "sample"]);
    assert_eq!(keys(&found["terms"][1]), ["estimable", "power", "powers", "term", "variance", "vif"]);
    assert!((found["leverage"]["largest"].as_f64().unwrap() - 0.625).abs() < 1e-12);
    // The plan is written too, if a place is given; its file has the same numbers.
    assert!(!here.path().join("plan.csv").exists());
    let written = json(&design(&["--evaluate", "--json", "--out", "plan.csv"]));
    assert_eq!(written, found);
    let read = json(&design(&["--evaluate", "plan.csv", "--json"]));
    assert_eq!((&read["file"], &read["design"]), (&"plan.csv".into(), &serde_json::Value::Null));
    assert_eq!((&read["terms"], &read["leverage"]), (&found["terms"], &found["leverage"]));
}

#[test]
fn runs_that_determine_too_little_are_a_negative_answer_and_bad_ones_are_refused() {
    let here = folder();
    let factor = |name: &str| format!("[factors.{name}]\nunit = \"1\"\nlevels = [-1, 1]\n");
    let specification = format!("format = 1\nplan = \"p\"\nseed = 1\n{}{}", factor("a"), factor("b"));
    std::fs::write(here.path().join("plan.toml"), specification).unwrap();
    let design = |options: &[&str]| rsm(&[&["design", "plan.toml"], options].concat(), here.path());
    let output = design(&["--evaluate"]);
    let printed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        printed.contains("the runs determine 4 of 6 parameters") && printed.contains("    a^2 = 1\n    b^2 = 1\n"),
        "{printed}"
    );
    assert!(printed.contains("these terms cannot be estimated: 1, a^2, b^2\n"), "{printed}");
    std::fs::write(here.path().join("runs.csv"), "run[1],a[1],b[m]\n1,0,0\n").unwrap();
    let output = design(&["--evaluate", "runs.csv"]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0));
    assert!(text_of(&output).starts_with("runs.csv:1: column 3 `b`: "), "{}", text_of(&output));
    for options in
        [&["--evaluate", "runs.csv", "--out", "x.csv"][..], &["--evaluate", "runs.csv", "--augment", "runs.csv"], &[]]
    {
        let output = design(options);
        assert_eq!(output.status.code(), Some(2), "{options:?}");
        assert!(!here.path().join("x.csv").exists());
    }
}

fn text_of(output: &std::process::Output) -> String {
    text(&output.stderr)
}

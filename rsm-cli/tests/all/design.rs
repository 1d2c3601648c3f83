//! `rsm design` as programs outside the project call it, on the shipped specifications.

use std::path::Path;

use crate::command::{folder, json, keys, rsm, text};

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
        assert_eq!(keys(&found), ["design", "factors", "left_out", "out", "plan", "points", "runs", "seed"]);
        assert_eq!((&found["points"], &found["runs"]), (&points.into(), &points.into()), "{name}");
        // A header and a line a run.
        let csv = std::fs::read_to_string(here.path().join("plan.csv")).unwrap();
        assert_eq!(csv.lines().count(), points + 1);
    }
}

#[test]
fn what_where_takes_from_a_design_is_told() {
    let here = folder();
    let written = |rest: &str| {
        let factor = |name: &str| format!("[factors.{name}]\nunit = \"1\"\nrange = [-1, 1]\n");
        let text = format!("format = 1\nplan = \"p\"\nseed = 1\ncentre_points = 2\n{rest}\n{}{}", factor("a"), factor("b"));
        std::fs::write(here.path().join("plan.toml"), text).unwrap();
    };
    let design = |words: &[&str]| rsm(&[&["design", "plan.toml", "--out", "plan.csv"], words].concat(), here.path());
    // The corner (1, 1) falls away: 7 of 8 points. Worked by hand in `plan/kept.rs`.
    written("design = \"central-composite\"\nalpha = \"rotatable\"\nwhere = [{ sum = { a = 1, b = 1 }, at_most = 1.5 }]");
    let found = json(&design(&["--json"]));
    let told = &found["left_out"];
    assert_eq!(keys(told), ["correlation", "correlation_of_whole", "of", "points", "was_rotatable"]);
    assert_eq!((&told["points"], &told["of"], &told["was_rotatable"]), (&1.into(), &8.into(), &true.into()));
    assert!((told["correlation"].as_f64().unwrap() - 1.0 / 6.0).abs() < 1e-14, "{told}");
    let output = design(&[]);
    let words = text(&output.stderr);
    assert!(words.contains("warning: `where` leaves 7 of the 8 points of the central-composite design"), "{words}");
    // A `where` that takes nothing says nothing.
    written("design = \"central-composite\"\nalpha = \"rotatable\"\nwhere = [{ sum = { a = 1, b = 1 }, at_most = 3 }]");
    assert!(json(&design(&["--json"]))["left_out"].is_null());
    assert!(!text(&design(&[]).stderr).contains("warning"));
    // Too few for what the design is made for: b at one value.
    written(
        "design = \"central-composite\"\nalpha = \"rotatable\"\nwhere = [{ sum = { a = 1, b = 10 }, at_most = 2 }, { sum = { b = -10 }, at_most = 1 }]",
    );
    let output = design(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("too few: 3 of the terms of second order"), "{}", text(&output.stderr));
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

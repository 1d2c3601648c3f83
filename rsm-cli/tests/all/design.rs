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
        assert_eq!(keys(&found), ["design", "factors", "out", "plan", "points", "runs", "seed"]);
        assert_eq!((&found["points"], &found["runs"]), (&points.into(), &points.into()), "{name}");
        // A header and a line a run.
        let csv = std::fs::read_to_string(here.path().join("plan.csv")).unwrap();
        assert_eq!(csv.lines().count(), points + 1);
    }
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

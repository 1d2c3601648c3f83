//! The motor's chain as commands: plan, bench, fit. The shipped files are equal to their output. `RSM_BLESS=1` writes them.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn demo(name: &str) -> PathBuf {
    root().join("rsm-cli/demo/motor").join(name)
}

fn rsm(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rsm")).args(arguments).current_dir(root().join("rsm-cli/demo/motor")).output().unwrap()
}

fn done(arguments: &[&str]) -> Output {
    let output = rsm(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn scratch() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

const PLANT: &str = "../../../rsm-sim/plants/pmac.toml";

/// Tables agree in every cell to the last of the six written digits: the sine of another library may differ in its last bit.
fn same_table(found: &str, expected: &str) -> bool {
    let cells = |text: &str| -> Vec<String> { text.lines().flat_map(|line| line.split(',')).map(str::to_string).collect() };
    let (found, expected) = (cells(found), cells(expected));
    found.len() == expected.len()
        && found.iter().zip(&expected).all(|(found, expected)| match (found.parse::<f64>(), expected.parse::<f64>()) {
            (Ok(found), Ok(expected)) => (found - expected).abs() < 1.5e-6,
            _ => found == expected,
        })
}

#[test]
fn the_shipped_runs_are_what_the_bench_measures() {
    let folder = scratch();
    let path = |name: &str| folder.path().join(name).display().to_string();
    for (plan_file, name, seed, at_limit) in
        [("dyno-90.toml", "dyno.csv", "1", 65), ("dyno-unseen.toml", "dyno-unseen.csv", "2", 55)]
    {
        let plan = path(plan_file).replace(".toml", "-plan.csv");
        done(&["design", plan_file, "--out", &plan]);
        let out = path(name);
        let output = done(&["experiment", "pmac", "--plan", &plan, "--plant", PLANT, "--out", &out, "--seed", seed, "--json"]);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((json["runs"].as_u64(), json["at_limit"].as_u64()), (Some(90), Some(at_limit)));
        let made = std::fs::read_to_string(&out).unwrap();
        let shipped = demo(name);
        if std::env::var_os("RSM_BLESS").is_some() {
            std::fs::write(&shipped, &made).unwrap();
        }
        assert!(
            same_table(&made, &std::fs::read_to_string(shipped).unwrap()),
            "{name} is stale: run with RSM_BLESS=1 and read the diff"
        );
    }
}

#[test]
fn the_shipped_surfaces_are_what_the_fitter_makes_of_the_shipped_runs() {
    let folder = scratch();
    let out = folder.path().join("motor.toml").display().to_string();
    done(&["fit", "fit.toml", "--out", &out]);
    let made = std::fs::read_to_string(&out).unwrap();
    let shipped = root().join("generated/coefficients/motor.toml");
    if std::env::var_os("RSM_BLESS").is_some() {
        std::fs::write(&shipped, &made).unwrap();
    }
    assert!(made == std::fs::read_to_string(shipped).unwrap(), "motor.toml is stale: run with RSM_BLESS=1 and read the diff");
}

#[test]
fn what_the_bench_cannot_set_is_refused_with_its_line() {
    let folder = scratch();
    let (plan, out) = (folder.path().join("plan.csv"), folder.path().join("out.csv"));
    let (plan, out) = (plan.display().to_string(), out.display().to_string());
    let refused = |text: &str, plant: &str| {
        std::fs::write(&plan, text).unwrap();
        let output = rsm(&["experiment", "pmac", "--plan", &plan, "--plant", plant, "--out", &out]);
        assert_eq!(output.status.code(), Some(2));
        assert!(!Path::new(&out).exists());
        String::from_utf8(output.stderr).unwrap().replace(&plan, "plan.csv")
    };
    let found = refused("run[1],depth[%],advance[deg]\n1,10,0\n2,0,20\n3,110,180\n", PLANT);
    assert_eq!(
        found.trim(),
        "plan.csv:3: `depth`: found 0 %, expected more than 0 and at most 100 %\n\
         plan.csv:4: `depth`: found 110 %, expected more than 0 and at most 100 %\n\
         plan.csv:4: `advance`: found 180 deg, expected 0 to below 180 deg"
    );
    let found = refused("run[1],depth[%],angle[deg]\n1,10,0\n", PLANT);
    assert!(
        found.contains("the plan has no factor `advance`")
            && found.contains("found the factor `angle`, expected `depth` or `advance`"),
        "{found}"
    );
    let found = refused("run[1],depth[%],advance[deg]\n1,10,0\n", "../../../rsm-sim/plants/driveline.toml");
    assert!(found.contains("driveline.toml") && found.contains("found \"driveline\", expected \"pmac\""), "{found}");
    // Units are converted: half a revolution in rad is also beyond the last advance.
    let found = refused("run[1],depth[1],advance[rad]\n1,0.5,3.1416\n", PLANT);
    assert!(found.contains("`advance`: found 180.0004"), "{found}");
}

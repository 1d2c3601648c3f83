//! The shipped tip-in runs and the model that is fitted from them: what is checked in is what is made. `RSM_BLESS=1` makes all of it anew,
//! in a minute: the plan is driven, the compensator tuned in rounds, the surfaces fitted. Then `rsm experiment driveline` as a command.

use std::path::{Path, PathBuf};

use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_fit::fit::fit;
use rsm_fit::spec::Specification;
use rsm_lab::plant_file::PlantFile;
use rsm_lab::track::experiment::{csv, experiment};
use rsm_lab::track::figures::{LASH, Study, car, with_lash};
use rsm_lab::track::plan::TrackPlan;
use rsm_lab::track::rounds::{self, Poles, specification};
use serde_json::json as value;

use crate::command::{folder, json, published, rsm, text};

/// The seed of the shipped runs: any would do.
const SEED: u64 = 29;

const HEADER: &str = "# Damping of driveline shuffle for a car of 1560 kg with 3 degrees of lash: surfaces of 25 tip-in runs on the simulated track, and the\n\
                      # compensator that the rounds found. Made from rsm-cli/demo/driveline by the test `driveline` of rsm-cli, RSM_BLESS=1.\n";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("demo/driveline").join(name)
}

fn nominal() -> PlantFile {
    let path = root().join("rsm-lab/plants/driveline.toml");
    PlantFile::read(&Source::new("driveline.toml", std::fs::read_to_string(path).unwrap())).unwrap()
}

/// The model that the shipped specification and data give, as a file.
fn made() -> String {
    let outcome =
        fit(&Specification::read(&shipped("fit.toml")).unwrap(), &mut |_| {}).unwrap_or_else(|faults| panic!("{faults}"));
    // 1.1 times the rate of the lag of 0.1 s.
    let model = rounds::with_compensator(&outcome.model, 11.0);
    format!("{HEADER}{}", model_file::write(&model))
}

#[test]
fn the_shipped_model_is_what_the_shipped_runs_give() {
    let path = root().join("generated/coefficients/driveline.toml");
    let lash = with_lash(&nominal(), LASH).unwrap();
    if std::env::var_os("RSM_BLESS").is_some() {
        let here = folder();
        let study = Study { folder: here.path(), seed: SEED, threads: 2 };
        let car = car(&lash, &study, "tip-in", Poles::WITH_LASH).unwrap();
        let best = &car.tuned.rounds[car.tuned.best];
        let unseen_poles = vec![0.7; car.unseen.len()];
        std::fs::write(shipped("tip-in.csv"), rounds::data(&car.tuned.uncompensated, &best.pole_damping)).unwrap();
        std::fs::write(shipped("tip-in-unseen.csv"), rounds::data(&car.unseen, &unseen_poles)).unwrap();
        std::fs::write(shipped("plan.csv"), TrackPlan::experiment(SEED).csv()).unwrap();
        std::fs::write(
            shipped("fit.toml"),
            specification("tip-in.csv", Some("tip-in-unseen.csv"), Poles::WITH_LASH.damping_terms),
        )
        .unwrap();
        std::fs::write(&path, made()).unwrap();
    }
    let stale = "is stale: run with RSM_BLESS=1 and read the diff";
    assert!(std::fs::read_to_string(&path).unwrap() == made(), "generated/coefficients/driveline.toml {stale}");
    let text = std::fs::read_to_string(shipped("fit.toml")).unwrap();
    assert!(text == specification("tip-in.csv", Some("tip-in-unseen.csv"), Poles::WITH_LASH.damping_terms), "fit.toml {stale}");
    let plan = TrackPlan::experiment(SEED);
    assert!(std::fs::read_to_string(shipped("plan.csv")).unwrap() == plan.csv(), "plan.csv {stale}");
    // Two of the 25 runs, driven again: noise and numbers are those of the run alone.
    let some = TrackPlan { runs: plan.runs[..2].to_vec() };
    let measured: Vec<_> = experiment(&lash, &some, SEED, None, 2).unwrap().into_iter().map(|(it, _)| it).collect();
    let data = std::fs::read_to_string(shipped("tip-in.csv")).unwrap();
    for (made, kept) in csv(&measured, &[]).lines().zip(data.lines()) {
        assert!(kept.starts_with(made), "tip-in.csv {stale}\n{made}\n{kept}");
    }
}

const PLAN: &str = "run[1],gear[1],engine_speed[rpm]\n1,2,3000\n2,1,2000\n";

#[test]
fn an_experiment_gives_a_row_a_run_and_records_that_simulate_reads() {
    let here = folder();
    std::fs::write(here.path().join("plan.csv"), PLAN).unwrap();
    let plant = root().join("rsm-lab/plants/driveline.toml").canonicalize().unwrap().display().to_string();
    let run = |further: &[&str], out: &str| {
        let arguments = ["experiment", "driveline", "--plan", "plan.csv", "--plant", &plant, "--out", out, "--json"];
        let output = rsm(&[&arguments[..], further].concat(), here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        json(&output)
    };
    let bare = run(&["--records", "records"], "bare.csv");
    assert_eq!((&bare["runs"], &bare["flagged"], &bare["seed"]), (&value!(2), &value!([]), &value!(1)));
    let data = std::fs::read_to_string(here.path().join("bare.csv")).unwrap();
    assert_eq!(data.lines().count(), 3);
    assert!(data.starts_with("run[1],gear[1],ratio[1],load[kg],speed[m/s],"), "{data}");
    let output = rsm(&["simulate", &plant, "--record", "records/run-02.csv", "--out", "again.csv"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));

    let model = published("driveline.toml");
    let with = run(&["--compensator", &model], "with.csv");
    let named = run(&["--compensator", &format!("{model}:tip_in")], "named.csv");
    assert_eq!(with["damping_ratio_mean"], named["damping_ratio_mean"]);
    // 0.38 and 0.15 without it (second and first gear), 0.6 and more with it.
    let [before, after] = [&bare, &with].map(|it| it["damping_ratio_mean"].as_f64().unwrap());
    assert!(before < 0.35 && after > 0.5, "{before} {after}");
}

#[test]
fn bad_plans_and_compensators_are_refused_with_their_lines() {
    let here = folder();
    let write = |name: &str, text: &str| std::fs::write(here.path().join(name), text).unwrap();
    let driveline = root().join("rsm-lab/plants/driveline.toml").canonicalize().unwrap().display().to_string();
    let motor = root().join("rsm-lab/plants/pmac.toml").canonicalize().unwrap().display().to_string();
    let model = published("driveline.toml");
    let (absent, none) = (format!("{model}:nothing"), published("throttle.toml"));
    let bad = "run[1],gear[1],engine_speed[rpm],load[kg]\n1,6,3000,0\n2,2,-1,0\n3,2,3000,-5\n";
    let cases: [(&str, &str, &[&str], &[&str]); 6] = [
        (
            bad,
            &driveline,
            &[],
            &[
                "plan.csv:2: `gear`: found 6, expected 1, 2, 3, 4 or 5",
                "plan.csv:3: `engine_speed`: found -1 rpm",
                "plan.csv:4: `load`: found -5 kg",
            ],
        ),
        ("run[1],gear[1]\n1,2\n", &driveline, &[], &["`engine_speed`"]),
        ("run[1],gear[1],engine_speed[rpm],colour[1]\n1,2,3000,1\n", &driveline, &[], &["the track has no factor `colour`"]),
        (PLAN, &motor, &[], &["the track needs a plant of kind \"driveline\", found \"pmac\""]),
        (PLAN, &driveline, &["--compensator", &absent], &["there is no compensator `nothing`; it has tip_in"]),
        (PLAN, &driveline, &["--compensator", &none], &["has 0 compensators"]),
    ];
    for (plan, plant, further, says) in cases {
        write("plan.csv", plan);
        write("out.csv", "old");
        let arguments = ["experiment", "driveline", "--plan", "plan.csv", "--plant", plant, "--out", "out.csv"];
        let output = rsm(&[&arguments[..], further].concat(), here.path());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        for says in says {
            assert!(said.contains(says), "{said}\ndoes not say\n{says}");
        }
        assert_eq!(std::fs::read_to_string(here.path().join("out.csv")).unwrap(), "old");
    }
}

//! The shipped tip-in runs and the model fitted from them: the files in the repository are equal to the generated ones. `RSM_BLESS=1` generates all
//! of them again, in a minute: the plan is driven, the compensator is tuned in rounds, the surfaces are fitted. Then `rsm experiment driveline` as a
//! command.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_fit::fit::fit;
use rsm_fit::spec::Specification;
use rsm_rigs::track::experiment::{csv, experiment};
use rsm_rigs::track::figures::{LASH, Study, car, with_lash};
use rsm_rigs::track::gearbox::{self, Against, OTHER_RATIOS, with_ratios};
use rsm_rigs::track::plan::TrackPlan;
use rsm_rigs::track::rounds::{self, Poles, specification};
use rsm_sim::plant_file::PlantFile;
use serde_json::json as value;

use crate::calls::{folder, json, rsm, text};
use crate::shell::published;

/// The seed of the shipped runs. Any number is possible.
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
    let path = root().join("rsm-sim/plants/driveline.toml");
    PlantFile::read(&Source::new("driveline.toml", std::fs::read_to_string(path).unwrap())).unwrap()
}

/// The model from the shipped specification and data, as a file.
fn made() -> String {
    let outcome =
        fit(&Specification::read(&shipped("fit.toml")).unwrap(), &mut |_| {}).unwrap_or_else(|faults| panic!("{faults}"));
    // The rate is 1.1 times that of the lag of 0.1 s.
    let model = rounds::with_compensator(&outcome.model, 11.0);
    format!("{HEADER}{}", model_file::write(&model))
}

fn ratio() -> String {
    gearbox::specification(Against::Ratio, "tip-in.csv", Some("tip-in-unseen.csv"))
}

fn load() -> String {
    gearbox::specification(Against::RatioAndLoad, "tip-in-load.csv", Some("tip-in-load-unseen.csv"))
}

#[test]
fn the_shipped_model_is_what_the_shipped_runs_give() {
    let path = root().join("generated/coefficients/driveline.toml");
    let lash = with_lash(&nominal(), LASH).unwrap();
    if std::env::var_os("RSM_BLESS").is_some() {
        let study = Study { seed: SEED, threads: 2 };
        let car = car(&lash, &study, Poles::WITH_LASH).unwrap();
        let best = &car.tuned.rounds[car.tuned.best];
        std::fs::write(shipped("tip-in.csv"), rounds::data(&car.tuned.uncompensated, &best.pole_damping)).unwrap();
        std::fs::write(shipped("tip-in-unseen.csv"), rounds::unseen_data(&car.unseen)).unwrap();
        std::fs::write(shipped("plan.csv"), TrackPlan::experiment(SEED).csv()).unwrap();
        std::fs::write(
            shipped("fit.toml"),
            specification("tip-in.csv", Some("tip-in-unseen.csv"), Poles::WITH_LASH.damping_terms),
        )
        .unwrap();
        std::fs::write(&path, made()).unwrap();
        std::fs::write(shipped("ratio.toml"), ratio()).unwrap();
        std::fs::write(shipped("load.toml"), load()).unwrap();
    }
    let stale = "is stale: run with RSM_BLESS=1 and read the diff";
    assert!(std::fs::read_to_string(&path).unwrap() == made(), "generated/coefficients/driveline.toml {stale}");
    let text = std::fs::read_to_string(shipped("fit.toml")).unwrap();
    assert!(text == specification("tip-in.csv", Some("tip-in-unseen.csv"), Poles::WITH_LASH.damping_terms), "fit.toml {stale}");
    assert!(std::fs::read_to_string(shipped("ratio.toml")).unwrap() == ratio(), "ratio.toml {stale}");
    assert!(std::fs::read_to_string(shipped("load.toml")).unwrap() == load(), "load.toml {stale}");
    let plan = TrackPlan::experiment(SEED);
    assert!(std::fs::read_to_string(shipped("plan.csv")).unwrap() == plan.csv(), "plan.csv {stale}");
    // Two of the 25 runs, driven again: the noise and the numbers depend only on the run.
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
    let plant = root().join("rsm-sim/plants/driveline.toml").canonicalize().unwrap().display().to_string();
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
    // The damping ratio is 0.38 and 0.15 without it (second and first gear), 0.6 and more with it.
    let [before, after] = [&bare, &with].map(|it| it["damping_ratio_mean"].as_f64().unwrap());
    assert!(before < 0.35 && after > 0.5, "{before} {after}");
}

#[test]
fn bad_plans_and_compensators_are_refused_with_their_lines() {
    let here = folder();
    let write = |name: &str, text: &str| std::fs::write(here.path().join(name), text).unwrap();
    let driveline = root().join("rsm-sim/plants/driveline.toml").canonicalize().unwrap().display().to_string();
    let motor = root().join("rsm-sim/plants/pmac.toml").canonicalize().unwrap().display().to_string();
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
    for (plan, plant, further, expected) in cases {
        write("plan.csv", plan);
        write("out.csv", "old");
        let arguments = ["experiment", "driveline", "--plan", "plan.csv", "--plant", plant, "--out", "out.csv"];
        let output = rsm(&[&arguments[..], further].concat(), here.path());
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        for expected in expected {
            assert!(message.contains(expected), "{message}\ndoes not contain\n{expected}");
        }
        assert_eq!(std::fs::read_to_string(here.path().join("out.csv")).unwrap(), "old");
    }
}

/// A command that must succeed.
fn done(arguments: &[&str], folder: &Path) -> std::process::Output {
    let output = rsm(arguments, folder);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    output
}

/// The mean absolute residual of a response on unseen rows, divided by the mean of one of their columns, in percent.
fn percent(fit: &serde_json::Value, response: &str, unseen: &Path, column: &str) -> f64 {
    let data = std::fs::read_to_string(unseen).unwrap();
    let cells = |line: &str| line.split(',').map(str::to_string).collect::<Vec<_>>();
    let place = cells(data.lines().next().unwrap()).iter().position(|name| name.starts_with(column)).unwrap();
    let values: Vec<f64> = data.lines().skip(1).map(|line| cells(line)[place].parse().unwrap()).collect();
    let validation = &fit["responses"][response]["validation"];
    assert_eq!(validation["rows"].as_u64(), Some(values.len() as u64));
    100.0 * validation["mean_abs_error"].as_f64().unwrap() / (values.iter().sum::<f64>() / values.len() as f64)
}

/// A model passes `rsm check`, and the emitted files compile, including the support tests.
fn checked_and_compiled(model: &str, folder: &Path) {
    assert_eq!(json(&done(&["check", &format!("{model}.toml"), "--json"], folder))["ok"], value!(true));
    done(&["emit", &format!("{model}.toml"), "--lang", "c", "--out", "c"], folder);
    let header = std::fs::read_to_string(folder.join("c").join(format!("{model}.h"))).unwrap();
    assert!(header.contains(&format!("{model}_damping_ratio_support(")), "{header}");
    let compiler = std::process::Command::new("cc")
        .args(["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2", "-c", &format!("{model}.c"), "-o", "model.o"])
        .current_dir(folder.join("c"))
        .output()
        .unwrap();
    assert!(compiler.status.success(), "{}", text(&compiler.stderr));
}

#[test]
fn the_shipped_runs_predict_a_car_with_another_gearbox() {
    let here = folder();
    let path = |name: &str| here.path().join(name);
    for name in ["tip-in.csv", "tip-in-unseen.csv"] {
        std::fs::copy(shipped(name), path(name)).unwrap();
    }
    // The second car and its runs, as a user would create them. It is driven, but never fitted.
    let other = with_ratios(&with_lash(&nominal(), LASH).unwrap(), OTHER_RATIOS);
    std::fs::write(path("other.toml"), other.write()).unwrap();
    std::fs::write(path("plan.csv"), TrackPlan::unseen(SEED + 1).csv()).unwrap();
    let arguments =
        ["experiment", "driveline", "--plan", "plan.csv", "--plant", "other.toml", "--out", "other.csv", "--seed", "31"];
    done(&arguments, here.path());
    let residuals = |against: Against, unseen: &str, out: &str| {
        std::fs::write(path("fit.toml"), gearbox::specification(against, "tip-in.csv", Some(unseen))).unwrap();
        let fit = json(&done(&["fit", "fit.toml", "--out", out, "--json"], here.path()));
        assert_eq!(fit["responses"]["damping_ratio"]["constraints"]["active"], value!(false));
        let of = |response: &str, column: &str| percent(&fit, response, &path(unseen), column);
        [of("damping_ratio", "shuffle_damping["), of("shuffle_frequency", "shuffle_frequency[")]
    };
    let own = residuals(Against::Ratio, "tip-in-unseen.csv", "driveline_ratio.toml");
    let predicted = residuals(Against::Ratio, "other.csv", "driveline_ratio.toml");
    let guessed = residuals(Against::Gear, "other.csv", "driveline_gear.toml");
    // With 3 degrees of lash, errors of 2.4 % of the damping and 0.4 % of the frequency remain on both cars. The effect of the lash on the last run
    // alone (fifth gear, 4500 rpm) is a fifth of that. The numbers are for one seed; the limits are half as much again, for the last bits of another
    // library.
    for [damping, frequency] in [own, predicted] {
        assert!(damping < 3.6 && frequency < 0.7, "{own:?} {predicted:?}");
    }
    // A model over the gear number has an error of 8 % in the frequency, the same as the difference of the other car's ratios.
    assert!(guessed[1] > 5.0 * predicted[1] && guessed[0] > 1.5 * predicted[0], "{guessed:?} {predicted:?}");
    checked_and_compiled("driveline_ratio", here.path());
    let model = Checked::read(&Source::read(&path("driveline_ratio.toml")).unwrap()).unwrap();
    let support = rsm_core::lower::support(&model, 0, rsm_core::number::Precision::F64).unwrap();
    let mut support = rsm_core::run::Interpreter::<f64>::new(&support);
    // A ratio of 1.5 at 17.7 m/s is 3000 rpm; a ratio of 3.4 at 40 m/s would be 15,000 rpm, and one of 1 at 5 m/s 560 rpm.
    let inside = [[17.7, 1.5], [40.0, 3.4], [5.0, 1.0]].map(|point| support.eval(&point));
    assert_eq!(inside, [1.0, 0.0, 0.0]);
}

#[test]
fn the_load_is_a_third_factor_from_plan_to_c() {
    let here = folder();
    let plant = root().join("rsm-sim/plants/driveline.toml").canonicalize().unwrap().display().to_string();
    std::fs::copy(shipped("load.toml"), here.path().join("load.toml")).unwrap();
    for (name, seed, runs) in [("tip-in-load", "1", 75), ("tip-in-load-unseen", "2", 40)] {
        let design = shipped(&format!("{name}.toml")).display().to_string();
        done(&["design", &design, "--out", "plan.csv"], here.path());
        let out = format!("{name}.csv");
        let arguments =
            ["experiment", "driveline", "--plan", "plan.csv", "--plant", &plant, "--out", &out, "--seed", seed, "--json"];
        assert_eq!(json(&done(&arguments, here.path()))["runs"], value!(runs));
    }
    let fit = json(&done(&["fit", "load.toml", "--out", "driveline_load.toml", "--json"], here.path()));
    let unseen = here.path().join("tip-in-load-unseen.csv");
    let damping = percent(&fit, "damping_ratio", &unseen, "shuffle_damping[");
    let frequency = percent(&fit, "shuffle_frequency", &unseen, "shuffle_frequency[");
    // 1.5 % and 0.5 %: the noise of single runs; the limits are half as much again, for the last bits of another library.
    assert!(damping < 2.3 && frequency < 0.8, "{damping} {frequency}");
    let support = &fit["responses"]["damping_ratio"]["support"];
    assert_eq!(support["unseen_rows_outside"], value!(0));
    // Loads fill their range; speed and ratio are in a wedge, so less than the whole box is supported.
    assert!(support["share_of_box"].as_f64().unwrap() < 0.9, "{support}");
    checked_and_compiled("driveline_load", here.path());
}

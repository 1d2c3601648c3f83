//! The driveline's part of a refit: damping and frequency of the shuffle from the track, and the compensator that they schedule.
//!
//! The test is the damping ratio of the compensated response, whose target is 0.7, in the runs of the plan with other noise.

use rsm_core::check::Checked;
use rsm_core::model::Model;
use rsm_core::threads;
use rsm_rigs::refit::{gain, usable};
use rsm_rigs::track::experiment::experiment;
use rsm_rigs::track::plan::TrackPlan;
use rsm_rigs::track::rounds::{self, COMPENSATOR, Driven, Poles, Settings};
use rsm_rigs::track::run::Compensation;
use rsm_sim::plant_file::PlantFile;
use serde_json::{Value, json};

use super::{Refitted, Request};
use crate::outcome::Refusal;
use crate::{evaluators, output};

/// The seed of the noise and of the run order, as in the demo.
const SEED: u64 = 1;

/// The seed of the test's noise. No round uses it, because there are fewer than 1000 rounds.
const TEST_SEED: u64 = 3000;

/// Effects that are removed before the experiment: a surface cannot represent a drift.
const REMOVED_EFFECTS: [&str; 1] = ["sensor-drift"];

fn json_of(driven: &Driven) -> Value {
    json!({
        "mean": output::finite(driven.mean),
        "mean_residual": output::finite(driven.mean_residual),
        "largest_residual": output::finite(driven.largest_residual),
        "largest_overshoot": output::finite(driven.largest_overshoot),
    })
}

pub fn refit(request: &Request<'_>) -> Result<Refitted, Refusal> {
    with_plan(request, &TrackPlan::experiment(SEED))
}

fn with_plan(request: &Request<'_>, plan: &TrackPlan) -> Result<Refitted, Refusal> {
    let (nominal, _) = usable(request.nominal, &REMOVED_EFFECTS);
    let (extended, left_out) = usable(request.extended, &REMOVED_EFFECTS);
    let mut files = Vec::new();
    let mut models: Vec<Model> = Vec::new();
    for (name, plant) in [("nominal", &nominal), ("extended", &extended)] {
        (request.progress)(&format!("the {name} car on the track"));
        let settings = Settings { seed: SEED, poles: poles(plant), threads: threads::available() };
        let tuned = rounds::tune(plant, plan, &settings)?;
        if name == "extended" {
            let data = rounds::data(&tuned.uncompensated, &tuned.rounds[tuned.best].pole_damping);
            files.push((request.folder.join("tip-in.csv"), data));
            files.push((request.folder.join("plan.csv"), plan.csv()));
            files.push((
                request.folder.join("fit.toml"),
                rounds::specification("tip-in.csv", None, settings.poles.damping_terms),
            ));
            files.extend(evaluators::files(&Checked::from_model(tuned.model())?, request.folder)?.1);
        }
        models.push(tuned.model().clone());
    }
    (request.progress)("driving both compensators");
    let on = if request.truth.is_some() { "truth" } else { "extended plant" };
    let judge = request.truth.map_or_else(|| extended.clone(), |truth| usable(truth, &REMOVED_EFFECTS).0);
    let without = driven(&judge, plan, None)?;
    let before = driven(&judge, plan, Some(&models[0]))?;
    let after = driven(&judge, plan, Some(&models[1]))?;
    let mut words = vec![format!(
        "Damping ratio of the response on the {on}, {} runs, target 0.7: {:.3} (residual {:.3} mean, {:.3} largest) with the nominal compensator, {:.3} ({:.3}, {:.3}) with the refitted \
         one; {:.3} without any. Largest overshoot {:.1} % before, {:.1} % after.",
        plan.runs.len(),
        before.mean,
        before.mean_residual,
        before.largest_residual,
        after.mean,
        after.mean_residual,
        after.largest_residual,
        without.mean,
        100.0 * before.largest_overshoot,
        100.0 * after.largest_overshoot
    )];
    if !left_out.is_empty() {
        words.push(format!("Left out, because a surface cannot represent it: {}.", left_out.join(", ")));
    }
    let value = json!({
        "experiment": "track",
        "judged_on": on,
        "damping_ratio": {
            "target": 0.7,
            "runs": plan.runs.len(),
            "uncompensated": json_of(&without),
            "before": json_of(&before),
            "after": json_of(&after),
            "gain": output::finite(gain(before.mean_residual, after.mean_residual)),
        },
        "left_out": left_out,
        "model": format!("refit/{}.toml", models[1].name),
    });
    Ok(Refitted { files, value, words })
}

/// The required poles. With lash they are slower.
fn poles(plant: &PlantFile) -> Poles {
    let lash = plant.effects.iter().any(|entry| entry.description.kind == "backlash");
    if lash { Poles::WITH_LASH } else { Poles::WITHOUT_LASH }
}

/// The car along the plan, with the compensator of a model.
fn driven(plant: &PlantFile, plan: &TrackPlan, model: Option<&Model>) -> Result<Driven, Refusal> {
    let compensation = match model {
        Some(model) => Some(Compensation::new(&Checked::from_model(model)?, COMPENSATOR)?),
        None => None,
    };
    let runs = experiment(plant, plan, TEST_SEED, compensation.as_ref(), threads::available())?;
    Ok(Driven::of(&runs.into_iter().map(|(measured, _)| measured).collect::<Vec<_>>()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;

    fn plant(stiffness: f64, effects: &str) -> PlantFile {
        let text = include_str!("../../../../../rsm-sim/plants/driveline.toml")
            .replace("driveshaft_stiffness = 5000.0", &format!("driveshaft_stiffness = {stiffness}"))
            .replace("driveshaft_damping = 65.0", &format!("driveshaft_damping = {}", 0.013 * stiffness));
        PlantFile::read(&Source::new("driveline.toml", text + effects)).unwrap()
    }

    #[test]
    fn a_soft_driveshaft_is_damped_as_it_should_be_after_a_refit() {
        let nominal = plant(5000.0, "");
        let truth = plant(3500.0, "");
        let errors = "\n[[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"driveshaft_stiffness\", value = 3530.0 }\n\
                      \n[[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"driveshaft_damping\", value = 45.0 }\n";
        let extended = plant(5000.0, errors);
        let folder = tempfile::tempdir().unwrap();
        let request = Request {
            nominal: &nominal,
            extended: &extended,
            truth: Some(&truth),
            records: &[],
            folder: folder.path(),
            progress: &|_| {},
        };
        // Three speeds in each of five gears: fifteen runs for the eight terms of each surface.
        let plan = TrackPlan::full(&[1500.0, 3000.0, 4500.0], &[0.0], SEED);
        let found = with_plan(&request, &plan).unwrap();
        let of = |key: &str| found.value["damping_ratio"][key]["mean_residual"].as_f64().unwrap();
        // Zeros at 1.2 times the true frequency do not cancel the poles. A compensator that is fitted to fifteen runs of the true plant leaves 0.02
        // to 0.04; rounds of the same plan are as good.
        assert!(of("after") < 0.5 * of("before") && of("after") < 0.08, "{}", found.value);
        let names: Vec<String> =
            found.files.iter().map(|(path, _)| path.strip_prefix(folder.path()).unwrap().display().to_string()).collect();
        for name in ["tip-in.csv", "fit.toml", "plan.csv", "driveline.toml", "emitted/driveline.c", "emitted/driveline.rs"] {
            assert!(names.iter().any(|it| it == name), "{names:?}");
        }
    }
}

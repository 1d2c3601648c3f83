//! `rsm experiment`: the simulated bench, by a plan.
//!
//! In: a plan and a plant file. Out: a CSV of measured points, whole or absent. The simulation is rsm-lab's; here are files and words.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use rsm_core::source::{Collector, Faults, Source};
use rsm_fit::plan::Plan;
use rsm_lab::bench::{self, Bench, Setting};
use rsm_lab::plant_file::PlantFile;
use serde_json::json;

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(Subcommand)]
enum Experiment {
    /// The motor on a dynamometer: modulation depth and current advance at the voltage limit
    Pmac(Pmac),
}

#[derive(Args)]
struct Pmac {
    /// The plan: factors `depth` (share of the current limit) and `advance` (angle of the current vector)
    #[arg(long)]
    plan: PathBuf,
    /// The plant file
    #[arg(long)]
    plant: PathBuf,
    /// The CSV that is written
    #[arg(long)]
    out: PathBuf,
    /// The seed of the sensors' noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    match &arguments.experiment {
        Experiment::Pmac(arguments) => pmac(arguments),
    }
}

fn pmac(arguments: &Pmac) -> Outcome {
    let plant = PlantFile::read(&Source::read(&arguments.plant)?)?;
    let settings = settings(&Plan::read(&Source::read(&arguments.plan)?)?)?;
    let outcomes = Bench::default().run(&plant, &settings, arguments.seed).map_err(|faults| {
        // The simulation knows no file: its name is put in front.
        Refusal::new(format!("{}: {faults}", arguments.plant.display()))
    })?;
    let measured = outcomes.iter().filter(|outcome| matches!(outcome, bench::Outcome::AtLimit(_))).count();
    output::write_all(&[(arguments.out.clone(), bench::csv(&outcomes).as_bytes())])?;
    if arguments.json {
        output::json(&json!({
            "plant": plant.kind.name(),
            "runs": outcomes.len(),
            "at_limit": measured,
            "below_limit": outcomes.len() - measured,
            "seed": arguments.seed,
            "out": arguments.out.display().to_string(),
        }))?;
    } else {
        let runs = outcomes.len();
        eprintln!("{}: {runs} runs, {measured} of them at the voltage limit", arguments.out.display());
    }
    Ok(Answer::Positive)
}

/// The settings of a plan; what cannot be set on the bench is told row by row.
fn settings(plan: &Plan) -> Result<Vec<Setting>, Faults> {
    let mut faults = Collector::new();
    let mut of = |name: &str, unit: &str| plan.settings(name, unit).map_err(|fault| faults.push(fault)).unwrap_or_default();
    let (depths, advances) = (of("depth", "%"), of("advance", "deg"));
    for factor in plan.factors.iter().filter(|factor| !["depth", "advance"].contains(&factor.name.as_str())) {
        faults.push(plan.fault_of_header(format!("the bench has no factor `{}`: it sets `depth` and `advance`", factor.name)));
    }
    for (row, (depth, advance)) in depths.iter().zip(&advances).enumerate() {
        if !(*depth > 0.0 && *depth <= 100.0) {
            faults.push(plan.fault(row, format!("`depth`: found {depth} %, expected more than 0 and at most 100 %")));
        }
        if !(*advance >= 0.0 && *advance < 180.0) {
            faults.push(plan.fault(row, format!("`advance`: found {advance} deg, expected 0 to below 180 deg")));
        }
    }
    let runs = plan.runs.iter().zip(depths.iter().zip(&advances));
    faults.finish(Some(runs.map(|(run, (depth, advance))| Setting { run: *run, depth: *depth, advance: *advance }).collect()))
}

//! `rsm experiment`: runs a plan on the simulated bench or the simulated track.
//!
//! In: a plan and a plant file. Out: a CSV of measured points or runs, and records of the runs, complete or not written at all. rsm-rigs simulates;
//! this module reads and writes files and prints.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use indicatif::ProgressBar;
use rsm_core::check::Checked;
use rsm_core::source::{Collector, Faults, Source};
use rsm_core::threads;
use rsm_fit::plan::Plan;
use rsm_rigs::bench::{self, Bench, Setting};
use rsm_rigs::track::experiment::{self, FLAGGED_AT_MOST};
use rsm_rigs::track::measure::Measured;
use rsm_rigs::track::plan::TrackPlan;
use rsm_rigs::track::rounds;
use rsm_rigs::track::run::Compensation;
use rsm_sim::plant_file::PlantFile;
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
    /// Run a plan on the simulated motor dynamometer: the speed at the voltage limit for each modulation depth and current advance
    Pmac(Pmac),
    /// Run a plan on the simulated test track: tip-in runs, each reduced to delay, frequency and damping
    Driveline(Driveline),
}

#[derive(Args)]
struct Pmac {
    /// The plan: factors `depth` (share of the current limit) and `advance` (angle of the current vector)
    #[arg(long)]
    plan: PathBuf,
    /// The plant file
    #[arg(long)]
    plant: PathBuf,
    /// The CSV file to write
    #[arg(long)]
    out: PathBuf,
    /// The seed of the simulated sensor noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct Driveline {
    /// The plan: factors `gear`, `engine_speed` and, if it varies, `load`
    #[arg(long)]
    plan: PathBuf,
    /// The plant file
    #[arg(long)]
    plant: PathBuf,
    /// The CSV file to write, one row for each run
    #[arg(long)]
    out: PathBuf,
    /// The seed of the simulated sensor noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A folder for the records of all runs, in the format that `rsm simulate` reads
    #[arg(long)]
    records: Option<PathBuf>,
    /// Put a compensator between pedal and throttle: MODEL.toml, or MODEL.toml:NAME if the file has several
    #[arg(long, value_name = "MODEL.toml[:NAME]")]
    compensator: Option<String>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    match &arguments.experiment {
        Experiment::Pmac(arguments) => pmac(arguments),
        Experiment::Driveline(arguments) => driveline(arguments),
    }
}

fn pmac(arguments: &Pmac) -> Outcome {
    let plant = PlantFile::read(&Source::read(&arguments.plant)?)?;
    let settings = settings(&Plan::read(&Source::read(&arguments.plan)?)?)?;
    let outcomes = Bench::default().run(&plant, &settings, arguments.seed).map_err(|faults| {
        // The simulation does not have the file's name, so it is added here.
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
        stderr_line!("{}: {runs} runs, {measured} of them at the voltage limit", arguments.out.display());
    }
    Ok(Answer::Positive)
}

fn driveline(arguments: &Driveline) -> Outcome {
    let plant = PlantFile::read(&Source::read(&arguments.plant)?)?;
    let plan = TrackPlan::read(&Source::read(&arguments.plan)?)?;
    let compensation = arguments.compensator.as_deref().map(compensation).transpose()?;
    let bar = ProgressBar::new(plan.runs.len() as u64);
    let runs = experiment::experiment(&plant, &plan, arguments.seed, compensation.as_ref(), threads::available());
    bar.finish_and_clear();
    // The simulation does not have the file's name, so it is added here.
    let runs = runs.map_err(|faults| Refusal::new(format!("{}: {faults}", arguments.plant.display())))?;
    let measured: Vec<Measured> = runs.iter().map(|(measured, _)| measured.clone()).collect();
    let mut files = vec![(arguments.out.clone(), experiment::csv(&measured, &[]))];
    if let Some(folder) = &arguments.records {
        files.extend(runs.iter().map(|(it, trace)| (folder.join(format!("run-{:02}.csv", it.run.run)), trace.csv())));
    }
    output::write_all(&files)?;
    let flagged: Vec<&Measured> = measured.iter().filter(|it| !it.flags.is_empty()).collect();
    let too_many = flagged.len() as f64 > FLAGGED_AT_MOST * measured.len() as f64;
    if arguments.json {
        let (mean, largest) = rounds::zeta(&measured);
        let flags: Vec<_> = flagged.iter().map(|it| json!({ "run": it.run.run, "why": it.flags })).collect();
        output::json(&json!({
            "plant": plant.kind.name(),
            "runs": measured.len(),
            "flagged": flags,
            "damping_ratio_mean": output::finite(mean),
            "damping_ratio_largest_residual": output::finite(largest),
            "seed": arguments.seed,
            "out": arguments.out.display().to_string(),
        }))?;
    } else {
        stderr_line!("{}: {} runs, {} flagged", arguments.out.display(), measured.len(), flagged.len());
        for it in &flagged {
            stderr_line!("  run {}: {}", it.run.run, it.flags.join("; "));
        }
    }
    // At most 2 of 25 runs may be flagged: with more the data are not good enough for a surface.
    Ok(if too_many { Answer::Negative } else { Answer::Positive })
}

/// The compensator of `MODEL.toml` or `MODEL.toml:NAME`; without a name the only one.
fn compensation(what: &str) -> Result<Compensation, Refusal> {
    let (path, name) = match what.rsplit_once(':') {
        Some((path, name)) if !name.is_empty() && !path.is_empty() => (path, Some(name)),
        _ => (what, None),
    };
    let checked = Checked::read(&Source::read(Path::new(path))?)?;
    let compensators = &checked.model().compensators;
    let name = match (name, &compensators[..]) {
        (Some(name), _) => name,
        (None, [only]) => only.name.as_str(),
        (None, all) => {
            let found = all.len();
            return Err(Refusal::new(format!("--compensator: {path} has {found} compensators, name one with {path}:NAME")));
        }
    };
    Ok(Compensation::new(&checked, name)?)
}

/// The settings of a plan. Every row that cannot be set on the bench is a fault.
pub fn settings(plan: &Plan) -> Result<Vec<Setting>, Faults> {
    let mut faults = Collector::new();
    let mut of = |name: &str, unit: &str| plan.settings(name, unit).map_err(|fault| faults.push(fault)).unwrap_or_default();
    let (depths, advances) = (of("depth", "%"), of("advance", "deg"));
    for factor in plan.factors.iter().filter(|factor| !["depth", "advance"].contains(&factor.name.as_str())) {
        faults.push(plan.fault_of_header(format!("found the factor `{}`, expected `depth` or `advance`", factor.name)));
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

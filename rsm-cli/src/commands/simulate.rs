//! `rsm simulate`: a plant with its effects along a record.
//!
//! In: a plant file and a CSV. Out: a CSV of time, inputs and simulated outputs, whole or absent. Adds no noise.

use std::path::PathBuf;

use clap::Args;
use rsm_core::source::Source;
use rsm_sim::kind::Signal;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{self, Record};
use rsm_sim::simulate::{Outputs, Simulator, Stopped};
use serde_json::{Map, Value, json};

use super::equations;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The plant file
    plant: PathBuf,
    /// The record: it gives the inputs of every row, and the outputs of the first row as the start
    #[arg(long)]
    record: PathBuf,
    /// The CSV file to write
    #[arg(long)]
    out: PathBuf,
    /// The method: `explicit` (Taylor series), `stiff` (order 3 to 4, with the exact Jacobian) or `automatic`
    #[arg(long, value_parser = ["automatic", "explicit", "stiff"])]
    method: Option<String>,
    /// The error of a step, relative to the size of each state [default: 1e-8]
    #[arg(long)]
    tolerance: Option<f64>,
    /// Use classical Runge-Kutta steps of this length, in s; the record's period must be a whole multiple of it
    #[arg(long, conflicts_with_all = ["method", "tolerance"])]
    fixed_step: Option<f64>,
    /// For a plant of equations: a folder of further effects, one TOML file each
    #[arg(long, value_name = "DIR")]
    effects: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let source = Source::read(&arguments.plant)?;
    let options = equations::simulate::Options {
        method: arguments.method.as_deref(),
        tolerance: arguments.tolerance,
        fixed_step: arguments.fixed_step,
        effects: arguments.effects.as_deref(),
    };
    if equations::is_equations(&source) || arguments.plant.extension().is_some_and(|it| it.eq_ignore_ascii_case("mo")) {
        return equations::simulate::run(&arguments.plant, &arguments.record, &arguments.out, &options, arguments.json);
    }
    if options.effects.is_some() {
        return Err(equations::built_in_effects_only());
    }
    let plant = PlantFile::read(&source)?;
    let record = Record::read(&Source::read(&arguments.record)?, &plant)?;
    let setting = options.setting(record.period)?;
    let mut simulator = Simulator::new(&plant, &record)?.method(setting.method).tolerance(setting.tolerance);
    let outputs = simulator.run(&record).map_err(|stopped| match stopped {
        Stopped::Step(what) => Refusal::new(format!("--fixed-step: {what}")),
        stopped => Refusal::new(format!("{}: {stopped}", arguments.record.display())),
    })?;
    let text = csv(&plant, &record, &outputs);
    output::write_all(&[(arguments.out.clone(), text.as_bytes())])?;
    if arguments.json {
        let range = |values: &Vec<f64>| {
            let (low, high) = values
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(*value), high.max(*value)));
            json!([output::finite(low), output::finite(high)])
        };
        let each = outputs.signals.iter().zip(&outputs.values);
        let ranges: Map<String, Value> =
            each.map(|(it, values)| (it.name.to_string(), json!({ "unit": it.unit, "range": range(values) }))).collect();
        let effects: Vec<&str> = plant.effects.iter().map(|entry| entry.description.kind).collect();
        output::json(&json!({
            "plant": plant.kind.name(),
            "rows": record.rows(),
            "period": record.period,
            "effects": effects,
            "outputs": ranges,
            "out": arguments.out.display().to_string(),
        }))?;
    } else {
        stderr_line!("{}: {} rows of {}", arguments.out.display(), record.rows(), plant.kind.name());
    }
    Ok(Answer::Positive)
}

/// The table: time, the inputs that acted, the outputs.
fn csv(plant: &PlantFile, record: &Record, outputs: &Outputs) -> String {
    let given = record.given(plant.kind);
    let mut columns: Vec<(Signal, &[f64])> = given.iter().map(|(signal, values)| (*signal, &**values)).collect();
    columns.extend(outputs.signals.iter().zip(&outputs.values).map(|(signal, values)| (*signal, values.as_slice())));
    record::csv(&columns)
}

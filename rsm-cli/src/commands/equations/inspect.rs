//! `rsm inspect`: prints a plant's equations as the compiler reads them.
//!
//! In: a plant of equations. Out: its signals, states and parameters; for each set of equations the variables that it is solved for, and the method;
//! conditions; time constants at the start; sites of effects, and sites that units and equations suggest.

use std::path::PathBuf;

use clap::Args;
use rsm_model::system::Method;
use rsm_sim::configurations::Configuration;
use rsm_sim::equations::{EquationFile, linearise};
use serde_json::json;

use super::{plant, point, pole_lines, poles_json, room_lines, rooms_json};
use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The plant file (format 2), or a text of equations (.mo)
    plant: PathBuf,
    /// A folder of further effects, one TOML file each
    #[arg(long, value_name = "DIR")]
    effects: Option<PathBuf>,
    /// The configuration of a plant file with [configurations]
    #[arg(long, value_name = "NAME")]
    configuration: Option<String>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn words(method: Method) -> &'static str {
    match method {
        Method::Given => "given",
        Method::Turned => "solved for it",
        Method::Linear => "linear equations, by elimination",
        Method::Newton => "nonlinear equations, by Newton's method",
    }
}

/// The configurations of the plant file as JSON.
fn configurations_json(file: &EquationFile) -> serde_json::Value {
    let numbers = |list: &[(String, f64)]| -> serde_json::Map<String, serde_json::Value> {
        list.iter().map(|(name, value)| (name.clone(), json!(value))).collect()
    };
    let one = |it: &Configuration| json!({ "name": it.name, "records": it.records, "parameters": numbers(&it.parameters), "tolerance": numbers(&it.tolerance) });
    let all = &file.configurations;
    json!({ "differ": all.differ, "list": all.list.iter().map(one).collect::<Vec<_>>() })
}

/// The configurations of the plant file in words.
fn configuration_lines(file: &EquationFile) -> Vec<String> {
    let all = &file.configurations;
    let one = |it: &Configuration| {
        let values: Vec<String> = it.parameters.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let values = if values.is_empty() { "the common parameters".to_string() } else { values.join(", ") };
        format!("configuration {}: {values}; records {}", it.name, it.records.join(", "))
    };
    let mut lines: Vec<String> = all.list.iter().map(one).collect();
    if !all.differ.is_empty() {
        lines.push(format!("may differ between configurations: {}", all.differ.join(", ")));
    }
    lines
}

pub fn run(arguments: &Arguments) -> Outcome {
    let (file, mut machine) = plant(&arguments.plant, arguments.effects.as_deref(), arguments.configuration.as_deref())?;
    // Without a starting point there are no time constants; all other results remain valid.
    let start = point(&file, &mut machine, "");
    let poles = match &start {
        Ok(at) => linearise(&file, &machine, at)?.poles,
        Err(_) => Vec::new(),
    };
    let (rooms, proposals) = (file.rooms()?, file.proposals());
    let system = machine.system();
    let flat = system.flat();
    let parameters: Vec<(String, String, Option<f64>, Option<f64>)> = system
        .parameters()
        .into_iter()
        .map(|it| {
            let variable = flat.variable(it);
            let tolerance = file.tolerance.iter().find(|given| given.name == variable.name).map(|given| given.value);
            (variable.name.clone(), variable.unit.clone().unwrap_or_default(), system.parameter_value(it), tolerance)
        })
        .collect();
    let rates = system.rates();
    let states = machine.states();
    if arguments.json {
        let names =
            |list: &[(String, String)]| -> Vec<_> { list.iter().map(|it| json!({ "name": it.0, "unit": it.1 })).collect() };
        let states: Vec<_> = states
            .iter()
            .zip(&rates)
            .enumerate()
            .map(|(k, (it, rate))| {
                let value = start.as_ref().ok().map(|at| at.states[k]);
                json!({ "name": it.0, "unit": it.1, "rate": system.text(*rate), "start": value })
            })
            .collect();
        let blocks: Vec<_> = system
            .blocks()
            .iter()
            .map(|it| {
                let unknowns: Vec<&str> = it.unknowns.iter().map(|symbol| system.name(*symbol)).collect();
                json!({ "unknowns": unknowns, "lines": it.lines, "method": words(it.method) })
            })
            .collect();
        let switches: Vec<String> =
            system.switches().iter().map(|it| format!("{} < {}", system.text(it.left), system.text(it.right))).collect();
        let parameters: Vec<_> = parameters
            .iter()
            .map(|(name, unit, value, tolerance)| json!({ "name": name, "unit": unit, "value": value, "tolerance": tolerance }))
            .collect();
        let declared = file.sites.iter().map(|it| json!({ "name": it.name, "kind": it.kind.name(), "declared": true }));
        let proposed =
            proposals.iter().map(|it| json!({ "name": it.name, "kind": it.kind.name(), "declared": false, "toml": it.toml() }));
        let sites: Vec<_> = declared.chain(proposed).collect();
        output::json(&json!({
            "plant": flat.name, "inputs": names(&machine.inputs()), "outputs": names(&machine.outputs()),
            "states": states, "parameters": parameters, "equations": blocks, "conditions": switches, "poles": poles_json(&poles),
            "sites": sites, "effects": rooms_json(&rooms), "configurations": configurations_json(&file),
        }))?;
        return Ok(Answer::Positive);
    }
    // The listing already ends with a line break.
    output::line(system.to_string().trim_end())?;
    for (name, _, _, tolerance) in &parameters {
        if let Some(tolerance) = tolerance {
            output::line(&format!("{name} has a tolerance of {} %", 100.0 * tolerance))?;
        }
    }
    for line in configuration_lines(&file) {
        output::line(&line)?;
    }
    match start {
        Ok(_) => {
            output::line("at the start:")?;
            for line in pole_lines(&poles) {
                output::line(&format!("  {line}"))?;
            }
        }
        Err(refusal) => output::line(&format!("no start: {refusal}"))?,
    }
    output::line("where effects can stand:")?;
    for line in room_lines(&rooms) {
        output::line(&format!("  {line}"))?;
    }
    if !proposals.is_empty() {
        output::line("sites that units and equations suggest, for the plant file:")?;
        for proposal in &proposals {
            output::line(&format!("\n{}", proposal.toml().trim_end()))?;
        }
    }
    Ok(Answer::Positive)
}

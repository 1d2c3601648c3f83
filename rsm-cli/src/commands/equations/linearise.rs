//! `rsm linearise`: computes the linear model of a plant at a point.
//!
//! In: a plant of equations and a point. Out: the matrices as CSV and JSON, the poles with their damping.

use std::path::PathBuf;

use clap::Args;
use rsm_core::number::decimal;
use rsm_sim::equations::{Linearised, linearise};
use serde_json::json;

use super::{plant, point, pole_lines, poles_json, refuse_several, with_unit};
use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The plant file (format 2), or a text of equations (.mo)
    plant: PathBuf,
    /// The operating point: inputs, states or outputs, `speed=3,command=2`. Inputs that are not named are 0, states have their start values
    #[arg(long, default_value = "", allow_hyphen_values = true)]
    at: String,
    /// The CSV file of the matrices: a row for each derivative and each output, a column for each state and each input
    #[arg(long)]
    out: Option<PathBuf>,
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

/// `None` where a number is not finite, because JSON has no such number.
fn finite(matrix: &[Vec<f64>]) -> Vec<Vec<Option<f64>>> {
    matrix.iter().map(|row| row.iter().map(|it| output::finite(*it)).collect()).collect()
}

pub fn run(arguments: &Arguments) -> Outcome {
    let (file, mut machine) = plant(&arguments.plant, arguments.effects.as_deref(), arguments.configuration.as_deref())?;
    refuse_several(&arguments.plant, &file, "--configuration")?;
    let at = point(&file, &mut machine, &arguments.at)?;
    let found = linearise(&file, &machine, &at)?;
    let (states, inputs, outputs) = (machine.states(), machine.inputs(), machine.outputs());
    if let Some(out) = &arguments.out {
        let name = |it: &(String, String)| it.0.clone();
        let rows: Vec<String> = states.iter().map(|it| format!("der({})", it.0)).chain(outputs.iter().map(name)).collect();
        let columns: Vec<String> = states.iter().chain(&inputs).map(name).collect();
        output::write_all(&[(out.clone(), csv(&rows, &columns, &found).as_bytes())])?;
    }
    if arguments.json {
        let names =
            |list: &[(String, String)]| -> Vec<_> { list.iter().map(|it| json!({ "name": it.0, "unit": it.1 })).collect() };
        let values: Vec<_> =
            states.iter().zip(&at.states).map(|(it, value)| json!({ "state": it.0, "value": value })).collect();
        output::json(&json!({
            "plant": machine.system().flat().name,
            "states": names(&states), "inputs": names(&inputs), "outputs": names(&outputs),
            "at": values,
            "a": finite(&found.a), "b": finite(&found.b), "c": finite(&found.c), "d": finite(&found.d),
            "poles": poles_json(&found.poles),
        }))?;
        return Ok(Answer::Positive);
    }
    for (state, value) in states.iter().zip(&at.states) {
        stderr_line!("at {} = {}", with_unit(state), decimal(*value + 0.0));
    }
    if [&found.a, &found.b, &found.c, &found.d].iter().any(|it| it.iter().flatten().any(|it| !it.is_finite())) {
        stderr_line!(
            "a derivative is not finite at this point (a square root at 0, a division by 0): choose another with --at"
        );
    }
    for line in pole_lines(&found.poles) {
        stderr_line!("{line}");
    }
    if let Some(out) = &arguments.out {
        stderr_line!("{}: {} states, {} inputs, {} outputs", out.display(), states.len(), inputs.len(), outputs.len());
    }
    Ok(Answer::Positive)
}

fn csv(rows: &[String], columns: &[String], found: &Linearised) -> String {
    let mut text = format!("row,{}\n", columns.join(","));
    let (upper, lower) = (found.a.iter().zip(&found.b), found.c.iter().zip(&found.d));
    for (name, (left, right)) in rows.iter().zip(upper.chain(lower)) {
        let cells: Vec<String> = left.iter().chain(right).map(|it| decimal(*it)).collect();
        text += &format!("{name},{}\n", cells.join(","));
    }
    text
}

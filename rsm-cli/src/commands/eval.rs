//! `rsm eval`: evaluates a surface with the interpreter at a point or a table of points, or runs a compensator over a sequence, one step for each
//! row, from rest at 0.

use std::path::{Path, PathBuf};

use clap::Args;
use rsm_core::certificate::compensator::require_stable;
use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::lower;
use rsm_core::model::{Input, Model, Surface};
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::tape::Tape;
use rsm_fit::content::Content;
use rsm_fit::table::Wanted;
use serde_json::json;

use super::{PrecisionName, model_source, surface_index};
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The model file; - is standard input
    model: PathBuf,
    /// The surface to evaluate; optional if the model has only one
    #[arg(long)]
    surface: Option<String>,
    /// The compensator to run over a sequence. --data must have the column `input` and a column for each of its scheduling inputs
    #[arg(long, conflicts_with_all = ["surface", "at"])]
    compensator: Option<String>,
    /// Print the partial derivatives of the surface with respect to its inputs, each in the surface's unit per unit of the input
    #[arg(long, conflicts_with = "compensator")]
    gradient: bool,
    /// One point, in the units of the model: a=1,b=2
    #[arg(long, required_unless_present_any = ["data", "compensator"], conflicts_with = "data", allow_hyphen_values = true)]
    at: Option<String>,
    /// A file of points (for a compensator: a sequence) whose columns have the names of the inputs: CSV, or Parquet or Arrow as `rsm fit` reads them
    #[arg(long)]
    data: Option<PathBuf>,
    /// The precision of the evaluation
    #[arg(long, default_value = "f64")]
    precision: PrecisionName,
    /// Print the IEEE bits in hexadecimal
    #[arg(long)]
    bits: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// One row of results. It has one result, or one for each input for a gradient: the values as the precision prints them, as f64 for JSON, and their
/// bits in hexadecimal.
struct Evaluated {
    texts: Vec<String>,
    values: Vec<f64>,
    bits: Vec<String>,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let precision = arguments.precision.precision();
    let checked = Checked::read(&model_source(&arguments.model)?)?;
    compile::held(&checked, &[precision])?;
    if let Some(name) = &arguments.compensator {
        return sequence(arguments, &checked, name, precision);
    }
    let index = surface_index(&checked, arguments.surface.as_deref())?;
    let surface = &checked.model().surfaces[index];
    let (name, unit) = (&surface.name, &surface.unit);
    let mut object = json!({ "surface": name, "unit": unit, "precision": precision.name() });
    let (tape, results) = if arguments.gradient {
        object["gradient"] = json!(surface.inputs);
        let inputs = checked.inputs_of(surface);
        let each = inputs.iter().map(|input| with_unit(&format!("d_{name}_d_{}", input.name), &per(unit, &input.unit)));
        (lower::gradient(&checked, index, precision), each.collect::<Vec<_>>().join(","))
    } else {
        (lower::surface(&checked, index, precision), with_unit(name, unit))
    };
    match (&arguments.at, &arguments.data) {
        (Some(at), _) => print(arguments, None, &evaluate(&tape, &[point(at, surface, precision)?]), object),
        (None, Some(path)) => {
            let inputs = checked.inputs_of(surface);
            let points = table(path, None, (&inputs, checked.model()))?;
            let header = header(None, &inputs, &results);
            print(arguments, Some((&header, &points)), &evaluate(&tape, &points), object)
        }
        (None, None) => Err(Refusal::new("give a point with --at or a table with --data")),
    }
}

/// Runs a compensator over the rows of a table, in order.
fn sequence(arguments: &Arguments, checked: &Checked, name: &str, precision: Precision) -> Outcome {
    let compensators = &checked.model().compensators;
    let index = compensators.iter().position(|compensator| compensator.name == name).ok_or_else(|| {
        let known = compensators.iter().map(|compensator| compensator.name.as_str()).collect::<Vec<_>>().join(", ");
        let known = if known.is_empty() { "none".to_string() } else { known };
        Refusal::new(format!("--compensator: found {name}, the compensators of {} are {known}", checked.file()))
    })?;
    require_stable(checked, index)?;
    let path = arguments.data.as_ref().ok_or_else(|| Refusal::new("give the sequence of the compensator with --data"))?;
    let schedule = checked.schedule_of(&compensators[index]);
    let points = table(path, Some(lower::SIGNAL), (&schedule, checked.model()))?;
    let results = evaluate(&lower::compensator(checked, index, precision), &points);
    // Input and output of a compensator have the same unit.
    let header = header(Some(lower::SIGNAL), &schedule, name);
    print(arguments, Some((&header, &points)), &results, json!({ "compensator": name, "precision": precision.name() }))
}

/// The header of a table of points and results.
fn header(signal: Option<&str>, inputs: &[Input], result: &str) -> String {
    let inputs = inputs.iter().map(|input| with_unit(&input.name, &input.unit));
    signal.map(str::to_string).into_iter().chain(inputs).chain([result.to_string()]).collect::<Vec<_>>().join(",")
}

/// The unit of a derivative.
fn per(unit: &str, input: &str) -> String {
    format!("({unit})/({input})")
}

fn with_unit(name: &str, unit: &str) -> String {
    format!("{name}[{unit}]")
}

/// Prints the results: as CSV beside the points of a table; bits, or the result of one point, with one line for each; or as a JSON object.
fn print(
    arguments: &Arguments,
    table: Option<(&str, &[Vec<f64>])>,
    results: &[Evaluated],
    mut object: serde_json::Value,
) -> Outcome {
    if arguments.json {
        let rows = |each: &dyn Fn(&Evaluated) -> Vec<serde_json::Value>| -> serde_json::Value {
            // A number for a surface, a list for its gradient.
            let row = |result| {
                let mut values = each(result);
                if arguments.gradient { values.into() } else { values.swap_remove(0) }
            };
            results.iter().map(row).collect()
        };
        object["values"] = rows(&|result| result.values.iter().map(|value| output::finite(*value).into()).collect());
        object["bits"] = rows(&|result| result.bits.iter().map(|bits| bits.as_str().into()).collect());
        output::json(&object)?;
    } else {
        let lines: Vec<String> = match table {
            Some((header, points)) if !arguments.bits => {
                let row = |(point, result): (&Vec<f64>, &Evaluated)| {
                    point.iter().map(|value| format!("{value:?},")).chain([result.texts.join(",")]).collect::<String>()
                };
                [header.to_string()].into_iter().chain(points.iter().zip(results).map(row)).collect()
            }
            _ => results.iter().map(|it| if arguments.bits { it.bits.join(",") } else { it.texts.join(",") }).collect(),
        };
        output::line(&lines.join("\n"))?;
    }
    Ok(Answer::Positive)
}

/// a=1,b=2: every input once. An f32 number is read directly as f32, not through f64.
fn point(text: &str, surface: &Surface, precision: Precision) -> Result<Vec<f64>, Refusal> {
    let mut values: Vec<Option<f64>> = vec![None; surface.inputs.len()];
    for part in text.split(',') {
        let (name, number) =
            part.split_once('=').ok_or_else(|| Refusal::new(format!("--at: found `{part}`, expected name=number")))?;
        let (name, number) = (name.trim(), number.trim());
        let known = || surface.inputs.join(", ");
        let index = surface.inputs.iter().position(|input| input == name);
        let index = index
            .ok_or_else(|| Refusal::new(format!("--at: found `{name}`, the inputs of {} are {}", surface.name, known())))?;
        let value = match precision {
            Precision::F64 => number.parse::<f64>().ok(),
            Precision::F32 => number.parse::<f32>().ok().map(f64::from),
        };
        let value = value.ok_or_else(|| Refusal::new(format!("--at: {name}: found `{number}`, expected a number")))?;
        if values[index].replace(value).is_some() {
            return Err(Refusal::new(format!("--at: {name} is given twice")));
        }
    }
    let missing: Vec<&str> =
        surface.inputs.iter().zip(&values).filter(|(_, value)| value.is_none()).map(|(name, _)| name.as_str()).collect();
    if !missing.is_empty() {
        return Err(Refusal::new(format!("--at: {} is missing", missing.join(", "))));
    }
    Ok(values.into_iter().flatten().collect())
}

/// The points of a file, in the units of the model. The signal of a compensator comes first and keeps its unit.
fn table(path: &Path, signal: Option<&str>, (inputs, model): (&[Input], &Model)) -> Result<Vec<Vec<f64>>, Refusal> {
    let names = signal.into_iter().chain(inputs.iter().map(|input| input.name.as_str()));
    let categories = model.categories().into_iter().cloned().collect();
    let wanted = Wanted { numbers: names.map(str::to_string).collect(), categories, ..Wanted::default() };
    let table = Content::read(path)?.table(&wanted)?;
    let mut columns = Vec::new();
    columns.extend(signal.and_then(|name| table.column(name)).map(|column| column.values.clone()));
    for input in inputs {
        let (values, _) = table
            .values_in(&input.name, Some(&input.unit))
            .map_err(|fault| Refusal::from(rsm_core::source::Faults::one(fault)))?;
        columns.push(values);
    }
    Ok((0..table.rows()).map(|row| columns.iter().map(|column| column[row]).collect()).collect())
}

fn evaluate(tape: &Tape, points: &[Vec<f64>]) -> Vec<Evaluated> {
    match tape.precision {
        Precision::F64 => {
            let mut interpreter = Interpreter::<f64>::new(tape);
            let each = |point: &Vec<f64>| {
                interpreter.step(point);
                let values: Vec<f64> = interpreter.results().collect();
                let texts = values.iter().map(|value| format!("{value:?}")).collect();
                Evaluated { texts, bits: values.iter().map(|value| format!("{:016x}", value.to_bits())).collect(), values }
            };
            points.iter().map(each).collect()
        }
        Precision::F32 => {
            let mut interpreter = Interpreter::<f32>::new(tape);
            let each = |point: &Vec<f64>| {
                let arguments: Vec<f32> = point.iter().map(|value| *value as f32).collect();
                interpreter.step(&arguments);
                let values: Vec<f32> = interpreter.results().collect();
                Evaluated {
                    texts: values.iter().map(|value| format!("{value:?}")).collect(),
                    bits: values.iter().map(|value| format!("{:08x}", value.to_bits())).collect(),
                    values: values.into_iter().map(f64::from).collect(),
                }
            };
            points.iter().map(each).collect()
        }
    }
}

//! Plant files of format 2 and records, in the format of docs/book/src/reference/plants.md 4.
//!
//! In: a true or a nominal plant, records. Out: text. It writes no file.

use std::fmt::Write;

use super::{Cause, System, Truth};
use crate::plant::Record;

/// A plant file: the parameters of a plant, the sites of the example, and these effects. `start` gives true outputs at the start; without it the
/// first row of a record is used.
pub fn plant_file(truth: &Truth, noise: &[f64], start: Option<&[f64]>, effects: &[Cause]) -> String {
    let system = truth.system;
    let mut text = format!("format = 2\nmodel = \"{}.mo\"\n\n[parameters]\n", system.name);
    let mut table = |heading: &str, lines: &mut dyn Iterator<Item = (&str, f64)>| {
        if !heading.is_empty() {
            write!(text, "\n[{heading}]\n").expect("a string takes text");
        }
        // The format `{:?}` of an f64 is the shortest decimal that reads back to the same bits, and always a TOML float.
        lines.for_each(|(name, value)| writeln!(text, "{name} = {value:?}").expect("a string takes text"));
    };
    table("", &mut system.parameters.iter().zip(&truth.parameters).map(|(it, value)| (it.0, *value)));
    table("tolerance", &mut system.tolerance.iter().copied());
    let outputs = || system.outputs.iter().map(|it| it.name);
    table("noise", &mut outputs().zip(noise.iter().copied()).filter(|it| it.1 > 0.0));
    if let Some(start) = start {
        table("initial", &mut outputs().zip(start.iter().copied()));
    }
    text.push('\n');
    text.push_str(system.sites_text());
    for effect in effects {
        let numbers: Vec<String> = effect.numbers.iter().map(|(name, value)| format!("{name} = {value:?}")).collect();
        write!(
            text,
            "\n[[effects]]\nkind = \"{}\"\nat = \"{}\"\nparameters = {{ {} }}\n",
            effect.kind,
            effect.at,
            numbers.join(", ")
        )
        .expect("a string takes text");
    }
    text
}

/// A record as CSV. `digits` rounds the numbers to this number of significant digits. Outputs listed in `without` and rows in `left_out` are absent.
pub fn record(
    system: &System,
    record: &Record,
    digits: Option<usize>,
    without: &[String],
    left_out: &[std::ops::Range<usize>],
) -> String {
    let inputs = system.inputs.iter().map(|it| (it.name, it.unit)).zip(&record.inputs);
    let outputs = system.outputs.iter().map(|it| (it.name, it.unit)).zip(&record.outputs);
    let columns: Vec<_> = inputs.chain(outputs.filter(|((name, _), _)| without.iter().all(|it| it != name))).collect();
    let mut text = "time[s]".to_string();
    columns.iter().for_each(|((name, unit), _)| write!(text, ",{name}[{unit}]").expect("a string takes text"));
    text.push('\n');
    for row in (0..record.inputs[0].len()).filter(|row| !left_out.iter().any(|it| it.contains(row))) {
        // Division keeps the decimals short if the rate is an integer number of hertz.
        let period = record.period;
        let time = if period < 1.0 { row as f64 / (1.0 / period).round() } else { row as f64 * period };
        write!(text, "{time}").expect("a string takes text");
        for (_, column) in &columns {
            let value = column[row];
            let value = digits.map_or(value, |digits| short(value, digits));
            write!(text, ",{value}").expect("a string takes text");
        }
        text.push('\n');
    }
    text
}

/// A number rounded to this number of significant digits.
fn short(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().expect("a number that was just written")
}

/// The columns of the outputs in a CSV of `rsm simulate`.
pub fn outputs(system: &System, text: &str) -> Result<Vec<Vec<f64>>, String> {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header: Vec<&str> = lines.next().ok_or("the file is empty")?.split(',').collect();
    let place =
        |name: &str| header.iter().position(|it| it.split('[').next() == Some(name)).ok_or_else(|| format!("no column {name}"));
    let places = system.outputs.iter().map(|it| place(it.name)).collect::<Result<Vec<_>, _>>()?;
    let mut columns = vec![vec![]; places.len()];
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        for (column, place) in columns.iter_mut().zip(&places) {
            let cell = cells.get(*place).ok_or_else(|| format!("a short row: {line}"))?;
            column.push(cell.parse().map_err(|error| format!("{cell}: {error}"))?);
        }
    }
    Ok(columns)
}

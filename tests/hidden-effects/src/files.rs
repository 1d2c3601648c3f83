//! Plant files and records, in the format of docs/book/src/reference/plants.md 1.
//!
//! In: plants, effects and records. Out: text. It writes no file.

use std::fmt::Write;

use crate::plant::{Effect, Kind, Parameters, Record};

/// A plant file. `start` gives true start values of outputs; without it the first row of the record is used, including its noise.
pub fn plant_file(
    kind: Kind,
    parameters: &Parameters,
    tolerance: &[(&str, f64)],
    noise: &[f64],
    start: Option<&[f64]>,
    effects: &[Effect],
) -> String {
    let mut text = format!("format = 1\nplant = \"{}\"\n\n[parameters]\n", kind.name());
    let mut line = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    // The format `{:?}` of an f64 is the shortest decimal that reads back to the same bits, and always a TOML float.
    for (name, value) in &parameters.values {
        line(format!("{name} = {value:?}"));
    }
    if !parameters.gear_ratios.is_empty() {
        line(format!("gear_ratios = {:?}", parameters.gear_ratios));
    }
    if kind == Kind::ClosedAxis {
        let from = if parameters.velocity_from_difference { "difference" } else { "state" };
        line(format!("velocity_from = \"{from}\""));
    }
    if !tolerance.is_empty() {
        line("\n[tolerance]".to_string());
        tolerance.iter().for_each(|(name, value)| line(format!("{name} = {value:?}")));
    }
    let outputs = || kind.outputs().iter().map(|(name, _)| name);
    // A noise of 0 means that no noise is stated.
    line("\n[noise]".to_string());
    outputs().zip(noise).filter(|(_, sigma)| **sigma > 0.0).for_each(|(name, sigma)| line(format!("{name} = {sigma:?}")));
    if let Some(start) = start {
        line("\n[initial]".to_string());
        // A command follows from reference and position, so it has no separate start.
        outputs()
            .zip(start)
            .filter(|(name, _)| **name != "command")
            .for_each(|(name, value)| line(format!("{name} = {value:?}")));
    }
    for effect in effects {
        let which = effect.which.iter().map(|(key, name)| format!("{key} = \"{name}\""));
        let values = effect.values.iter().map(|(name, value)| format!("{name} = {value:?}"));
        let parameters = which.chain(values).collect::<Vec<_>>().join(", ");
        line(format!("\n[[effects]]\nkind = \"{}\"\nparameters = {{ {parameters} }}", effect.kind));
    }
    text
}

/// A record as CSV. Rows listed in `left_out` and outputs listed in `without` are absent.
pub fn record(kind: Kind, record: &Record, left_out: &[std::ops::Range<usize>], without: &[String]) -> String {
    let signals: Vec<_> = kind.inputs().iter().chain(kind.outputs()).collect();
    // The command of an axis is an output in closed loop and an input in open loop. Without an input there is no record.
    let inputs = kind.inputs().len();
    let is_kept = |(place, (name, _)): (usize, &&(&str, &str))| place < inputs || without.iter().all(|out| out != name);
    let kept: Vec<bool> = signals.iter().enumerate().map(is_kept).collect();
    let mut text = "time[s]".to_string();
    signals
        .iter()
        .zip(&kept)
        .filter(|(_, kept)| **kept)
        .for_each(|((name, unit), _)| write!(text, ",{name}[{unit}]").expect("a string takes text"));
    text.push('\n');
    let columns = record.inputs.iter().chain(&record.outputs).zip(&kept).filter(|(_, kept)| **kept);
    let columns: Vec<&Vec<f64>> = columns.map(|(column, _)| column).collect();
    for row in (0..columns[0].len()).filter(|row| !left_out.iter().any(|lost| lost.contains(row))) {
        // Division keeps the decimals short if the rate is an integer number of hertz.
        write!(text, "{}", row as f64 / (1.0 / record.period).round()).expect("a string takes text");
        columns.iter().for_each(|column| write!(text, ",{}", column[row]).expect("a string takes text"));
        text.push('\n');
    }
    text
}

/// The columns of these outputs in a CSV of `rsm simulate`.
pub fn outputs(kind: Kind, text: &str) -> Result<Vec<Vec<f64>>, String> {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header: Vec<&str> = lines.next().ok_or("the file is empty")?.split(',').collect();
    let place = |name: &str| {
        let found = header.iter().position(|column| column.split('[').next() == Some(name));
        found.ok_or_else(|| format!("no column {name} in {header:?}"))
    };
    let places = kind.outputs().iter().map(|(name, _)| place(name)).collect::<Result<Vec<_>, _>>()?;
    let mut columns = vec![vec![]; places.len()];
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        for (column, place) in columns.iter_mut().zip(&places) {
            let cell = cells.get(*place).ok_or_else(|| format!("a short row: {line}"))?;
            column.push(cell.parse::<f64>().map_err(|error| format!("{cell}: {error}"))?);
        }
    }
    Ok(columns)
}

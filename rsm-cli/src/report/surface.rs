//! Plots of a fitted surface: static pictures, and the numbers from which the page's script rotates the surface and draws slices.
//!
//! In: a model, one of its surfaces, the rows. Out: a figure. Values come from the tape, so a page shows the values that an evaluator returns.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::{Input, Surface};
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::tape::{Op, Tape};
use rsm_fit::constrain::ConstraintStatistics;
use rsm_fit::fit::Outcome;
use rsm_fit::records::Records;
use serde_json::{Value, json};

use crate::outcome::Refusal;
use crate::page::number;
use crate::plot::{self, BLACK, BLUE, GREY, Mark, ORANGE, PINK, Series, Words};

/// The largest number of rows of one kind in a plot. From more rows, a regular selection is drawn.
const MOST_ROWS: usize = 2000;

/// Points of a slice in a static picture.
const CUT: usize = 200;

/// One response of a fit, for the figure.
pub struct Shown<'a> {
    pub outcome: &'a Outcome,
    pub checked: &'a Checked,
    /// The index of its surface in the model.
    pub surface: usize,
    /// Its index among the responses of the rows.
    pub response: usize,
    pub constraints: Option<&'a ConstraintStatistics>,
    /// The error estimate, and the rows on which it is computed.
    pub error: Option<(f64, String)>,
}

/// The figure.
pub fn figure(shown: &Shown<'_>) -> Result<String, Refusal> {
    let surface = &shown.outcome.model.surfaces[shown.surface];
    let inputs = shown.checked.inputs_of(surface);
    let tape = lower::surface(shown.checked, shown.surface, Precision::F64);
    let support = lower::support(shown.checked, shown.surface, Precision::F64);
    let mut interpreter = Interpreter::<f64>::new(&tape);
    let mut supported = support.as_ref().map(Interpreter::<f64>::new);
    let mut value = |point: &[f64]| {
        let inside = supported.as_mut().is_none_or(|supported| supported.eval(point) == 1.0);
        inside.then(|| interpreter.eval(point))
    };
    let (pictures, series) = match inputs.as_slice() {
        [one] => line(shown, surface, one, &mut value)?,
        [first, second] => plane(shown, surface, first, second, &mut value)?,
        _ => cuts(surface, &inputs, &mut value)?,
    };
    let sets: Vec<(&str, Vec<Vec<f64>>)> = sets(shown, &inputs);
    let error = shown.error.as_ref();
    let mut all = sets.iter().flat_map(|(_, rows)| rows).filter_map(|row| row.last().copied()).filter(|y| y.is_finite());
    let first = all.next().unwrap_or(0.0);
    let (low, high) = all.fold((first, first), |(low, high), y| (low.min(y), high.max(y)));
    let margin = if high > low { 0.08 * (high - low) } else { 1.0 };
    let marks = [(PINK, Mark::Circle), (ORANGE, Mark::Cross), (BLACK, Mark::Cross)];
    let spec = json!({
        "kind": "explorer", "name": surface.name, "title": titled(&surface.name, &surface.unit),
        "unit": if surface.unit == "1" { "" } else { surface.unit.as_str() },
        "decimals": number::decimals(error.map_or(0.0, |(error, _)| *error), high.abs().max(low.abs())),
        "known": error.map_or(String::new(), |(error, words)| format!("± {} {words}", number::with_unit(&number::short(*error), &surface.unit))),
        "span": [low - margin, high + margin],
        "inputs": inputs.iter().map(|input| json!({
            "name": input.name, "unit": if input.unit == "1" { "" } else { input.unit.as_str() },
            "title": titled(&input.name, &input.unit), "range": input.range,
        })).collect::<Vec<Value>>(),
        "tape": operations(&tape),
        "support": support.as_ref().map(operations),
        "sets": sets.iter().zip(marks).map(|((name, rows), (colour, mark))| plot::set(name, colour, mark, rows)).collect::<Vec<Value>>(),
    });
    Ok(plot::explorer(&pictures, &series, &spec))
}

fn titled(name: &str, unit: &str) -> String {
    if unit == "1" || unit.is_empty() { name.to_string() } else { format!("{name} [{unit}]") }
}

/// The operations of a tape for the page's script, which executes them in their order.
fn operations(tape: &Tape) -> Value {
    let tables = tape.tables();
    let one = |op: &Op| match op {
        Op::Constant(constant) => json!(["constant", constant.value]),
        Op::Input(port) => json!(["input", port.0]),
        // A surface has no state.
        Op::State(_) => json!(["state"]),
        Op::Negate(a) => json!(["negate", a.0]),
        Op::Absolute(a) => json!(["absolute", a.0]),
        // Only elementary functions have these operations, and no surface has an elementary function.
        Op::Exponent(_) | Op::PowerOfTwo(_) => json!(["state"]),
        Op::Nearest(a) => json!(["nearest", a.0]),
        Op::Load { table, index, offset } => {
            let place = tables.iter().position(|it| *it == table).expect("it is one of the tape's tables");
            json!(["load", place, index.0, offset])
        }
        Op::Add(a, b) => json!(["add", a.0, b.0]),
        Op::Subtract(a, b) => json!(["subtract", a.0, b.0]),
        Op::Multiply(a, b) => json!(["multiply", a.0, b.0]),
        Op::Divide(a, b) => json!(["divide", a.0, b.0]),
        Op::Less(a, b) => json!(["less", a.0, b.0]),
        Op::Select { condition, then, otherwise } => json!(["select", condition.0, then.0, otherwise.0]),
    };
    json!({
        "ops": tape.ops.iter().map(one).collect::<Vec<Value>>(), "output": tape.output().0,
        "tables": tables.iter().map(|table| table.entries.iter().map(|it| it.value).collect::<Vec<f64>>()).collect::<Vec<_>>(),
        "single": tape.precision == Precision::F32,
    })
}

/// Indices of the surface's inputs among the columns of the rows.
fn columns(shown: &Shown<'_>, inputs: &[Input]) -> Vec<usize> {
    let place = |input: &Input| {
        shown.outcome.model.inputs.iter().position(|other| other.name == input.name).expect("a surface's input is in the model")
    };
    inputs.iter().map(place).collect()
}

/// Rows as lists of the inputs' values and the measured response, grouped by their use.
fn sets(shown: &Shown<'_>, inputs: &[Input]) -> Vec<(&'static str, Vec<Vec<f64>>)> {
    let columns = columns(shown, inputs);
    let rows = |records: &Records| -> Vec<Vec<f64>> {
        let complete = records.complete(&columns, shown.response);
        let step = complete.len().div_ceil(MOST_ROWS).max(1);
        let row = |row: &usize| {
            let mut values: Vec<f64> = columns.iter().map(|column| records.inputs[*column][*row]).collect();
            values.push(records.responses[shown.response][*row]);
            values
        };
        complete.iter().step_by(step).map(row).collect()
    };
    let outcome = shown.outcome;
    let mut sets = vec![("fitted rows", rows(&outcome.fitted))];
    let apart = [("validation rows", &outcome.validation), ("test rows", &outcome.test)];
    sets.extend(apart.into_iter().filter_map(|(name, records)| Some((name, rows(records.as_ref()?)))));
    sets
}

/// Computes the value at a point; `None` where the data do not support it.
type Valued<'a> = &'a mut dyn FnMut(&[f64]) -> Option<f64>;

/// A surface of one input: a curve with the rows.
fn line(shown: &Shown<'_>, surface: &Surface, input: &Input, value: Valued<'_>) -> Result<(String, Vec<Series>), Refusal> {
    let curve = cut(input, &mut |x| value(&[x]));
    let mut series = vec![Series::new("surface", BLUE, Mark::Line, curve)];
    let marks = [(BLUE, Mark::Circle), (ORANGE, Mark::Cross), (BLACK, Mark::Cross)];
    for ((name, rows), (colour, mark)) in sets(shown, std::slice::from_ref(input)).into_iter().zip(marks) {
        series.push(Series::new(name, colour, mark, rows.iter().map(|row| (row[0], row[1])).collect()));
    }
    let (x, y) = (titled(&input.name, &input.unit), titled(&surface.name, &surface.unit));
    Ok((plot::still::curves(&Words { title: &surface.name, x: &x, y: &y }, &series)?, series))
}

fn cut(input: &Input, value: &mut dyn FnMut(f64) -> Option<f64>) -> Vec<(f64, f64)> {
    let [low, high] = input.range;
    let at = (0..=CUT).map(|k| low + (high - low) * k as f64 / CUT as f64);
    at.filter_map(|x| Some((x, value(x)?))).collect()
}

/// A surface of two inputs over its box, blank where the data do not support it.
fn plane(
    shown: &Shown<'_>,
    surface: &Surface,
    first: &Input,
    second: &Input,
    value: Valued<'_>,
) -> Result<(String, Vec<Series>), Refusal> {
    let columns = columns(shown, &[first.clone(), second.clone()]);
    let points = |records: &Records| {
        let [x, y] = [columns[0], columns[1]].map(|column| &records.inputs[column]);
        let complete = records.complete(&columns, shown.response);
        super::condensed(complete.iter().map(|row| (x[*row], y[*row])).collect::<Vec<_>>())
    };
    let outcome = shown.outcome;
    let mut series = vec![Series::new("fitted rows", PINK, Mark::Circle, points(&outcome.fitted))];
    let apart = [("validation rows", ORANGE, &outcome.validation), ("test rows", GREY, &outcome.test)];
    series.extend(
        apart
            .into_iter()
            .filter_map(|(name, colour, records)| Some(Series::new(name, colour, Mark::Cross, points(records.as_ref()?)))),
    );
    if let Some(statistics) = shown.constraints {
        let active = statistics.constraints.iter().flat_map(|report| &report.points).map(|point| (point.0[0].1, point.0[1].1));
        let active: Vec<(f64, f64)> = active.collect();
        series.extend((!active.is_empty()).then(|| Series::new("held by a constraint", BLACK, Mark::Cross, active)));
    }
    let axis = |input: &Input| format!("{} [{}]", input.name, input.unit);
    let (x, y) = (axis(first), axis(second));
    let words = Words { title: &surface.name, x: &x, y: &y };
    let pair = |[low, high]: [f64; 2]| (low, high);
    let map = plot::Map::new(pair(first.range), pair(second.range), &mut |x, y| value(&[x, y]));
    Ok((plot::still::map(&words, &surface.unit, &map, &series)?, series))
}

/// A surface of more inputs: a slice along each input through the middle of the box.
fn cuts(surface: &Surface, inputs: &[Input], value: Valued<'_>) -> Result<(String, Vec<Series>), Refusal> {
    let middle: Vec<f64> = inputs.iter().map(|input| 0.5 * (input.range[0] + input.range[1])).collect();
    let y = titled(&surface.name, &surface.unit);
    let mut pictures = String::new();
    for (k, input) in inputs.iter().enumerate() {
        let mut point = middle.clone();
        let curve = cut(input, &mut |x| {
            point[k] = x;
            value(&point)
        });
        let x = titled(&input.name, &input.unit);
        let title = format!("{} along {}, the others in the middle", surface.name, input.name);
        let series = [Series::new("", BLUE, Mark::Line, curve)];
        pictures += &plot::still::curves(&Words { title: &title, x: &x, y: &y }, &series)?;
    }
    Ok((pictures, Vec::new()))
}

//! Reports: one self-contained HTML file, plots as SVG inside.
//!
//! In: what a fit found. Out: text. Predictions come from the interpreter, so a report shows what an evaluator will return.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::constrain::ConstraintStatistics;
use rsm_fit::design;
use rsm_fit::fit::{ChosenBy, Outcome, ResponseOutcome};
use rsm_fit::records::Records;
use rsm_fit::statistics::{Named, ResponseStatistics, ValidationStatistics};

use crate::commands::fit::verdict_in_words;

use crate::outcome::Refusal;
use crate::page::{escaped, figure, page};
use crate::plot::{self, BLACK, BLUE, GREY, Mark, ORANGE, PINK, Series, Words};

/// The report of a fit.
pub fn fit(outcome: &Outcome) -> Result<String, Refusal> {
    let mut body = format!("<h1>Model <code>{}</code></h1>\n<p>Data: ", escaped(&outcome.model.name));
    let files: Vec<String> = outcome
        .files
        .iter()
        .map(|file| format!("{} ({} rows, SHA-256 <code>{}</code>)", escaped(&file.name), file.rows, &file.sha256[..16]))
        .collect();
    body += &format!("{}</p>\n", files.join("; "));
    // Where no response could be fitted there is no surface, and no model to check.
    let fitted = (!outcome.model.surfaces.is_empty()).then(|| Checked::from_model(&outcome.model));
    let checked = fitted.transpose()?;
    for response in &outcome.responses {
        body += &format!("<h2>{}</h2>\n<p>{}.</p>\n", escaped(&response.name), escaped(&verdict_in_words(response)));
        let warnings = response.statistics.iter().flat_map(|statistics| &statistics.warnings);
        let lines: String =
            warnings.map(|warning| format!("<li><b>{}</b>: {}</li>\n", warning.kind, escaped(&warning.what))).collect();
        if !lines.is_empty() {
            body += &format!("<p>Warnings:</p>\n<ul class=\"warnings\">\n{lines}</ul>\n");
        }
        if let (Some(checked), Some(statistics)) = (&checked, &response.statistics) {
            body += &of_response(outcome, checked, response, statistics)?;
        }
    }
    Ok(page(&format!("rsm fit: {}", outcome.model.name), &body))
}

/// Measured and predicted values of some rows.
struct Pairs {
    measured: Vec<f64>,
    predicted: Vec<f64>,
}

fn of_response(
    outcome: &Outcome,
    checked: &Checked,
    response: &ResponseOutcome,
    statistics: &ResponseStatistics,
) -> Result<String, Refusal> {
    let index = outcome
        .model
        .surfaces
        .iter()
        .position(|surface| surface.name == response.name)
        .expect("a fitted response has a surface");
    let surface = &outcome.model.surfaces[index];
    let inputs = checked.inputs_of(surface);
    let tape = lower::surface(checked, index, Precision::F64);
    let place = outcome.responses.iter().position(|other| other.name == response.name).expect("it is one of them");
    let pairs = |records: &Records| {
        let mut interpreter = Interpreter::<f64>::new(&tape);
        let columns: Vec<usize> = surface
            .inputs
            .iter()
            .map(|name| outcome.model.inputs.iter().position(|input| input.name == *name).expect("a known input"))
            .collect();
        let predicted = (0..records.rows()).map(|row| {
            let point: Vec<f64> = columns.iter().map(|column| records.inputs[*column][row]).collect();
            interpreter.eval(&point)
        });
        Pairs { predicted: predicted.collect(), measured: records.responses[place].clone() }
    };
    let fitted = pairs(&outcome.fitted);
    let is_unseen = response.chosen_by == ChosenBy::Nobody;
    let of_validation = if is_unseen { "unseen rows" } else { "validation rows" };
    let apart: Vec<(&str, Pairs)> = [(of_validation, &outcome.validation), ("test rows", &outcome.test)]
        .into_iter()
        .filter_map(|(name, records)| Some((name, pairs(records.as_ref()?))))
        .collect();

    let unit = if surface.unit == "1" { String::new() } else { format!(" {}", escaped(&surface.unit)) };
    let brackets = if unit.is_empty() { String::new() } else { format!(" [{}]", surface.unit) };
    let mut text = String::from("<table>\n");
    let mut row = |name: &str, value: String| text += &format!("<tr><th>{name}</th><td>{value}</td></tr>\n");
    row("rows", statistics.rows.to_string());
    row("residual standard deviation", figure(statistics.residual_sd) + &unit);
    row(
        "R<sup>2</sup>, adjusted, predicted",
        [statistics.r2, statistics.r2_adjusted, statistics.r2_predicted].map(share).join(", "),
    );
    row("confidence C on the fitted rows", figure(statistics.confidence_c) + " %");
    if let Some(lack) = &statistics.lack_of_fit {
        row(
            "lack of fit",
            format!("F = {}, p = {}, {} and {} degrees of freedom", figure(lack.f), figure(lack.p), lack.df[0], lack.df[1]),
        );
    }
    let mut errors = |what: &str, errors: &ValidationStatistics| {
        row(what, errors.rows.to_string());
        row("mean error on them", figure(Some(errors.mean_abs_error)) + &unit);
        row("largest error on them", figure(Some(errors.max_abs_error)) + &unit);
        row("root of mean square", figure(Some(errors.rmse)) + &unit);
    };
    if let Some(validation) = &statistics.validation {
        errors(if is_unseen { "unseen rows" } else { "validation rows: on the rows that chose it" }, validation);
    }
    if let Some(test) = &statistics.test {
        errors("test rows, which chose nothing", test);
    }
    if let Some(cross) = &statistics.cross_validation {
        errors(&format!("rows left out in {} parts in turn", cross.parts), &cross.errors);
    }
    row("terms chosen by", escaped(&statistics.rows_used.terms));
    row("error to be believed", escaped(&statistics.rows_used.error));
    if let Some(canonical) = &statistics.canonical {
        let point: Vec<String> = canonical
            .stationary_point
            .0
            .iter()
            .map(|(name, value)| format!("{} = {}", escaped(name), figure(Some(*value))))
            .collect();
        let kind =
            serde_json::to_value(canonical.kind).ok().and_then(|kind| kind.as_str().map(str::to_string)).unwrap_or_default();
        row("stationary point", format!("{kind} at {}", point.join(", ")));
    }
    if let Some(support) = &statistics.support {
        let words = format!("{:.1} % of the box, by {} half-spaces", 100.0 * support.share_of_box, support.half_spaces);
        row("supported by the data", words);
        if !apart.is_empty() {
            row("rows outside that were not fitted", support.unseen_rows_outside.to_string());
        }
    }
    text += "</table>\n";
    text += &statistics.constraints.as_ref().map_or(String::new(), |told| constraints(told, &unit));
    text +=
        "<table>\n<tr><th>term, in coded variables</th><th>coefficient</th><th>standard error</th><th>t</th><th>p</th></tr>\n";
    for term in &statistics.terms {
        text += &format!(
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            escaped(&design::name(surface, &inputs, &term.powers)),
            figure(Some(term.coefficient)),
            figure(term.standard_error),
            figure(term.t),
            figure(term.p)
        );
    }
    text += "</table>\n<div class=\"plots\">\n";
    text += &over_the_plane(outcome, checked, index)?;
    text += &against_prediction(&fitted, &apart, &brackets)?;
    text += &over_rows(&fitted, &apart, &brackets)?;
    text += "</div>\n";
    Ok(text)
}

/// What is proven, and what it cost.
fn constraints(told: &ConstraintStatistics, unit: &str) -> String {
    let mut text = String::from("<table>\n<tr><th>constraint</th><th>proven distance</th><th>holds the surface at</th></tr>\n");
    for report in &told.constraints {
        let places: Vec<String> = report.points.iter().map(place).collect();
        let places = if places.is_empty() { "nowhere".to_string() } else { places.join("; ") };
        let distance = figure(Some(report.distance)) + unit;
        text += &format!("<tr><td>{}</td><td>{distance}</td><td>{places}</td></tr>\n", escaped(&report.constraint));
    }
    text += "</table>\n";
    match &told.largest_change {
        None => text += "<p>The constraints hold without changing a coefficient.</p>\n",
        Some(change) => {
            let unseen = told.validation_without.as_ref().map_or(String::new(), |unseen| {
                format!(", mean error on validation rows {}{unit}", figure(Some(unseen.mean_abs_error)))
            });
            text += &format!(
                "<p>Without constraints: residual standard deviation {}{unit}{unseen}. The surface was changed most, by {}{unit}, at {}.</p>\n",
                figure(told.residual_sd_without),
                figure(Some(change.value)),
                place(&change.at)
            );
        }
    }
    text
}

fn place(point: &Named<f64>) -> String {
    let each = point.0.iter().map(|(name, value)| format!("{} = {}", escaped(name), figure(Some(*value))));
    each.collect::<Vec<String>>().join(", ")
}

fn share(value: Option<f64>) -> String {
    value.map_or("none".to_string(), |value| format!("{value:.6}"))
}

fn against_prediction(fitted: &Pairs, apart: &[(&str, Pairs)], brackets: &str) -> Result<String, Refusal> {
    let all: Vec<&Pairs> = std::iter::once(fitted).chain(apart.iter().map(|(_, pairs)| pairs)).collect();
    let values = || all.iter().flat_map(|pairs| pairs.measured.iter().chain(&pairs.predicted));
    let (low, high) =
        values().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(*value), high.max(*value)));
    let points = |pairs: &Pairs| pairs.predicted.iter().copied().zip(pairs.measured.iter().copied()).collect::<Vec<_>>();
    let (x, y) = (format!("predicted{brackets}"), format!("measured{brackets}"));
    let words = Words { title: "measured against predicted", x: &x, y: &y };
    with_rule(
        &words,
        vec![(low, low), (high, high)],
        points(fitted),
        apart.iter().map(|(name, pairs)| (*name, points(pairs))).collect(),
    )
}

fn over_rows(fitted: &Pairs, apart: &[(&str, Pairs)], brackets: &str) -> Result<String, Refusal> {
    let residuals = |pairs: &Pairs| {
        let each = pairs.measured.iter().zip(&pairs.predicted).enumerate();
        each.map(|(row, (measured, predicted))| (row as f64 + 1.0, measured - predicted)).collect::<Vec<_>>()
    };
    let apart: NamedPoints<'_> = apart.iter().map(|(name, pairs)| (*name, residuals(pairs))).collect();
    let fitted = residuals(fitted);
    let last = apart.iter().map(|(_, rows)| rows.len()).fold(fitted.len(), usize::max) as f64 + 1.0;
    let y = format!("residual{brackets}");
    let words = Words { title: "residual over row", x: "row", y: &y };
    with_rule(&words, vec![(0.0, 0.0), (last, 0.0)], fitted, apart)
}

/// Points of rows that were kept apart, under their name.
type NamedPoints<'a> = Vec<(&'a str, Vec<(f64, f64)>)>;

/// The rule shows where a perfect model would lie.
fn with_rule(
    words: &Words<'_>,
    rule: Vec<(f64, f64)>,
    fitted: Vec<(f64, f64)>,
    apart: NamedPoints<'_>,
) -> Result<String, Refusal> {
    let mut series = vec![Series::new("", GREY, Mark::Line, rule), Series::new("fitted rows", BLUE, Mark::Circle, fitted)];
    let colours = [ORANGE, BLACK];
    series.extend(apart.into_iter().zip(colours).map(|((name, rows), colour)| Series::new(name, colour, Mark::Cross, rows)));
    plot::curves(words, &series)
}

fn constraints_of(response: &ResponseOutcome) -> Option<&ConstraintStatistics> {
    response.statistics.as_ref()?.constraints.as_ref()
}

/// A surface of two inputs over its box, blank where the data do not support it; nothing for other surfaces.
fn over_the_plane(outcome: &Outcome, checked: &Checked, index: usize) -> Result<String, Refusal> {
    let surface = &outcome.model.surfaces[index];
    let inputs = checked.inputs_of(surface);
    let [first, second] = inputs.as_slice() else { return Ok(String::new()) };
    let tape = lower::surface(checked, index, Precision::F64);
    let support = lower::support(checked, index, Precision::F64);
    let mut interpreter = Interpreter::<f64>::new(&tape);
    let mut supported = support.as_ref().map(Interpreter::<f64>::new);
    let mut value = |x: f64, y: f64| {
        let inside = supported.as_mut().is_none_or(|supported| supported.eval(&[x, y]) == 1.0);
        inside.then(|| interpreter.eval(&[x, y]))
    };
    let columns = [first, second].map(|input| {
        outcome.model.inputs.iter().position(|other| other.name == input.name).expect("a surface's input is in the model")
    });
    let points = |records: &Records| {
        let [x, y] = columns.map(|column| &records.inputs[column]);
        x.iter().copied().zip(y.iter().copied()).collect::<Vec<_>>()
    };
    let mut series = vec![Series::new("fitted rows", PINK, Mark::Circle, points(&outcome.fitted))];
    let apart = [("validation rows", ORANGE, &outcome.validation), ("test rows", GREY, &outcome.test)];
    series.extend(
        apart
            .into_iter()
            .filter_map(|(name, colour, records)| Some(Series::new(name, colour, Mark::Cross, points(records.as_ref()?)))),
    );
    if let Some(told) = outcome.responses.iter().find(|response| response.name == surface.name).and_then(constraints_of) {
        let held = told.constraints.iter().flat_map(|report| &report.points).map(|point| (point.0[0].1, point.0[1].1));
        let held: Vec<(f64, f64)> = held.collect();
        series.extend((!held.is_empty()).then(|| Series::new("held by a constraint", BLACK, Mark::Cross, held)));
    }
    let axis = |input: &rsm_core::model::Input| format!("{} [{}]", input.name, input.unit);
    let (x, y) = (axis(first), axis(second));
    let words = Words { title: &surface.name, x: &x, y: &y };
    let pair = |[low, high]: [f64; 2]| (low, high);
    plot::map(&words, &surface.unit, pair(first.range), pair(second.range), &mut value, &series)
}

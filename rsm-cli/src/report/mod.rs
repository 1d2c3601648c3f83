//! The report of a fit. For each response: verdict, three numbers and a plot of the surface, then statistics of the fit, constraints and terms.
//!
//! In: the outcome of a fit. Out: text. Predictions come from the interpreter, so a report shows the values that an evaluator returns.

mod surface;

use std::collections::BTreeMap;

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::{Input, Surface, Transform};
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::constrain::ConstraintStatistics;
use rsm_fit::fit::{ChosenBy, Outcome, ResponseOutcome, Verdict};
use rsm_fit::left_out::LeftOut;
use rsm_fit::records::Records;
use rsm_fit::statistics::{BlockEffect, BlocksReport, Named, ResponseStatistics, ValidationStatistics};

use crate::commands::fit::verdict_in_words;

use crate::outcome::Refusal;
use crate::page::summary::{self, Number, Tone};
use crate::page::{escaped, figure, known, page, rows, short, with_unit};
use crate::plot::{self, BLACK, BLUE, GREY, Mark, ORANGE, Series, Words};

/// The report of a fit.
pub fn fit(outcome: &Outcome) -> Result<String, Refusal> {
    let outcome = &*outcome.without_blocks();
    let mut body = format!("<h1>Model <code>{}</code></h1>\n", escaped(&outcome.model.name));
    let reached = outcome.responses.iter().filter(|it| matches!(it.verdict, Verdict::Fitted | Verdict::Reached { .. })).count();
    if outcome.responses.len() > 1 {
        body += &format!(
            "<p class=\"lead\">{reached} of {} responses reach their target.</p>\n{}",
            outcome.responses.len(),
            overview(outcome)
        );
    }
    // If no response could be fitted, there is no surface and no model to check.
    let fitted = (!outcome.model.surfaces.is_empty()).then(|| Checked::from_model(&outcome.model));
    let checked = fitted.transpose()?;
    for response in &outcome.responses {
        let (tone, state) = tone(&response.verdict);
        body += &format!("<section>\n<h2>{}</h2>\n", escaped(&response.name));
        let words = match (&response.verdict, &response.statistics) {
            (Verdict::Fitted, Some(statistics)) => format!("{} terms on {} rows", statistics.terms.len(), statistics.rows),
            _ => verdict_in_words(response),
        };
        body += &summary::verdict(tone, state, &format!("{words}."));
        let (checked, statistics) = match (&checked, &response.statistics) {
            (Some(checked), Some(statistics)) => (checked, statistics),
            _ => {
                body += "<p>This response has no surface.</p>\n</section>\n";
                continue;
            }
        };
        body += &of_response(outcome, checked, response, statistics)?;
        body += "</section>\n";
    }
    let files: Vec<String> = outcome
        .files
        .iter()
        .map(|file| {
            format!("<li>{} ({} rows, SHA-256 <code>{}</code>)</li>", escaped(&file.name), file.rows, &file.sha256[..16])
        })
        .collect();
    body += &format!("<h2>Data</h2>\n<ul>\n{}\n</ul>\n", files.join("\n"));
    body += &left_out(outcome);
    Ok(page(&format!("rsm fit: {}", outcome.model.name), &body))
}

/// The rows that responses leave out because a cell is missing.
fn left_out(outcome: &Outcome) -> String {
    let pairs = outcome.responses.iter().zip(&outcome.left_out);
    let of_one = |(response, left_out): (&ResponseOutcome, &Vec<LeftOut>)| {
        let line = |one: &LeftOut| format!("<li><b>{}</b>: {}</li>\n", escaped(&response.name), escaped(&one.words()));
        left_out.iter().map(line).collect::<String>()
    };
    let lines: String = pairs.map(of_one).collect();
    if lines.is_empty() { lines } else { format!("<h3>Rows with missing cells</h3>\n<ul>\n{lines}</ul>\n") }
}

/// The colour of the verdict, and its state in a word or two.
fn tone(verdict: &Verdict) -> (Tone, &'static str) {
    match verdict {
        Verdict::Fitted => (Tone::Good, "fitted"),
        Verdict::Reached { .. } => (Tone::Good, "reached"),
        Verdict::ReachedAboutZero { .. } => (Tone::Warn, "reached about zero only"),
        Verdict::NotReached { .. } => (Tone::Warn, "not reached"),
        Verdict::Infeasible { .. } => (Tone::Bad, "no surface"),
        Verdict::NotProven(_) => (Tone::Bad, "not proven"),
        Verdict::IllConditioned { .. } => (Tone::Bad, "no surface"),
    }
}

/// A line for each of several responses.
fn overview(outcome: &Outcome) -> String {
    let line = |response: &ResponseOutcome| {
        let unit = outcome.model.surface(&response.name).map_or("", |surface| surface.unit.as_str());
        let error = response.statistics.as_ref().and_then(|statistics| error_estimate(response, statistics));
        let error = error.map_or(String::new(), |(error, on)| format!("{} {on}", with_unit(&short(error), unit)));
        format!(
            "<tr><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            escaped(&response.name),
            tone(&response.verdict).1,
            escaped(&error)
        )
    };
    let lines: String = outcome.responses.iter().map(line).collect();
    format!("<table>\n<tr><th>response</th><th>verdict</th><th>error estimate (root mean square)</th></tr>\n{lines}</table>\n")
}

/// The error estimate (root mean square) and its rows: the rows that influenced the choice of terms least.
fn error_estimate(response: &ResponseOutcome, statistics: &ResponseStatistics) -> Option<(f64, String)> {
    let on = |errors: &ValidationStatistics, of: &str| (errors.rmse, format!("on {} {of}", errors.rows));
    let test = statistics.test.as_ref().map(|it| on(it, "test rows"));
    let cross = statistics.cross_validation.as_ref().map(|it| on(&it.errors, "rows, each left out in turn"));
    let validation = statistics.validation.as_ref().map(|it| {
        let of =
            if response.chosen_by == ChosenBy::Validation { "validation rows, which chose the terms" } else { "holdout rows" };
        on(it, of)
    });
    let of_fit = statistics.transform.as_ref().and_then(|it| it.fitted.as_ref()).map(|fitted| fitted.rmse);
    let residual = of_fit.or(statistics.residual_sd).map(|sd| (sd, format!("on the {} fitted rows", statistics.rows)));
    test.or(cross).or(validation).or(residual)
}

/// The three numbers of a response.
fn numbers(response: &ResponseOutcome, statistics: &ResponseStatistics, unit: &str) -> String {
    let mut list = Vec::new();
    if let Some((error, on)) = error_estimate(response, statistics) {
        list.push(Number::new("Error (root mean square)", with_unit(&short(error), unit), on));
    }
    let share = |share: f64| format!("{:.1} %", 100.0 * share);
    let left_out = statistics.r2_predicted.map(|it| (it, "of the spread of the rows, each left out in turn (predicted R²)"));
    if let Some((r2, from)) = left_out.or(statistics.r2.map(|it| (it, "of the spread of the fitted rows (R²)"))) {
        list.push(Number::new("Explained", share(r2), from));
    }
    let from = format!("from {} rows", statistics.rows);
    list.push(match &statistics.spline {
        Some(spline) => Number::new("Coefficients", spline.coefficients.to_string(), format!("of a spline, {from}")),
        None => Number::new("Terms", statistics.terms.len().to_string(), from),
    });
    summary::numbers(&list)
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
    let response_index = outcome.responses.iter().position(|other| other.name == response.name).expect("it is one of them");
    let pairs = |records: &Records| {
        let mut interpreter = Interpreter::<f64>::new(&tape);
        let columns: Vec<usize> = surface
            .inputs
            .iter()
            .map(|name| outcome.model.inputs.iter().position(|input| input.name == *name).expect("a known input"))
            .collect();
        let complete = records.complete(&columns, response_index);
        let predicted = complete.iter().map(|row| {
            let point: Vec<f64> = columns.iter().map(|column| records.inputs[*column][*row]).collect();
            interpreter.eval(&point)
        });
        Pairs {
            predicted: predicted.collect(),
            measured: complete.iter().map(|row| records.responses[response_index][*row]).collect(),
        }
    };
    let fitted = pairs(&outcome.fitted);
    let is_unseen = response.chosen_by != ChosenBy::Validation;
    let of_validation = if is_unseen { "holdout rows" } else { "validation rows" };
    let apart: Vec<(&str, Pairs)> = [(of_validation, &outcome.validation), ("test rows", &outcome.test)]
        .into_iter()
        .filter_map(|(name, records)| Some((name, pairs(records.as_ref()?))))
        .collect();

    let behind = |unit: &str| if unit == "1" { String::new() } else { format!(" {}", escaped(unit)) };
    let in_brackets = |unit: &str| if unit == "1" { String::new() } else { format!(" [{unit}]") };
    let of_terms = surface.unit_of_terms();
    let (unit, behind_terms) = (behind(&surface.unit), behind(&of_terms));
    let mut text = numbers(response, statistics, &surface.unit);
    text += &surface::figure(&surface::Shown {
        outcome,
        checked,
        surface: index,
        response: response_index,
        constraints: statistics.constraints.as_ref(),
        error: error_estimate(response, statistics).map(|(error, on)| (error, format!("(root mean square {on})"))),
    })?;
    let warnings = statistics.warnings.iter();
    let lines: String =
        warnings.map(|warning| format!("<li><b>{}</b>: {}</li>\n", warning.kind, escaped(&warning.what))).collect();
    if !lines.is_empty() {
        text += &format!("<h3>Warnings</h3>\n<ul class=\"warnings\">\n{lines}</ul>\n");
    }
    text += "<h3>Measured and predicted</h3>\n<div class=\"plots\">\n";
    text += &against_prediction(&fitted, &apart, &in_brackets(&surface.unit))?;
    text += &over_rows(&fitted, &apart, (surface.transform, &in_brackets(&of_terms)))?;
    text += "</div>\n<div class=\"columns\">\n<div>\n<h3>Errors</h3>\n";
    text += &errors(statistics, is_unseen, [&unit, &behind_terms]);
    text += "<h3>Statistics of the fit</h3>\n";
    text += &of_the_fit(statistics, &inputs, !apart.is_empty());
    text += "</div>\n<div>\n";
    if let Some(spline) = &statistics.spline {
        text += &format!(
            "<h3>Spline</h3>\n<p>{}. With this penalty it is worth {:.1} free coefficients. {} cells contain no row.</p>\n</div>\n</div>\n",
            escaped(&spline.words()),
            spline.effective,
            spline.empty_cells
        );
        return Ok(text);
    }
    text += "<h3>Terms</h3>\n<p>Of variables that are coded to -1 and 1 at the ends of their ranges. Each coefficient is rounded to the digits that its 95 % interval supports; the model file has all digits.</p>\n";
    text += &terms(surface, statistics, &behind_terms);
    text += "</div>\n</div>\n";
    if let Some(constrained) = &statistics.constraints {
        text += "<h3>Constraints</h3>\n";
        text += &constraints(constrained, &inputs, [&unit, &behind_terms]);
    }
    Ok(text)
}

/// Errors by the rows on which they are computed.
fn errors(statistics: &ResponseStatistics, is_unseen: bool, [unit, of_terms]: [&str; 2]) -> String {
    let validation = if is_unseen { "holdout rows" } else { "validation rows, which chose the terms" };
    let cross = statistics.cross_validation.as_ref();
    let left_out = cross.map_or(String::new(), |cross| format!("rows left out in {} parts in turn", cross.parts));
    let lists = [
        ("fitted rows, in the unit of the response", statistics.transform.as_ref().and_then(|it| it.fitted.as_ref())),
        (validation, statistics.validation.as_ref()),
        ("test rows, which were not used before", statistics.test.as_ref()),
        (left_out.as_str(), cross.map(|cross| &cross.errors)),
    ];
    let line = |name: &str, rows: usize, errors: [Option<f64>; 3], unit: &str| {
        let number = |value: Option<f64>| value.map_or(String::new(), |value| short(value) + unit);
        let [mean, root, largest] = errors.map(number);
        format!(
            "<tr><td>{name}</td><td class=\"number\">{rows}</td><td class=\"number\">{mean}</td><td class=\"number\">{root}</td><td class=\"number\">{largest}</td></tr>\n"
        )
    };
    let mut text = String::from(
        "<table>\n<tr><th>on</th><th class=\"number\">rows</th><th class=\"number\">mean of magnitudes</th><th class=\"number\">root mean square</th><th class=\"number\">largest</th></tr>\n",
    );
    let of_residual = [None, statistics.residual_sd, None];
    text += &line("fitted rows (residual standard deviation)", statistics.rows, of_residual, of_terms);
    for (name, errors) in lists {
        let Some(errors) = errors else { continue };
        text += &line(name, errors.rows, [Some(errors.mean_abs_error), Some(errors.rmse), Some(errors.max_abs_error)], unit);
    }
    let mut sources = vec![
        ("terms chosen by".to_string(), escaped(&statistics.rows_used.terms)),
        ("error estimate".to_string(), escaped(&statistics.rows_used.error)),
    ];
    sources.extend(statistics.forms.as_ref().map(|forms| ("form".to_string(), escaped(&forms.words()))));
    if let Some(transform) = &statistics.transform {
        sources.push(("transform of the response".to_string(), escaped(&transform.words())));
        if transform.transform != "none" {
            let of =
                "coefficients, residual standard deviation and the statistics of the fit are those of the transformed response";
            sources.push(("its meaning".to_string(), of.to_string()));
        }
    }
    text + "</table>\n" + &rows(&sources)
}

fn of_the_fit(statistics: &ResponseStatistics, inputs: &[Input], has_rows_apart: bool) -> String {
    let mut list: Vec<(String, String)> = Vec::new();
    let mut row = |name: &str, value: String| list.push((name.to_string(), value));
    row(
        "R<sup>2</sup>, adjusted, predicted",
        [statistics.r2, statistics.r2_adjusted, statistics.r2_predicted].map(share).join(", "),
    );
    if let Some(loss) = &statistics.loss {
        row("loss", escaped(&loss.words("")));
    }
    if let Some(noise) = &statistics.noise {
        row("noise", escaped(&noise.words()));
    }
    if let Some(blocks) = &statistics.blocks {
        row(&format!("effects of {}", escaped(&blocks.columns.join(" / "))), effects(blocks));
    }
    row("confidence C on the fitted rows", figure(statistics.confidence_c) + " %");
    if let Some(lack) = &statistics.lack_of_fit {
        let number = |value: Option<f64>| value.map_or("none".to_string(), short);
        row(
            "lack of fit",
            format!("F = {}, p = {}, {} and {} degrees of freedom", number(lack.f), number(lack.p), lack.df[0], lack.df[1]),
        );
    }
    if let Some(canonical) = &statistics.canonical {
        let kind =
            serde_json::to_value(canonical.kind).ok().and_then(|kind| kind.as_str().map(str::to_string)).unwrap_or_default();
        row("stationary point", format!("{} at {}", escaped(&kind), place(&canonical.stationary_point, inputs)));
    }
    if let Some(support) = &statistics.support {
        let words = format!("{:.1} % of the box, by {} half-spaces", 100.0 * support.share_of_box, support.half_spaces);
        row("supported by the data", words);
        if has_rows_apart {
            row("holdout rows outside the support", support.unseen_rows_outside.to_string());
        }
    }
    rows(&list)
}

/// The most blocks that are listed.
const MOST_BLOCKS: usize = 20;

/// The effects of the blocks, each with its 95 % interval.
fn effects(blocks: &BlocksReport) -> String {
    let of_one = |one: &BlockEffect| {
        let width = 2.0 * one.standard_error.unwrap_or(0.0);
        let width_words = if width > 0.0 { format!(" &plusmn; {}", short(width)) } else { String::new() };
        format!("{}: {}{width_words}", escaped(&one.block), known(one.effect, width))
    };
    let mut lines: Vec<String> = blocks.effects.iter().take(MOST_BLOCKS).map(of_one).collect();
    if blocks.effects.len() > MOST_BLOCKS {
        lines.push(format!("{} more", blocks.effects.len() - MOST_BLOCKS));
    }
    format!("standard deviation {}; {}. Plots show measured values less these effects.", short(blocks.sd), lines.join("; "))
}

fn terms(surface: &Surface, statistics: &ResponseStatistics, unit: &str) -> String {
    let related = statistics.serial.as_ref().map_or(&[][..], |serial| &serial.standard_errors[..]);
    let mut text = format!(
        "<table>\n<tr><th>term</th><th class=\"number\">coefficient{}</th><th class=\"number\">standard error</th><th class=\"number\">t</th><th class=\"number\">p</th>{}</tr>\n",
        if unit.is_empty() { String::new() } else { format!(",{unit}") },
        if related.is_empty() { "" } else { "<th class=\"number\">standard error with related errors</th>" }
    );
    let number = |value: Option<f64>| value.map_or("none".to_string(), short);
    for (index, term) in statistics.terms.iter().enumerate() {
        let related = related.get(index).map_or(String::new(), |error| format!("<td class=\"number\">{}</td>", short(*error)));
        text += &format!(
            "<tr><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td>{related}</tr>\n",
            escaped(&surface.term_name(&term.powers)),
            // Two standard errors are about half the width of a 95 % interval.
            known(term.coefficient, 2.0 * term.standard_error.unwrap_or(0.0)),
            number(term.standard_error),
            number(term.t),
            number(term.p)
        );
    }
    text + "</table>\n"
}

/// The proved constraints, and the increase of the error that they cause.
fn constraints(statistics: &ConstraintStatistics, inputs: &[Input], [unit, of_terms]: [&str; 2]) -> String {
    let mut text = String::from("<table>\n<tr><th>constraint</th><th>proved distance</th><th>active at</th></tr>\n");
    for report in &statistics.constraints {
        let places: Vec<String> = report.points.iter().map(|point| place(point, inputs)).collect();
        let places = if places.is_empty() { "nowhere".to_string() } else { places.join("; ") };
        let distance = short(report.distance) + of_terms;
        text += &format!("<tr><td>{}</td><td>{distance}</td><td>{places}</td></tr>\n", escaped(&report.constraint));
    }
    text += "</table>\n";
    match &statistics.largest_change {
        None => text += "<p>The constraints hold without changing a coefficient.</p>\n",
        Some(change) => {
            let unseen = statistics.validation_without.as_ref().map_or(String::new(), |unseen| {
                format!(", mean error on validation rows {}{unit}", short(unseen.mean_abs_error))
            });
            text += &format!(
                "<p>Without constraints: residual standard deviation {}{of_terms}{unseen}. The surface was changed most, by {}{of_terms}, at {}.</p>\n",
                statistics.residual_sd_without.map_or("none".to_string(), short),
                short(change.value),
                place(&change.at, inputs)
            );
        }
    }
    text
}

/// A point with its units, to four digits.
fn place(point: &Named<f64>, inputs: &[Input]) -> String {
    let unit = |name: &String| inputs.iter().find(|input| input.name == *name).map_or("", |input| input.unit.as_str());
    let each = point.0.iter().map(|(name, value)| escaped(&format!("{name} = {}", with_unit(&known(*value, 0.0), unit(name)))));
    each.collect::<Vec<String>>().join(", ")
}

fn share(value: Option<f64>) -> String {
    value.map_or("none".to_string(), |value| format!("{value:.4}"))
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

/// Measured minus predicted; with a transform those of the terms, where the noise is even.
fn over_rows(
    fitted: &Pairs,
    apart: &[(&str, Pairs)],
    (transform, brackets): (Option<Transform>, &str),
) -> Result<String, Refusal> {
    // The evaluator may saturate at a value that has no transform; such a row has no mark.
    let of_terms = |y: f64| transform.map_or(y, |transform| transform.transformed(y).unwrap_or(f64::NAN));
    let residuals = |pairs: &Pairs| {
        let each = pairs.measured.iter().zip(&pairs.predicted).enumerate();
        let residual = |measured: f64, predicted: f64| of_terms(measured) - of_terms(predicted);
        let points = each.map(|(row, (measured, predicted))| (row as f64 + 1.0, residual(*measured, *predicted)));
        points.filter(|(_, residual)| residual.is_finite()).collect::<Vec<_>>()
    };
    let apart: NamedPoints<'_> = apart.iter().map(|(name, pairs)| (*name, residuals(pairs))).collect();
    let fitted = residuals(fitted);
    let last = apart.iter().map(|(_, rows)| rows.len()).fold(fitted.len(), usize::max) as f64 + 1.0;
    let y = format!("residual{brackets}");
    let words = Words { title: "residual over row", x: "row", y: &y };
    with_rule(&words, vec![(0.0, 0.0), (last, 0.0)], fitted, apart)
}

/// Points of holdout rows, with the name of their set.
type NamedPoints<'a> = Vec<(&'a str, Vec<(f64, f64)>)>;

/// Up to this many points of a set, a plot has a mark for each.
const MOST_MARKS: usize = 2000;

/// Cells across and down for more points.
const CELLS: [usize; 2] = [40, 24];

/// The points of a set; of many points, the mean of those in each cell of the plot. Every cell with a point has a mark, so no outlier is lost.
fn condensed(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    if points.len() <= MOST_MARKS {
        return points;
    }
    let range = |of: fn(&(f64, f64)) -> f64| {
        let finite = points.iter().map(of).filter(|value| value.is_finite());
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let cell = |value: f64, (low, high): (f64, f64), cells: usize| {
        (((value - low) / (high - low).max(f64::MIN_POSITIVE) * cells as f64) as usize).min(cells - 1)
    };
    let (across, down) = (range(|point| point.0), range(|point| point.1));
    let mut sums: BTreeMap<[usize; 2], (f64, f64, f64)> = BTreeMap::new();
    for (x, y) in points.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
        let sum = sums.entry([cell(*x, across, CELLS[0]), cell(*y, down, CELLS[1])]).or_default();
        *sum = (sum.0 + x, sum.1 + y, sum.2 + 1.0);
    }
    sums.into_values().map(|(x, y, count)| (x / count, y / count)).collect()
}

/// Adds the line on which the points of a perfect model would be.
fn with_rule(
    words: &Words<'_>,
    rule: Vec<(f64, f64)>,
    fitted: Vec<(f64, f64)>,
    apart: NamedPoints<'_>,
) -> Result<String, Refusal> {
    let fitted = Series::new("fitted rows", BLUE, Mark::Circle, condensed(fitted));
    let mut series = vec![Series::new("", GREY, Mark::Line, rule), fitted];
    let apart = apart.into_iter().map(|(name, rows)| (name, condensed(rows)));
    let colours = [ORANGE, BLACK];
    series.extend(apart.zip(colours).map(|((name, rows), colour)| Series::new(name, colour, Mark::Cross, rows)));
    plot::curves(words, &series)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_points_become_a_mark_for_each_cell_and_an_outlier_keeps_its_own() {
        let few = vec![(0.0, 1.0), (2.0, 3.0)];
        assert_eq!(condensed(few.clone()), few);
        let mut many: Vec<(f64, f64)> = (0..100_000).map(|k| (f64::from(k), f64::from(k % 7))).collect();
        many[500].1 = 90.0;
        let marks = condensed(many);
        assert!(marks.len() <= CELLS[0] * CELLS[1]);
        assert!(marks.contains(&(500.0, 90.0)));
    }
}

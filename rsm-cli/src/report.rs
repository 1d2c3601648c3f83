//! Reports: one self-contained HTML file, plots as SVG inside.
//!
//! In: what a fit found. Out: text. Predictions come from the interpreter, so a report shows what an evaluator will return.

use plotters::prelude::{
    ChartBuilder, Circle, Cross, EmptyElement, IntoDrawingArea, LineSeries, PointSeries, RGBColor, SVGBackend,
};
use plotters::style::{IntoFont, WHITE};
use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::design;
use rsm_fit::fit::{Outcome, ResponseOutcome};
use rsm_fit::records::Records;
use rsm_fit::statistics::ResponseStatistics;

use crate::outcome::Refusal;

const FITTED: RGBColor = RGBColor(31, 90, 160);
const UNSEEN: RGBColor = RGBColor(205, 92, 20);
const RULE: RGBColor = RGBColor(150, 150, 150);

/// Size of a plot in pixels.
const PLOT: (u32, u32) = (460, 340);

/// The report of a fit.
pub fn fit(outcome: &Outcome) -> Result<String, Refusal> {
    let mut body = format!("<h1>Model <code>{}</code></h1>\n<p>Data: ", escaped(&outcome.model.name));
    let files: Vec<String> = outcome
        .files
        .iter()
        .map(|file| format!("{} ({} rows, SHA-256 <code>{}</code>)", escaped(&file.name), file.rows, &file.sha256[..16]))
        .collect();
    body += &format!("{}</p>\n<p>Blue circles: rows that were fitted. Orange crosses: unseen rows.</p>\n", files.join("; "));
    // Where no response could be fitted there is no surface, and no model to check.
    let fitted = (!outcome.model.surfaces.is_empty()).then(|| Checked::from_model(&outcome.model));
    let checked = fitted.transpose()?;
    for response in &outcome.responses {
        body += &format!(
            "<h2>{}</h2>\n<p>{} on {}.</p>\n",
            escaped(&response.name),
            escaped(&response.verdict.to_string()),
            response.judged_on.words()
        );
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
    let unseen = outcome.unseen.as_ref().map(pairs);

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
    if let Some(validation) = &statistics.validation {
        row("unseen rows", validation.rows.to_string());
        row("mean error on them", figure(Some(validation.mean_abs_error)) + &unit);
        row("largest error on them", figure(Some(validation.max_abs_error)) + &unit);
        row("root of mean square", figure(Some(validation.rmse)) + &unit);
    }
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
    text += "</table>\n<table>\n<tr><th>term, in coded variables</th><th>coefficient</th><th>standard error</th><th>t</th><th>p</th></tr>\n";
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
    text += &against_prediction(&fitted, unseen.as_ref(), &format!("measured against predicted{brackets}"))?;
    text += &over_rows(&fitted, unseen.as_ref(), &format!("residual{brackets} over row"))?;
    text += "</div>\n";
    Ok(text)
}

fn figure(value: Option<f64>) -> String {
    match value {
        None => "none".to_string(),
        Some(value) if value == 0.0 || (1e-3..1e5).contains(&value.abs()) => {
            // Five significant digits.
            let before = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
            format!("{value:.*}", (4 - before).max(0) as usize)
        }
        Some(value) => format!("{value:.4e}"),
    }
}

fn share(value: Option<f64>) -> String {
    value.map_or("none".to_string(), |value| format!("{value:.6}"))
}

/// The least and the greatest of some values, with a margin; never empty.
fn span<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(*value), high.max(*value)));
    if low >= high || !(high - low).is_finite() {
        return if low.is_finite() { (low - 1.0, low + 1.0) } else { (0.0, 1.0) };
    }
    let margin = 0.05 * (high - low);
    (low - margin, high + margin)
}

fn against_prediction(fitted: &Pairs, unseen: Option<&Pairs>, title: &str) -> Result<String, Refusal> {
    let all = std::iter::once(fitted).chain(unseen);
    let (low, high) = span(all.flat_map(|pairs| pairs.measured.iter().chain(&pairs.predicted)));
    let points = |pairs: &Pairs| pairs.predicted.iter().copied().zip(pairs.measured.iter().copied()).collect::<Vec<_>>();
    plot(title, (low, high), (low, high), &[(low, low), (high, high)], &points(fitted), &unseen.map(points).unwrap_or_default())
}

fn over_rows(fitted: &Pairs, unseen: Option<&Pairs>, title: &str) -> Result<String, Refusal> {
    let residuals = |pairs: &Pairs| {
        let each = pairs.measured.iter().zip(&pairs.predicted).enumerate();
        each.map(|(row, (measured, predicted))| (row as f64 + 1.0, measured - predicted)).collect::<Vec<_>>()
    };
    let (fitted, unseen) = (residuals(fitted), unseen.map(residuals).unwrap_or_default());
    let values: Vec<f64> = fitted.iter().chain(&unseen).map(|(_, residual)| *residual).collect();
    let last = fitted.len().max(unseen.len()) as f64 + 1.0;
    plot(title, (0.0, last), span(values.iter()), &[(0.0, 0.0), (last, 0.0)], &fitted, &unseen)
}

/// Circles: fitted rows. Crosses: unseen rows. A grey rule shows where a perfect model would lie.
fn plot(
    title: &str,
    (left, right): (f64, f64),
    (bottom, top): (f64, f64),
    rule: &[(f64, f64)],
    fitted: &[(f64, f64)],
    unseen: &[(f64, f64)],
) -> Result<String, Refusal> {
    let failed = |error: &dyn std::fmt::Display| Refusal::new(format!("a plot cannot be drawn: {error}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, PLOT).into_drawing_area();
        area.fill(&WHITE).map_err(|error| failed(&error))?;
        let mut chart = ChartBuilder::on(&area)
            .caption(title, ("sans-serif", 15).into_font())
            .margin(10)
            .x_label_area_size(28)
            .y_label_area_size(58)
            .build_cartesian_2d(left..right, bottom..top)
            .map_err(|error| failed(&error))?;
        let label = |value: &f64| figure(Some(if value.abs() < 1e-12 * (top - bottom).abs() { 0.0 } else { *value }));
        let short = |value: &f64| {
            let text = label(value);
            if text.contains('.') && !text.contains('e') {
                text.trim_end_matches('0').trim_end_matches('.').to_string()
            } else {
                text
            }
        };
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_labels(6)
            .y_labels(6)
            .x_label_formatter(&short)
            .y_label_formatter(&short)
            .draw()
            .map_err(|error| failed(&error))?;
        chart.draw_series(LineSeries::new(rule.iter().copied(), RULE)).map_err(|error| failed(&error))?;
        chart
            .draw_series(PointSeries::of_element(fitted.iter().copied(), 3, FITTED, &|at, size, colour| {
                EmptyElement::at(at) + Circle::new((0, 0), size, colour.filled())
            }))
            .map_err(|error| failed(&error))?;
        chart
            .draw_series(PointSeries::of_element(unseen.iter().copied(), 3, UNSEEN, &|at, size, colour| {
                EmptyElement::at(at) + Cross::new((0, 0), size, colour.stroke_width(2))
            }))
            .map_err(|error| failed(&error))?;
        area.present().map_err(|error| failed(&error))?;
    }
    Ok(svg)
}

fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{}</title>\n<style>\n\
         body {{ font: 15px/1.5 sans-serif; color: #222; max-width: 1000px; margin: 2em auto; padding: 0 1em; }}\n\
         table {{ border-collapse: collapse; margin: 0.8em 0; }}\n\
         th, td {{ border: 1px solid #ccc; padding: 0.2em 0.7em; text-align: left; font-variant-numeric: tabular-nums; }}\n\
         th {{ background: #f3f3f3; font-weight: 600; }}\n\
         .plots {{ display: flex; flex-wrap: wrap; gap: 1em; }}\n</style>\n</head>\n<body>\n{body}\
         </body>\n</html>\n",
        escaped(title)
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

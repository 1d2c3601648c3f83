//! Curves before and after: whole records, the stretch that is worst, what is left over time, by frequency and by order. A switch takes each cause out of the simulation.
//!
//! In: a diagnosis. Out: figures. Decides nothing: which record, which stretch and what is simulated without a cause come from the diagnosis.

use std::fmt::Write as _;
use std::ops::Range;

use rsm_diagnose::plant::error_breakdown::Trace;
use rsm_diagnose::plant::orders::Orders;
use rsm_diagnose::plant::validation::Error;
use rsm_diagnose::plant::{Cause, Diagnosis};
use rsm_sim::kind::PlantKind;

use super::super::evidence::label;
use super::super::words;
use crate::outcome::Refusal;
use crate::page::{escaped, multiple};
use crate::plot::{self, BLACK, BLUE, GREY, Mark, ORANGE, PINK, Series, Words, decades, switched};

/// The output that is worst before any cause: its worst stretch, with a switch. Nothing where there are no curves.
pub fn summary(kind: PlantKind, found: &Diagnosis) -> Result<String, Refusal> {
    let worst = calibrated(found).iter().max_by(|a, b| a.noise_ratio.total_cmp(&b.noise_ratio));
    let shown = worst.and_then(|worst| Shown::of(found, worst.output));
    let Some(shown) = shown.or_else(|| (0..kind.outputs().len()).find_map(|output| Shown::of(found, output))) else {
        return Ok(String::new());
    };
    let y = title(kind, shown.trace.output);
    let (from, to) = (shown.trace.time[shown.trace.worst.start], shown.trace.time[shown.trace.worst.end - 1]);
    let group = format!("summary of {y}");
    let words = format!("{y}, where it is worst: {from:.3} to {to:.3} s");
    Ok(format!(
        "{}<div class=\"plots one\">\n{}</div>\n<p class=\"note\">Of {}: the rows in which the plant without a cause is worst.</p>\n",
        shown.switch(found, &group),
        shown.outputs(&group, &shown.trace.worst, &words, &y)?,
        escaped(shown.record)
    ))
}

/// The section.
pub fn section(body: &mut String, kind: PlantKind, found: &Diagnosis) -> Result<(), Refusal> {
    let breakdown = &found.error_breakdown;
    if breakdown.traces.is_empty() {
        return Ok(());
    }
    let _ = writeln!(body, "<h2>Before and after, on {}</h2>", words::judging(breakdown));
    body.push_str("<p>Of each output the record in which the plant is worst, calibrated within its tolerances: all of it, the stretch that is worst, and what is left over time. Without a cause, everything else is fitted again.</p>\n");
    for output in 0..kind.outputs().len() {
        let Some(shown) = Shown::of(found, output) else { continue };
        let trace = shown.trace;
        let signal = kind.outputs()[output];
        let y = title(kind, output);
        let _ = writeln!(body, "<h3>{} in {}</h3>", escaped(&y), escaped(shown.record));
        body.push_str(&shown.switch(found, &y));
        body.push_str("<div class=\"plots\">\n");
        let whole = 0..trace.time.len();
        body.push_str(&shown.outputs(&y, &whole, "the whole record", &y)?);
        let (from, to) = (trace.time[trace.worst.start], trace.time[trace.worst.end - 1]);
        body.push_str(&shown.outputs(&y, &trace.worst, &format!("where it is worst: {from:.3} to {to:.3} s"), &y)?);
        body.push_str(&shown.residuals(&y, &whole, "measured less simulated", &y)?);
        if let Some(spectrum) = breakdown.spectra.iter().find(|it| it.output == output) {
            let pairs = |values: &[f64]| spectrum.frequency.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
            let series = [
                Series::new("calibrated", ORANGE, Mark::Line, pairs(&spectrum.before)),
                Series::new("extended", BLUE, Mark::Line, pairs(&spectrum.after)),
                Series::new("noise", BLACK, Mark::Line, pairs(&spectrum.noise)),
            ];
            let density = format!("({})^2/Hz", signal.unit);
            let title = "what is left, by frequency";
            body.push_str(&decades(&Words { title, x: "frequency [Hz]", y: &density }, &series)?);
        }
        body.push_str("</div>\n");
    }
    let telling: Vec<&Orders> = breakdown.orders.iter().filter(|it| it.order.len() > 4).collect();
    let telling = telling.into_iter().filter(|orders| {
        let named = |list: &[rsm_diagnose::plant::regions::Region]| {
            list.iter().any(|region| region.output == orders.output && region.quantity == "order")
        };
        named(&breakdown.before) || named(&breakdown.after)
    });
    let mut any = false;
    for it in telling {
        if !any {
            body.push_str("<h3>What repeats with the motion</h3>\n<div class=\"plots\">\n");
            any = true;
        }
        body.push_str(&of_order(kind, it)?);
    }
    if any {
        body.push_str("</div>\n");
    }
    Ok(())
}

fn title(kind: PlantKind, output: usize) -> String {
    let signal = kind.outputs()[output];
    format!("{} [{}]", signal.name, signal.unit)
}

/// Errors of the calibrated plant, which has no cause yet.
fn calibrated(found: &Diagnosis) -> &[Error] {
    let first = found.steps.first().filter(|step| step.causes.is_empty());
    first.map_or(found.nominal.as_slice(), |step| step.errors.as_slice())
}

/// The points of a curve, from its values at all rows.
type Points<'a> = dyn Fn(&[f64]) -> Vec<(f64, f64)> + 'a;

/// The curves of one output in the record where it is worst.
struct Shown<'a> {
    trace: &'a Trace,
    /// The name of its record.
    record: &'a str,
    /// Where there are several causes: each of the strongest, and what the plant without it simulates.
    without: Vec<(&'a Cause, &'a [f64])>,
}

impl<'a> Shown<'a> {
    fn of(found: &'a Diagnosis, output: usize) -> Option<Self> {
        let breakdown = &found.error_breakdown;
        let records = if breakdown.unseen { &breakdown.records[1] } else { &breakdown.records[0] };
        let traces = breakdown.traces.iter().enumerate().filter(|(_, it)| it.output == output);
        let (place, trace) = traces.max_by(|a, b| a.1.error.total_cmp(&b.1.error))?;
        let record = records.get(trace.record).map_or("", |(name, _)| name.as_str());
        let without = |cause: &'a Cause| Some((cause, cause.witness.as_ref()?.without.get(place)?.as_slice()));
        // Without the only cause the plant is the calibrated one.
        let several = found.entries().count() > 1;
        let without = found.entries().filter_map(without).filter(|(_, values)| several && values.len() == trace.time.len());
        Some(Shown { trace, record, without: without.collect() })
    }

    /// Buttons: all causes, without each, without any. Nothing where no cause was found.
    fn switch(&self, found: &Diagnosis, group: &str) -> String {
        let names: Vec<String> = found.entries().map(label).collect();
        if names.is_empty() {
            return String::new();
        }
        let output = self.trace.output;
        let told = |errors: &[Error]| {
            let error = errors.iter().find(|it| it.output == output);
            error.map_or(String::new(), |it| format!("error {} times the noise", multiple(it.noise_ratio)))
        };
        let all = match names.as_slice() {
            [one] => format!("With {one}"),
            _ => "With all causes".to_string(),
        };
        let mut states = vec![(all, told(&found.extended))];
        for (cause, _) in &self.without {
            let outputs = cause.witness.iter().flat_map(|witness| &witness.outputs);
            let error =
                outputs.filter(|it| it.0 == output).map(|it| format!("error {} times the noise", multiple(it.1))).next();
            states.push((format!("Without {}", label(cause)), error.unwrap_or_default()));
        }
        let none = match names.as_slice() {
            [one] => format!("Without {one}"),
            _ => "Without any".to_string(),
        };
        states.push((none, told(calibrated(found))));
        plot::switch(group, "Simulated", &states)
    }

    /// Measured and simulated values over time.
    fn outputs(&self, group: &str, rows: &Range<usize>, title: &str, y: &str) -> Result<String, Refusal> {
        let trace = self.trace;
        let points = |values: &[f64]| rows.clone().map(|row| (trace.time[row], values[row])).collect::<Vec<_>>();
        let mut series = vec![Series::new("measured", GREY, Mark::Line, points(&trace.measured))];
        series.extend(self.simulated(&points));
        switched(Some(group), &Words { title, x: "time [s]", y }, &series)
    }

    /// Errors over time; rows that do not count are left out.
    fn residuals(&self, group: &str, rows: &Range<usize>, title: &str, y: &str) -> Result<String, Refusal> {
        let trace = self.trace;
        let points = |values: &[f64]| {
            let used = rows.clone().filter(|row| trace.used[*row]);
            used.map(|row| (trace.time[row], trace.measured[row] - values[row])).collect::<Vec<_>>()
        };
        switched(Some(group), &Words { title, x: "time [s]", y }, &self.simulated(&points))
    }

    /// What each plant simulates, in the state of the switch that has it. The still picture has the plants before and after.
    fn simulated(&self, points: &Points<'_>) -> Vec<Series> {
        let trace = self.trace;
        let none = self.without.len() + 1;
        let mut series = vec![
            Series::new("nominal", PINK, Mark::Line, points(&trace.nominal)).in_state(none),
            Series::new("calibrated", ORANGE, Mark::Line, points(&trace.before)).in_state(none),
            Series::new("extended", BLUE, Mark::Line, points(&trace.after)).in_state(0),
        ];
        for (k, (cause, values)) in self.without.iter().enumerate() {
            let name = format!("without {}", label(cause));
            series.push(Series::new(&name, ORANGE, Mark::Line, points(values)).in_state(k + 1).only_live());
        }
        series.extend(trace.corrected.as_ref().map(|it| Series::new("corrected", BLACK, Mark::Line, points(it)).in_state(0)));
        series
    }
}

fn of_order(kind: PlantKind, it: &Orders) -> Result<String, Refusal> {
    let pairs = |values: &[f64]| it.order.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
    let series = [
        Series::new("calibrated", ORANGE, Mark::Line, pairs(&it.before)),
        Series::new("extended", BLUE, Mark::Line, pairs(&it.after)),
        Series::new("noise", BLACK, Mark::Line, it.order.iter().map(|order| (*order, 1.0)).collect()),
    ];
    let (title, x) = match it.of {
        "position" => (format!("{} over the position", kind.outputs()[it.output].name), "waves per metre".to_string()),
        of => (format!("{} over the angle: {of}", kind.outputs()[it.output].name), format!("order ({of})")),
    };
    decades(&Words { title: &title, x: &x, y: "power over noise" }, &series)
}

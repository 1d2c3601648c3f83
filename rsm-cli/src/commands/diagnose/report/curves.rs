//! Curves before and after: whole records, the stretch that is worst, what is left over time, by frequency and by order.
//!
//! In: a diagnosis. Out: figures. Decides nothing: which record and which stretch comes from the diagnosis.

use std::fmt::Write as _;
use std::ops::Range;

use rsm_diagnose::plant::Diagnosis;
use rsm_diagnose::plant::error_breakdown::Trace;
use rsm_diagnose::plant::orders::Orders;
use rsm_sim::kind::PlantKind;

use super::super::words;
use crate::outcome::Refusal;
use crate::page::escaped;
use crate::plot::{BLACK, BLUE, GREY, Mark, ORANGE, PINK, Series, Words, curves, decades};

/// The section.
pub fn section(body: &mut String, kind: PlantKind, found: &Diagnosis) -> Result<(), Refusal> {
    let breakdown = &found.error_breakdown;
    if breakdown.traces.is_empty() {
        return Ok(());
    }
    let records = if breakdown.unseen { &breakdown.records[1] } else { &breakdown.records[0] };
    let _ = writeln!(body, "<h2>Before and after, on {}</h2>", words::judging(breakdown));
    body.push_str("<p>Of each output the record in which the plant is worst, calibrated within its tolerances: all of it, the stretch that is worst, and what is left over time.</p>\n");
    for output in 0..kind.outputs().len() {
        let worst = breakdown.traces.iter().filter(|it| it.output == output).max_by(|a, b| a.error.total_cmp(&b.error));
        let Some(trace) = worst else { continue };
        let signal = kind.outputs()[output];
        let y = format!("{} [{}]", signal.name, signal.unit);
        let record = records.get(trace.record).map_or("", |(name, _)| name.as_str());
        let _ = writeln!(body, "<h3>{} in {}</h3>\n<div class=\"plots\">", escaped(&y), escaped(record));
        let whole = 0..trace.time.len();
        body.push_str(&outputs(trace, &whole, "the whole record", &y)?);
        let (from, to) = (trace.time[trace.worst.start], trace.time[trace.worst.end - 1]);
        body.push_str(&outputs(trace, &trace.worst, &format!("where it is worst: {from:.3} to {to:.3} s"), &y)?);
        body.push_str(&residuals(trace, &whole, "measured less simulated", &y)?);
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

/// Measured and simulated values over time.
fn outputs(trace: &Trace, rows: &Range<usize>, title: &str, y: &str) -> Result<String, Refusal> {
    let points = |values: &[f64]| rows.clone().map(|row| (trace.time[row], values[row])).collect::<Vec<_>>();
    let mut series = vec![
        Series::new("measured", GREY, Mark::Line, points(&trace.measured)),
        Series::new("nominal", PINK, Mark::Line, points(&trace.nominal)),
        Series::new("calibrated", ORANGE, Mark::Line, points(&trace.before)),
        Series::new("extended", BLUE, Mark::Line, points(&trace.after)),
    ];
    series.extend(trace.corrected.as_ref().map(|it| Series::new("corrected", BLACK, Mark::Line, points(it))));
    curves(&Words { title, x: "time [s]", y }, &series)
}

/// Errors over time; rows that do not count are left out.
fn residuals(trace: &Trace, rows: &Range<usize>, title: &str, y: &str) -> Result<String, Refusal> {
    let points = |values: &[f64]| {
        let used = rows.clone().filter(|row| trace.used[*row]);
        used.map(|row| (trace.time[row], trace.measured[row] - values[row])).collect::<Vec<_>>()
    };
    let mut series = vec![
        Series::new("nominal", PINK, Mark::Line, points(&trace.nominal)),
        Series::new("calibrated", ORANGE, Mark::Line, points(&trace.before)),
        Series::new("extended", BLUE, Mark::Line, points(&trace.after)),
    ];
    series.extend(trace.corrected.as_ref().map(|it| Series::new("corrected", BLACK, Mark::Line, points(it))));
    curves(&Words { title, x: "time [s]", y }, &series)
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

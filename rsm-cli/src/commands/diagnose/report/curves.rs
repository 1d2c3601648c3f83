//! Curves before and after: whole records, the section with the largest error, the remaining error over time, by frequency and by order. A click
//! removes a cause from the simulation or restores it.
//!
//! In: a diagnosis. Out: figures. Decides nothing: records, sections and simulations of all combinations come from the diagnosis.

use std::fmt::Write as _;
use std::ops::Range;

use rsm_diagnose::plant::Diagnosis;
use rsm_diagnose::plant::combinations::{Combinations, Combined};
use rsm_diagnose::plant::error_breakdown::Trace;
use rsm_diagnose::plant::orders::Orders;
use rsm_sim::kind::PlantKind;

use super::super::words;
use crate::outcome::Refusal;
use crate::page::{escaped, multiple};
use crate::plot::{self, BLACK, BLUE, GREY, Mark, ORANGE, PINK, Series, Words, decades, switched};

/// The section with the largest error of the worst output before any cause, with a switch. Empty if there are no curves.
pub fn summary(kind: PlantKind, found: &Diagnosis) -> Result<String, Refusal> {
    let Some(shown) = found.worst_output().and_then(|output| Shown::of(found, output)) else { return Ok(String::new()) };
    let y = title(kind, shown.trace.output);
    let (from, to) = (shown.trace.time[shown.trace.worst.start], shown.trace.time[shown.trace.worst.end - 1]);
    let group = format!("summary of {y}");
    let words = format!("{y}, section with the largest error: {from:.3} to {to:.3} s");
    Ok(format!(
        "{}<div class=\"plots one\">\n{}</div>\n<p class=\"note\">Of {}: the rows with the largest error of the plant without a cause.</p>\n",
        shown.switch(&group),
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
    body.push_str("<p>For each output: the record with the largest error of the plant, calibrated within its tolerances. The plots show the whole record, its section with the largest error, and the residual over time. If a cause is switched off, all other parameters are fitted again.</p>\n");
    for output in 0..kind.outputs().len() {
        let Some(shown) = Shown::of(found, output) else { continue };
        let trace = shown.trace;
        let signal = kind.outputs()[output];
        let y = title(kind, output);
        let _ = writeln!(body, "<h3>{} in {}</h3>", escaped(&y), escaped(shown.record));
        body.push_str(&shown.switch(&y));
        body.push_str("<div class=\"plots\">\n");
        let whole = 0..trace.time.len();
        body.push_str(&shown.outputs(&y, &whole, "the whole record", &y)?);
        let (from, to) = (trace.time[trace.worst.start], trace.time[trace.worst.end - 1]);
        body.push_str(&shown.outputs(
            &y,
            &trace.worst,
            &format!("section with the largest error: {from:.3} to {to:.3} s"),
            &y,
        )?);
        body.push_str(&shown.residuals(&y, &whole, "measured minus simulated", &y)?);
        if let Some(spectrum) = breakdown.spectra.iter().find(|it| it.output == output) {
            let pairs = |values: &[f64]| spectrum.frequency.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
            let series = [
                Series::new("calibrated", ORANGE, Mark::Line, pairs(&spectrum.before)),
                Series::new("extended", BLUE, Mark::Line, pairs(&spectrum.after)),
                Series::new("noise", BLACK, Mark::Line, pairs(&spectrum.noise)),
            ];
            let density = format!("({})^2/Hz", signal.unit);
            let title = "residual, by frequency";
            body.push_str(&decades(&Words { title, x: "frequency [Hz]", y: &density }, &series)?);
        }
        body.push_str("</div>\n");
    }
    let mut any = false;
    for it in breakdown.significant_orders() {
        if !any {
            body.push_str("<h3>Residuals that repeat with the motion</h3>\n<div class=\"plots\">\n");
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

/// Computes the points of a curve from its values at all rows.
type Points<'a> = dyn Fn(&[f64]) -> Vec<(f64, f64)> + 'a;

/// The curves of one output in the record with its largest error.
struct Shown<'a> {
    trace: &'a Trace,
    /// The name of its record.
    record: &'a str,
    /// Its index among the traces.
    place: usize,
    combinations: &'a Combinations<Combined>,
}

impl<'a> Shown<'a> {
    fn of(found: &'a Diagnosis, output: usize) -> Option<Self> {
        let breakdown = &found.error_breakdown;
        let (place, trace) = breakdown.worst(output)?;
        let record = breakdown.evaluation_records().get(trace.record).map_or("", |(name, _)| name.as_str());
        Some(Shown { trace, record, place, combinations: &breakdown.combinations })
    }

    /// A button for each cause. Empty if no cause can be removed.
    fn switch(&self, group: &str) -> String {
        let state_text = |plant: &Option<Combined>| {
            let errors = plant.iter().flat_map(|it| &it.errors);
            let error = errors.filter(|it| it.output == self.trace.output).map(|it| multiple(it.noise_ratio)).next();
            error.map_or("cannot be simulated".to_string(), |times| format!("error {times} times the noise"))
        };
        let state_texts: Vec<String> = self.combinations.of.iter().map(state_text).collect();
        plot::switch(group, "Causes in the simulation:", &self.combinations.causes, &state_texts)
    }

    /// Measured and simulated values over time.
    fn outputs(&self, group: &str, rows: &Range<usize>, title: &str, y: &str) -> Result<String, Refusal> {
        let trace = self.trace;
        let points = |values: &[f64]| rows.clone().map(|row| (trace.time[row], values[row])).collect::<Vec<_>>();
        let mut series = vec![Series::new("measured", GREY, Mark::Line, points(&trace.measured))];
        series.extend(self.simulated(&points));
        switched(Some(group), &Words { title, x: "time [s]", y }, &series)
    }

    /// Errors over time, without the rows that the diagnosis does not use.
    fn residuals(&self, group: &str, rows: &Range<usize>, title: &str, y: &str) -> Result<String, Refusal> {
        let trace = self.trace;
        let points = |values: &[f64]| {
            let used = rows.clone().filter(|row| trace.used[*row]);
            used.map(|row| (trace.time[row], trace.measured[row] - values[row])).collect::<Vec<_>>()
        };
        switched(Some(group), &Words { title, x: "time [s]", y }, &self.simulated(&points))
    }

    /// The simulation of each plant, shown in its state of the switch. The static picture has the plants before and after.
    fn simulated(&self, points: &Points<'_>) -> Vec<Series> {
        let trace = self.trace;
        let line = |name: &str, colour, values: &[f64]| Series::new(name, colour, Mark::Line, points(values));
        let none = [line("nominal", PINK, &trace.nominal), line("calibrated", ORANGE, &trace.before)];
        let mut all = vec![line("extended", BLUE, &trace.after)];
        all.extend(trace.corrected.as_ref().map(|it| line("corrected", BLACK, it)));
        if self.combinations.causes.is_empty() {
            return none.into_iter().chain(all).collect();
        }
        let last = self.combinations.of.len() - 1;
        let mut series: Vec<Series> =
            none.into_iter().map(|it| it.in_state(0)).chain(all.into_iter().map(|it| it.in_state(last))).collect();
        for (set, plant) in self.combinations.of.iter().enumerate().take(last) {
            let values = plant.iter().filter_map(|it| it.simulated.get(self.place));
            // The combination without any cause equals the calibrated plant, which is drawn already, unless weaker causes stay in it.
            for values in values.filter(|it| **it != trace.before) {
                let names = self.combinations.names(set);
                let name =
                    if names.is_empty() { "without these causes".to_string() } else { format!("with {}", names.join(", ")) };
                series.push(line(&name, ORANGE, values).in_state(set).only_live());
            }
        }
        series
    }
}

fn of_order(kind: PlantKind, orders: &Orders) -> Result<String, Refusal> {
    let pairs = |values: &[f64]| orders.order.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
    let series = [
        Series::new("calibrated", ORANGE, Mark::Line, pairs(&orders.before)),
        Series::new("extended", BLUE, Mark::Line, pairs(&orders.after)),
        Series::new("noise", BLACK, Mark::Line, orders.order.iter().map(|order| (*order, 1.0)).collect()),
    ];
    let (title, x) = match orders.of {
        "position" => (format!("{} over the position", kind.outputs()[orders.output].name), "waves per metre".to_string()),
        of => (format!("{} over the angle: {of}", kind.outputs()[orders.output].name), format!("order ({of})")),
    };
    decades(&Words { title: &title, x: &x, y: "power divided by noise" }, &series)
}

//! The page of a diagnosis.
//!
//! In: a diagnosis and the record on which it is shown. Out: one self-contained HTML page. Decides nothing: every figure comes from the diagnosis.

use std::fmt::Write as _;

use rsm_lab::diagnosis::{Diagnosis, Verdict};
use rsm_lab::kind::PlantKind;
use rsm_lab::record::Record;

use crate::outcome::Refusal;
use crate::page::{escaped, figure, page};
use crate::plot::{BLUE, GREY, Mark, ORANGE, Series, Words, curves};

/// The whole page. `shown` is the record of [`Diagnosis::before_after`], `refitted` what a refit has to say.
pub fn html(kind: PlantKind, found: &Diagnosis, shown: Option<&Record>, refitted: &[String]) -> Result<String, Refusal> {
    let mut body = format!("<h1>Diagnosis of a {}: {}</h1>\n<p>{}</p>\n", kind.name(), found.verdict.name(), verdict(found));
    causes(&mut body, found);
    if let Some(sentence) = super::next::sentence(found) {
        let _ = write!(body, "<h2>What to measure next</h2>\n<p>{}</p>\n", escaped(&sentence));
    }
    if !refitted.is_empty() {
        let lines: String = refitted.iter().map(|line| format!("<p>{}</p>\n", escaped(line))).collect();
        let _ = write!(
            body,
            "<h2>The controller, refitted</h2>\n{lines}<p>Its surfaces and evaluators stand in the folder <code>refit</code>.</p>\n"
        );
    }
    errors(&mut body, kind, found);
    regions(&mut body, kind, found);
    if let Some(record) = shown {
        plots(&mut body, kind, found, record)?;
    }
    data(&mut body, kind, found);
    Ok(page(&format!("Diagnosis: {}", found.verdict.name()), &body))
}

fn verdict(found: &Diagnosis) -> String {
    let gain = format!("{:.1} % of the error above the noise is gone on the records shown below", 100.0 * found.gain);
    match found.verdict {
        Verdict::NoDiscrepancy => {
            "With its parameters moved inside their tolerances, the simulation leaves noise and nothing else.".to_string()
        }
        Verdict::Explained => format!("The causes below leave noise and nothing else: {gain}."),
        Verdict::Unexplained => format!(
            "Structure is left that no entry of the catalogue explains: {:.0} % of the energy of the noise, beyond it. What is named below helps: {gain}.",
            100.0 * found.left.excess
        ),
    }
}

fn causes(body: &mut String, found: &Diagnosis) {
    for cause in &found.causes {
        let _ = write!(body, "<h2>{}</h2>\n<p>{} ", escaped(cause.kind), escaped(&cause.sentence));
        let _ = write!(
            body,
            "Without it the squared residual is larger by {} (in units of the noise); {} is what chance and worth ask of a cause. Confidence {:.2}.",
            figure(Some(cause.gain)),
            figure(Some(found.threshold)),
            cause.confidence
        );
        for (rival, behind) in cause.rivals.iter().take(3) {
            let _ = write!(body, " In its place {} does worse by {}.", escaped(rival), figure(Some(*behind)));
        }
        if !cause.indistinguishable_from.is_empty() {
            let names = cause.indistinguishable_from.join(", ");
            let _ = write!(body, " <b>These records do not tell it from {}.</b>", escaped(&names));
        }
        body.push_str("</p>\n<table><tr><th>parameter</th><th>value</th><th>95 % interval</th><th>unit</th></tr>\n");
        for it in &cause.parameters {
            let _ = writeln!(
                body,
                "<tr><td>{}</td><td>{}</td><td>{} to {}</td><td>{}</td></tr>",
                it.name,
                figure(Some(it.value)),
                figure(Some(it.low)),
                figure(Some(it.high)),
                escaped(&it.unit)
            );
        }
        body.push_str("</table>\n");
    }
    if !found.ranking.is_empty() {
        body.push_str("<h2>What the screen of the catalogue promised</h2>\n<table><tr><th>hypothesis</th><th>gain, first order</th></tr>\n");
        for (label, gain) in found.ranking.iter().take(10) {
            let _ = writeln!(body, "<tr><td>{}</td><td>{}</td></tr>", escaped(label), figure(Some(*gain)));
        }
        body.push_str("</table>\n");
    }
}

fn errors(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    body.push_str(
        "<h2>Errors on unseen records</h2>\n<table><tr><th>output</th><th>nominal r.m.s.</th><th>over noise</th>\
         <th>extended r.m.s.</th><th>over noise</th></tr>\n",
    );
    for (before, after) in found.nominal.iter().zip(&found.extended) {
        let signal = kind.outputs()[before.output];
        let _ = writeln!(
            body,
            "<tr><td>{} [{}]</td><td>{}</td><td>{:.2}</td><td>{}</td><td>{:.2}</td></tr>",
            signal.name,
            signal.unit,
            figure(Some(before.rmse)),
            before.noise_ratio,
            figure(Some(after.rmse)),
            after.noise_ratio
        );
    }
    body.push_str("</table>\n");
}

fn regions(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    body.push_str("<h2>Where the nominal plant is wrong</h2>\n<table><tr><th>output</th><th>where</th><th>share of the error</th><th>share of the rows</th></tr>\n");
    for it in &found.regions {
        let name = kind.outputs()[it.output].name;
        let shares = (100.0 * it.share_of_error, 100.0 * it.share_of_rows);
        let _ = writeln!(
            body,
            "<tr><td>{name}</td><td>{}</td><td>{:.0} %</td><td>{:.0} %</td></tr>",
            it.region, shares.0, shares.1
        );
    }
    body.push_str("</table>\n");
}

fn plots(body: &mut String, kind: PlantKind, found: &Diagnosis, record: &Record) -> Result<(), Refusal> {
    body.push_str("<h2>Before and after</h2>\n<div class=\"plots\">\n");
    for (output, before, after) in &found.before_after {
        let Some(measured) = &record.measured[*output] else { continue };
        let signal = kind.outputs()[*output];
        let points = |values: &[f64]| -> Vec<(f64, f64)> {
            record.time.iter().zip(measured).zip(values).map(|((time, measured), value)| (*time, measured - value)).collect()
        };
        let plain: Vec<(f64, f64)> = record.time.iter().copied().zip(measured.iter().copied()).collect();
        let y = format!("{} [{}]", signal.name, signal.unit);
        let words = Words { title: "measured", x: "time [s]", y: &y };
        body.push_str(&curves(&words, &[Series::new("measured", GREY, Mark::Line, plain)])?);
        let words = Words { title: "measured less simulated", x: "time [s]", y: &y };
        let series = [
            Series::new("nominal", ORANGE, Mark::Line, points(before)),
            Series::new("extended", BLUE, Mark::Line, points(after)),
        ];
        body.push_str(&curves(&words, &series)?);
    }
    body.push_str("</div>\n");
    Ok(())
}

fn data(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    body.push_str("<h2>Data and noise</h2>\n<p>");
    for (output, sd, correlation) in &found.noise {
        let signal = kind.outputs()[*output];
        let _ = write!(
            body,
            "{}: noise of {} {}, correlation from row to row {correlation:.2}. ",
            signal.name,
            figure(Some(*sd)),
            escaped(signal.unit)
        );
    }
    body.push_str("</p>\n<ul>\n");
    for it in &found.findings {
        let _ = writeln!(
            body,
            "<li>{}: {} {}, data rows {} to {}, left out</li>",
            escaped(&it.record),
            escaped(&it.channel),
            it.what,
            it.rows.0 + 1,
            it.rows.1 + 1
        );
    }
    body.push_str("</ul>\n");
}

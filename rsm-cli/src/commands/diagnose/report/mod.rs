//! The report of a diagnosis. It needs no other document to be understood.
//!
//! In: a diagnosis. Out: one self-contained HTML page: the verdict, faults of the data, the causes with their evidence, the extended parameters, the
//! regions with a large error, curves before and after, the remaining error. Decides nothing: every figure comes from the diagnosis.

mod curves;
mod law;
mod where_wrong;

use std::fmt::Write as _;

use rsm_diagnose::plant::correction::CorrectionResult;
use rsm_diagnose::plant::error_breakdown::ErrorBreakdown;
use rsm_diagnose::plant::validation::{Error, worst};
use rsm_diagnose::plant::{Cause, Diagnosis, Verdict};
use rsm_sim::kind::PlantKind;

use super::equations;
use super::evidence;
use super::next;
use super::words;
use crate::outcome::Refusal;
use crate::page::summary::{self, Number, Tone};
use crate::page::{escaped, known, multiple, page, short};

/// The number of causes with full evidence.
const CAUSES_WITH_EVIDENCE: usize = 3;

/// The number of lines of the ranking.
const RANKING_LINES: usize = 12;

/// The whole page. `refitted`: the sentences of a refit.
pub fn html(kind: PlantKind, found: &Diagnosis, refitted: &[String]) -> Result<String, Refusal> {
    let title = format!("Diagnosis of a {}: {}", kind.name(), found.verdict.name());
    let mut body = format!("<h1>{title}</h1>\n");
    body.push_str(&verdict_and_numbers(kind, found));
    body.push_str(&curves::summary(kind, found)?);
    data(&mut body, found);
    law::section(&mut body, found)?;
    causes(&mut body, kind, found);
    if found.verdict == Verdict::Unexplained {
        remaining_error(&mut body, kind, found);
    }
    next_record(&mut body, found);
    parameters(&mut body, found);
    refit(&mut body, refitted);
    errors(&mut body, kind, found);
    where_wrong::section(&mut body, kind, found);
    curves::section(&mut body, kind, found)?;
    ranking(&mut body, found);
    Ok(page(&title, &body))
}

/// The verdict and three numbers.
fn verdict_and_numbers(kind: PlantKind, found: &Diagnosis) -> String {
    let tone = match found.verdict {
        Verdict::NoDiscrepancy | Verdict::Explained => Tone::Good,
        Verdict::Unexplained => Tone::Bad,
    };
    let state = match found.verdict {
        Verdict::NoDiscrepancy => "no error found",
        Verdict::Explained => "explained",
        Verdict::Unexplained => "not explained",
    };
    let worst = |errors: &[Error]| worst(errors).map_or(0.0, |it| it.noise_ratio);
    let judging = words::judging(&found.error_breakdown);
    let mut numbers = Vec::new();
    if found.verdict == Verdict::NoDiscrepancy {
        numbers.push(Number::new(
            "Worst output",
            format!("{} × noise", multiple(worst(&found.extended))),
            format!("on {judging}"),
        ));
        if let Some(it) = found.moved_most() {
            let moved = format!("{:.1} σ", it.sds.abs());
            numbers.push(Number::new("Largest change within a tolerance", moved, format!("of {} (2 σ are allowed)", it.name)));
        }
        let rows: usize = found.error_breakdown.records.iter().flatten().map(|(_, rows)| rows).sum();
        numbers.push(Number::new("Rows compared", rows.to_string(), "in all records"));
    } else {
        let ((gain, (low, high)), on) = match &found.tested {
            Some(it) => ((it.gain, it.gain_interval), "on test records, which were not used before".to_string()),
            None => ((found.gain, found.gain_interval), format!("on {judging}")),
        };
        let from = format!("{on}; 95 % interval {:.1} to {:.1} %", 100.0 * low, 100.0 * high);
        numbers.push(Number::new("Removed error above the noise", percent(gain, high - low), from));
        let moved = format!("{} → {} × noise", multiple(worst(&found.nominal)), multiple(worst(&found.extended)));
        numbers.push(Number::new("Worst output", moved, format!("plant file, then with what was found, on {judging}")));
        match found.entries().next() {
            _ if found.law.is_some() => numbers.extend(law::number(found)),
            Some(cause) => {
                let probability = [cause.confidence, cause.confidence_of_any];
                let (equals, more) = (cause.indistinguishable_from.len(), found.entries().count() - 1);
                numbers.push(Number::confidence(&cause.label(), probability, equals, more));
            }
            None => numbers.push(Number::new("Causes", "none", "of the catalogue reduces the error")),
        }
    }
    summary::verdict(tone, state, &words::verdict(kind, found)) + &summary::numbers(&numbers)
}

/// A share in per cent with as many decimals as its interval supports.
fn percent(share: f64, width: f64) -> String {
    let decimals = crate::page::number::decimals(50.0 * width, 100.0).min(2);
    format!("{:.*} %", decimals, 100.0 * share)
}

/// The records of the comparison, and faults of their data.
fn data(body: &mut String, found: &Diagnosis) {
    let list = |records: &[(String, usize)]| -> String {
        let each: Vec<String> = records.iter().map(|(name, rows)| format!("{} ({rows} rows)", escaped(name))).collect();
        each.join(", ")
    };
    let [training, unseen] = &found.error_breakdown.records;
    body.push_str("<h2>What was compared</h2>\n<p>The simulation of the plant file, free running, against ");
    if unseen.is_empty() {
        let _ = write!(body, "{}. There is no validation record: all figures below are those of the fit.", list(training));
    } else {
        let _ = write!(
            body,
            "{} (training: causes and parameters are estimated from these), and {} (validation: no parameter is estimated from these, but they take part in the choice of causes). The figures below are those of the validation records.",
            list(training),
            list(unseen)
        );
    }
    if let Some(tested) = &found.tested {
        let files: Vec<String> = tested.files.iter().map(|name| escaped(name)).collect();
        let _ = write!(body, " Test records, used only for the final figures: {}.", files.join(", "));
    }
    body.push_str("</p>\n");
    for it in &found.units {
        let _ = writeln!(body, "<p><b>A column in another unit.</b> {}.</p>", escaped(&it.to_string()));
    }
    if let Some(it) = &found.unused_rows {
        let _ = writeln!(body, "<p>{it}.</p>");
    }
    if let Some(it) = &found.all_rows {
        let _ = writeln!(body, "<p>{}.</p>", escaped(&it.to_string()));
    }
    for it in &found.filled_gaps {
        let _ = writeln!(body, "<p>{}: {}.</p>", escaped(&it.record), words::bridged(it));
    }
    if found.findings.is_empty() {
        body.push_str(
            "<p>No fault was found in the data: no channel is stuck, is clipped or jumps, and no row occurs twice.</p>\n",
        );
        return;
    }
    body.push_str("<p><b>What is wrong with the data.</b> All figures below leave these rows out, and swapped columns are exchanged. Correct the measurement first.</p>\n<table><tr><th>record</th><th>channel</th><th>what</th><th>data rows</th></tr>\n");
    for it in &found.findings {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{} to {}</td></tr>",
            escaped(&it.record),
            escaped(&it.channel),
            it.what,
            it.rows.0 + 1,
            it.rows.1 + 1
        );
    }
    body.push_str("</table>\n");
}

fn causes(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    listed(body, kind, found, "Causes, the strongest first", &found.causes);
    listed(body, kind, found, "Effects that reduce the error, but are not confirmed causes", &found.helpers);
    let claims: Vec<String> = found.claims.iter().map(words::claim).collect();
    list(body, "Effects of the plant file", &claims);
    let refused: Vec<String> = found.refused.iter().map(|it| format!("{}: {}.", it.cause, it.why)).collect();
    list(body, "Tried and rejected", &refused);
    if let Some(screen) = &found.equations {
        let sentences = equations::sentences(screen);
        if !sentences.is_empty() {
            let _ = writeln!(
                body,
                "<h3>Prediction errors</h3>\n<p>A Kalman filter of the plant follows the records: the readings correct its states at every row. Its prediction errors ({}) are computed on holdout blocks of rows. \
                 Calibration leaves {:.2} %. The search also tries these terms in free-running simulations, beside all other causes. They are candidates, not results.</p>",
                escaped(&screen.equations.join(", ")),
                100.0 * screen.calibrated
            );
            list(body, "Terms, in the order in which they were chosen", &sentences);
        }
    }
}

fn listed(body: &mut String, kind: PlantKind, found: &Diagnosis, heading: &str, causes: &[Cause]) {
    if causes.is_empty() {
        return;
    }
    let _ = writeln!(body, "<h2>{heading}</h2>");
    for (number, cause) in causes.iter().enumerate() {
        let _ = write!(
            body,
            "<h3>{}. {}</h3>\n<p>{} Confidence {:.2}.",
            number + 1,
            escaped(&cause.label()),
            escaped(&cause.sentence),
            cause.confidence
        );
        if !cause.indistinguishable_from.is_empty() {
            let names = cause.indistinguishable_from.join(", ");
            let _ = write!(
                body,
                " <b>These records do not distinguish it from {}: one of them is enough. Confidence that one of these is right: {:.2}.</b>",
                escaped(&names),
                cause.confidence_of_any
            );
        }
        body.push_str("</p>\n");
        if number < CAUSES_WITH_EVIDENCE {
            let evidence = evidence::of(kind, found, cause);
            body.push_str("<div class=\"columns\">\n<div>\n");
            list(body, "For it", &evidence.supports);
            body.push_str("</div>\n<div>\n");
            list(body, "Against it", &evidence.speaks_against);
            if evidence.speaks_against.is_empty() {
                body.push_str("<p>These records show no evidence against it.</p>\n");
            }
            body.push_str("</div>\n</div>\n");
        }
        let _ = writeln!(body, "<p><b>Check:</b> {}</p>", escaped(cause.check));
    }
}

/// The record that would distinguish the causes.
fn next_record(body: &mut String, found: &Diagnosis) {
    if let Some(sentence) = next::sentence(found) {
        let _ = write!(body, "<h2>What to measure next</h2>\n<p>{}</p>\n", escaped(&sentence));
    }
}

fn refit(body: &mut String, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    body.push_str("<h2>The controller, refitted</h2>\n");
    for line in lines {
        let _ = writeln!(body, "<p>{}</p>", escaped(line));
    }
    body.push_str("<p>Its surfaces and evaluators are in the folder <code>refit</code>.</p>\n");
}

fn list(body: &mut String, title: &str, sentences: &[String]) {
    if sentences.is_empty() {
        return;
    }
    let _ = writeln!(body, "<p><b>{title}</b></p>\n<ul>");
    for sentence in sentences {
        let _ = writeln!(body, "<li>{}</li>", escaped(sentence));
    }
    body.push_str("</ul>\n");
}

/// The unexplained error, and its black-box correction.
fn remaining_error(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    body.push_str("<h2>Error that the catalogue does not explain</h2>\n");
    if let Some(limit) = found.stopped {
        let _ = writeln!(body, "<p>The search stopped {limit}: its result may be incomplete or wrong.</p>");
    }
    let error_breakdown = &found.error_breakdown;
    if error_breakdown.after.is_empty() {
        body.push_str("<p>The remaining error is spread over all regions.</p>\n");
    } else {
        body.push_str("<p>The remaining error of the extended plant above the noise is in these regions:</p>\n");
        where_wrong::table(body, kind, &error_breakdown.after);
    }
    match &error_breakdown.correction {
        None => {}
        Some(CorrectionResult::NoGain { gain }) => {
            let _ = writeln!(
                body,
                "<p>A black-box response surface of the remaining error, over inputs and simulated quantities, gains nothing on {} ({:.0} % of the error above \
                 noise): the remaining error does not depend on these quantities alone. There is no correction.</p>",
                words::judging(error_breakdown),
                100.0 * gain
            );
        }
        Some(CorrectionResult::Useful(correction)) => {
            let _ = writeln!(
                body,
                "<p><b>A black-box correction</b> is in correction.toml. It is not an explanation, and it is valid only in the range of the records. Added to the output that the \
                 extended plant simulates, it removes {:.0} % of the remaining error above the noise on {} (at least {:.0} %, one-sided 95 %).</p>",
                100.0 * correction.gain,
                words::judging(error_breakdown),
                100.0 * correction.low
            );
            body.push_str(
                "<table><tr><th>output</th><th>surface</th><th>over</th><th>terms</th><th>error over noise without</th><th>with</th></tr>\n",
            );
            for it in &correction.outputs {
                let _ = writeln!(
                    body,
                    "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{:.2}</td>\
                     <td class=\"number\">{:.2}</td></tr>",
                    kind.outputs()[it.output].name,
                    it.surface,
                    escaped(&it.inputs.join(", ")),
                    it.terms.len(),
                    it.before,
                    it.after
                );
            }
            body.push_str("</table>\n");
        }
    }
}

/// The numbers of the extended plant: those of causes with intervals, calibrated ones with their tolerances.
fn parameters(body: &mut String, found: &Diagnosis) {
    let error_breakdown: &ErrorBreakdown = &found.error_breakdown;
    if found.causes.is_empty() && found.helpers.is_empty() && error_breakdown.calibration.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Parameters of the extended plant</h2>\n<p>They are in extended.toml; <code>rsm simulate</code> runs it.</p>\n\
         <table><tr><th>of</th><th>parameter</th><th>unit</th><th>plant file</th><th>now</th><th>95 % interval, or move within tolerance</th></tr>\n",
    );
    let mut row = |of: &str, name: &str, unit: &str, was: &str, is: &str, note: &str| {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"number\">{was}</td><td class=\"number\">{}</td><td>{note}</td></tr>",
            escaped(of),
            escaped(name),
            escaped(unit),
            is
        );
    };
    // A cause that acts in one record only is not part of the extended plant.
    for cause in found.causes.iter().chain(&found.helpers).filter(|it| it.only_in.is_none()) {
        for it in &cause.parameters {
            let half = 0.5 * (it.high - it.low);
            let interval = format!("{} to {}", known(it.low, half), known(it.high, half));
            let note = if !it.is_determined() {
                "not determined by these records".to_string()
            } else if it.high > it.low {
                interval
            } else {
                "not estimated".to_string()
            };
            row(&cause.label(), it.name, &it.unit, &words::before(found, cause), &known(it.value, half), &note);
        }
    }
    for it in &error_breakdown.calibration {
        let note = format!("{:+.1} standard deviations of its tolerance (2 are allowed)", it.sds);
        let is = known(it.value, 0.5 * (it.high - it.low));
        row("calibration", it.name, it.unit, &format!("{}", it.nominal), &is, &note);
    }
    body.push_str("</table>\n");
}

fn errors(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    let _ = write!(
        body,
        "<h2>Errors and noise</h2>\n<p>Root mean square errors on {}. The noise level is estimated from the records themselves: the residual at high frequencies, \
         extrapolated to low frequencies. No simulation can be better than 1.00 times the noise.</p>\n\
         <table><tr><th>output</th><th>noise</th><th>from row to row</th><th>nominal</th><th>over noise</th><th>extended</th><th>over noise</th></tr>\n",
        words::judging(&found.error_breakdown)
    );
    for (before, after) in found.nominal.iter().zip(&found.extended) {
        let signal = kind.outputs()[before.output];
        let noise = found.noise.iter().find(|(k, _, _)| *k == before.output);
        let (sd, correlation) = noise.map_or((None, String::new()), |(_, sd, correlation)| {
            let words = if *correlation == 0.0 { "white".to_string() } else { format!("correlation {correlation:.2}") };
            (Some(*sd), words)
        });
        let _ = writeln!(
            body,
            "<tr><td>{} [{}]</td><td class=\"number\">{}</td><td>{correlation}</td><td class=\"number\">{}</td><td class=\"number\">{}</td>\
             <td class=\"number\">{}</td><td class=\"number\">{}</td></tr>",
            signal.name,
            escaped(signal.unit),
            sd.map_or("none".to_string(), short),
            short(before.rmse),
            multiple(before.noise_ratio),
            short(after.rmse),
            multiple(after.noise_ratio)
        );
    }
    body.push_str("</table>\n");
}

fn ranking(body: &mut String, found: &Diagnosis) {
    let rejected = found.rejected();
    if rejected.is_empty() {
        return;
    }
    let _ = write!(
        body,
        "<h2>Rejected hypotheses</h2>\n<p>Gains are squared errors in units of the noise. A cause needs at least {:.0} (significance and effect size). The gains \
         are those of first order.</p>\n\
         <table><tr><th>hypothesis</th><th>gain in the screening</th><th>gain with the causes included</th><th>reason</th></tr>\n",
        found.threshold
    );
    for it in rejected.iter().take(RANKING_LINES) {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td>{}</td></tr>",
            escaped(&it.label),
            rounded(Some(it.predicted_gain)),
            rounded(it.remaining),
            escaped(&evidence::why(found, &it.why))
        );
    }
    body.push_str("</table>\n");
    if rejected.len() > RANKING_LINES {
        let _ = writeln!(body, "<p class=\"note\">{} more had a smaller first-order gain.</p>", rejected.len() - RANKING_LINES);
    }
}

/// A gain without decimals, because gains are in the thousands.
fn rounded(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| format!("{value:.0}"))
}

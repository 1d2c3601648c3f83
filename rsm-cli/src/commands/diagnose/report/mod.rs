//! The page of a diagnosis. Its reader is an engineer who has read nothing else.
//!
//! In: a diagnosis. Out: one self-contained HTML page: the verdict, what is wrong with the data, the causes with their evidence, the extended parameters, where
//! the plant is wrong, curves before and after, what is left. Decides nothing: every figure comes from the diagnosis.

mod curves;
mod where_wrong;

use std::fmt::Write as _;

use rsm_diagnose::plant::correction::Offer;
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

/// Causes whose evidence is told in full.
const CLOSELY: usize = 3;

/// Lines of the ranking.
const RANKED: usize = 12;

/// The whole page. `refitted` is what a refit has to say.
pub fn html(kind: PlantKind, found: &Diagnosis, refitted: &[String]) -> Result<String, Refusal> {
    let title = format!("Diagnosis of a {}: {}", kind.name(), found.verdict.name());
    let mut body = format!("<h1>{title}</h1>\n");
    body.push_str(&in_short(kind, found));
    body.push_str(&curves::summary(kind, found)?);
    data(&mut body, found);
    causes(&mut body, kind, found);
    if found.verdict == Verdict::Unexplained {
        left(&mut body, kind, found);
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
fn in_short(kind: PlantKind, found: &Diagnosis) -> String {
    let tone = match found.verdict {
        Verdict::NoDiscrepancy | Verdict::Explained => Tone::Good,
        Verdict::Unexplained => Tone::Bad,
    };
    let state = match found.verdict {
        Verdict::NoDiscrepancy => "the simulation holds",
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
            numbers.push(Number::new("Largest move within a tolerance", moved, format!("of {} (2 σ are allowed)", it.name)));
        }
        let rows: usize = found.error_breakdown.records.iter().flatten().map(|(_, rows)| rows).sum();
        numbers.push(Number::new("Rows compared", rows.to_string(), "in all records"));
    } else {
        let ((gain, (low, high)), on) = match &found.tested {
            Some(it) => ((it.gain, it.gain_interval), "on test records, which nothing has seen before".to_string()),
            None => ((found.gain, found.gain_interval), format!("on {judging}")),
        };
        let from = format!("{on}; 95 % interval {:.1} to {:.1} %", 100.0 * low, 100.0 * high);
        numbers.push(Number::new("Error beyond the noise that is gone", percent(gain, high - low), from));
        let moved = format!("{} → {} × noise", multiple(worst(&found.nominal)), multiple(worst(&found.extended)));
        numbers.push(Number::new("Worst output", moved, format!("plant file, then with what was found, on {judging}")));
        match found.entries().next() {
            Some(cause) => {
                let probability = [cause.confidence, cause.confidence_of_any];
                let (equals, more) = (cause.indistinguishable_from.len(), found.entries().count() - 1);
                numbers.push(Number::confidence(&cause.label(), probability, equals, more));
            }
            None => numbers.push(Number::new("Causes", "none", "of the catalogue helps")),
        }
    }
    summary::verdict(tone, state, &words::verdict(kind, found)) + &summary::numbers(&numbers)
}

/// A share in per cent with as many decimals as its interval supports.
fn percent(share: f64, width: f64) -> String {
    let decimals = crate::page::number::decimals(50.0 * width, 100.0).min(2);
    format!("{:.*} %", decimals, 100.0 * share)
}

/// What was compared, and what is wrong with it.
fn data(body: &mut String, found: &Diagnosis) {
    let list = |records: &[(String, usize)]| -> String {
        let each: Vec<String> = records.iter().map(|(name, rows)| format!("{} ({rows} rows)", escaped(name))).collect();
        each.join(", ")
    };
    let [training, unseen] = &found.error_breakdown.records;
    body.push_str("<h2>What was compared</h2>\n<p>The simulation of the plant file, free running, against ");
    if unseen.is_empty() {
        let _ = write!(body, "{}. No record was kept for validation: every figure below is one of the fit.", list(training));
    } else {
        let _ = write!(
            body,
            "{}, from which causes and numbers were found, and {}, from which no number was estimated, and by which causes were chosen, too: figures below are of these, the records that chose it.",
            list(training),
            list(unseen)
        );
    }
    if let Some(tested) = &found.tested {
        let files: Vec<String> = tested.files.iter().map(|name| escaped(name)).collect();
        let _ = write!(body, " Nothing has seen the test records before the last figures: {}.", files.join(", "));
    }
    body.push_str("</p>\n");
    for it in &found.units {
        let _ = writeln!(body, "<p><b>A column in another unit.</b> {}.</p>", escaped(&it.to_string()));
    }
    if let Some(it) = &found.not_seen {
        let _ = writeln!(body, "<p>{it}.</p>");
    }
    if let Some(it) = &found.everywhere {
        let _ = writeln!(body, "<p>{}.</p>", escaped(&it.to_string()));
    }
    for it in &found.bridged {
        let _ = writeln!(body, "<p>{}: {}.</p>", escaped(&it.record), words::bridged(it));
    }
    if found.findings.is_empty() {
        body.push_str("<p>The data are in order: no channel hangs, is clipped or jumps, no row stands twice.</p>\n");
        return;
    }
    body.push_str("<p><b>What is wrong with the data.</b> These rows are left out of every figure below, and swapped columns are put right; mend the measurement first.</p>\n<table><tr><th>record</th><th>channel</th><th>what</th><th>data rows</th></tr>\n");
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
    listed(body, kind, found, "What helps, and is not sure to be a cause", &found.helpers);
    let claims: Vec<String> = found.claims.iter().map(words::claim).collect();
    list(body, "Effects of the plant file", &claims);
    let refused: Vec<String> = found.refused.iter().map(|it| format!("{}: {}.", it.cause, it.why)).collect();
    list(body, "Tried and refused", &refused);
    if let Some(said) = &found.equations {
        let sentences = equations::sentences(said);
        if !sentences.is_empty() {
            let _ = writeln!(
                body,
                "<h3>What the equations say</h3>\n<p>Along the recorded signals, without a simulation: what each equation ({}) misses, judged on blocks of rows that gave no number. \
                 Calibration leaves {:.2} %. The search asked them in a free run beside all others; they are no answer.</p>",
                escaped(&said.equations.join(", ")),
                100.0 * said.calibrated
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
                " <b>In these records it is the same as {}: one of them is enough. Confidence that one of these is right: {:.2}.</b>",
                escaped(&names),
                cause.confidence_of_any
            );
        }
        body.push_str("</p>\n");
        if number < CLOSELY {
            let evidence = evidence::of(kind, found, cause);
            body.push_str("<div class=\"columns\">\n<div>\n");
            list(body, "For it", &evidence.supports);
            body.push_str("</div>\n<div>\n");
            list(body, "Against it", &evidence.speaks_against);
            if evidence.speaks_against.is_empty() {
                body.push_str("<p>Against it nothing was found in these records.</p>\n");
            }
            body.push_str("</div>\n</div>\n");
        }
        let _ = writeln!(body, "<p><b>To be sure:</b> {}</p>", escaped(cause.check));
    }
}

/// The record that would tell causes apart.
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
    body.push_str("<p>Its surfaces and evaluators stand in the folder <code>refit</code>.</p>\n");
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

/// What nothing explains, and the black box over it.
fn left(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    body.push_str("<h2>What nothing in the catalogue explains</h2>\n");
    if let Some(limit) = found.stopped {
        let _ = writeln!(body, "<p>The search stopped {limit}: what it found may not be all, or not be right.</p>");
    }
    let error_breakdown = &found.error_breakdown;
    if error_breakdown.after.is_empty() {
        body.push_str("<p>What is left is spread too thin to have a place.</p>\n");
    } else {
        body.push_str("<p>What the extended plant still gets wrong beyond the noise lies here:</p>\n");
        where_wrong::table(body, kind, &error_breakdown.after);
    }
    match &error_breakdown.correction {
        None => {}
        Some(Offer::Nothing { gain }) => {
            let _ = writeln!(
                body,
                "<p>A black-box response surface of what is left, over what is simulated and what drives it, gains nothing on {} ({:.0} % of the error beyond \
                 noise): what is left does not hang on these quantities alone. No correction is offered.</p>",
                words::judging(error_breakdown),
                100.0 * gain
            );
        }
        Some(Offer::Gains(correction)) => {
            let _ = writeln!(
                body,
                "<p><b>A black-box correction</b> stands in correction.toml: it is no explanation, and holds only where the records went. Added to what the \
                 extended plant simulates, it removes {:.0} % of the error beyond noise that is left on {} (at least {:.0} %, one-sided 95 %).</p>",
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

/// The numbers of the extended plant: those of causes with intervals, calibrated ones with their tolerance.
fn parameters(body: &mut String, found: &Diagnosis) {
    let error_breakdown: &ErrorBreakdown = &found.error_breakdown;
    if found.causes.is_empty() && found.helpers.is_empty() && error_breakdown.calibration.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Parameters of the extended plant</h2>\n<p>extended.toml holds them; <code>rsm simulate</code> runs it.</p>\n\
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
    // What acts in one record alone is none of the plant's.
    for cause in found.causes.iter().chain(&found.helpers).filter(|it| it.only_in.is_none()) {
        for it in &cause.parameters {
            let half = 0.5 * (it.high - it.low);
            let interval = format!("{} to {}", known(it.low, half), known(it.high, half));
            let note = if it.high > it.low { interval } else { "not estimated".to_string() };
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
        "<h2>Errors and noise</h2>\n<p>Root mean square errors on {}. The noise is estimated from the records themselves: what is left at high frequencies, \
         continued downwards. 1.00 times the noise is as good as a simulation can be.</p>\n\
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
        "<h2>What was not believed, and why</h2>\n<p>Gains are squared errors in units of the noise; {:.0} is what chance and worth ask of a cause. The first \
         column is what the catalogue's screen promised in first order.</p>\n\
         <table><tr><th>hypothesis</th><th>promised</th><th>with the causes in</th><th>why not</th></tr>\n",
        found.threshold
    );
    for it in rejected.iter().take(RANKED) {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td>{}</td></tr>",
            escaped(&it.label),
            rounded(Some(it.promised)),
            rounded(it.remaining),
            escaped(&evidence::why(found, &it.why))
        );
    }
    body.push_str("</table>\n");
    if rejected.len() > RANKED {
        let _ = writeln!(body, "<p class=\"note\">{} more promised less.</p>", rejected.len() - RANKED);
    }
}

/// Gains are counts of thousands: one decimal says too much already.
fn rounded(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| format!("{value:.0}"))
}

//! The page of a diagnosis of surfaces.
//!
//! In: a model, new data, a diagnosis. Out: one self-contained HTML page: first the causes and what to do about them, then the evidence. Decides
//! nothing: every figure comes from the diagnosis.

mod plots;

use std::fmt::Write as _;

use rsm_core::model::{Model, Surface};
use rsm_diagnose::surface::causes::Cause;
use rsm_diagnose::surface::data::NewData;
use rsm_diagnose::surface::regions::Region;
use rsm_diagnose::surface::{Diagnosis, ResponseDiagnosis, Verdict};

use super::surface::{runs, told};
use crate::outcome::Refusal;
use crate::page::summary::{self, Number, Tone};
use crate::page::{escaped, known, page, short};

/// The whole page.
pub fn html(model: &Model, data: &NewData, found: &Diagnosis) -> Result<String, Refusal> {
    let files: Vec<String> = data
        .files
        .iter()
        .map(|file| format!("{} ({} rows, SHA-256 <code>{}</code>)", escaped(&file.name), file.rows, &file.sha256[..16]))
        .collect();
    let order = match &data.ordered_by {
        Some(column) => format!("in the order of column <code>{}</code>", escaped(column)),
        None => "in the order of their rows".to_string(),
    };
    let mut body =
        format!("<h1>Model <code>{}</code> against new data: {}</h1>\n", escaped(&model.name), found.verdict.name(),);
    for response in &found.responses {
        of_response(&mut body, model, data, response)?;
    }
    let _ = writeln!(body, "<h2>Data</h2>\n<p>Compared with {}, runs {order}.</p>", files.join("; "));
    for (column, why) in &data.ignored {
        let _ = writeln!(body, "<p>Column <code>{}</code> is not used: {}.</p>", escaped(column), escaped(why));
    }
    Ok(page(&format!("Diagnosis: {}", found.verdict.name()), &body))
}

fn of_response(body: &mut String, model: &Model, data: &NewData, response: &ResponseDiagnosis) -> Result<(), Refusal> {
    let surface = &model.surfaces[response.surface];
    let _ = writeln!(body, "<section>\n<h2>{}: {}</h2>", escaped(&surface.name), response.verdict.name());
    body.push_str(&in_short(response));
    let plots = plots::Plots { model, response };
    body.push_str(&plots.switch("summary"));
    let _ = write!(body, "<div class=\"plots one\">\n{}</div>\n", plots.summary("summary")?);
    what_to_do(body, response);
    let of_file = response.rows_of_file.map_or_else(
        || {
            "The file does not give the number of rows of its fit. Its coefficients are assumed exact, or fitted to as many rows as the new data have, whichever explains the data better".to_string()
        },
        |rows| format!("The file was fitted to {rows} rows; the uncertainty of its coefficients follows from this number"),
    );
    let _ = writeln!(
        body,
        "<p>{} rows were compared. {of_file}. Noise of one row: {} {} (standard deviation, from {}).</p>",
        response.rows,
        short(response.floor.sd),
        escaped(&surface.unit_of_terms()),
        escaped(&response.floor.from)
    );
    if !response.outside.is_empty() {
        let places: Vec<String> = response.outside.iter().take(PLACES).map(|row| escaped(&data.place_of(*row))).collect();
        let more = response.outside.len().saturating_sub(PLACES);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let _ = writeln!(
            body,
            "<p>{} rows lie outside the ranges or the support of the surface, or where it saturates, and are not used: {}{more}.</p>",
            response.outside.len(),
            places.join(", ")
        );
    }
    for (sentence, ranges) in told(&response.faults) {
        let _ = writeln!(body, "<p><b>Data:</b> {} {}.</p>", escaped(sentence), runs(&ranges).replacen('r', "R", 1));
    }
    if response.left_out > 0 {
        let _ = writeln!(body, "<p>{} rows are left out because of their data.</p>", response.left_out);
    }
    body.push_str("<div class=\"columns\">\n");
    for cause in &response.causes {
        of_cause(body, data, response, cause);
    }
    body.push_str("</div>\n");
    for note in &response.notes {
        let _ = writeln!(body, "<p>Note: {}.</p>", escaped(note));
    }
    plots.section(body)?;
    body.push_str("<div class=\"columns\">\n<div>\n");
    errors(body, surface, response);
    body.push_str("</div>\n<div>\n");
    regions(body, response);
    body.push_str("</div>\n<div>\n");
    evidence(body, response);
    body.push_str("</div>\n</div>\n</section>\n");
    Ok(())
}

/// The verdict and three numbers.
fn in_short(response: &ResponseDiagnosis) -> String {
    let (tone, state) = match response.verdict {
        Verdict::NoDiscrepancy => (Tone::Good, "no error found"),
        Verdict::Explained => (Tone::Good, "explained"),
        Verdict::Unexplained => (Tone::Bad, "not explained"),
    };
    let (before, after) = (response.nominal.noise_ratio, response.extended.noise_ratio);
    let rows = format!("on {} holdout rows", response.nominal.rows);
    let mut numbers = Vec::new();
    if response.verdict == Verdict::NoDiscrepancy {
        numbers.push(Number::new("Error", format!("{before:.2} × noise"), rows));
        numbers.push(Number::new(
            "Rows compared",
            response.rows.to_string(),
            format!("{} more are not used", response.outside.len()),
        ));
        let worst = response.tests.iter().min_by(|a, b| a.ln_p.total_cmp(&b.ln_p));
        numbers.extend(worst.map(|it| {
            Number::new(
                "Least similar to noise",
                format!("p = {}", short(it.ln_p.exp())),
                format!("{} (structure below {})", it.what, short(response.threshold_p_structure)),
            )
        }));
    } else {
        let (gain, on) = response.tested.as_ref().map_or((response.gain, rows.clone()), |it| {
            (it.gain, format!("on {} test rows, which were not used before", it.nominal.rows))
        });
        let gone = if gain >= 0.0 { format!("{:.0} %", 100.0 * gain) } else { "none".to_string() };
        numbers.push(Number::new("Removed squared error above the noise", gone, on));
        numbers.push(Number::new(
            "Error",
            format!("{} → {} × noise", short(before), short(after)),
            format!("the file, then with the causes, {rows}"),
        ));
        numbers.push(match response.causes.first() {
            Some(cause) => {
                let probability = [cause.confidence, cause.confidence_of_any];
                let (equals, more) = (cause.indistinguishable_from.len(), response.causes.len() - 1);
                Number::confidence(&cause.label, probability, equals, more)
            }
            None => Number::new("Causes", "none", "of the catalogue reduces the error"),
        });
    }
    summary::verdict(tone, state, &verdict(response)) + &summary::numbers(&numbers)
}

/// The largest number of rows that the page lists by file and line; diagnosis.json has all of them.
const PLACES: usize = 12;

/// A probability; in words if it is below one in a million.
fn chance(ln_p: f64) -> String {
    // ln 10^-6.
    if ln_p < -13.8 { "under one in a million".to_string() } else { short(ln_p.exp()) }
}

/// Each cause with a recommendation.
fn what_to_do(body: &mut String, response: &ResponseDiagnosis) {
    if response.causes.is_empty() {
        return;
    }
    body.push_str("<table><tr><th>what is wrong</th><th>how sure</th><th>what to do</th></tr>\n");
    for cause in &response.causes {
        let rivals = if cause.indistinguishable_from.is_empty() {
            String::new()
        } else {
            " The data do not exclude another cause (see below): decide this first.".to_string()
        };
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{:.2}</td><td>{}{rivals}</td></tr>",
            escaped(&cause.sentence),
            cause.confidence,
            escaped(&remedy(cause))
        );
    }
    body.push_str("</table>\n");
}

/// The recommendation for a cause.
fn remedy(cause: &Cause) -> String {
    let name = cause.subject.as_ref().map_or("", |(_, name)| name.as_str());
    let detail = |key: &str| cause.details.iter().find(|it| it.0 == key).map(|it| it.1.as_str());
    match cause.kind {
        "missing-term" => "Use extended.toml, which has it.".to_string(),
        "coefficient-error" => "Find out what has changed since the fit of the file. If the change is permanent, use extended.toml.".to_string(),
        "missing-input" => format!("Use extended.toml, which takes {name} as an input, or hold {name} constant."),
        "drift" if detail("shape") == Some("step") => {
            "Find out what was changed before that run. The model file cannot represent it: correct it and measure again.".to_string()
        }
        "drift" => "Find out what changes with time (warm-up, wear, zero drift of a sensor) and make the runs in random order. The model file cannot represent it.".to_string(),
        "block-offset" => format!("Find out what differs with {name} (set-up, batch, day), and measure one common point in every block. The model file cannot represent it."),
        "sensor-gain" | "sensor-bias" => {
            format!("Compare the sensor of {name} with a reference and correct it; after that, the original file is valid. Until then use extended.toml with its readings.")
        }
        "outlying-runs" => "Look for these runs in the test log, and repeat them.".to_string(),
        "growing-noise" => {
            let weights = detail("weights").map_or(String::new(), |weights| format!(" {weights}"));
            format!("Fit with the weights{weights}, and repeat the runs where the noise is large.")
        }
        "correlated-errors" => "Make the runs in random order. Correlated rows contain less information than the same number of independent rows.".to_string(),
        _ => "See the evidence.".to_string(),
    }
}

fn verdict(response: &ResponseDiagnosis) -> String {
    match response.verdict {
        Verdict::NoDiscrepancy => {
            "The new data agree with the file within the noise. There is nothing to do; extended.toml equals the file."
                .to_string()
        }
        Verdict::Explained => "With the causes below, the residuals are noise.".to_string(),
        Verdict::Unexplained => {
            let worst = response.tests.iter().min_by(|a, b| a.ln_p.total_cmp(&b.ln_p));
            let what = worst.map_or(String::new(), |it| {
                format!(": {} are not consistent with noise (probability by chance: {})", it.what, chance(it.ln_p))
            });
            let regions: Vec<String> = response.regions_left.iter().take(2).map(|it| it.region.clone()).collect();
            let regions =
                if regions.is_empty() { String::new() } else { format!(" Most of it lies at {}.", regions.join(", and at ")) };
            let helps = if response.causes.is_empty() {
                ""
            } else {
                " The causes below reduce the error, but do not explain all of it; another cause may bias their parameters."
            };
            format!(
                "The residuals have structure that no known cause explains{what}.{regions}{helps} Look at the residual plots, and measure more points there: a polynomial of this order cannot follow this shape."
            )
        }
    }
}

fn of_cause(body: &mut String, data: &NewData, response: &ResponseDiagnosis, cause: &Cause) {
    let _ = write!(body, "<div>\n<h3>{}</h3>\n<p>{} ", escaped(&cause.label), escaped(&cause.sentence));
    let _ = write!(
        body,
        "For it: evidence {} (2 ln of the likelihood ratio; a cause with one unknown needs {}); probability by chance: {}. Confidence {:.2}.",
        short(cause.gain),
        short(response.threshold),
        chance(cause.ln_p),
        cause.confidence
    );
    if let Some((rival, behind)) = cause.rivals.first() {
        let _ = write!(body, " Against it: the evidence of {} in its place is only {} less.", escaped(rival), short(*behind));
        for (rival, behind) in cause.rivals.iter().skip(1).take(2) {
            let _ = write!(body, " Then {}: {}.", escaped(rival), short(*behind));
        }
    }
    if !cause.indistinguishable_from.is_empty() {
        let _ = write!(
            body,
            " <b>These data do not distinguish it from {}. Confidence that one of these is right: {:.2}.</b>",
            escaped(&cause.indistinguishable_from.join(", ")),
            cause.confidence_of_any
        );
    }
    body.push_str("</p>\n<table><tr><th>number</th><th>value</th><th>95 % interval</th><th>unit</th></tr>\n");
    for it in &cause.parameters {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td>{} to {}</td><td>{}</td></tr>",
            escaped(&it.name),
            known(it.value, 0.5 * (it.high - it.low)),
            known(it.low, 0.5 * (it.high - it.low)),
            known(it.high, 0.5 * (it.high - it.low)),
            escaped(&it.unit)
        );
    }
    body.push_str("</table>\n");
    if !cause.runs.is_empty() {
        body.push_str(
            "<table><tr><th>run</th><th>row</th><th>residual</th><th>studentised</th><th>p among all runs</th></tr>\n",
        );
        for it in &cause.runs {
            let _ = writeln!(
                body,
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                it.place + 1,
                escaped(&data.place_of(it.place)),
                short(it.residual),
                short(it.studentised),
                short(it.p)
            );
        }
        body.push_str("</table>\n");
    }
    body.push_str("</div>\n");
}

fn errors(body: &mut String, surface: &Surface, response: &ResponseDiagnosis) {
    let is_as_it_was = response.verdict == Verdict::NoDiscrepancy;
    let gain = if is_as_it_was {
        String::new()
    } else if response.gain >= 0.0 {
        format!(" {:.1} % of the squared error above the noise is removed.", 100.0 * response.gain)
    } else {
        " The extension increases the error of these rows: they do not contain what it corrects (a drift, a block, another state of a sensor)."
            .to_string()
    };
    let _ = write!(
        body,
        "<h3>{}</h3>\n<p>{} rows, {}.{}</p>\n\
         <table><tr><th></th><th>r.m.s. error [{}]</th><th>over the noise</th></tr>\n",
        if is_as_it_was { "On holdout rows" } else { "Before and after on holdout rows" },
        response.nominal.rows,
        escaped(&response.holdout_source),
        gain,
        escaped(&surface.unit_of_terms())
    );
    let mut rows = vec![("the file", &response.nominal)];
    if !is_as_it_was {
        rows.push(("extended file", &response.extended_file));
    }
    if response.has_offsets {
        rows.push(("extended file, with drift and offsets for rows that give run and block", &response.extended));
    }
    for (name, errors) in rows {
        let _ = writeln!(body, "<tr><td>{name}</td><td>{}</td><td>{:.2}</td></tr>", short(errors.rmse), errors.noise_ratio);
    }
    body.push_str("</table>\n");
}

fn regions(body: &mut String, response: &ResponseDiagnosis) {
    if response.verdict != Verdict::NoDiscrepancy {
        of_regions(body, "Regions with a large error of the file", &response.regions);
    }
    if response.verdict == Verdict::Unexplained {
        of_regions(body, "Regions with a large error after all causes", &response.regions_left);
    }
}

fn of_regions(body: &mut String, title: &str, regions: &[Region]) {
    if regions.is_empty() {
        return;
    }
    let _ = writeln!(
        body,
        "<h3>{title}</h3>\n<table><tr><th>where</th><th>share of the squared error</th><th>share of the runs</th></tr>"
    );
    for it in regions {
        let shares = (100.0 * it.share_of_error, 100.0 * it.share_of_rows);
        let _ = writeln!(body, "<tr><td>{}</td><td>{:.0} %</td><td>{:.0} %</td></tr>", escaped(&it.region), shares.0, shares.1);
    }
    body.push_str("</table>\n");
}

fn evidence(body: &mut String, response: &ResponseDiagnosis) {
    let _ = writeln!(
        body,
        "<h3>What each cause alone would explain</h3>\n<p>Evidence is 2 ln of the likelihood ratio; causes with several unknowns need more. Many causes are tried, so some have a small probability by chance: only values below {} are significant.</p>\n\
         <table><tr><th>cause</th><th>evidence</th><th>probability by chance</th></tr>",
        chance(response.ln_p_threshold)
    );
    for (label, gain, ln_p) in response.ranking.iter().take(10) {
        let class = if *ln_p < response.ln_p_threshold { "" } else { " (may be chance)" };
        let _ =
            writeln!(body, "<tr><td>{}{class}</td><td>{}</td><td>{}</td></tr>", escaped(label), short(*gain), chance(*ln_p));
    }
    body.push_str(
        "</table>\n</div>\n<div>\n<h3>Are the residuals noise?</h3>\n<table><tr><th>test</th><th>probability by chance</th></tr>\n",
    );
    for it in &response.tests {
        let class = if it.ln_p < response.threshold_p_structure.ln() { " class=\"missed\"" } else { "" };
        let _ = writeln!(body, "<tr{class}><td>{}</td><td>{}</td></tr>", escaped(&it.what), chance(it.ln_p));
    }
    let _ =
        writeln!(body, "</table>\n<p>Values below {} show structure, not noise.</p>", short(response.threshold_p_structure));
}

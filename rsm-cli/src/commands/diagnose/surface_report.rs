//! The page of a diagnosis of surfaces.
//!
//! In: a model, new data, a diagnosis. Out: one self-contained HTML page. Decides nothing: every figure comes from the diagnosis.

use std::fmt::Write as _;

use rsm_core::model::{Model, Surface};
use rsm_fit::diagnosis::causes::Cause;
use rsm_fit::diagnosis::data::NewData;
use rsm_fit::diagnosis::{Diagnosis, ResponseDiagnosis, Verdict};

use crate::outcome::Refusal;
use crate::page::{escaped, figure, page};
use crate::plot::{BLUE, GREY, Mark, ORANGE, PINK, Series, Words, curves};

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
    let mut body = format!(
        "<h1>Model <code>{}</code> against new data: {}</h1>\n<p>Compared with {}, runs {order}.</p>\n",
        escaped(&model.name),
        found.verdict.name(),
        files.join("; ")
    );
    for (column, why) in &data.ignored {
        let _ = writeln!(body, "<p>Column <code>{}</code> takes no part: {}.</p>", escaped(column), escaped(why));
    }
    for response in &found.responses {
        of_response(&mut body, model, data, response)?;
    }
    Ok(page(&format!("Diagnosis: {}", found.verdict.name()), &body))
}

fn of_response(body: &mut String, model: &Model, data: &NewData, response: &ResponseDiagnosis) -> Result<(), Refusal> {
    let surface = &model.surfaces[response.surface];
    let _ = write!(body, "<h2>{}: {}</h2>\n<p>{}</p>\n", escaped(&surface.name), response.verdict.name(), verdict(response));
    let of_file = response.rows_of_file.map_or_else(
        || "it does not say how many rows made it; as many as the new ones are taken".to_string(),
        |rows| format!("made from {rows} rows"),
    );
    let _ = writeln!(
        body,
        "<p>{} rows were compared with the file ({of_file}); its coefficients may be wrong by what that leaves open. Noise: {} {} (from {}).</p>",
        response.rows,
        figure(Some(response.floor.sd)),
        escaped(&surface.unit),
        escaped(&response.floor.from)
    );
    if !response.outside.is_empty() {
        let places: Vec<String> = response.outside.iter().map(|row| escaped(&data.place_of(*row))).collect();
        let _ = writeln!(
            body,
            "<p>{} rows lie outside the ranges or the support of the surface, or where it saturates, and take no part: {}.</p>",
            response.outside.len(),
            places.join(", ")
        );
    }
    for cause in &response.causes {
        of_cause(body, data, response, cause);
    }
    for note in &response.notes {
        let _ = writeln!(body, "<p>Note: {}.</p>", escaped(note));
    }
    errors(body, surface, response);
    regions(body, response);
    evidence(body, response);
    plots(body, model, response)
}

fn verdict(response: &ResponseDiagnosis) -> String {
    match response.verdict {
        Verdict::NoDiscrepancy => {
            "The new data are what the file says, and noise. extended.toml is the file as it is.".to_string()
        }
        Verdict::Explained => "The causes below leave noise and nothing else.".to_string(),
        Verdict::Unexplained => {
            let worst = response.tests.iter().min_by(|a, b| a.ln_p.total_cmp(&b.ln_p));
            let what = worst.map_or(String::new(), |it| {
                format!(": {} (probability by chance {})", escaped(&it.what), figure(Some(it.ln_p.exp())))
            });
            format!(
                "Structure is left that none of the causes explains{what}. What is named below helps, and is not the whole."
            )
        }
    }
}

fn of_cause(body: &mut String, data: &NewData, response: &ResponseDiagnosis, cause: &Cause) {
    let _ = write!(body, "<h3>{}</h3>\n<p>{} ", escaped(&cause.label), escaped(&cause.sentence));
    let _ = write!(
        body,
        "For it: without it 2 ln of the likelihood is lower by {} (a cause of one unknown must reach {}); the probability of as much by chance is {}. Confidence {:.2}.",
        figure(Some(cause.gain)),
        figure(Some(response.threshold)),
        figure(Some(cause.ln_p.exp())),
        cause.confidence
    );
    if let Some((rival, behind)) = cause.rivals.first() {
        let _ = write!(body, " Against it: in its place {} does worse by {}.", escaped(rival), figure(Some(*behind)));
        for (rival, behind) in cause.rivals.iter().skip(1).take(2) {
            let _ = write!(body, " Then {}: {}.", escaped(rival), figure(Some(*behind)));
        }
    }
    if !cause.indistinguishable_from.is_empty() {
        let _ = write!(body, " <b>These data do not tell it from {}.</b>", escaped(&cause.indistinguishable_from.join(", ")));
    }
    body.push_str("</p>\n<table><tr><th>number</th><th>value</th><th>95 % interval</th><th>unit</th></tr>\n");
    for it in &cause.parameters {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td>{} to {}</td><td>{}</td></tr>",
            escaped(&it.name),
            figure(Some(it.value)),
            figure(Some(it.low)),
            figure(Some(it.high)),
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
                figure(Some(it.residual)),
                figure(Some(it.studentised)),
                figure(Some(it.p))
            );
        }
        body.push_str("</table>\n");
    }
}

fn errors(body: &mut String, surface: &Surface, response: &ResponseDiagnosis) {
    let _ = write!(
        body,
        "<h3>Before and after on unseen rows</h3>\n<p>{} rows, {}. {:.1} % of the squared error above the noise is gone.</p>\n\
         <table><tr><th></th><th>r.m.s. error [{}]</th><th>over the noise</th></tr>\n",
        response.nominal.rows,
        escaped(&response.judged_on),
        100.0 * response.gain,
        escaped(&surface.unit)
    );
    let rows = [
        ("nominal file", &response.nominal),
        ("extended file", &response.extended_file),
        ("extended file, with drift and offsets where a row names them", &response.extended),
    ];
    for (name, errors) in rows {
        let _ =
            writeln!(body, "<tr><td>{name}</td><td>{}</td><td>{:.2}</td></tr>", figure(Some(errors.rmse)), errors.noise_ratio);
    }
    body.push_str("</table>\n");
}

fn regions(body: &mut String, response: &ResponseDiagnosis) {
    if response.regions.is_empty() || response.verdict == Verdict::NoDiscrepancy {
        return;
    }
    body.push_str(
        "<h3>Where the file is wrong</h3>\n<table><tr><th>where</th><th>share of the squared error</th><th>share of the runs</th></tr>\n",
    );
    for it in &response.regions {
        let shares = (100.0 * it.share_of_error, 100.0 * it.share_of_rows);
        let _ = writeln!(body, "<tr><td>{}</td><td>{:.0} %</td><td>{:.0} %</td></tr>", escaped(&it.region), shares.0, shares.1);
    }
    body.push_str("</table>\n");
}

fn evidence(body: &mut String, response: &ResponseDiagnosis) {
    body.push_str(
        "<h3>What each hypothesis alone would win</h3>\n<table><tr><th>hypothesis</th><th>2 ln of the likelihood ratio</th><th>probability by chance</th></tr>\n",
    );
    for (label, gain, ln_p) in response.ranking.iter().take(10) {
        let class = if *ln_p < response.ln_p_threshold { "" } else { " (below the threshold)" };
        let _ = writeln!(
            body,
            "<tr><td>{}{class}</td><td>{}</td><td>{}</td></tr>",
            escaped(label),
            figure(Some(*gain)),
            figure(Some(ln_p.exp()))
        );
    }
    body.push_str("</table>\n<h3>Is noise left?</h3>\n<table><tr><th>test</th><th>probability by chance</th></tr>\n");
    for it in &response.tests {
        let class = if it.ln_p < response.threshold_p_structure.ln() { " class=\"missed\"" } else { "" };
        let _ = writeln!(body, "<tr{class}><td>{}</td><td>{}</td></tr>", escaped(&it.what), figure(Some(it.ln_p.exp())));
    }
    let _ = writeln!(body, "</table>\n<p>Below {} it is structure.</p>", figure(Some(response.threshold_p_structure)));
}

fn plots(body: &mut String, model: &Model, response: &ResponseDiagnosis) -> Result<(), Refusal> {
    let surface = &model.surfaces[response.surface];
    let shown = &response.shown;
    let y = format!("measured less computed [{}]", surface.unit);
    let rows = shown.measured.len();
    let series = |x: &dyn Fn(usize) -> f64| -> Vec<Series> {
        let points = |computed: &[f64], counts: bool| -> Vec<(f64, f64)> {
            let rows = (0..rows).filter(|row| shown.counts[*row] == counts);
            rows.map(|row| (x(row), shown.measured[row] - computed[row])).collect()
        };
        let mut series = vec![
            Series::new("nominal file", ORANGE, Mark::Cross, points(&shown.nominal, true)),
            Series::new("with the causes", BLUE, Mark::Circle, points(&shown.explained, true)),
        ];
        let outlying = points(&shown.nominal, false);
        if !outlying.is_empty() {
            series.push(Series::new("outlying", PINK, Mark::Cross, outlying));
        }
        series
    };
    body.push_str("<h3>Residuals</h3>\n<div class=\"plots\">\n");
    for (column, name) in shown.points.iter().zip(&surface.inputs) {
        let unit = model.input(name).map_or("", |input| input.unit.as_str());
        let x = format!("{name} [{unit}]");
        let words = Words { title: &format!("against {name}"), x: &x, y: &y };
        body.push_str(&curves(&words, &series(&|row| column[row]))?);
    }
    let words = Words { title: "against the run order", x: "run", y: &y };
    body.push_str(&curves(&words, &series(&|row| shown.places[row] as f64 + 1.0))?);
    let x = format!("fitted value [{}]", surface.unit);
    let words = Words { title: "against the fitted value", x: &x, y: &y };
    body.push_str(&curves(&words, &series(&|row| shown.explained[row]))?);
    let judged = &response.judged;
    let pairs = |computed: &[f64]| judged.measured.iter().copied().zip(computed.iter().copied()).collect::<Vec<_>>();
    let (low, high) = judged.measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(*y), b.max(*y)));
    let (x, y) = (format!("measured [{}]", surface.unit), format!("computed [{}]", surface.unit));
    let words = Words { title: "unseen rows", x: &x, y: &y };
    let all = [
        Series::new("equal", GREY, Mark::Line, vec![(low, low), (high, high)]),
        Series::new("nominal file", ORANGE, Mark::Cross, pairs(&judged.nominal)),
        Series::new("extended", BLUE, Mark::Circle, pairs(&judged.extended)),
    ];
    body.push_str(&curves(&words, &all)?);
    body.push_str("</div>\n");
    Ok(())
}

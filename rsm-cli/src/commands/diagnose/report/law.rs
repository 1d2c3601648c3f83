//! A law that is in no textbook, in the report: its curve with the confidence band, and the textbook forms that are nearest to it.
//!
//! In: a diagnosis. Out: a section; nothing if the diagnosis has no law. Decides nothing.

use std::fmt::Write as _;

use rsm_diagnose::plant::Diagnosis;
use rsm_diagnose::plant::law::curve::{Point, joined};
use rsm_diagnose::plant::law::{EFFECT_FILE, MODEL_FILE};

use crate::outcome::Refusal;
use crate::page::escaped;
use crate::page::summary::Number;
use crate::plot::{self, BLUE, GREY, Mark, Series, Words};

/// The site of the law, for the summary.
pub fn number(found: &Diagnosis) -> Option<Number> {
    let law = found.law.as_ref()?;
    Some(Number::new("Unknown law", format!("at {}", law.at), format!("over {}", joined(&law.inputs))))
}

/// The section.
pub fn section(body: &mut String, found: &Diagnosis) -> Result<(), Refusal> {
    let Some(law) = &found.law else { return Ok(()) };
    let _ = writeln!(
        body,
        "<h2>A law that is in no textbook</h2>\n<p>{} The 95 % interval of the removed share is {:.1} to {:.1} %. The law is a surface fitted to the \
         records, and it is valid only in their range. It is in {MODEL_FILE}, and extended.toml contains it by {EFFECT_FILE}.</p>\n<div class=\"plots\">",
        escaped(&law.words),
        100.0 * law.gain_interval.0,
        100.0 * law.gain_interval.1,
    );
    for curve in &law.curves {
        let line = |value: fn(&Point) -> f64| -> Vec<(f64, f64)> { curve.points.iter().map(|it| (it.at, value(it))).collect() };
        let series = [
            Series::new("law", BLUE, Mark::Line, line(|it| it.value)),
            Series::new("95 % band, low", GREY, Mark::Line, line(|it| it.low)),
            Series::new("95 % band, high", GREY, Mark::Line, line(|it| it.high)),
        ];
        let x = format!("{} [{}]", curve.variable, curve.unit);
        let y = format!("{} [{}]", law.surface, law.unit);
        let title = format!("the law over {}", curve.variable);
        body.push_str(&plot::curves(&Words { title: &title, x: &x, y: &y }, &series)?);
    }
    body.push_str("</div>\n<table><tr><th>textbook form</th><th>misfit</th></tr>\n");
    for it in &law.textbook {
        let _ = writeln!(body, "<tr><td>{}</td><td class=\"number\">{:.0} %</td></tr>", it.words, 100.0 * it.misfit);
    }
    body.push_str(
        "</table>\n<p class=\"note\">Misfit: the root mean square difference of the best form of this kind from the law, divided by the root mean square of \
         the law, over the rows of the records.</p>\n",
    );
    Ok(())
}

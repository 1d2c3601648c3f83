//! The campaign of faults on the motor's loop (`host_runners::campaign`), as a table. Part of the full demo: it takes half a minute.

use std::fmt::Write as _;

use host_runners::campaign::{self, MOST_A, MOST_MS, Row};
use serde_json::{Value, json};

use super::{Printer, Section};
use crate::outcome::Refusal;

/// Runs the campaign.
pub fn run(printer: &Printer) -> Result<Section, Refusal> {
    printer.print("faults   every sensor of the motor's loop, broken in six ways for 1 to 500 samples, at 11 points and 4 bus voltages ...")?;
    let exact = campaign::exact_longest_a();
    let rows = campaign::run(1);
    let runs: usize = rows.iter().map(|row| row.runs).sum();
    let (longest, back) = rows.iter().fold((0f64, 0f64), |(a, ms), row| (a.max(row.longest_a), ms.max(row.back_ms)));
    let good = rows.iter().all(Row::kept);
    printer.print(&format!(
        "         {runs} runs: {longest:.1} A at most (the exact controller without a fault: {exact:.1} A), torque back within {back:.1} ms"
    ))?;
    let mut html = format!(
        "<h2>The motor's loop under faults</h2>\n<p>{runs} runs of the embedded steps: every sensor, broken for 1, 5, 10, 100 and 500 samples of 0.1 ms, at 11 operating points \
         and bus voltages of 180, 230, 270 and 330 V. No current may be longer than {MOST_A} A, 1.2 of the limit (the exact controller without a fault has {exact:.1} A), and \
         the torque must be back {MOST_MS} ms after the last bad sample. The bridge opens after ten bad samples in a row, or where the current leaves the limit by 7 %. A bias or a \
         noise that is plausible cannot be detected: the last column has the mean torque error of such a fault of 50 ms.</p>\n\
         <table>\n<tr><th>sensor</th><th>fault</th><th>runs</th><th>longest current, A</th><th>torque back after, ms</th><th>bridge opened in</th>\
         <th>torque error if undetected, N m</th></tr>\n"
    );
    for row in &rows {
        let mark = if row.kept() { "" } else { " class=\"missed\"" };
        let Row { sensor, kind, runs, longest_a, back_ms, opened, torque_error_nm } = row;
        let _ = writeln!(
            html,
            "<tr{mark}><td>{}</td><td>{}</td><td>{runs}</td><td>{longest_a:.1}</td><td>{back_ms:.1}</td><td>{opened}</td><td>{torque_error_nm:.2}</td></tr>",
            sensor.name(),
            kind.name()
        );
    }
    html.push_str("</table>\n");
    let table: Vec<Value> = rows
        .iter()
        .map(|row| {
            let Row { sensor, kind, runs, longest_a, back_ms, opened, torque_error_nm } = row;
            json!({
                "sensor": sensor.name(), "fault": kind.name(), "runs": runs, "longest_a": longest_a, "back_ms": back_ms, "opened": opened,
                "torque_error_nm": torque_error_nm, "kept": row.kept(),
            })
        })
        .collect();
    Ok(Section { good, plot: String::new(), html, json: json!({ "exact_longest_a": exact, "rows": table }) })
}

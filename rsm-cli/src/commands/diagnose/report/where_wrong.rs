//! Regions with a large error, and the error by region before and after.
//!
//! In: a diagnosis. Out: tables with bars. Decides nothing.

use std::fmt::Write as _;

use rsm_diagnose::plant::Diagnosis;
use rsm_diagnose::plant::regions::{ErrorSlice, Region};
use rsm_sim::kind::PlantKind;

use crate::page::{bar, escaped};

/// Lines of the first table.
const LINES: usize = 16;

/// The section.
pub fn section(body: &mut String, kind: PlantKind, found: &Diagnosis) {
    let breakdown = &found.error_breakdown;
    body.push_str("<h2>Where the plant is wrong, calibrated within its tolerances</h2>\n");
    if breakdown.before.is_empty() {
        body.push_str("<p>In every region that was examined, the error is at the noise level.</p>\n");
        return;
    }
    body.push_str(
        "<p>Shares of the squared error above the noise, summed over all outputs in units of their noise. Regions overlap, so their shares do not sum to one.</p>\n",
    );
    table(body, kind, &breakdown.before);
    let quantities = quantities(found);
    if quantities.is_empty() {
        return;
    }
    let _ = writeln!(
        body,
        "<h3>Error by region, before and after</h3>\n<p>Root mean square error divided by the noise; <span class=\"colour-before\">calibrated</span>, \
         <span class=\"colour-after\">extended</span>; the grey line is the noise level.</p>"
    );
    for (output, quantity) in quantities {
        let slices: Vec<&ErrorSlice> =
            breakdown.slices.iter().filter(|it| it.output == output && it.quantity == quantity).collect();
        let most = slices.iter().map(|it| it.before.max(it.after).sqrt()).fold(1.0, f64::max);
        let _ = writeln!(
            body,
            "<table><tr><th>{} by {}</th><th>rows</th><th>calibrated</th><th>extended</th><th></th></tr>",
            kind.outputs()[output].name,
            escaped(quantity)
        );
        for it in slices {
            let (before, after) = (it.before.sqrt(), it.after.sqrt());
            let noise = 200.0 / most;
            let _ = writeln!(
                body,
                "<tr><td>{}</td><td class=\"number\">{:.0} %</td><td class=\"number\">{before:.2}</td><td class=\"number\">{after:.2}</td>\
                 <td class=\"bars\" style=\"background:linear-gradient(#999,#999) calc(0.7em + {noise:.0}px) 0/1px 100% no-repeat\">{}<br>{}</td></tr>",
                escaped(&it.region),
                100.0 * it.share_of_rows,
                bar(before / most, "before"),
                bar(after / most, "after")
            );
        }
        body.push_str("</table>\n");
    }
}

/// Regions with their shares.
pub fn table(body: &mut String, kind: PlantKind, regions: &[Region]) {
    body.push_str("<table><tr><th>output</th><th>where</th><th>of all error</th><th>of its output's</th><th>of the rows</th><th></th></tr>\n");
    for it in regions.iter().take(LINES) {
        // Spectral lines and octaves have no rows.
        let rows = match it.quantity.as_str() {
            "frequency" | "line" | "order" => String::new(),
            _ => format!("{:.0} %", 100.0 * it.share_of_rows),
        };
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td class=\"number\">{:.0} %</td><td class=\"number\">{:.0} %</td>\
             <td class=\"number\">{rows}</td><td class=\"bars\">{}</td></tr>",
            kind.outputs()[it.output].name,
            escaped(&it.region),
            100.0 * it.share_of_error,
            100.0 * it.share_of_output,
            bar(it.share_of_error, "before")
        );
    }
    body.push_str("</table>\n");
}

/// Outputs and quantities with a region of large error, in the order of the list of regions.
fn quantities(found: &Diagnosis) -> Vec<(usize, &str)> {
    let mut list = Vec::new();
    for it in &found.error_breakdown.before {
        let is_class =
            found.error_breakdown.slices.iter().any(|slice| slice.output == it.output && slice.quantity == it.quantity);
        let one = (it.output, it.quantity.as_str());
        if is_class && it.quantity != "output" && !list.contains(&one) && list.len() < 6 {
            list.push(one);
        }
    }
    list
}

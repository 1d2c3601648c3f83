//! The steps that both cases share: certify a fitted model, emit it, compile it with the machine's compilers, and compare the results.
//!
//! In: a model. Out: its files in a folder, the results as JSON, and whether every step succeeded.

use std::path::Path;

use rsm_core::check::Checked;
use rsm_core::model::Model;
use rsm_core::{certificate, compile};
use rsm_fit::fit::Outcome as Fitted;
use serde_json::{Map, Value, json};

use super::{Printer, twins};
use crate::commands::fit;
use crate::outcome::Refusal;
use crate::{evaluators, output};

/// Prints the results of a fit.
pub fn print_fit(printer: &Printer, fitted: &Fitted) -> Result<(), Refusal> {
    fit::require_all(fitted)?;
    for (response, statistics) in fitted.responses.iter().filter_map(|it| Some((it, it.statistics.as_ref()?))) {
        let unit = fitted.model.surface(&response.name).map_or("", |surface| surface.unit.as_str());
        let unseen = statistics.validation.as_ref().map_or(f64::NAN, |validation| validation.mean_abs_error);
        printer.print(&format!(
            "fit      {}: {} terms from {} rows; mean error on holdout rows {unseen:.4} {unit}",
            response.name,
            statistics.terms.len(),
            statistics.rows,
        ))?;
    }
    Ok(())
}

/// Certifies and emits a model, compiles the emitted code and compares the results.
pub fn compiled(printer: &Printer, folder: &Path, model: &Model, results: &mut Map<String, Value>) -> Result<bool, Refusal> {
    let checked = Checked::from_model(model)?;
    let mut good = true;
    let mut certified = Map::new();
    for certificate in &certificate::surfaces(&checked, &compile::held(&checked, &[])?)? {
        let tapes = &certificate.tapes;
        let errors: Vec<String> = tapes.iter().map(|tape| format!("{} {:.1e}", tape.precision.name(), tape.error)).collect();
        let (low, high) = (certificate.range.low, certificate.range.high);
        printer.print(&format!(
            "check    {}: always within [{low:.3}, {high:.3}], rounding error at most {}",
            certificate.name,
            errors.join(", ")
        ))?;
        good &= tapes.iter().all(|tape| tape.error.is_finite());
        let errors: Map<String, Value> =
            tapes.iter().map(|tape| (tape.precision.name().into(), json!(output::finite(tape.error)))).collect();
        certified.insert(certificate.name.clone(), json!({ "range": [low, high], "error": errors }));
    }
    results.insert("check".into(), Value::Object(certified));

    // A compensator without a proof of stability is refused here.
    let (unit, files) = evaluators::files(&checked, folder)?;
    for compensator in &model.compensators {
        printer
            .print(&format!("check    {}: stable over the whole range of its inputs, in exact arithmetic", compensator.name))?;
    }
    output::write_all(&files)?;
    printer.print(&format!("emit     {} functions in C and Rust", unit.functions.len()))?;

    let mut compared = Map::new();
    for verdict in twins::compare(&unit, &folder.join("emitted"))? {
        match verdict {
            Ok(twins::Verdict { compiler, compared: count, different }) => {
                printer.print(&format!(
                    "compare  {compiler}: {different} of {count} results differ from the interpreter in any bit"
                ))?;
                good &= different == 0;
                compared.insert(compiler, json!({ "compared": count, "different": different }));
            }
            // Without one of the compilers its comparison is left out, and a line reports this.
            Err(reason) => printer.print(&format!("compare  left out: {}", reason.trim_end()))?,
        }
    }
    good &= !compared.is_empty();
    results.insert("compare".into(), Value::Object(compared));
    Ok(good)
}

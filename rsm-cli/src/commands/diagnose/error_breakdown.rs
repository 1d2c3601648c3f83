//! Further keys of docs/book/src/reference/formats.md 4.3: evidence, calibration, the remaining error and its correction, as JSON.
//!
//! In: a diagnosis. Out: values of diagnosis.json, and correction.toml. Decides nothing.

use rsm_diagnose::plant::correction::CorrectionResult;
use rsm_diagnose::plant::regions::Region;
use rsm_diagnose::plant::{Cause, Diagnosis};
use rsm_sim::kind::PlantKind;
use serde_json::{Map, Value, json};

use super::{cause_json, evidence};
use crate::output::finite;

/// The name of the model file beside diagnosis.json.
pub const CORRECTION: &str = "correction.toml";

/// The largest number of entries of `where` and `left`.
const LINES: usize = 16;

/// Regions as a list.
pub fn regions(kind: PlantKind, regions: &[Region]) -> Value {
    let each = regions.iter().take(LINES).map(|it| {
        json!({
            "output": kind.outputs()[it.output].name, "region": it.region, "of": it.quantity,
            "share_of_error": finite(it.share_of_error), "share_of_output": finite(it.share_of_output), "share_of_rows": finite(it.share_of_rows),
        })
    });
    Value::Array(each.collect())
}

/// Evidence for and against a cause, and how to check it.
pub fn evidence(kind: PlantKind, found: &Diagnosis, cause: &Cause) -> Value {
    let sentences = evidence::of(kind, found, cause);
    json!({
        "for": sentences.supports, "against": sentences.speaks_against, "check": cause.check, "gain": finite(cause.gain),
        "rivals": cause_json::rivals(&cause.rivals), "rivals_asked": cause.rivals_tested,
    })
}

/// Calibrated parameters: each moved within its tolerance.
pub fn calibration(found: &Diagnosis) -> Value {
    let each = found.error_breakdown.calibration.iter().map(|it| {
        let value = json!({
            "nominal": it.nominal, "value": finite(it.value), "low": finite(it.low), "high": finite(it.high), "unit": it.unit,
            "standard_deviations": finite(it.sds)
        });
        (it.name.to_string(), value)
    });
    Value::Object(each.collect::<Map<String, Value>>())
}

/// The correction: null if none was tried; without a file if none gains.
pub fn correction(kind: PlantKind, found: &Diagnosis) -> Value {
    match &found.error_breakdown.correction {
        None => Value::Null,
        Some(CorrectionResult::NoGain { gain }) => json!({ "file": null, "gain": finite(*gain) }),
        Some(CorrectionResult::Useful(it)) => {
            let outputs = it.outputs.iter().map(|one| {
                let value = json!({
                    "surface": one.surface, "terms": one.terms,
                    "noise_ratio": { "without": finite(one.before), "with": finite(one.after) },
                });
                (kind.outputs()[one.output].name.to_string(), value)
            });
            json!({
                "file": CORRECTION, "gain": finite(it.gain), "gain_low": finite(it.low), "unseen": it.unseen,
                "outputs": outputs.collect::<Map<String, Value>>(),
            })
        }
    }
}

/// The text of correction.toml, if a correction gains.
pub fn correction_file(found: &Diagnosis) -> Option<String> {
    match &found.error_breakdown.correction {
        Some(CorrectionResult::Useful(it)) => Some(rsm_core::model_file::write(&it.model)),
        _ => None,
    }
}

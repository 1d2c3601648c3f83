//! A law that is in no textbook: its JSON, its file and its part of the report.
//!
//! In: a diagnosis. Out: values and texts; nothing if the diagnosis has no law.

use rsm_core::model_file;
use rsm_diagnose::plant::Diagnosis;
use rsm_diagnose::plant::law::{EFFECT_FILE, MODEL_FILE};
use serde_json::{Value, json};

use crate::output::finite;

/// docs/book/src/reference/formats.md 4.3: `law`.
pub fn value(found: &Diagnosis) -> Value {
    let Some(law) = &found.law else { return Value::Null };
    let curves: Vec<Value> = law
        .curves
        .iter()
        .map(|curve| {
            let points: Vec<[Option<f64>; 4]> =
                curve.points.iter().map(|it| [it.at, it.value, it.low, it.high].map(finite)).collect();
            json!({ "input": curve.variable, "unit": curve.unit, "points": points })
        })
        .collect();
    let forms: Vec<Value> = law.textbook.iter().map(|it| json!({ "form": it.words, "misfit": finite(it.misfit) })).collect();
    json!({
        "at": law.at,
        "inputs": law.inputs,
        "model": MODEL_FILE,
        "effect": EFFECT_FILE,
        "surface": law.surface,
        "unit": law.unit,
        "gain": finite(law.gain),
        "gain_interval": [finite(law.gain_interval.0), finite(law.gain_interval.1)],
        "curves": curves,
        "textbook": forms,
        "words": law.words,
    })
}

/// The law as a model file.
pub fn file(found: &Diagnosis) -> Option<String> {
    found.law.as_ref().map(|law| model_file::write(&law.model))
}

//! What the equations say along the recorded signals, for the page and as JSON.
//!
//! In: what the screen by equation error found. Out: sentences and a value. Decides nothing.

use rsm_diagnose::plant::equations::{Said, Term};
use serde_json::{Map, Value, json};

use crate::output;
use crate::page::figure;

/// As JSON.
pub fn value(it: &Said) -> Value {
    let terms = it.terms.iter().map(|term| {
        let numbers = term.entry.arguments.numbers.iter();
        let numbers: Map<String, Value> =
            numbers.map(|(name, value)| ((*name).to_string(), json!(output::finite(*value)))).collect();
        json!({ "cause": term.label, "numbers": numbers, "left": output::finite(term.left) })
    });
    json!({ "of": it.equations, "calibrated": output::finite(it.calibrated), "terms": terms.collect::<Vec<Value>>() })
}

/// A sentence a term; none where calibration does it.
pub fn sentences(it: &Said) -> Vec<String> {
    let sentence = |term: &Term| {
        let numbers = term.entry.arguments.numbers.iter();
        let numbers: Vec<String> = numbers.map(|(name, value)| format!("{name} {}", figure(Some(*value)))).collect();
        let left = 100.0 * term.left;
        format!("{} ({}): {left:.2} % of what the plant file misses is left with it.", term.label, numbers.join(", "))
    };
    it.terms.iter().map(sentence).collect()
}

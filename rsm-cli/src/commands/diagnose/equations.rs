//! Prediction errors of a filter along the records, for the report and as JSON.
//!
//! In: the results of the screen by equation error. Out: sentences and a value. Decides nothing.

use rsm_diagnose::plant::equations::{EquationScreen, Term};
use serde_json::{Map, Value, json};

use crate::output;
use crate::page::figure;

/// As JSON.
pub fn value(screen: &EquationScreen) -> Value {
    let terms = screen.terms.iter().map(|term| {
        let numbers = term.entry.arguments.numbers.iter();
        let numbers: Map<String, Value> =
            numbers.map(|(name, value)| ((*name).to_string(), json!(output::finite(*value)))).collect();
        json!({ "cause": term.label, "numbers": numbers, "left": output::finite(term.left) })
    });
    json!({ "of": screen.equations, "calibrated": output::finite(screen.calibrated), "terms": terms.collect::<Vec<Value>>() })
}

/// One sentence for each term; none if calibration alone explains the error.
pub fn sentences(screen: &EquationScreen) -> Vec<String> {
    let sentence = |term: &Term| {
        let numbers = term.entry.arguments.numbers.iter();
        let numbers: Vec<String> = numbers.map(|(name, value)| format!("{name} {}", figure(Some(*value)))).collect();
        let remaining = 100.0 * term.left;
        format!(
            "{} ({}): with this term, {remaining:.2} % of the prediction error of the plant file remains.",
            term.label,
            numbers.join(", ")
        )
    };
    screen.terms.iter().map(sentence).collect()
}

//! Decides whether a diagnosis of a surface is correct.
//!
//! In: a case and the JSON of `rsm diagnose`. Out: [`Judgement`]. A correct answer has the correct verdict, names every hidden cause or lists it as
//! indistinguishable from a named one, and names nothing else. For a disturbance outside the catalogue only the verdict counts. Data faults must be
//! those of the case: their kind, their column and nearly their rows.

use std::collections::BTreeSet;

use serde_json::Value;

use super::Case;
use crate::reliability::Named;

/// The evaluation of one answer.
#[derive(Debug, Clone, Default)]
pub struct Judgement {
    /// Whether verdict and causes are correct.
    pub right: bool,
    /// The answer in short.
    pub answer: String,
    /// For each hidden number: the relative error, and whether the interval contains the true value.
    pub numbers: Vec<(f64, bool)>,
    /// The named causes, each with its confidence.
    pub named: Vec<Named>,
}

/// KIND, or KIND:NAME.
fn label(cause: &Value) -> String {
    let kind = cause["kind"].as_str().unwrap_or("?");
    match ["term", "input", "column", "output"].iter().find_map(|key| cause[*key].as_str()) {
        Some(name) => format!("{kind}:{name}"),
        None => kind.to_string(),
    }
}

/// The least share of rows that the named rows and the faulty rows have in common: the first and the last row of a fault are often within the noise.
const COMMON_ROWS: f64 = 0.8;

/// Whether every named fault is that of the case, and the fault of the case is named.
fn faults_match(case: &Case, faults: &[Value]) -> bool {
    let Some(fault) = &case.fault else { return faults.is_empty() };
    let is_this = |it: &Value| {
        it["kind"] == "data-fault"
            && it["what"].as_str().is_some_and(|what| what.starts_with(fault.what))
            && it["column"].as_str() == Some(&fault.column)
    };
    let named: BTreeSet<u64> =
        faults.iter().filter_map(|it| Some(it["rows"][0].as_u64()?..=it["rows"][1].as_u64()?)).flatten().collect();
    let rows: BTreeSet<u64> = fault.rows.iter().map(|row| *row as u64).collect();
    let common = named.intersection(&rows).count() as f64 / named.union(&rows).count().max(1) as f64;
    !faults.is_empty() && faults.iter().all(is_this) && (fault.rows.is_empty() || common >= COMMON_ROWS)
}

/// Each fault once: what it is, and its column.
fn fault_labels(faults: &[Value]) -> BTreeSet<String> {
    let word = |it: &Value, key: &str| it[key].as_str().unwrap_or("?").to_string();
    faults.iter().map(|it| format!("{} {}", word(it, "column"), word(it, "what"))).collect()
}

/// Evaluates an answer.
pub fn judge(case: &Case, answer: &Value) -> Judgement {
    let empty = Vec::new();
    let causes = answer["causes"].as_array().unwrap_or(&empty);
    let labels: Vec<String> = causes.iter().map(label).collect();
    let verdict = answer["verdict"].as_str().unwrap_or("?");
    let says = |cause: usize, truth: &str| {
        let rivals = causes[cause]["indistinguishable_from"].as_array();
        labels[cause] == truth || rivals.is_some_and(|it| it.iter().any(|rival| rival.as_str() == Some(truth)))
    };
    // Each true cause is assigned to a separate named cause; those with its own name first.
    let mut free: Vec<usize> = (0..causes.len()).collect();
    let mut found = 0;
    let mut numbers = Vec::new();
    let mut open = Vec::new();
    for truth in &case.truths {
        match free.iter().position(|cause| labels[*cause] == truth.label) {
            Some(place) => {
                let cause = &causes[free.remove(place)];
                found += 1;
                if let Some((name, value)) = truth.number {
                    let number = &cause["parameters"][name];
                    if let (Some(x), Some(low), Some(high)) =
                        (number["value"].as_f64(), number["low"].as_f64(), number["high"].as_f64())
                    {
                        // For a gain, the difference from 1 is the cause.
                        let size = if name == "gain" { value - 1.0 } else { value };
                        numbers.push((((x - value) / size).abs(), low <= value && value <= high));
                    }
                }
            }
            None => open.push(truth),
        }
    }
    for truth in open {
        if let Some(place) = free.iter().position(|cause| says(*cause, &truth.label)) {
            free.remove(place);
            found += 1;
        }
    }
    let faults = answer["data"].as_array().unwrap_or(&empty);
    let (faults_right, faults) = (faults_match(case, faults), fault_labels(faults));
    let causes_right = case.verdict == "unexplained" || (found == case.truths.len() && free.is_empty());
    let mut answer = format!("{verdict}: {}", if labels.is_empty() { "nothing".to_string() } else { labels.join(", ") });
    if !faults.is_empty() {
        answer += &format!("; data: {}", faults.into_iter().collect::<Vec<_>>().join(", "));
    }
    let named = causes.iter().enumerate().map(|(k, cause)| {
        let right = case.truths.iter().any(|truth| truth.label == labels[k]);
        Named::of(cause, right, case.truths.iter().any(|truth| says(k, &truth.label)))
    });
    Judgement { right: verdict == case.verdict && causes_right && faults_right, answer, numbers, named: named.collect() }
}

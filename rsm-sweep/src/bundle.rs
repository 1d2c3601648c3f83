//! A scenario with all its files in one text, for workers on other hosts without a shared file system.
//!
//! In: a scenario, or a bundle. Out: a bundle, or the same scenario with the same tasks and hashes.

use rsm_core::source::{Fault, Faults, Source};
use serde_json::{Map, Value, json};

use crate::scenario::Scenario;

/// The bundle of a scenario.
#[must_use]
pub fn write(scenario: &Scenario) -> String {
    let files: Map<String, Value> = scenario.files.iter().map(|(name, text)| (name.clone(), json!(text))).collect();
    json!({ "bundle": 1, "scenario": scenario.source.text(), "name": scenario.source.name(), "files": files }).to_string()
}

/// Whether a text is a bundle: its beginning is not valid at the beginning of TOML.
#[must_use]
pub fn is_one(text: &str) -> bool {
    text.starts_with("{\"bundle\":")
}

/// Reads a bundle.
///
/// # Errors
/// If the text is not a bundle of this version, or its scenario has faults.
pub fn read(source: &Source) -> Result<Scenario, Faults> {
    let refuse = |what: &str| Faults::one(Fault::whole_file(source.name(), what));
    let value: Value =
        serde_json::from_str(source.text()).map_err(|error| refuse(&format!("not a bundle of `rsm sweep`: {error}")))?;
    let (Some(1), Some(scenario), Some(name), Some(files)) =
        (value["bundle"].as_u64(), value["scenario"].as_str(), value["name"].as_str(), value["files"].as_object())
    else {
        return Err(refuse("not a bundle of this version of rsm"));
    };
    let open = |wanted: &str| match files.get(wanted).and_then(Value::as_str) {
        Some(text) => Ok(Source::new(wanted, text)),
        None => Err(Faults::one(Fault::whole_file(wanted, "is not in the bundle"))),
    };
    Scenario::read(&Source::new(name, scenario), &open)
}

//! `rsm emit` of a plant of equations: a step of constant length as source text.
//!
//! In: a plant, the length of a step, a starting point. Out: a header and a source file in C, or a module in Rust, complete or not written at all.

use std::path::{Path, PathBuf};

use rsm_core::emit::{c_plant, rust_plant};
use rsm_core::source::Source;
use rsm_sim::equations::{Machine, Signals, code, linearise};
use serde_json::json;

use super::point;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

/// The options of the command line for a plant.
pub struct Options<'a> {
    pub step: f64,
    pub in_c: bool,
    pub name: Option<&'a str>,
    pub at: Option<&'a str>,
    pub record: Option<&'a Path>,
    /// The configuration of the plant file.
    pub configuration: Option<&'a str>,
    /// A folder of further effects.
    pub effects: Option<&'a Path>,
    pub out: &'a Path,
    pub as_json: bool,
}

pub fn run(path: &Path, options: &Options<'_>) -> Outcome {
    let record = options.record.map(Source::read).transpose()?;
    let file = super::file(path, record.as_ref(), options.effects)?;
    let mut file = super::in_configuration(file, options.configuration)?;
    if let Some(record) = &record {
        file = file.of_record(record)?;
    }
    super::refuse_several(path, &file, "--configuration or --record")?;
    let mut machine = Machine::new(&file)?;
    let (start, words) = match &record {
        None => {
            let at = options.at.unwrap_or_default();
            let words = if at.is_empty() { "all inputs 0".to_string() } else { format!("at {at}") };
            (point(&file, &mut machine, at)?, words)
        }
        Some(record) => {
            let signals = Signals::read(record, &file, &machine)?;
            let inputs: Vec<f64> = signals.inputs.iter().map(|it| it[0]).collect();
            let (given, recorded) = signals.start(&file, &machine);
            (
                machine.start_along(&file, signals.time[0], &inputs, &given, &recorded)?,
                format!("with the first row of {}", options.record.map_or_else(String::new, shown)),
            )
        }
    };
    let linear = linearise(&file, &machine, &start)?;
    let from = code::Start { point: &start, words, linear: &linear };
    let plant = code::plant(&machine, options.step, &from, options.name, &shown(path))
        .map_err(|what| Refusal::new(format!("{}: --step: {what}", path.display())))?;
    let file = |ending: &str| options.out.join(format!("{}.{ending}", plant.model));
    let files: Vec<(PathBuf, String)> = if options.in_c {
        let text = c_plant::emit(&plant);
        vec![(file("h"), text.header), (file("c"), text.source)]
    } else {
        vec![(file("rs"), rust_plant::emit(&plant))]
    };
    output::write_all(&files)?;
    if options.as_json {
        let names: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
        let states: Vec<_> = plant
            .tape
            .states
            .iter()
            .zip(&plant.states)
            .map(|(it, (signal, start))| json!({ "name": it.name, "unit": signal.unit, "start": start }))
            .collect();
        output::json(&json!({
            "model": plant.model,
            "files": names,
            "functions": plant.functions(options.in_c),
            "step": plant.length,
            "operations": plant.tape.operation_count(),
            "states": states,
        }))?;
    } else {
        for (path, _) in &files {
            output::line(&path.display().to_string())?;
        }
    }
    Ok(Answer::Positive)
}

/// The name of a file without its folder: emitted text is the same wherever it was made.
fn shown(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

//! `rsm emit`: evaluators as source text.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use rsm_core::check::Checked;
use rsm_core::{compile, emit};
use serde_json::json;

use super::{PrecisionName, model_source, precisions, tell_left_out};
use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The model file; - is standard input
    model: PathBuf,
    /// The language
    #[arg(long)]
    lang: Language,
    /// The precisions; all that can hold the model when not given
    #[arg(long, value_delimiter = ',')]
    precision: Vec<PrecisionName>,
    /// Also the gradient of each surface: its derivatives by its inputs
    #[arg(long)]
    gradient: bool,
    /// The folder for the files
    #[arg(long)]
    out: PathBuf,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// A language to emit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Language {
    /// one module that needs nothing outside core
    Rust,
    /// C99, a header and a source file
    C,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let asked = precisions(&arguments.precision);
    let checked = Checked::read(&model_source(&arguments.model)?)?;
    let unit =
        if arguments.gradient { compile::unit_with_gradients(&checked, &asked)? } else { compile::unit(&checked, &asked)? };
    let model = &unit.model;
    let files: Vec<(PathBuf, String)> = match arguments.lang {
        Language::Rust => vec![(arguments.out.join(format!("{model}.rs")), emit::rust::emit(&unit))],
        Language::C => {
            let files = emit::c::emit(&unit);
            vec![
                (arguments.out.join(format!("{model}.h")), files.header),
                (arguments.out.join(format!("{model}.c")), files.source),
            ]
        }
    };
    output::write_all(&files)?;
    if asked.is_empty() {
        tell_left_out(&checked);
    }
    if arguments.json {
        let names: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
        let functions: Vec<String> = unit
            .functions
            .iter()
            .map(|function| if arguments.lang == Language::Rust { function.rust_name() } else { function.c_name(model) })
            .collect();
        output::json(&json!({ "model": model, "files": names, "functions": functions }))?;
    } else {
        for (path, _) in &files {
            output::line(&path.display().to_string())?;
        }
    }
    Ok(Answer::Positive)
}

//! `rsm emit`: evaluators, or a step of a plant, as source text.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use rsm_core::check::Checked;
use rsm_core::compile::{self, Parts};
use rsm_core::emit;
use serde_json::json;

use super::following::Following;
use super::{PrecisionName, equations, model_source, precisions, print_left_out};
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The model file (- is standard input), or a plant of equations: a plant file of format 2 or a text (.mo)
    model: PathBuf,
    /// The language of the emitted code
    #[arg(long)]
    lang: Language,
    /// The precisions to emit [default: all that can represent the model]
    #[arg(long, value_delimiter = ',')]
    precision: Vec<PrecisionName>,
    /// Also emit the gradient of each surface: its partial derivatives with respect to its inputs
    #[arg(long)]
    gradient: bool,
    /// Also emit each surface without clamps, for callers that keep arguments and result inside their ranges
    #[arg(long)]
    inside: bool,
    /// With --inside: inputs that change rarely. Their contribution to the surface becomes a separate function
    #[arg(long, value_delimiter = ',', requires = "inside", value_name = "INPUT")]
    once: Vec<String>,
    /// Also emit the update step of recursive least squares for a surface, and its evaluator with the adapted coefficients
    #[arg(long)]
    recursive: bool,
    #[command(flatten)]
    following: Following,
    /// For a plant: the length of a step in s. The emitted step gives the same bits as `rsm simulate --fixed-step`
    #[arg(long, conflicts_with_all = ["precision", "gradient", "inside", "recursive"])]
    step: Option<f64>,
    /// For a plant: the starting point, `speed=3,command=2`. Inputs that are not named are 0, states have their start values
    #[arg(long, requires = "step", allow_hyphen_values = true)]
    at: Option<String>,
    /// For a plant: a folder of further effects, one TOML file each
    #[arg(long, requires = "step", value_name = "DIR")]
    effects: Option<PathBuf>,
    /// For a plant: a record whose first row gives the starting point, as for `rsm simulate`
    #[arg(long, requires = "step", conflicts_with = "at")]
    record: Option<PathBuf>,
    /// For a plant file with [configurations]: the configuration to emit
    #[arg(long, requires = "step", conflicts_with = "record", value_name = "NAME")]
    configuration: Option<String>,
    /// For a plant: the name of the module and the prefix of C names [default: the name of the model in its text]
    #[arg(long, requires = "step")]
    name: Option<String>,
    /// The folder for the files
    #[arg(long)]
    out: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// A language to emit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Language {
    /// Rust, one module that needs only `core`
    Rust,
    /// C99, a header and a source file
    C,
}

pub fn run(arguments: &Arguments) -> Outcome {
    if let (false, Some(option)) = (arguments.recursive, arguments.following.given()) {
        return Err(Refusal::new(format!("{option}: found without --recursive, whose settings it gives")));
    }
    let requested = precisions(&arguments.precision);
    let source = model_source(&arguments.model)?;
    let is_text = arguments.model.extension().is_some_and(|it| it.eq_ignore_ascii_case("mo"));
    let shown = arguments.model.display();
    match (is_text || equations::is_plant(&source), arguments.step) {
        (false, None) => {}
        (true, Some(step)) => {
            let options = equations::emit::Options {
                step,
                effects: arguments.effects.as_deref(),
                in_c: arguments.lang == Language::C,
                name: arguments.name.as_deref(),
                at: arguments.at.as_deref(),
                record: arguments.record.as_deref(),
                configuration: arguments.configuration.as_deref(),
                out: &arguments.out,
                as_json: arguments.json,
            };
            return equations::emit::run(&arguments.model, &options);
        }
        (true, None) => {
            return Err(Refusal::new(format!(
                "{shown}: found a plant without --step: give the length of its step in s, such as --step 1e-4"
            )));
        }
        (false, Some(_)) => {
            return Err(Refusal::new(format!(
                "{shown}: --step is for plants, and this is a model file: it has no `format = 2` or `plant`"
            )));
        }
    }
    let checked = Checked::read(&source)?;
    let mut recursive = vec![];
    if arguments.recursive {
        let (surface, settings) = arguments.following.settings(&checked)?;
        recursive.push((checked.model().surfaces[surface].name.clone(), settings));
    }
    let parts = Parts { gradient: arguments.gradient, inside: arguments.inside, once: arguments.once.clone(), recursive };
    let unit = compile::unit_with_parts(&checked, &requested, &parts)?;
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
    if requested.is_empty() {
        print_left_out(&checked);
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

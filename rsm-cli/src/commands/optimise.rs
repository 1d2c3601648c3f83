//! `rsm optimise`: the best settings for several responses of a model, or a Pareto front of responses that conflict.
//!
//! In: a model file and a study. Out: settings and responses in words or as JSON, and as a CSV with one row for each point.

use std::path::PathBuf;

use clap::Args;
use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::number::Precision;
use rsm_core::source::Source;
use rsm_fit::optimise::{Front, Limit, Optimum, Study};
use serde_json::{Value, json};

use super::model_source;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;
use crate::page::number::with_unit;

#[derive(Args)]
pub struct Arguments {
    /// The model file; - is standard input
    model: PathBuf,
    /// The study: goals of responses, limits of inputs
    #[arg(long)]
    goals: PathBuf,
    /// Search a front of this many points instead of the best settings
    #[arg(long, value_name = "N")]
    pareto: Option<usize>,
    /// A CSV file for the settings and responses, one row for each point
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let checked = Checked::read(&model_source(&arguments.model)?)?;
    compile::held(&checked, &[Precision::F64])?;
    let study = Study::from_source(Source::read(&arguments.goals)?)?;
    let (found, points, words, answer) = match arguments.pareto {
        None => {
            let optimum = study.optimise(&checked)?;
            let answer = if optimum.is_acceptable() { Answer::Positive } else { Answer::Negative };
            (object(&optimum)?, vec![optimum.clone()], in_words(&checked, &study, &optimum), answer)
        }
        Some(count) => {
            let front = study.front(&checked, count)?;
            let answer = if front.points.is_empty() { Answer::Negative } else { Answer::Positive };
            (object(&front)?, front.points.clone(), front_in_words(&checked, &study, &front), answer)
        }
    };
    if let Some(out) = &arguments.out {
        output::write_all(&[(out.clone(), csv(&checked, &points))])?;
    }
    if arguments.json {
        let mut object = json!({
            "study": study.name,
            "model": checked.model().name,
            "out": arguments.out.as_ref().map(|out| out.display().to_string()),
        });
        if let (Value::Object(object), Value::Object(more)) = (&mut object, found) {
            object.extend(more);
        }
        output::json(&object)?;
    } else {
        output::line(words.trim_end())?;
        if let Some(out) = &arguments.out {
            stderr_line!("written: {}", out.display());
        }
    }
    Ok(answer)
}

fn object(found: &impl serde::Serialize) -> Result<Value, Refusal> {
    serde_json::to_value(found).map_err(|error| Refusal::new(format!("cannot be written as JSON: {error}")))
}

fn input_unit<'a>(checked: &'a Checked, name: &str) -> &'a str {
    checked.model().input(name).map_or("1", |input| &input.unit)
}

fn settings(checked: &Checked, optimum: &Optimum) -> String {
    let setting = |(name, value): &(String, f64)| format!("{name} = {}", with_unit(&six(*value), input_unit(checked, name)));
    optimum.settings.0.iter().map(setting).collect::<Vec<_>>().join(", ")
}

fn in_words(checked: &Checked, study: &Study, optimum: &Optimum) -> String {
    let mut text = format!("{}: {}\n", study.name, settings(checked, optimum));
    let width = optimum.responses.iter().map(|it| it.response.chars().count()).max().unwrap_or(0);
    for it in &optimum.responses {
        let value = with_unit(&six(it.value), &it.unit);
        text += &format!("  {:width$}  {value:>20}  {:8}  desirability {:.4}\n", it.response, it.goal, it.desirability);
    }
    text += &format!(
        "  total desirability {:.6}; {} of {} searches ended there\n",
        optimum.desirability, optimum.agreeing, optimum.starts
    );
    for limit in &optimum.active {
        text += &format!("  active: {}\n", limit_in_words(limit));
    }
    for limit in &optimum.violated {
        text += &format!("  violated: {}, by {}\n", limit_in_words(limit), six(limit.excess));
    }
    if !optimum.violated.is_empty() {
        text += "no settings were found that hold all limits; these violate them least\n";
    } else if optimum.desirability <= 0.0 {
        let bad: Vec<&str> =
            optimum.responses.iter().filter(|it| it.desirability <= 0.0).map(|it| it.response.as_str()).collect();
        text += &format!("no settings were found at which every response is acceptable; here not: {}\n", bad.join(", "));
    }
    text
}

fn limit_in_words(limit: &Limit) -> String {
    match limit.kind {
        "support" => format!("the data of `{}` end here", limit.name),
        "condition" => format!("condition {} of `where`, {} {}", limit.name, limit.end, six(limit.bound)),
        kind => format!("{kind} `{}` at its {} limit {}", limit.name, limit.end, six(limit.bound)),
    }
}

fn front_in_words(checked: &Checked, study: &Study, front: &Front) -> String {
    if front.points.is_empty() {
        return format!("{}: no settings were found that hold all limits\n", study.name);
    }
    let mut text = format!("{}: front of {} points in {}\n", study.name, front.points.len(), front.objectives.join(", "));
    for ((name, best), worst) in front.objectives.iter().zip(&front.best).zip(&front.worst) {
        text += &format!("  {name}: {} at best, {} at worst\n", six(*best), six(*worst));
    }
    for point in &front.points {
        let of_objective = |it: &&rsm_fit::optimise::ResponseValue| front.objectives.contains(&it.response);
        let values = point.responses.iter().filter(of_objective);
        let values: Vec<String> =
            values.map(|it| format!("{} = {}", it.response, with_unit(&six(it.value), &it.unit))).collect();
        text += &format!("  {}: {}\n", values.join(", "), settings(checked, point));
    }
    text
}

/// Inputs, responses, desirability.
fn csv(checked: &Checked, points: &[Optimum]) -> String {
    let Some(first) = points.first() else { return "desirability[1]\n".to_string() };
    let inputs = first.settings.0.iter().map(|(name, _)| format!("{name}[{}]", input_unit(checked, name)));
    let responses = first.responses.iter().map(|it| format!("{}[{}]", it.response, it.unit));
    let header: Vec<String> = inputs.chain(responses).chain(["desirability[1]".to_string()]).collect();
    let mut text = header.join(",") + "\n";
    for point in points {
        let values = point.settings.0.iter().map(|(_, value)| *value).chain(point.responses.iter().map(|it| it.value));
        // The shortest decimal number that has the same bits.
        let row: Vec<String> = values.chain([point.desirability]).map(|value| value.to_string()).collect();
        text += &(row.join(",") + "\n");
    }
    text
}

/// A number with six digits.
fn six(value: f64) -> String {
    format!("{value:.5e}").parse::<f64>().map_or_else(|_| value.to_string(), |value| value.to_string())
}

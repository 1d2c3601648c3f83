//! `rsm design --evaluate`: the terms that the runs of a design can determine, in words or as JSON.
//!
//! In: an evaluation. Out: standard output. The answer is negative if a term cannot be estimated.

use std::path::Path;

use rsm_fit::plan::{AliasRow, DesignSpecification, Evaluation, TermEvaluation};
use serde_json::{Value, json};

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;
use crate::page::number::with_unit;

/// Entries of the alias matrix of at least this size are printed in words. JSON has all.
const LEAST_ALIAS: f64 = 0.1;

/// The largest number of names in a printed line.
const MOST_NAMES: usize = 8;

/// Prints an evaluation. `file`: the runs, if they are not those of the specification.
pub(super) fn print(specification: &DesignSpecification, found: &Evaluation, file: Option<&Path>, json: bool) -> Outcome {
    if json {
        let failed = |error: serde_json::Error| Refusal::new(format!("cannot be written as JSON: {error}"));
        let mut object = json!({
            "plan": specification.plan,
            "design": file.is_none().then(|| specification.design.name()),
            "file": file.map(|file| file.display().to_string()),
        });
        if let (Value::Object(object), Value::Object(more)) = (&mut object, serde_json::to_value(found).map_err(failed)?) {
            object.extend(more);
        }
        output::json(&object)?;
    } else {
        output::line(in_words(specification, found, file).trim_end())?;
    }
    Ok(if found.is_estimable() { Answer::Positive } else { Answer::Negative })
}

fn in_words(specification: &DesignSpecification, found: &Evaluation, file: Option<&Path>) -> String {
    let of = match file {
        Some(file) => file.display().to_string(),
        None => format!("{}, {}", specification.plan, specification.design.name()),
    };
    let contrasts = found.parameters - found.terms_of_model;
    let blocks = if contrasts > 0 { format!(" ({contrasts} of blocks)") } else { String::new() };
    let mut text = format!("{of}: {} runs of {} points, {} parameters{blocks}\n", found.runs, found.points, found.parameters);
    if found.runs_outside > 0 {
        text += &format!("  {} runs lie outside the region of the specification\n", found.runs_outside);
    }
    if !found.is_estimable() {
        text += &format!("  the runs determine {} of {} parameters. On every run:\n", found.rank, found.parameters);
        for relation in &found.dependent {
            text += &format!("    {}\n", relation.relation);
        }
        let lost: Vec<&str> = found.terms.iter().filter(|it| !it.estimable).map(|it| it.term.as_str()).collect();
        if !lost.is_empty() {
            text += &format!("  these terms cannot be estimated: {}\n", lost.join(", "));
        }
    }
    let freedom = found.freedom;
    text += &format!(
        "  degrees of freedom: {} of the residual, {} of lack of fit, {} of pure error\n",
        freedom.residual, freedom.lack_of_fit, freedom.pure_error
    );
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let efficiency = &found.efficiency;
    let others = [("A", efficiency.a), ("G", efficiency.g), ("I", efficiency.i)];
    text += &format!("  efficiency: D {}", percent(efficiency.d));
    for (name, value) in others.iter().filter_map(|(name, value)| value.map(|value| (name, value))) {
        text += &format!(", {name} {}", percent(value));
    }
    text += "\n";
    let leverage = &found.leverage;
    let runs: Vec<String> = leverage.runs.iter().map(ToString::to_string).collect();
    text += &format!(
        "  leverage: mean {:.3}, largest {:.3} of {} {}\n",
        leverage.mean,
        leverage.largest,
        if runs.len() == 1 { "run" } else { "runs" },
        first(&runs)
    );
    if let Some(prediction) = &found.prediction {
        let setting = |(name, value): &(String, f64)| {
            let unit = specification.factors.iter().find(|factor| factor.name == *name).map_or("", |factor| &factor.unit);
            format!("{name} = {}", with_unit(&short(*value), unit))
        };
        let at: Vec<String> = prediction.at.0.iter().map(setting).collect();
        text += &format!(
            "  variance of a prediction times runs, in units of the noise variance: mean {:.3}, largest {:.3} at {}\n",
            prediction.mean,
            prediction.max,
            at.join(", ")
        );
        let each = prediction.quantiles.iter().map(|it| format!("{:.3} in {:.0} %", it.value, 100.0 * it.share));
        text += &format!("    at most {} of the region\n", each.collect::<Vec<_>>().join(", "));
    }
    text += &table(&found.terms);
    match &found.aliases {
        None => text += "aliases are not listed: too many terms are missing in the model\n",
        Some(rows) => text += &aliases(rows),
    }
    text
}

/// A line for each term.
fn table(terms: &[TermEvaluation]) -> String {
    let width = terms.iter().map(|term| term.term.chars().count()).max().unwrap_or(0).max(4);
    let mut text = format!("{:width$}  {:>10}  {:>8}  {:>10}  {:>10}\n", "term", "variance", "VIF", "power 1 sd", "power 2 sd");
    let number = |value: Option<f64>, decimals: usize| value.map_or("-".to_string(), |value| format!("{value:.decimals$}"));
    for term in terms {
        let power = |k: usize| term.power.map_or("-".to_string(), |power| format!("{:.1} %", 100.0 * power[k]));
        text += &format!(
            "{:width$}  {:>10}  {:>8}  {:>10}  {:>10}\n",
            term.term,
            number(term.variance, 5),
            number(term.vif, 3),
            power(0),
            power(1)
        );
    }
    text
}

/// The larger entries of the alias matrix.
fn aliases(rows: &[AliasRow]) -> String {
    let mut text = String::new();
    for row in rows {
        let large = row.with.iter().filter(|alias| alias.factor.abs() >= LEAST_ALIAS);
        let names: Vec<String> = large.map(|alias| format!("{:+.2} {}", alias.factor, alias.term)).collect();
        if !names.is_empty() {
            text += &format!("  {}: {}\n", row.term, first(&names));
        }
    }
    if text.is_empty() {
        return "no term that the model does not have changes a coefficient by more than a tenth of its own\n".to_string();
    }
    format!("aliases: an estimate contains these terms, if the response has them\n{text}")
}

/// The first of many names, and how many more there are.
fn first(names: &[String]) -> String {
    let shown = names[..names.len().min(MOST_NAMES)].join(", ");
    if names.len() > MOST_NAMES { format!("{shown} and {} more", names.len() - MOST_NAMES) } else { shown }
}

/// A setting with six digits.
fn short(value: f64) -> String {
    let text = format!("{value:.5e}");
    let rounded: f64 = text.parse().unwrap_or(value);
    rounded.to_string()
}

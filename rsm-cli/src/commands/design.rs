//! `rsm design`: from a design specification to a plan in random run order.
//!
//! In: a design specification. Out: a CSV `run[1],factor[unit],...`, whole or absent. The same specification gives the same bytes.

use std::path::PathBuf;

use clap::Args;
use rsm_core::source::Source;
use rsm_fit::plan::{DesignSpecification, Plan};
use serde_json::{Map, Value, json};

use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The design specification
    specification: PathBuf,
    /// The CSV that is written
    #[arg(long)]
    out: PathBuf,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let specification = DesignSpecification::from_source(Source::read(&arguments.specification)?)?;
    let plan = Plan::make(&specification)?;
    output::write_all(&[(arguments.out.clone(), plan.csv())])?;
    let out = arguments.out.display().to_string();
    if arguments.json {
        let factors: Map<String, Value> = plan
            .factors
            .iter()
            .map(|factor| {
                let mut settings = factor.values.clone();
                settings.sort_by(f64::total_cmp);
                settings.dedup();
                let range = [settings.first(), settings.last()];
                (factor.name.clone(), json!({ "unit": factor.unit, "settings": settings.len(), "range": range }))
            })
            .collect();
        output::json(&json!({
            "plan": specification.plan,
            "design": specification.design.name(),
            "seed": specification.seed,
            "runs": plan.runs.len(),
            "points": plan.points(),
            "left_out": plan.kept.as_ref().map(|kept| json!({
                "points": kept.left_out(),
                "of": kept.of,
                "correlation": kept.correlation[1],
                "correlation_of_whole": kept.correlation[0],
                "was_rotatable": kept.was_rotatable,
            })),
            "factors": factors,
            "out": out,
        }))?;
    } else {
        let names: Vec<&str> = plan.factors.iter().map(|factor| factor.name.as_str()).collect();
        let (runs, points) = (plan.runs.len(), plan.points());
        tell!("{out}: {runs} runs of {points} points in {}, {}", names.join(", "), specification.design.name());
    }
    if let Some(kept) = &plan.kept {
        tell!("warning: {}", kept.words(specification.design.name()));
    }
    Ok(Answer::Positive)
}

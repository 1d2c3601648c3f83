//! `rsm design`: from a design specification to a plan in random run order, or to its evaluation.
//!
//! In: a design specification. Out: a CSV `run[1],factor[unit],...`, complete or not written at all; with `--evaluate` the evaluation of the design.
//! The same specification gives the same bytes.

mod evaluate;

use std::path::{Path, PathBuf};

use clap::Args;
use rsm_core::source::Source;
use rsm_fit::plan::{Design, DesignSpecification, Existing, Fraction, Plan, Runs};
use serde_json::{Map, Value, json};

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The design specification
    specification: PathBuf,
    /// The CSV file to write
    #[arg(long, required_unless_present = "evaluate")]
    out: Option<PathBuf>,
    /// A CSV file of runs that were already made, with the factors: an optimal design adds the best further runs
    #[arg(long)]
    augment: Option<PathBuf>,
    /// Evaluate the design: what its runs can determine. With a CSV file: these runs in place of those of the specification
    #[arg(long, value_name = "RUNS")]
    evaluate: Option<Option<PathBuf>>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let folder = arguments.specification.parent().unwrap_or(Path::new(""));
    let specification = DesignSpecification::from_source_in(Source::read(&arguments.specification)?, folder)?;
    if let Some(Some(runs)) = &arguments.evaluate {
        if arguments.out.is_some() || arguments.augment.is_some() {
            let what = "--evaluate: found a file of runs with --out or --augment; evaluated runs are not planned";
            return Err(Refusal::new(format!("{what}\n  help: leave the file out to evaluate the design that is made")));
        }
        let evaluation = specification.evaluate(&Runs::read(runs, &specification)?)?;
        return evaluate::print(&specification, &evaluation, Some(runs), arguments.json);
    }
    let existing = arguments.augment.as_ref().map(|done| Existing::read(done, &specification)).transpose()?;
    let plan = match &existing {
        None => Plan::make(&specification)?,
        Some(done) => Plan::augment(&specification, done)?,
    };
    if arguments.evaluate.is_some() {
        let runs = existing.map_or_else(|| Runs::of(&plan), |existing| Runs::of_augmented(&plan, &existing));
        // The evaluation comes first: if it is refused, no file is written.
        let evaluation = specification.evaluate(&runs)?;
        if let Some(out) = &arguments.out {
            output::write_all(&[(out.clone(), plan.csv())])?;
            stderr_line!("{}: {} runs", out.display(), plan.runs.len());
        }
        return evaluate::print(&specification, &evaluation, None, arguments.json);
    }
    let Some(out) = &arguments.out else { return Err(Refusal::new("--out is missing")) };
    let fraction = match &specification.design {
        Design::FractionalFactorial(fraction) => Some(fraction),
        _ => None,
    };
    let effects = |fraction: &Fraction| -> Vec<Vec<String>> {
        let class = |class: &Vec<(u32, bool)>| class.iter().map(|effect| effect_name(&specification, *effect)).collect();
        fraction.aliases().iter().map(class).collect()
    };
    output::write_all(&[(out.clone(), plan.csv())])?;
    let out = out.display().to_string();
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
            "blocks": plan.blocks.iter().max(),
            "fraction": fraction.map(|fraction| json!({
                "resolution": fraction.resolution(),
                "words": fraction.words().iter().map(|word| effect_name(&specification, *word)).collect::<Vec<_>>(),
                "aliases": effects(fraction),
            })),
            "factors": factors,
            "out": out,
        }))?;
    } else {
        let names: Vec<&str> = plan.factors.iter().map(|factor| factor.name.as_str()).collect();
        let (runs, points) = (plan.runs.len(), plan.points());
        if let Some(fraction) = fraction {
            let resolution = fraction.resolution().map_or("full".to_string(), |length| length.to_string());
            stderr_line!("resolution {resolution}; aliased effects:");
            for class in effects(fraction) {
                stderr_line!("  {}", class.join(" = "));
            }
        }
        stderr_line!("{out}: {runs} runs of {points} points in {}, {}", names.join(", "), specification.design.name());
    }
    if let Some(kept) = &plan.kept {
        stderr_line!("warning: {}", kept.words(specification.design.name()));
    }
    Ok(Answer::Positive)
}

/// `a`, `a*b`, `-a*b*c`.
fn effect_name(specification: &DesignSpecification, (set, is_negative): (u32, bool)) -> String {
    let factors = specification.factors.iter().enumerate();
    let names: Vec<&str> = factors.filter(|(k, _)| set >> k & 1 == 1).map(|(_, factor)| factor.name.as_str()).collect();
    format!("{}{}", if is_negative { "-" } else { "" }, names.join("*"))
}

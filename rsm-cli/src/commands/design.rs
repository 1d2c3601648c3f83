//! `rsm design`: from a design specification to a plan in random run order.
//!
//! In: a design specification. Out: a CSV `run[1],factor[unit],...`, whole or absent. The same specification gives the same bytes.

use std::path::{Path, PathBuf};

use clap::Args;
use rsm_core::source::Source;
use rsm_fit::plan::{Design, DesignSpecification, Existing, Fraction, Plan};
use serde_json::{Map, Value, json};

use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The design specification
    specification: PathBuf,
    /// The CSV file to write
    #[arg(long)]
    out: PathBuf,
    /// A CSV file of runs that were already made, with the factors: an optimal design adds the best further runs
    #[arg(long)]
    augment: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let folder = arguments.specification.parent().unwrap_or(Path::new(""));
    let specification = DesignSpecification::from_source_in(Source::read(&arguments.specification)?, folder)?;
    let plan = match &arguments.augment {
        None => Plan::make(&specification)?,
        Some(done) => Plan::augment(&specification, &Existing::read(done, &specification)?)?,
    };
    let fraction = match &specification.design {
        Design::FractionalFactorial(fraction) => Some(fraction),
        _ => None,
    };
    let effects = |fraction: &Fraction| -> Vec<Vec<String>> {
        let class = |class: &Vec<(u32, bool)>| class.iter().map(|effect| effect_name(&specification, *effect)).collect();
        fraction.aliases().iter().map(class).collect()
    };
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
            tell!("resolution {resolution}; aliased effects:");
            for class in effects(fraction) {
                tell!("  {}", class.join(" = "));
            }
        }
        tell!("{out}: {runs} runs of {points} points in {}, {}", names.join(", "), specification.design.name());
    }
    if let Some(kept) = &plan.kept {
        tell!("warning: {}", kept.words(specification.design.name()));
    }
    Ok(Answer::Positive)
}

/// `a`, `a*b`, `-a*b*c`.
fn effect_name(specification: &DesignSpecification, (set, is_negative): (u32, bool)) -> String {
    let factors = specification.factors.iter().enumerate();
    let names: Vec<&str> = factors.filter(|(k, _)| set >> k & 1 == 1).map(|(_, factor)| factor.name.as_str()).collect();
    format!("{}{}", if is_negative { "-" } else { "" }, names.join("*"))
}

//! `rsm merge`: the fit of all parts that `rsm fit --partial` has written.
//!
//! In: files of parts. Out: the model file and the figures of `rsm fit`, as far as sums have them; or one part.

use std::path::PathBuf;

use clap::Args;
use rsm_core::source::{Collector, Source};
use rsm_fit::partial::{self, Merged, Part};

use super::fit;
use crate::outcome::{Outcome, Refusal};
use crate::page::number::with_unit;

#[derive(Args)]
pub struct Arguments {
    /// The files of all parts, in any order
    #[arg(required = true)]
    parts: Vec<PathBuf>,
    /// The model file to write [default: print the model]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Write the sums of all parts to this file as one part, instead of a fit
    #[arg(long, value_name = "PART", conflicts_with = "out")]
    partial: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let parts = read(&arguments.parts)?;
    if let Some(path) = &arguments.partial {
        return fit::give_part(&partial::combine(parts)?, path, arguments.json);
    }
    let merged = partial::merge(parts)?;
    let json = arguments.json.then(|| merged.report());
    fit::give(&merged.outcome, json, &in_words(&merged), arguments.out.as_deref(), Vec::new())
}

/// Reads all parts; the faults of all files are reported together.
fn read(paths: &[PathBuf]) -> Result<Vec<Part>, Refusal> {
    let mut faults = Collector::new();
    let mut parts = Vec::new();
    for path in paths {
        match Source::read(path).and_then(|source| Part::read(&source)) {
            Ok(part) => parts.push(part),
            Err(found) => found.list().iter().for_each(|fault| faults.push(fault.clone())),
        }
    }
    Ok(faults.finish(Some(parts))?)
}

fn in_words(merged: &Merged) -> String {
    let mut text = fit::in_words(&merged.outcome);
    for (response, bounds) in &merged.merge.largest_difference.0 {
        if let Some(largest) = bounds.as_ref().and_then(|bounds| bounds.iter().copied().reduce(f64::max)) {
            let unit = merged.outcome.model.surface(response).map_or_else(String::new, |surface| surface.unit_of_terms());
            text += &format!(
                "{response}: coefficients of one fit of all rows differ by at most {}\n",
                with_unit(&format!("{largest:.1e}"), &unit)
            );
        }
    }
    text + &format!(
        "{} parts; they hold no rows, so these do not exist: {}\n",
        merged.merge.parts,
        merged.merge.needs_rows.join(", ")
    )
}

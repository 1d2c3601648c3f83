//! `rsm track`: a surface follows measured rows in order, by the update step of `rsm emit --recursive`.
//!
//! In: a model file and CSV files of rows. Out: used and frozen rows, errors before each update, how far each coefficient moved; with `--out` the
//! model file with the adapted coefficients.

use std::path::PathBuf;

use clap::Args;
use rsm_core::check::Checked;
use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_fit::track::{Track, Tracked};
use serde_json::json;

use super::following::Following;
use super::{PrecisionName, model_source};
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;
use crate::page::number::with_unit;

/// From this number of rows in one run on, rows beyond the gate are named: single outliers do not come in tens.
const RUN: usize = 10;

#[derive(Args)]
pub struct Arguments {
    /// The model file; - is standard input
    model: PathBuf,
    /// A CSV file of measured rows in the order of time, with columns named like the inputs and the surface; may be repeated
    #[arg(long, required = true, value_name = "CSV")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    following: Following,
    /// The precision of the update, that of the target
    #[arg(long, default_value = "f64")]
    precision: PrecisionName,
    /// The model file with the adapted coefficients
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let checked = Checked::read(&model_source(&arguments.model)?)?;
    let (surface, settings) = arguments.following.settings(&checked)?;
    let data: Vec<Source> = arguments.data.iter().map(|path| Source::read(path)).collect::<Result<_, _>>()?;
    let track = Track { surface, settings, precision: arguments.precision.precision() };
    let (found, model) = track.run(&checked, &data)?;
    if let Some(out) = &arguments.out {
        output::write_all(&[(out.clone(), model_file::write(&model))])?;
    }
    if arguments.json {
        let mut object =
            serde_json::to_value(&found).map_err(|error| Refusal::new(format!("cannot be written as JSON: {error}")))?;
        object["model"] = json!(checked.model().name);
        object["out"] = json!(arguments.out.as_ref().map(|out| out.display().to_string()));
        let it = &track.settings;
        object["settings"] = json!({
            "forgetting": it.forgetting, "noise": it.noise, "gate": it.gate, "limit": it.limit, "start": it.start,
            "precision": track.precision.name(),
        });
        output::json(&object)?;
    } else {
        output::line(words(&found, &track).trim_end())?;
        if let Some(out) = &arguments.out {
            stderr_line!("written: {}", out.display());
        }
    }
    Ok(if found.used > 0 { Answer::Positive } else { Answer::Negative })
}

fn words(found: &Tracked, track: &Track) -> String {
    let number = |value: f64| with_unit(&six(value), &found.unit);
    let it = &track.settings;
    let mut text = format!("{}: {} of {} rows used", found.surface, found.used, found.rows);
    let frozen = found.frozen;
    let reasons = [
        (frozen.not_finite, "not finite".to_string()),
        (frozen.outside, "outside the range of an input or the support".to_string()),
        (frozen.beyond_gate, format!("error above {} standard deviations", six(it.gate))),
        (frozen.state, "a state would not be finite".to_string()),
    ];
    let reasons: Vec<String> =
        reasons.iter().filter(|(rows, _)| *rows > 0).map(|(rows, why)| format!("{rows} {why}")).collect();
    text += &if reasons.is_empty() { "\n".to_string() } else { format!("; frozen: {}\n", reasons.join(", ")) };
    text += &format!(
        "  forgetting factor {}, noise {}, precision {}\n",
        six(it.forgetting),
        number(it.noise),
        track.precision.name()
    );
    if let Some(ratio) = found.error_ratio {
        text += &format!("  errors before each update are {} of their standard deviation\n", six(ratio));
    }
    if let Some(run) = found.longest_beyond_gate.as_ref().filter(|run| run.rows >= RUN) {
        text += &format!(
            "  warning: {} rows in a run were above the gate, from {}:{} on. If the surface has jumped there, start again from a new fit, or raise --gate\n",
            run.rows, run.file, run.line
        );
    }
    text += "  part  rows   used  rmse before each update  rmse of the file\n";
    for (k, part) in found.parts.iter().enumerate() {
        let rms = |value: Option<f64>| value.map_or("-".to_string(), number);
        text += &format!(
            "  {:>4}  {:>5}  {:>5}  {:>23}  {:>16}\n",
            k + 1,
            part.rows,
            part.used,
            rms(part.rmse),
            rms(part.rmse_of_file)
        );
    }
    let width = found.coefficients.iter().map(|it| it.term.chars().count()).max().unwrap_or(0);
    for it in &found.coefficients {
        text += &format!(
            "  {:width$}  {} -> {}, moved {}, standard error {}\n",
            it.term,
            six(it.before),
            number(it.after),
            number(it.after - it.before),
            number(it.standard_error)
        );
    }
    text
}

/// A number with six digits.
fn six(value: f64) -> String {
    format!("{value:.5e}").parse::<f64>().map_or_else(|_| value.to_string(), |value| value.to_string())
}

//! `rsm fit`: from data to a model file, or to the sums of a part of the data, which `rsm merge` fits together with others.

use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use rsm_core::check::Checked;
use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_fit::constrain::{ConstraintReport, ConstraintStatistics};
use rsm_fit::fit::{self, ChosenBy, Outcome as Fitted, Progress, ResponseOutcome, Verdict};
use rsm_fit::partial::{self, Part};
use rsm_fit::records::{DataFile, Refused};
use rsm_fit::spec::Specification;
use rsm_fit::statistics::{Named, ValidationStatistics};
use serde::Serialize;
use serde_json::json;

use crate::outcome::{Answer, Outcome, Refusal};
use crate::{output, report};

#[derive(Args)]
pub struct Arguments {
    /// The fit specification
    specification: PathBuf,
    /// The model file to write [default: print the model]
    #[arg(long)]
    out: Option<PathBuf>,
    /// A folder for the report, one HTML file with tables and plots
    #[arg(long)]
    report: Option<PathBuf>,
    /// Write the sums of the data to this file instead of a fit; `rsm merge` fits the files of all shards
    #[arg(long, value_name = "PART", conflicts_with_all = ["out", "report"])]
    partial: Option<PathBuf>,
    /// With --partial: a data file of this shard, in place of those of the specification; may be repeated
    #[arg(long, value_name = "FILE", requires = "partial")]
    data: Vec<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let specification = Specification::read(&arguments.specification)?;
    if let Some(path) = &arguments.partial {
        return partial(&specification, path, arguments);
    }
    let fitted = with_progress(&specification)?;
    let mut files = Vec::new();
    if let Some(folder) = &arguments.report {
        files.push((folder.join("report.html"), report::fit(&fitted)?));
    }
    let json = arguments.json.then(|| fitted.report());
    give(&fitted, json, &in_words(&fitted), arguments.out.as_deref(), files)
}

/// Writes the model file beside other files, and prints the outcome: as JSON if there is some; otherwise in words, with the model if it has no file.
pub fn give(
    fitted: &Fitted,
    json: Option<impl Serialize>,
    words: &str,
    out: Option<&Path>,
    others: Vec<(PathBuf, String)>,
) -> Outcome {
    let mut files: Vec<(PathBuf, String)> = Vec::new();
    // If no response could be fitted, there is no model file.
    if let (Some(path), false) = (out, fitted.model.surfaces.is_empty()) {
        // Check that the written file can be read again.
        Checked::from_model(&fitted.model)?;
        files.push((path.to_path_buf(), model_file::write(&fitted.model)));
    }
    files.extend(others);
    output::write_all(&files)?;
    if let Some(json) = json {
        output::json(&json)?;
        stderr_text!("{words}");
    } else if out.is_some() {
        output::line(words.trim_end())?;
        // Standard output may be a file, so warnings also go to standard error.
        stderr_text!("{}", warnings(fitted));
        for (path, _) in &files {
            output::line(&format!("written: {}", path.display()))?;
        }
    } else {
        stderr_text!("{words}");
        if !fitted.model.surfaces.is_empty() {
            output::line(model_file::write(&fitted.model).trim_end())?;
        }
    }
    Ok(if fitted.reached() { Answer::Positive } else { Answer::Negative })
}

/// Writes the sums of a shard.
fn partial(specification: &Specification, path: &Path, arguments: &Arguments) -> Outcome {
    let part = spinning(|progress| partial::of_files(specification, &arguments.data, progress))?;
    give_part(&part, path, arguments.json)
}

/// Writes a part, and prints what it has.
pub fn give_part(part: &Part, path: &Path, json: bool) -> Outcome {
    output::write_all(&[(path.to_path_buf(), part.write())])?;
    if json {
        let file = |file: &DataFile| json!({ "file": file.name, "sha256": file.sha256, "rows": file.rows });
        let files: Vec<_> = part.files().iter().map(file).collect();
        output::json(&json!({
            "part": path.display().to_string(), "sha256": part.sha256(), "rows": part.rows(), "data": files
        }))?;
    } else {
        let files = match part.files().len() {
            1 => "1 file".to_string(),
            count => format!("{count} files"),
        };
        output::line(&format!("written: {}, the sums of {} rows of {files}", path.display(), part.rows()))?;
    }
    Ok(Answer::Positive)
}

/// Fits. On a terminal a spinner shows the current step.
pub fn with_progress(specification: &Specification) -> Result<Fitted, Refusal> {
    spinning(|progress| fit::fit(specification, progress))
}

/// The same for data files that are in memory.
pub fn sources_with_progress(specification: &Specification, sources: &[Source]) -> Result<Fitted, Refusal> {
    spinning(|progress| fit::fit_sources(specification, sources, progress))
}

fn spinning<T>(fit: impl FnOnce(&mut dyn FnMut(Progress<'_>)) -> Result<T, Refused>) -> Result<T, Refusal> {
    // Draws on standard error, and only on a terminal.
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::with_template("{spinner} {elapsed_precise} {msg}").expect("the template is ours"));
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    let result = fit(&mut |progress| {
        bar.set_message(match progress {
            Progress::Reading { file } => format!("reading {file}"),
            Progress::Fitting { response, number, of } => format!("fitting {response} ({number} of {of})"),
            Progress::Step { response, order, terms, confidence } => {
                format!("fitting {response}: order {order}, {terms} terms, confidence {confidence:.3} %")
            }
        });
    });
    bar.finish_and_clear();
    result.map_err(|refused| Refusal::new(refused.to_string()))
}

/// Refuses a fit in which a response has no surface.
pub fn require_all(fitted: &Fitted) -> Result<(), Refusal> {
    match fitted.responses.iter().find(|response| response.statistics.is_none()) {
        Some(response) => Err(Refusal::new(format!("{} could not be fitted: {}", response.name, response.verdict))),
        None => Ok(()),
    }
}

/// A few lines for each response.
pub fn in_words(fitted: &Fitted) -> String {
    let mut text = String::new();
    for (response, left_out) in fitted.responses.iter().zip(&fitted.left_out) {
        text += &format!("{}: {}\n", response.name, verdict_in_words(response));
        text += &left_out.iter().map(|one| format!("  {}\n", one.words())).collect::<String>();
        let Some(statistics) = &response.statistics else {
            text += "  no surface was written for this response\n";
            continue;
        };
        let surface = fitted.model.surface(&response.name);
        let (unit, of_terms) = surface.map_or_else(Default::default, |it| (it.unit.clone(), it.unit_of_terms()));
        // A share has no unit to print.
        let [unit, of_terms] = [unit, of_terms].map(|unit| if unit == "1" { String::new() } else { unit });
        let [behind, behind_terms] = [&unit, &of_terms].map(|it| if it.is_empty() { String::new() } else { format!(" {it}") });
        let figure = |value: Option<f64>| value.map_or("none".to_string(), |value| format!("{value:.4e}{behind_terms}"));
        let what = match &statistics.spline {
            Some(spline) => spline.words(),
            None => format!("{} terms", statistics.terms.len()),
        };
        text += &format!(
            "  {what} from {} rows, residual sd {}, R2 {}\n",
            statistics.rows,
            figure(statistics.residual_sd),
            statistics.r2.map_or("none".to_string(), |r2| format!("{r2:.6}")),
        );
        let errors = |what: &str, errors: &ValidationStatistics, of: &str| {
            format!(
                "  {what}: {} rows {of}, mean error {:.4e}{behind}, largest {:.4e}{behind}, root mean square {:.4e}{behind}\n",
                errors.rows, errors.mean_abs_error, errors.max_abs_error, errors.rmse
            )
        };
        if let Some(transform) = &statistics.transform {
            text += &format!("  transform: {}\n", transform.words());
            if let Some(fitted) = &transform.fitted {
                text += &errors("fitted rows", fitted, "(used for the fit)");
            }
        }
        if let Some(validation) = &statistics.validation {
            text += &match response.chosen_by {
                ChosenBy::Validation => errors("validation", validation, "(these rows chose the terms)"),
                _ => errors("holdout", validation, "(not used for the fit)"),
            };
        }
        if let Some(test) = &statistics.test {
            text += &errors("test", test, "(not used before)");
        }
        if let Some(cross) = &statistics.cross_validation {
            text += &errors("cross-validation", &cross.errors, &format!("left out in {} parts in turn", cross.parts));
        }
        text += &format!(
            "  rows: coefficients from {}; terms by {}\n",
            statistics.rows_used.coefficients, statistics.rows_used.terms
        );
        text += &format!("  error estimate: {}\n", statistics.rows_used.error);
        if let Some(loss) = &statistics.loss {
            text += &format!("  loss: {}\n", loss.words(&of_terms));
        }
        if let Some(noise) = &statistics.noise {
            text += &format!("  noise: {}\n", noise.words());
        }
        if let Some(blocks) = &statistics.blocks {
            text += &format!("  blocks: {}\n", blocks.words(&of_terms));
        }
        if let Some(forms) = &statistics.forms {
            text += &format!("  form: {}\n", forms.words());
        }
        if let Some(constraints) = &statistics.constraints {
            text += &in_words_of_constraints(constraints, [&behind_terms, &behind]);
        }
        if let Some(support) = &statistics.support {
            text += &format!(
                "  supported: {:.1} % of the box by {} half-spaces; {} holdout rows are outside\n",
                100.0 * support.share_of_box,
                support.half_spaces,
                support.unseen_rows_outside
            );
        }
    }
    text + &warnings(fitted)
}

/// The verdict, and the rows on which the criterion was computed.
pub fn verdict_in_words(response: &ResponseOutcome) -> String {
    match response.verdict {
        Verdict::Fitted | Verdict::Infeasible { .. } | Verdict::NotProven(_) | Verdict::IllConditioned { .. } => {
            response.verdict.to_string()
        }
        _ => format!("{} (C on {})", response.verdict, response.chosen_by.words()),
    }
}

/// One line for each warning.
fn warnings(fitted: &Fitted) -> String {
    let of_one = |response: &ResponseOutcome| {
        let warnings = response.statistics.iter().flat_map(|statistics| &statistics.warnings);
        warnings.map(|warning| format!("warning: {}: {}: {}\n", response.name, warning.kind, warning.what)).collect::<String>()
    };
    fitted.responses.iter().map(of_one).collect()
}

/// The constraints that hold, and how much they increase the error. `[of_terms, behind]`: the units of the terms and of the response behind a number.
fn in_words_of_constraints(statistics: &ConstraintStatistics, [of_terms, behind]: [&str; 2]) -> String {
    let mut text = String::new();
    for report in &statistics.constraints {
        let activity =
            if report.points.is_empty() { "not active".to_string() } else { format!("active at {}", places(report)) };
        text += &format!("  constraint {}: proven over the whole region, {activity}\n", report.constraint);
    }
    if let Some(change) = &statistics.largest_change {
        let figure = |value: Option<f64>| value.map_or("none".to_string(), |value| format!("{value:.4e}"));
        let unseen = statistics.validation_without.as_ref();
        let unseen = unseen
            .map_or(String::new(), |unseen| format!(", mean error on validation rows {:.4e}{behind}", unseen.mean_abs_error));
        text += &format!(
            "  without constraints: residual sd {}{of_terms}{unseen}; largest change {:.4e}{of_terms}\n",
            figure(statistics.residual_sd_without),
            change.value
        );
    }
    text
}

fn places(report: &ConstraintReport) -> String {
    let point = |point: &Named<f64>| {
        let each: Vec<String> = point.0.iter().map(|(name, value)| format!("{name} = {value:.5}")).collect();
        each.join(", ")
    };
    report.points.iter().map(point).collect::<Vec<String>>().join("; ")
}

//! `rsm diagnose`: finds errors of a simulation, their causes, the extended plant and the gain.
//!
//! In: a plant file, training, validation and test records. Out: one JSON object, and with `--out` the files diagnosis.json, extended.toml,
//! report.html; correction.toml if a black-box correction gains; law.toml and law-effect.toml if a law that is in no textbook acts;
//! next_experiment.csv if causes cannot be distinguished; with `--refit` the folder refit. The files are complete or not written at all. Every
//! verdict is an answer: exit status 0. A model file with new data goes to [`surface`].

mod cause_json;
mod equations;
mod error_breakdown;
mod evidence;
mod law;
mod next;
mod refit;
mod report;
mod surface;
mod surface_report;
mod words;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use rsm_core::source::{Collector, Source};
use rsm_core::threads;
use rsm_core::toml_reader;
use rsm_diagnose::plant::checks::Finding;
use rsm_diagnose::plant::gaps::FilledGaps;
use rsm_diagnose::plant::units::WrongUnit;
use rsm_diagnose::plant::{self, Cause, Diagnosis, Options};
use rsm_sim::effect::Subject;
use rsm_sim::equation_plant;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use serde_json::{Map, Value, json};

use crate::commands::equations as plants;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;
use cause_json::CauseJson;

#[derive(Args)]
pub struct Arguments {
    /// The nominal plant file, or a model file (then with --data)
    #[arg(value_name = "PLANT.toml|MODEL.toml")]
    plant: PathBuf,
    /// A training record: causes and their parameters are estimated from it; may be repeated
    #[arg(long)]
    record: Vec<PathBuf>,
    /// A validation record: it takes part in the choice of causes, no parameter is estimated from it; may be repeated. With a model file: holdout
    /// data for the error before and after
    #[arg(long)]
    validate: Vec<PathBuf>,
    /// A test record (with a model file: test data): only the final gain is computed on it; may be repeated
    #[arg(long)]
    test: Vec<PathBuf>,
    /// New data to compare with a model file; may be repeated
    #[arg(long)]
    data: Vec<PathBuf>,
    /// The folder for diagnosis.json, extended.toml and report.html
    #[arg(long)]
    out: Option<PathBuf>,
    /// Repeat the designed experiment on the extended plant: writes new surfaces and evaluators to OUT/refit and reports what the controller gains
    #[arg(long, requires = "out")]
    refit: bool,
    /// With --refit: the true plant of a simulated study, on which the surfaces are tested [default: the extended plant]
    #[arg(long, requires = "refit")]
    truth: Option<PathBuf>,
    /// For a plant of equations: a folder of further effects, one TOML file each
    #[arg(long, value_name = "DIR")]
    effects: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    crate::memory::keep_freed_vectors();
    let source = Source::read(&arguments.plant)?;
    if arguments.plant.extension().is_some_and(|it| it.eq_ignore_ascii_case("mo")) {
        return Err(Refusal::new(format!(
            "{}: found a text of equations, expected a plant file that names it (`format = 2`, `model = \"{0}\"`) and gives tolerances, noise and sites",
            source.name()
        )));
    }
    if is_model(&source, arguments)? {
        return surface::run(&surface::Task {
            model: &source,
            data: &arguments.data,
            validate: &arguments.validate,
            test: &arguments.test,
            out: arguments.out.as_deref(),
            json: arguments.json,
        });
    }
    if arguments.record.is_empty() {
        return Err(Refusal::new("--record: found none, a diagnosis needs at least one record to estimate from"));
    }
    let plant = plant_file(&source, arguments)?;
    let truth = arguments.truth.as_ref().map(|path| Ok::<_, Refusal>(PlantFile::read(&Source::read(path)?)?)).transpose()?;
    if arguments.refit {
        refit::refuse(&plant, truth.as_ref())?;
    }
    let read = |paths: &[PathBuf]| -> Result<Vec<Record>, Refusal> {
        paths.iter().map(|path| Ok(Record::read_with_gaps(&Source::read(path)?, &plant)?)).collect()
    };
    let training = read(&arguments.record)?;
    let validation = read(&arguments.validate)?;
    let test = read(&arguments.test)?;
    let began = Instant::now();
    let bar = ProgressBar::new_spinner();
    bar.set_style(
        ProgressStyle::with_template("{elapsed} {spinner} {msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()),
    );
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    let progress = |message: &str| bar.set_message(message.to_string());
    let options = Options { threads: threads::available(), progress: &progress };
    let found = plant::diagnose_and_test(&plant, &training, &validation, &test, &options);
    let found = found.map_err(|why| Refusal::new(format!("{}: {why}", arguments.plant.display())))?;
    let refitted = match (&arguments.out, arguments.refit) {
        (Some(folder), true) => {
            let records: Vec<Record> = training.iter().chain(&validation).cloned().collect();
            let folder = folder.join("refit");
            Some(refit::refit(&refit::Request {
                nominal: &plant,
                extended: &found.plant,
                truth: truth.as_ref(),
                records: &records,
                folder: &folder,
                progress: &progress,
            }))
        }
        _ => None,
    };
    bar.finish_and_clear();
    let mut value = value(plant.kind, &found);
    let mut page_words: &[String] = &[];
    if let Some(refitted) = &refitted {
        let refit_value = match refitted {
            Ok(refitted) => refitted.value.clone(),
            // The diagnosis is valid without the refit.
            Err(why) => json!({ "failed": why.to_string() }),
        };
        value["refit"] = refit_value;
        page_words = refitted.as_ref().map_or(&[], |refitted| &refitted.words);
    }
    if let Some(folder) = &arguments.out {
        let text = serde_json::to_string_pretty(&value)
            .map_err(|error| Refusal::new(format!("diagnosis.json cannot be written as JSON: {error}")))?;
        let page = report::html(plant.kind, &found, page_words)?;
        let mut files = vec![
            (folder.join("diagnosis.json"), text + "\n"),
            (folder.join("extended.toml"), found.plant.write()),
            (folder.join("report.html"), page),
        ];
        files.extend(named_files(&found.plant).into_iter().map(|(name, text)| (folder.join(name), text)));
        files.extend(law::file(&found).map(|text| (folder.join(plant::law::MODEL_FILE), text)));
        files.extend(next::csv(&found).map(|csv| (folder.join(next::FILE), csv)));
        files.extend(error_breakdown::correction_file(&found).map(|text| (folder.join(error_breakdown::CORRECTION), text)));
        if let Some(Ok(refitted)) = &refitted {
            files.extend(refitted.files.iter().cloned());
        }
        output::write_all(&files)?;
    }
    if arguments.json {
        output::json(&value)?;
    }
    words::print(&found, plant.kind, began.elapsed().as_secs_f64());
    match refitted {
        Some(Ok(refitted)) => refitted.words.iter().for_each(|line| stderr_line!("  {line}")),
        Some(Err(why)) => {
            stderr_line!("  The extended plant could not be refitted: {why}");
            return Ok(Answer::Negative);
        }
        None => {}
    }
    Ok(Answer::Positive)
}

/// The plant of a plant file of either format.
fn plant_file(source: &Source, arguments: &Arguments) -> Result<PlantFile, Refusal> {
    if !plants::is_equations(source) {
        if arguments.effects.is_some() {
            return Err(plants::built_in_effects_only());
        }
        return Ok(PlantFile::read(source)?);
    }
    let folder = arguments.plant.parent().unwrap_or(std::path::Path::new(""));
    let open = |name: &str| Source::read(&folder.join(name));
    Ok(equation_plant::read_with(source, &open, &plants::catalogue(arguments.effects.as_deref())?)?)
}

/// The files that a plant file refers to. They are copied beside the extended plant file, which refers to them without a folder.
fn named_files(plant: &PlantFile) -> Vec<(String, String)> {
    let last = |name: &str| name.rsplit_once('/').map_or(name, |it| it.1).to_string();
    plant.kind.files.iter().map(|(name, text)| (last(name), text.clone())).collect()
}

/// Whether the file is a model file (it has the key `model`) or a plant file (key `plant`). Options that belong to the other kind are refused.
fn is_model(source: &Source, arguments: &Arguments) -> Result<bool, Refusal> {
    if plants::is_equations(source) {
        return Ok(false);
    }
    let mut faults = Collector::new();
    let document = toml_reader::parse(source, &mut faults);
    let has = document.as_ref().map(|table| ["model", "plant"].map(|key| table.get_ref().contains_key(key)));
    let [model, plant] = faults.finish(has)?;
    match (model, plant) {
        (true, false) if !arguments.record.is_empty() => {
            Err(Refusal::new(format!("--record: {} is a model file, whose new data are given with --data", source.name())))
        }
        (true, false) if arguments.data.is_empty() => Err(Refusal::new(format!(
            "--data: found none, and {} is a model file: give the new data to compare",
            source.name()
        ))),
        (false, true) if !arguments.data.is_empty() => {
            Err(Refusal::new(format!("--data: {} is a plant file, whose records are given with --record", source.name())))
        }
        (true, false) => Ok(true),
        (false, true) => Ok(false),
        (true, true) => Err(Refusal::new(format!("{}: found both `model` and `plant`, expected one of them", source.name()))),
        (false, false) => Err(Refusal::new(format!(
            "{}: found neither `model` (a model file) nor `plant` (a plant file) among its keys",
            source.name()
        ))),
    }
}

/// The effects that the plant file contains, each with its test against the records.
fn claims(found: &Diagnosis) -> Vec<Value> {
    let one = |claim: &plant::claims::Claim| {
        let numbers: Map<String, Value> = claim
            .records
            .iter()
            .zip(&claim.file)
            .map(|(it, file)| {
                let number = output::finite;
                let value = json!({
                    "file": number(*file), "value": number(it.value), "low": number(it.low), "high": number(it.high), "unit": it.unit
                });
                (it.name.to_string(), value)
            })
            .collect();
        json!({ "kind": claim.kind, "subject": claim.subject, "stands": claim.stands, "parameters": numbers })
    };
    found.claims.iter().map(one).collect()
}

fn bridged(list: &[FilledGaps]) -> Vec<Value> {
    let each = list.iter().map(|it| json!({ "record": it.record, "gaps": it.gaps, "rows": it.rows, "longest": it.longest }));
    each.collect()
}

fn findings(list: &[Finding]) -> Vec<Value> {
    let each = list
        .iter()
        .map(|it| json!({
            "kind": "data-fault", "what": it.what, "column": it.channel, "channel": it.channel, "record": it.record, "rows": [it.rows.0, it.rows.1],
        }));
    each.collect()
}

/// Columns whose unit is not the stated one, as findings about all records.
fn in_other_units(list: &[WrongUnit]) -> Vec<Value> {
    let finding = |it: &WrongUnit, column: &str| {
        json!({
            "kind": "data-fault", "what": format!("in another unit: {}, not {}", it.unit, it.stated), "column": column, "channel": column, "record": null, "rows": null,
        })
    };
    list.iter().flat_map(|it| it.columns.iter().map(move |column| finding(it, column))).collect()
}

/// The object of docs/book/src/reference/formats.md 4.3.
pub fn value(kind: PlantKind, found: &Diagnosis) -> Value {
    let cause_value = |cause: &Cause| {
        let details = match cause.of {
            Subject::Parameter => vec![("parameter", json!(cause.subject))],
            Subject::Output => vec![("output", json!(cause.subject))],
            Subject::Site => vec![("at", json!(cause.subject))],
            Subject::None => Vec::new(),
        };
        let mut evidence: cause_json::Keys = cause.only_in.iter().map(|record| ("only_in", json!([record]))).collect();
        evidence.extend((!cause.acts_in.is_empty()).then(|| ("configurations", json!(cause.acts_in))));
        evidence.extend((!cause.by_holdout.is_empty()).then(|| ("by_validation", json!(cause.by_holdout))));
        evidence.push(("evidence", error_breakdown::evidence(kind, found, cause)));
        let numbers = cause.parameters.iter();
        let cause_json = CauseJson {
            kind: cause.kind,
            place: Vec::new(),
            numbers: numbers.map(|it| (it.name.to_string(), cause_json::number(it.value, it.low, it.high, &it.unit))).collect(),
            details,
            confidence: cause.confidence,
            confidence_of_any: cause.confidence_of_any,
            indistinguishable_from: &cause.indistinguishable_from,
            evidence,
        };
        cause_json.value()
    };
    let causes: Vec<Value> = found.causes.iter().map(cause_value).collect();
    let helpers: Vec<Value> = found.helpers.iter().map(cause_value).collect();
    let refused: Vec<Value> = found.refused.iter().map(|it| json!({ "cause": it.cause, "why": it.why })).collect();
    let by_output = |it: &plant::validation::Error| {
        (kind.outputs()[it.output].name.to_string(), cause_json::error(it.rmse, it.noise_ratio))
    };
    let errors = |list: &[plant::validation::Error], test: Option<&[plant::validation::Error]>| {
        cause_json::errors(list.iter().map(by_output), test.map(|test| test.iter().map(by_output)))
    };
    let tested = found.tested.as_ref();
    let steps: Vec<Value> = found
        .steps
        .iter()
        .map(|it| {
            let mut step = errors(&it.errors, None);
            step["causes"] = json!(it.causes);
            if let Some(error) = it.force_error {
                step["force_error"] = json!(output::finite(error));
            }
            step
        })
        .collect();
    let ranking: Vec<Value> =
        found.ranking.iter().take(12).map(|(label, gain)| json!({ "cause": label, "predicted_gain": gain })).collect();
    json!({
        "verdict": found.verdict.name(),
        "causes": causes,
        "helpers": helpers,
        "refused": refused,
        "claims": claims(found),
        "law": law::value(found),
        "practical": found.practical.map(|it| json!({ "gone": output::finite(it.removed), "left": output::finite(it.left) })),
        "nominal": errors(&found.nominal, tested.map(|it| it.nominal.as_slice())),
        "extended": errors(&found.extended, tested.map(|it| it.extended.as_slice())),
        "judged_on": words::CHOSEN,
        "test": found.tested.as_ref().map(|it| json!({
            "records": it.files, "judged_on": words::tested_on(), "gain": output::finite(it.gain),
            "gain_interval": [output::finite(it.gain_interval.0), output::finite(it.gain_interval.1)],
            "data": findings(&it.findings),
        })),
        "gain": output::finite(found.gain),
        "gain_interval": [output::finite(found.gain_interval.0), output::finite(found.gain_interval.1)],
        "where": error_breakdown::regions(kind, &found.error_breakdown.before),
        "steps": steps,
        "left": error_breakdown::regions(kind, &found.error_breakdown.after),
        "correction": error_breakdown::correction(kind, found),
        "calibration": error_breakdown::calibration(found),
        "noise": found.noise.iter().map(|(k, sd, correlation)| {
            let grown = found.growing.iter().find(|it| it.0 == *k);
            let mut noise = json!({ "sd": sd, "correlation": correlation });
            if let Some((_, at_zero, at_largest)) = grown {
                noise["sd_at_zero"] = json!(at_zero);
                noise["sd_at_largest"] = json!(at_largest);
            }
            if let Some((_, step)) = found.rounded.iter().find(|it| it.0 == *k) {
                noise["rounded_to"] = json!(step);
            }
            if let Some((_, law)) = found.tails.iter().find(|it| it.0 == *k) {
                noise["freedom"] = json!(law.freedom);
                noise["outlying"] = json!(law.outlying);
            }
            (kind.outputs()[*k].name.to_string(), noise)
        }).collect::<Map<String, Value>>(),
        "data": in_other_units(&found.units).into_iter().chain(findings(&found.findings)).collect::<Vec<Value>>(),
        "bridged": bridged(&found.filled_gaps),
        "units": found.units.iter().map(|it| json!({
            "columns": it.columns, "stated": it.stated, "unit": it.unit, "factor": it.factor,
            "gain": { "value": output::finite(it.gain[0]), "low": output::finite(it.gain[1]), "high": output::finite(it.gain[2]) },
            "indistinguishable_from": it.alike,
        })).collect::<Vec<Value>>(),
        "rows_seen": found.unused_rows.map(|it| json!({ "seen": it.used, "of": it.total })),
        "all_rows": found.all_rows.as_ref().map(|it| json!({
            "rows": it.rows, "of": it.total_rows, "windows": it.windows, "excess": output::finite(it.excess), "not_simulated": it.not_simulated,
            "beyond_noise": it.beyond_noise.iter().map(|it| json!({ "record": it.record, "excess": output::finite(it.excess) })).collect::<Vec<Value>>(),
        })),
        "threshold": found.threshold,
        "stopped": found.stopped.map(|limit| limit.to_string()),
        "structure_left": found.left.excess,
        "structure_left_unseen": found.left_unseen.as_ref().map(|it| it.excess),
        "known_loop": found.known_loop.as_ref().map(|it| {
            let gain = |known: &plant::known_loop::GainEstimate| {
                json!({ "value": output::finite(known.value), "low": output::finite(known.low), "high": output::finite(known.high) })
            };
            json!({
                "position_gain": gain(&it.position), "command_gain": gain(&it.command), "position_late_rows": it.late,
                "rms_stated": output::finite(it.stated), "rms_left": output::finite(it.left),
            })
        }),
        "equations": found.equations.as_ref().map(equations::value),
        "predicted_by": found.predicted.as_ref().map(|it| json!({
            "output": kind.outputs()[it.output].name, "what": it.what, "excess": output::finite(it.excess), "ln_p": output::finite(it.ln_p),
        })),
        "ranking": ranking,
        "next_experiment": next::sentence(found),
        "experiment": next::value(found),
    })
}

//! `rsm diagnose MODEL.toml --data`: compares a fitted surface with new data.
//!
//! In: a model file, new data, holdout rows. Out: one JSON object, and with `--out` diagnosis.json, extended.toml (a model file) and report.html,
//! complete or not written at all. Every verdict is an answer: exit status 0.

use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};
use rsm_core::check::Checked;
use rsm_core::model::Model;
use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_diagnose::surface::causes::{Cause, OutlyingRun};
use rsm_diagnose::surface::data::NewData;
use rsm_diagnose::surface::fault::Fault;
use rsm_diagnose::surface::holdout::Errors;
use rsm_diagnose::surface::regions::Region;
use rsm_diagnose::surface::{Diagnosis, ResponseDiagnosis, Tested};
use rsm_fit::content::Content;
use serde_json::{Map, Value, json};

use super::cause_json::{self, CauseJson};
use super::surface_report;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

/// The arguments of the command line for a surface.
pub struct Task<'a> {
    /// The model file.
    pub model: &'a Source,
    /// New data.
    pub data: &'a [PathBuf],
    /// Holdout rows.
    pub validate: &'a [PathBuf],
    /// Test rows: only the final gain is computed on them.
    pub test: &'a [PathBuf],
    /// The folder for the files.
    pub out: Option<&'a Path>,
    /// Whether to print JSON.
    pub json: bool,
}

pub fn run(task: &Task<'_>) -> Outcome {
    let checked = Checked::read(task.model)?;
    let model = checked.model();
    let contents = |paths: &[PathBuf]| paths.iter().map(|path| Content::read(path)).collect::<Result<Vec<_>, _>>();
    let refusal = |refused: rsm_fit::records::Refused| Refusal::new(refused.to_string());
    let data = NewData::read(model, &contents(task.data)?, None).map_err(refusal)?;
    let like = |paths: &[PathBuf]| -> Result<Option<NewData>, Refusal> {
        if paths.is_empty() {
            return Ok(None);
        }
        NewData::read_like(model, &contents(paths)?, &data).map(Some).map_err(refusal)
    };
    let (unseen, test) = (like(task.validate)?, like(task.test)?);
    let bar = ProgressBar::new_spinner();
    bar.set_style(
        ProgressStyle::with_template("{elapsed} {spinner} {msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()),
    );
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    let mut progress = |words: &str| bar.set_message(words.to_string());
    let found = rsm_diagnose::surface::diagnose_and_test(&checked, &data, unseen.as_ref(), test.as_ref(), &mut progress);
    bar.finish_and_clear();
    let found = found.map_err(|why| Refusal::new(format!("{}: {why}", task.model.name())))?;
    let value = value(model, &data, &found);
    if let Some(folder) = task.out {
        let text = serde_json::to_string_pretty(&value)
            .map_err(|error| Refusal::new(format!("diagnosis.json cannot be written as JSON: {error}")))?;
        let page = surface_report::html(model, &data, &found)?;
        let files = [
            (folder.join("diagnosis.json"), text + "\n"),
            (folder.join("extended.toml"), model_file::write(&found.extended)),
            (folder.join("report.html"), page),
        ];
        output::write_all(&files)?;
    }
    if task.json {
        output::json(&value)?;
    }
    print(model, &data, &found);
    Ok(Answer::Positive)
}

/// Faults with one sentence, in their order: the sentence, and the ranges of rows.
pub(super) fn told(faults: &[Fault]) -> Vec<(&str, Vec<(usize, usize)>)> {
    let mut told: Vec<(&str, Vec<(usize, usize)>)> = Vec::new();
    for fault in faults {
        match told.iter_mut().find(|it| it.0 == fault.sentence) {
            Some(it) => it.1.push(fault.rows),
            None => told.push((&fault.sentence, vec![fault.rows])),
        }
    }
    told
}

/// At most this many ranges of rows are listed.
const MOST_RANGES: usize = 5;

/// "runs 3 to 9, 12": runs are counted from 1.
pub(super) fn runs(ranges: &[(usize, usize)]) -> String {
    let one = |(first, last): &(usize, usize)| {
        if first == last { format!("{}", first + 1) } else { format!("{} to {}", first + 1, last + 1) }
    };
    let listed: Vec<String> = ranges.iter().take(MOST_RANGES).map(one).collect();
    let more = if ranges.len() > MOST_RANGES { ", ..." } else { "" };
    format!("runs {}{more}", listed.join(", "))
}

/// Prints verdict and causes on standard error.
fn print(model: &Model, data: &NewData, found: &Diagnosis) {
    for (column, why) in &data.ignored {
        stderr_line!("column `{column}` is not used: {why}");
    }
    for (_, fault) in &found.constant {
        stderr_line!("Data: {} It is not diagnosed.", fault.sentence);
    }
    stderr_line!("{}", found.verdict.name());
    for response in &found.responses {
        let surface = &model.surfaces[response.surface];
        let unit = surface.unit_of_terms();
        stderr_line!("{}: {}, {} rows compared", surface.name, response.verdict.name(), response.rows);
        if !response.outside.is_empty() {
            let places: Vec<String> = response.outside.iter().take(5).map(|row| data.place_of(*row)).collect();
            let more = if response.outside.len() > 5 { " ..." } else { "" };
            stderr_line!(
                "  {} rows are outside the ranges or the support and are not used: {}{more}",
                response.outside.len(),
                places.join(", ")
            );
        }
        for (sentence, ranges) in told(&response.faults) {
            stderr_line!("  Data: {sentence} {}.", runs(&ranges).replacen('r', "R", 1));
        }
        if response.left_out > 0 {
            stderr_line!("  {} rows are left out because of their data", response.left_out);
        }
        for cause in &response.causes {
            stderr_line!("  {} Confidence {:.2}.", cause.sentence, cause.confidence);
            if !cause.indistinguishable_from.is_empty() {
                stderr_line!(
                    "    These data do not distinguish it from {}. Confidence that one of these is right: {:.2}.",
                    cause.indistinguishable_from.join(", "),
                    cause.confidence_of_any
                );
            }
        }
        for note in &response.notes {
            stderr_line!("  Note: {note}.");
        }
        stderr_line!(
            "  noise {:.4} {unit} (from {}); on holdout rows ({}): {:.2} times the noise before, {:.2} after",
            response.floor.sd,
            response.floor.from,
            response.holdout_source,
            response.nominal.noise_ratio,
            response.extended.noise_ratio
        );
        if let Some(it) = &response.tested {
            stderr_line!(
                "  on {} test rows, not used before: {:.2} times the noise before, {:.2} after",
                it.nominal.rows,
                it.nominal.noise_ratio,
                it.extended.noise_ratio
            );
        }
    }
}

/// The object of docs/book/src/reference/formats.md 4.3, with the keys that exist for surfaces; every cause has its `response`.
pub fn value(model: &Model, data: &NewData, found: &Diagnosis) -> Value {
    let name = |response: &ResponseDiagnosis| model.surfaces[response.surface].name.clone();
    let mut all: Vec<(&ResponseDiagnosis, &Cause)> =
        found.responses.iter().flat_map(|response| response.causes.iter().map(move |cause| (response, cause))).collect();
    all.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
    let causes: Vec<Value> = all.iter().map(|(response, cause)| cause_value(&name(response), data, cause)).collect();
    let figures =
        |response: &ResponseDiagnosis, errors: &Errors| (name(response), cause_json::error(errors.rmse, errors.noise_ratio));
    let errors = |of: fn(&ResponseDiagnosis) -> &Errors, on_test: Option<fn(&Tested) -> &Errors>| {
        let each = found.responses.iter().map(|response| figures(response, of(response)));
        let tested = found.responses.iter().filter_map(|it| Some((it, it.tested.as_ref()?)));
        let on_test = on_test.filter(|_| found.responses.iter().any(|it| it.tested.is_some()));
        cause_json::errors(each, on_test.map(|on_test| tested.map(move |(response, it)| figures(response, on_test(it)))))
    };
    let regions = |of: fn(&ResponseDiagnosis) -> &Vec<Region>| -> Vec<Value> {
        let each = found.responses.iter().flat_map(|response| {
            let output = name(response);
            of(response).iter().map(move |it| {
                json!({ "output": output, "region": it.region, "share_of_error": it.share_of_error, "share_of_rows": it.share_of_rows })
            })
        });
        each.collect()
    };
    let responses = found.responses.iter().map(|response| (name(response), response_value(data, response)));
    json!({
        "verdict": found.verdict.name(),
        "causes": causes,
        "nominal": errors(|response| &response.nominal, Some(|it| &it.nominal)),
        "extended": errors(|response| &response.extended, Some(|it| &it.extended)),
        "extended_file": errors(|response| &response.extended_file, None),
        "gain": output::finite(found.gain),
        "data": faults(model, data, found),
        "where": regions(|response| &response.regions),
        "left": regions(|response| &response.regions_left),
        "responses": responses.collect::<Map<String, Value>>(),
        "run_order": data.ordered_by.as_deref().unwrap_or("the order of the rows"),
        "ignored_columns": data.ignored.iter().map(|(column, why)| json!({ "column": column, "why": why })).collect::<Vec<Value>>(),
    })
}

/// The faults of the data, with the keys of the faults of a record.
fn faults(model: &Model, data: &NewData, found: &Diagnosis) -> Vec<Value> {
    let one = |surface: usize, fault: &Fault| {
        let (first, last) = (data.lines[fault.rows.0], data.lines[fault.rows.1]);
        let mut value = json!({
            "kind": "data-fault", "what": fault.what, "column": fault.column, "channel": fault.column,
            "response": model.surfaces[surface].name, "record": data.files[first.0].name,
            "rows": [fault.rows.0, fault.rows.1], "lines": [first.1, last.1], "left_out": fault.is_left_out, "words": fault.sentence,
        });
        if let Some(input) = &fault.input {
            value["input"] = json!(input);
        }
        for (name, number) in &fault.numbers {
            value[*name] = json!(output::finite(*number));
        }
        value
    };
    let of_responses = found.responses.iter().flat_map(|it| it.faults.iter().map(|fault| (it.surface, fault)));
    let constant = found.constant.iter().map(|(surface, fault)| (*surface, fault));
    constant.chain(of_responses).map(|(surface, fault)| one(surface, fault)).collect()
}

fn cause_value(response: &str, data: &NewData, cause: &Cause) -> Value {
    let mut identity = vec![("response", json!(response))];
    identity.extend(cause.subject.as_ref().map(|(key, subject)| (*key, json!(subject))));
    // Numbers and lists of numbers keep their JSON type.
    let detail = |value: &String| serde_json::from_str(value).unwrap_or_else(|_| json!(value));
    let mut details: cause_json::Keys = cause.details.iter().map(|(key, value)| (*key, detail(value))).collect();
    if !cause.runs.is_empty() {
        let run = |it: &OutlyingRun| {
            let (file, line) = data.lines[it.place];
            json!({
                "run": it.place + 1, "file": data.files[file].name, "line": line, "residual": output::finite(it.residual),
                "studentised_residual": output::finite(it.studentised), "p": it.p,
            })
        };
        details.push(("runs", cause.runs.iter().map(run).collect()));
    }
    let evidence = json!({
        "likelihood_ratio": output::finite(cause.gain), "ln_p": output::finite(cause.ln_p), "rivals": cause_json::rivals(&cause.rivals)
    });
    CauseJson {
        kind: cause.kind,
        place: identity,
        numbers: cause
            .parameters
            .iter()
            .map(|it| (it.name.clone(), cause_json::number(it.value, it.low, it.high, &it.unit)))
            .collect(),
        details,
        confidence: cause.confidence,
        confidence_of_any: cause.confidence_of_any,
        indistinguishable_from: &cause.indistinguishable_from,
        evidence: vec![("evidence", evidence), ("words", json!(cause.sentence))],
    }
    .value()
}

fn response_value(data: &NewData, response: &ResponseDiagnosis) -> Value {
    let tests = response.tests.iter().map(|it| json!({ "test": it.what, "ln_p": output::finite(it.ln_p) }));
    let ranking = response.ranking.iter().take(12).map(|(label, gain, ln_p)| {
        json!({ "cause": label, "likelihood_ratio": output::finite(*gain), "ln_p": output::finite(*ln_p) })
    });
    json!({
        "verdict": response.verdict.name(),
        "rows": response.rows,
        "rows_outside": response.outside.iter().map(|row| data.place_of(*row)).collect::<Vec<String>>(),
        "rows_left_out": response.left_out,
        "rows_of_file": response.rows_of_file,
        "noise": { "sd": output::finite(response.floor.sd), "from": response.floor.from },
        "gain": output::finite(response.gain),
        "judged_on": response.holdout_source,
        "stopped": response.stopped,
        "test": response.tested.as_ref().map(|it| json!({
            "rows": it.nominal.rows, "gain": output::finite(it.gain), "judged_on": "test rows, which nothing has seen before",
        })),
        "threshold": output::finite(response.threshold),
        "structure_tests": tests.collect::<Vec<Value>>(),
        "structure_threshold_p": response.threshold_p_structure,
        "ranking": ranking.collect::<Vec<Value>>(),
        "notes": response.notes,
    })
}

//! `rsm demo`: the whole chain on shipped data, each link real.
//!
//! fit -> check -> emit -> compile with the machine's compilers -> compare bits -> run the motor loop for two seconds. The data are
//! made-up dynamometer runs that the project makes itself; they are part of the program, so the demo runs anywhere.

mod twins;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use rsm_core::certificate;
use rsm_core::check::Checked;
use rsm_core::{compile, emit, model_file};
use rsm_fit::spec::Specification;
use serde_json::{Map, Value, json};

use super::fit;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::{output, report};

/// What is fitted: a specification and its data.
const SHIPPED: [(&str, &str); 3] = [
    ("fit.toml", include_str!("../../../demo/fit.toml")),
    ("dyno.csv", include_str!("../../../demo/dyno.csv")),
    ("dyno-unseen.csv", include_str!("../../../demo/dyno-unseen.csv")),
];

#[derive(Args)]
pub struct Arguments {
    /// The folder for everything that the demo makes
    #[arg(long, default_value = "rsm-demo")]
    out: PathBuf,
    /// Seconds of the motor loop
    #[arg(long, default_value_t = 2.0)]
    seconds: f64,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Says a line: on standard output, or on standard error when that belongs to JSON.
struct Teller {
    json: bool,
}

impl Teller {
    fn say(&self, line: &str) -> Result<(), Refusal> {
        if self.json {
            eprintln!("{line}");
            Ok(())
        } else {
            output::line(line)
        }
    }
}

pub fn run(arguments: &Arguments) -> Outcome {
    if !(arguments.seconds > 0.0 && arguments.seconds <= 86_400.0) {
        return Err(Refusal::new(format!("--seconds: found {}, expected more than 0 and at most 86400", arguments.seconds)));
    }
    let begin = Instant::now();
    let tell = Teller { json: arguments.json };
    let mut good = true;
    let mut results = Map::new();
    let folder = arguments.out.join("data");
    output::write_all(&SHIPPED.map(|(name, text)| (folder.join(name), text)))?;

    let fitted = fit::with_progress(&Specification::read(&folder.join("fit.toml"))?)?;
    good &= fitted.reached();
    for response in &fitted.responses {
        let statistics = response.statistics.as_ref().ok_or_else(|| Refusal::new("the shipped data could not be fitted"))?;
        let unit = fitted.model.surface(&response.name).map_or("", |surface| surface.unit.as_str());
        let unseen = statistics.validation.as_ref().map_or(f64::NAN, |validation| validation.mean_abs_error);
        tell.say(&format!(
            "fit      {}: {} terms from {} rows, {}; mean error on unseen rows {unseen:.3} {unit}",
            response.name,
            statistics.terms.len(),
            statistics.rows,
            response.verdict
        ))?;
    }
    results.insert("fit".into(), serde_json::to_value(fitted.report()).map_err(|error| Refusal::new(error.to_string()))?);

    let model_path = arguments.out.join("weakening.toml");
    let report_path = arguments.out.join("report.html");
    let checked = Checked::from_model(&fitted.model)?;
    let certificates = certificate::surfaces(&checked, &compile::held(&checked, &[])?)?;
    let mut certified = Map::new();
    for certificate in &certificates {
        let tapes = &certificate.tapes;
        let errors: Vec<String> = tapes.iter().map(|tape| format!("{} {:.1e}", tape.precision.name(), tape.error)).collect();
        let (low, high) = (certificate.range.low, certificate.range.high);
        tell.say(&format!(
            "check    {}: always within [{low:.3}, {high:.3}], rounding error at most {}",
            certificate.name,
            errors.join(", ")
        ))?;
        good &= tapes.iter().all(|tape| tape.error.is_finite());
        let errors: Map<String, Value> =
            tapes.iter().map(|tape| (tape.precision.name().into(), json!(output::finite(tape.error)))).collect();
        certified.insert(certificate.name.clone(), json!({ "range": [low, high], "error": errors }));
    }
    results.insert("check".into(), Value::Object(certified));

    let unit = compile::unit(&checked, &[])?;
    let c = emit::c::emit(&unit);
    let rust = emit::rust::emit(&unit);
    let emitted = arguments.out.join("emitted");
    let model_text = model_file::write(&fitted.model);
    let report_text = report::fit(&fitted)?;
    output::write_all(&[
        (model_path.clone(), model_text.as_bytes()),
        (report_path.clone(), report_text.as_bytes()),
        (emitted.join("weakening.h"), c.header.as_bytes()),
        (emitted.join("weakening.c"), c.source.as_bytes()),
        (emitted.join("weakening.rs"), rust.as_bytes()),
    ])?;
    tell.say(&format!("emit     {} functions in C and Rust", unit.functions.len()))?;

    let mut compared = Map::new();
    for verdict in twins::compare(&unit, &emitted)? {
        match verdict {
            Ok(twins::Verdict { compiler, compared: count, different }) => {
                tell.say(&format!(
                    "compare  {compiler}: {different} of {count} results differ from the interpreter in any bit"
                ))?;
                good &= different == 0;
                compared.insert(compiler, json!({ "compared": count, "different": different }));
            }
            // A machine without one of the compilers shows less, and says so.
            Err(reason) => tell.say(&format!("compare  left out: {}", reason.trim_end()))?,
        }
    }
    good &= !compared.is_empty();
    results.insert("compare".into(), Value::Object(compared));

    tell.say(&format!("loop     {} s of the motor loop at 1 kHz ...", arguments.seconds))?;
    let motor = host_runners::motor::run(&host_loop::Settings::new(1000.0, arguments.seconds));
    let report = &motor.report;
    for line in report.to_string().lines() {
        tell.say(&format!("         {line}"))?;
    }
    let parsed = serde_json::from_str(&report.json()).map_err(|error| Refusal::new(error.to_string()))?;
    results.insert("loop".into(), parsed);
    tell.say(&format!(
        "done     in {:.1} s; model {}, report {}, evaluators in {}",
        begin.elapsed().as_secs_f64(),
        model_path.display(),
        report_path.display(),
        emitted.display()
    ))?;
    if arguments.json {
        results.insert("ok".into(), json!(good));
        output::json(&results)?;
    }
    Ok(if good { Answer::Positive } else { Answer::Negative })
}

//! `rsm check`: checks the rules of the file, and certifies range and rounding error of its surfaces and the stability of its compensators. With
//! `--limits` it also checks the limits of the control loop around the surfaces.

use std::path::PathBuf;

use clap::Args;
use rsm_core::certificate::compensator::{CompensatorCertificate, certify};
use rsm_core::certificate::{self, SurfaceCertificate};
use rsm_core::check::Checked;
use rsm_core::interval::Interval;
use rsm_core::lower::{self, Saturation};
use rsm_core::number::Precision;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::limits;
use super::{PrecisionName, model_source, precisions, print_left_out};
use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The model file; - is standard input
    model: PathBuf,
    /// The precisions to certify [default: all that can represent the model]
    #[arg(long, value_delimiter = ',')]
    precision: Vec<PrecisionName>,
    /// Print the sequences of operations (tapes) that are certified
    #[arg(long)]
    explain: bool,
    #[command(flatten)]
    limits: limits::LimitsArguments,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// A property that does not hold.
#[derive(Serialize)]
pub struct Problem {
    pub r#where: String,
    pub what: String,
    pub at: Map<String, Value>,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let requested = precisions(&arguments.precision);
    let checked = Checked::read(&model_source(&arguments.model)?)?;
    let mut problems = Vec::new();
    let candidates = if requested.is_empty() { Precision::ALL.to_vec() } else { requested.clone() };
    if requested.is_empty() {
        print_left_out(&checked);
    }
    let mut representable = Vec::new();
    for precision in candidates {
        match checked.refusal(precision) {
            None => representable.push(precision),
            // A precision that the user did not name is no problem.
            Some(_) if requested.is_empty() => {}
            Some(faults) => {
                problems.extend(faults.list().iter().map(|fault| Problem {
                    r#where: format!("{}:{}:{}", fault.file, fault.line, fault.column),
                    what: fault.what.clone(),
                    at: Map::new(),
                }));
            }
        }
    }
    let certificates = certificate::surfaces(&checked, &representable)?;
    for surface in &certificates {
        for tape in surface.tapes.iter().filter(|tape| !tape.error.is_finite()) {
            problems.push(Problem {
                r#where: format!("surfaces.{}", surface.name),
                what: format!(
                    "no bound of the rounding error in {} can be given: an intermediate result may overflow",
                    tape.precision.name()
                ),
                at: Map::new(),
            });
        }
    }
    let compensators: Vec<CompensatorCertificate> =
        (0..checked.model().compensators.len()).map(|index| certify(&checked, index)).collect();
    for compensator in &compensators {
        problems.extend(compensator.violations.iter().map(|violation| Problem {
            r#where: format!("compensators.{}.{}", compensator.name, violation.key),
            what: violation.what.clone(),
            at: violation.at.iter().map(|(input, xi)| (input.clone(), json!(xi))).collect(),
        }));
    }
    let of_loop = limits::check(&arguments.limits, &checked)?;
    problems.extend(of_loop.iter().filter_map(limits::Checked::problem));
    if arguments.explain {
        for index in 0..checked.model().surfaces.len() {
            for precision in &representable {
                stderr_text!("{}", lower::surface(&checked, index, *precision));
                if let Some(saturation) = lower::saturation(&checked, index, *precision) {
                    stderr_line!("{}", at_bounds(&saturation));
                }
            }
        }
        for index in 0..compensators.len() {
            for precision in &representable {
                stderr_text!("{}", lower::compensator(&checked, index, *precision));
            }
        }
    }
    if arguments.json {
        let mut object = as_json(&certificates, &compensators, &problems);
        if let Some(of_loop) = &of_loop {
            object["limits"] = of_loop.json();
        }
        output::json(&object)?;
    } else {
        let lines = of_loop.iter().flat_map(limits::Checked::lines).collect::<Vec<String>>();
        in_words(&checked, &certificates, &compensators, &lines, &problems)?;
    }
    Ok(if problems.is_empty() { Answer::Positive } else { Answer::Negative })
}

/// Whether the result can reach the bounds of `output_range`, and why.
fn at_bounds(saturation: &Saturation) -> String {
    let why = match saturation.values {
        Some(Interval { low, high }) => format!("Before a clamp every value of this tape lies in [{low:?}, {high:?}]."),
        None => "An argument outside the range, or the polynomial itself, may pass both bounds.".to_string(),
    };
    format!("  {} {why}", saturation.words())
}

fn as_json(certificates: &[SurfaceCertificate], compensators: &[CompensatorCertificate], problems: &[Problem]) -> Value {
    let surfaces: Map<String, Value> = certificates
        .iter()
        .map(|surface| {
            let each = |pick: &dyn Fn(&certificate::TapeCertificate) -> Value| -> Map<String, Value> {
                surface.tapes.iter().map(|tape| (tape.precision.name().to_string(), pick(tape))).collect()
            };
            let value = json!({
                "range": [output::finite(surface.range.low), output::finite(surface.range.high)],
                "error": each(&|tape| json!(output::finite(tape.error))),
                "operations": each(&|tape| json!(tape.operations)),
                "depth": each(&|tape| json!(tape.depth)),
            });
            (surface.name.clone(), value)
        })
        .collect();
    let compensators: Map<String, Value> = compensators
        .iter()
        .map(|compensator| {
            let ends = |range: Interval| json!([output::finite(range.low), output::finite(range.high)]);
            let mut value = json!({
                "natural_frequency": ends(compensator.natural_frequency),
                "zero_damping": ends(compensator.zero_damping),
                "pole_damping": ends(compensator.pole_damping),
                "stable": compensator.violations.is_empty(),
            });
            if let Some(range) = compensator.pole_frequency {
                value["pole_frequency"] = ends(range);
            }
            (compensator.name.clone(), value)
        })
        .collect();
    json!({ "ok": problems.is_empty(), "surfaces": surfaces, "compensators": compensators, "problems": problems })
}

fn in_words(
    checked: &Checked,
    certificates: &[SurfaceCertificate],
    compensators: &[CompensatorCertificate],
    of_loop: &[String],
    problems: &[Problem],
) -> Result<(), crate::outcome::Refusal> {
    for (surface, certificate) in checked.model().surfaces.iter().zip(certificates) {
        let unit = if surface.unit == "1" { "" } else { surface.unit.as_str() };
        let range = certificate.range;
        output::line(&format!("{}: every value lies in [{:.6}, {:.6}] {unit}", surface.name, range.low, range.high))?;
        for tape in &certificate.tapes {
            let name = tape.precision.name();
            let (error, operations, depth) = (tape.error, tape.operations, tape.depth);
            output::line(&format!(
                "  {name}: rounding error at most {error:.3e} {unit}, {operations} operations, {depth} deep"
            ))?;
        }
    }
    for it in compensators {
        let state = if it.violations.is_empty() {
            "stable over the whole range of its inputs, in exact arithmetic"
        } else {
            "not proved stable"
        };
        output::line(&format!("{}: {state}", it.name))?;
        let mut ranges = vec![
            ("natural frequency", it.natural_frequency),
            ("zero damping", it.zero_damping),
            ("pole damping", it.pole_damping),
        ];
        ranges.extend(it.pole_frequency.map(|range| ("pole frequency", range)));
        for (name, range) in ranges {
            let unit = if name.ends_with("frequency") { " rad/s" } else { "" };
            output::line(&format!("  {name}: every value lies in [{:.6}, {:.6}]{unit}", range.low, range.high))?;
        }
    }
    for line in of_loop {
        output::line(line)?;
    }
    for problem in problems {
        output::line(&format!("problem: {}: {}", problem.r#where, problem.what))?;
    }
    Ok(())
}

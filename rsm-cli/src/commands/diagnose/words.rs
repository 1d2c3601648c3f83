//! The verdict in sentences, for the report and for standard error.
//!
//! In: a diagnosis. Out: sentences with its numbers. Decides nothing.

use rsm_diagnose::plant::checks::SWAPPED;
use rsm_diagnose::plant::claims::Claim;
use rsm_diagnose::plant::correction::CorrectionResult;
use rsm_diagnose::plant::error_breakdown::ErrorBreakdown;
use rsm_diagnose::plant::gaps::FilledGaps;
use rsm_diagnose::plant::law::curve::joined;
use rsm_diagnose::plant::nested_models::Step;
use rsm_diagnose::plant::regions::{Region, most_informative};
use rsm_diagnose::plant::tested::FIRST_PART;
use rsm_diagnose::plant::validation::{Error, worst};
use rsm_diagnose::plant::{Cause, Diagnosis, Interval, Verdict};
use rsm_sim::effect::Subject;
use rsm_sim::kind::PlantKind;

use super::next;
use crate::page::number::short;
use crate::page::{figure, multiple};

/// The records on which the figures of training and validation are computed. No parameter is estimated from validation records, but they take part in
/// the choice of causes.
pub const CHOSEN: &str = "on the records that chose it";

/// Noise with at least this lag-one autocorrelation is called slow: its correlation lasts for more than ten rows.
const SLOW_NOISE: f64 = 0.9;

/// The records on which the figures of the test are computed.
pub fn tested_on() -> String {
    format!(
        "on test records, which nothing has seen before: their starts are estimated on the first {} % of each, errors are of the rest",
        100 / FIRST_PART
    )
}

/// The records on which the errors are computed, in words.
pub fn judging(error_breakdown: &ErrorBreakdown) -> String {
    let count = if error_breakdown.unseen { error_breakdown.records[1].len() } else { error_breakdown.records[0].len() };
    let plural = if count == 1 { "" } else { "s" };
    if error_breakdown.unseen {
        format!("{count} validation record{plural}")
    } else {
        format!("the {count} record{plural} of the fit")
    }
}

/// The verdict with its numbers.
pub fn verdict(kind: PlantKind, found: &Diagnosis) -> String {
    let judging = judging(&found.error_breakdown);
    let worst = |errors: &[Error]| {
        worst(errors).map_or((String::new(), 0.0), |it| (kind.outputs()[it.output].name.to_string(), it.noise_ratio))
    };
    let ((before, most), (after, least)) = (worst(&found.nominal), worst(&found.extended));
    let names = and(&found.causes.iter().map(Cause::label).collect::<Vec<_>>());
    let gain = format!(
        "On {judging} ({CHOSEN}) {:.1} % of the error above the noise is removed. Before, the worst output was {before}, at {} times its noise; now it is {after}, at {} times its noise.{}",
        100.0 * found.gain,
        multiple(most),
        multiple(least),
        test(kind, found)
    );
    match found.verdict {
        Verdict::NoDiscrepancy => {
            let moved = found.moved_most().map_or(String::new(), |it| {
                format!(
                    " The largest change within a tolerance is that of {}: {:.1} standard deviations of the tolerance.",
                    it.name,
                    it.sds.abs()
                )
            });
            format!(
                "These records show no error of the simulation: with all parameters inside their tolerances, the residuals are noise. On {judging} the worst \
                 output, {after}, is {} times its noise.{moved}{}",
                multiple(least),
                test(kind, found)
            )
        }
        Verdict::Explained => {
            let explain = if found.causes.len() == 1 { "explains" } else { "explain" };
            let stopped =
                found.stopped.map_or(String::new(), |it| format!(" The search stopped {it}, before every rival was tried."));
            if let Some(record) = &found.own_record {
                return format!(
                    "One record is of another configuration: {names} {explain} {record}, and the residuals of all other records are noise.{stopped}"
                );
            }
            match found.practical {
                Some(it) => format!(
                    "{names} {explain} the error of the simulation for practical purposes: {:.2} % of the error above the noise is removed, and {:.2} % of the \
                     noise's energy is left that is more than chance.{stopped} {gain}",
                    100.0 * it.removed,
                    100.0 * it.left
                ),
                None => format!("{names} {explain} the error of the simulation; the residuals are noise.{stopped} {gain}"),
            }
        }
        Verdict::Unexplained => {
            let looks = most_informative(&found.error_breakdown.after, 1);
            let looks = looks.first().map_or(String::new(), |it| format!(" The clearest region: {}.", place(kind, it)));
            let predicted = found.predicted.as_ref().map_or(String::new(), |it| {
                let output = kind.outputs()[it.output].name;
                format!(
                    " The residual of {output} depends on {}, by {} % of the noise's energy.",
                    it.what,
                    short(100.0 * it.excess)
                )
            });
            let looks = format!("{looks}{predicted}");
            let stopped = found.stopped.map_or(String::new(), |limit| format!(" The search stopped {limit}."));
            let helpers = and(&found.helpers.iter().map(Cause::label).collect::<Vec<_>>());
            let (some, one) = (found.helpers.len() + found.causes.len(), found.helpers.len() == 1);
            let helps = match (some, found.causes.len()) {
                _ if found.law.is_some() => {
                    format!("{} {gain}", found.law.as_ref().map_or("", |law| law.words.as_str()))
                }
                (0, _) => "No cause of the catalogue reduces the error.".to_string(),
                (_, 0) => format!(
                    "{helpers} {} in the extended plant, but a cause outside the catalogue may produce the effect of {}. {gain}",
                    if one { "helps" } else { "help" },
                    if one { "it" } else { "them" }
                ),
                (_, named) => {
                    let (explain, does) = if named == 1 { ("removes", "does") } else { ("remove", "do") };
                    format!("{names} {explain} most of the error, but {does} not explain all of it. {gain}")
                }
            };
            let looks = match &found.own_record {
                Some(record) => format!(" Only {record} shows it: the residuals of all other records are noise.{looks}"),
                None => looks,
            };
            format!(
                "The simulation has an error that the catalogue does not explain: the remaining error is {} times the noise.{looks}{stopped} {helps}",
                multiple(found.times_noise())
            )
        }
    }
}

/// The result on test records, if there are any.
fn test(kind: PlantKind, found: &Diagnosis) -> String {
    let Some(it) = &found.tested else { return String::new() };
    let count = it.files.len();
    let plural = if count == 1 { "" } else { "s" };
    let worst = it.extended.iter().max_by(|a, b| a.noise_ratio.total_cmp(&b.noise_ratio));
    let worst = worst.map_or(String::new(), |it| {
        format!("; the worst output, {}, is {} times its noise", kind.outputs()[it.output].name, multiple(it.noise_ratio))
    });
    format!(
        " On {count} test record{plural}, not used before, {:.1} % is removed ({:.1} to {:.1} %){worst}. The initial states are estimated on the first {} % of each record, errors are computed on the rest.",
        100.0 * it.gain,
        100.0 * it.gain_interval.0,
        100.0 * it.gain_interval.1,
        100 / FIRST_PART
    )
}

/// A region with its output and share.
pub fn place(kind: PlantKind, region: &Region) -> String {
    let rows = match region.quantity.as_str() {
        "frequency" | "line" | "order" => String::new(),
        _ => format!(", which is {:.0} % of the rows", 100.0 * region.share_of_rows),
    };
    format!(
        "{:.0} % of the error of {} lies in: {}{rows}",
        100.0 * region.share_of_output,
        kind.outputs()[region.output].name,
        region.region
    )
}

/// The values in the plant file of the parameters that a cause changes.
pub fn before(found: &Diagnosis, cause: &Cause) -> String {
    let subject = cause.subject.as_deref().filter(|_| cause.of == Subject::Parameter);
    let value = subject.and_then(|name| found.plant.parameters.optional(name));
    value.map_or("absent".to_string(), |value| figure(Some(value)))
}

/// a, b and c.
fn and(names: &[String]) -> String {
    if names.is_empty() { "Nothing".to_string() } else { joined(names) }
}

/// How gaps of a few rows were filled.
pub fn bridged(filled: &FilledGaps) -> String {
    let gaps = match (filled.gaps, filled.longest) {
        (1, 1) => "a lost row was bridged".to_string(),
        (1, rows) => format!("a gap of {rows} rows was bridged"),
        (gaps, 1) => format!("{gaps} lost rows were bridged"),
        (gaps, longest) => format!("{gaps} gaps of 1 to {longest} rows, {} rows in all, were bridged", filled.rows),
    };
    format!("{gaps}: there, outputs are not compared, and inputs are interpolated from the readings around the gap")
}

/// An effect of the plant file, with its parameters as estimated from the records.
pub fn claim(claim: &Claim) -> String {
    let number = |(number, file): (&Interval, &f64)| {
        if !number.is_determined() {
            return format!("{} is {file} in the file, and these records do not determine it", number.name);
        }
        format!(
            "{} is {file} in the file, {:.4} ({:.4} to {:.4}) in the records",
            number.name, number.value, number.low, number.high
        )
    };
    let numbers: Vec<String> = claim.records.iter().zip(&claim.file).map(number).collect();
    let subject = claim.subject.as_ref().map_or(String::new(), |name| format!(" of {name}"));
    let judged = if claim.stands { "agrees with the records" } else { "disagrees with the records" };
    format!("{}{subject} {judged}: {}.", claim.kind, numbers.join("; "))
}

/// Prints the results on standard error.
pub fn print(found: &Diagnosis, kind: PlantKind, seconds: f64) {
    for it in &found.findings {
        let rows = (it.rows.0 + 1, it.rows.1 + 1);
        let action = if it.what == SWAPPED { "corrected here" } else { "left out" };
        stderr_line!("{}: data rows {} to {}: {} {}, {action}", it.record, rows.0, rows.1, it.channel, it.what);
    }
    for (output, low, high) in &found.growing {
        let name = kind.outputs()[*output].name;
        let (low, high) = (figure(Some(*low)), figure(Some(*high)));
        stderr_line!(
            "The noise of {name} grows with the reading: its standard deviation is {low} at 0 and {high} at the largest."
        );
    }
    for (output, step) in &found.rounded {
        let signal = kind.outputs()[*output];
        stderr_line!("The readings of {} are rounded to multiples of {} {}.", signal.name, figure(Some(*step)), signal.unit);
    }
    for (output, _, correlation) in found.noise.iter().filter(|it| it.2 > SLOW_NOISE) {
        stderr_line!(
            "The noise of {} is slow: its correlation from row to row is {correlation:.2}.",
            kind.outputs()[*output].name
        );
    }
    for (output, law) in &found.tails {
        stderr_line!(
            "The noise of {} has heavy tails (Student's t with {} degrees of freedom; {:.2} % of its readings are far from their neighbours): such readings have a lower weight.",
            kind.outputs()[*output].name,
            law.freedom,
            100.0 * law.outlying
        );
    }
    for it in &found.units {
        stderr_line!("{it}.");
    }
    if let Some(it) = &found.unused_rows {
        stderr_line!("{it}.");
    }
    if let Some(it) = &found.all_rows {
        stderr_line!("{it}.");
    }
    for it in &found.filled_gaps {
        stderr_line!("{}: {}", it.record, bridged(it));
    }
    stderr_line!("{} ({seconds:.1} s). {}", found.verdict.name(), verdict(kind, found));
    for cause in &found.causes {
        stderr_line!("  {}: {} Confidence {:.2}.", cause.label(), cause.sentence, cause.confidence);
        if !cause.indistinguishable_from.is_empty() {
            stderr_line!(
                "    These records do not distinguish it from {}. Confidence that one of these is right: {:.2}.",
                cause.indistinguishable_from.join(", "),
                cause.confidence_of_any
            );
        }
        stderr_line!("    Check: {}", cause.check);
    }
    for helper in &found.helpers {
        stderr_line!(
            "  Reduces the error, but is not a confirmed cause: {}: {} Confidence {:.2}.",
            helper.label(),
            helper.sentence,
            helper.confidence
        );
    }
    for it in &found.claims {
        stderr_line!("  The plant file's {}", claim(it));
    }
    for it in &found.refused {
        stderr_line!("  Tried and rejected: {}: {}.", it.cause, it.why);
    }
    let forces: Vec<String> = found.steps.iter().filter_map(force).collect();
    if !forces.is_empty() {
        stderr_line!("  Error of the force by the inverse model: {}.", forces.join(", "));
    }
    if let Some(sentence) = next::sentence(found) {
        stderr_line!("  {sentence}");
    }
    match &found.error_breakdown.correction {
        Some(CorrectionResult::Useful(it)) => stderr_line!(
            "  A black-box correction (correction.toml) removes {:.0} % of the remaining error on {}.",
            100.0 * it.gain,
            judging(&found.error_breakdown)
        ),
        Some(CorrectionResult::NoGain { .. }) => {
            stderr_line!(
                "  A black-box correction of the remaining error gains nothing on {}.",
                judging(&found.error_breakdown)
            );
        }
        None => {}
    }
}

/// The error of the force at a step of the ladder, by the inverse model of an axis.
fn force(step: &Step) -> Option<String> {
    let name = if step.causes.is_empty() { "calibrated".to_string() } else { step.causes.join(" and ") };
    Some(format!("{name} {:.1} %", 100.0 * step.force_error?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_joined_as_in_a_sentence() {
        let names = |list: &[&str]| and(&list.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!([names(&["a"]), names(&["a", "b"]), names(&["a", "b", "c"])], ["a", "a and b", "a, b and c"]);
    }
}

//! Evidence for and against a cause, in sentences with numbers, and the reasons for rejecting other hypotheses.
//!
//! In: a diagnosis. Out: sentences. Decides nothing: all numbers come from the diagnosis.

use rsm_diagnose::plant::cause::Changes;
use rsm_diagnose::plant::rejected::Reason;
use rsm_diagnose::plant::{Cause, Diagnosis, Verdict};
use rsm_sim::kind::PlantKind;

use super::words;
use crate::page::{figure, multiple};

/// An interval is called wide if its half width is at least this share of the value.
const WIDE_INTERVAL: f64 = 0.3;

/// A parameter is called close to its limit if it used this share of its two standard deviations of tolerance.
const NEAR_LIMIT: f64 = 1.8;

/// Sentences for and against a cause.
pub struct Evidence {
    pub supports: Vec<String>,
    pub speaks_against: Vec<String>,
}

/// Evidence for and against a cause.
pub fn of(kind: PlantKind, found: &Diagnosis, cause: &Cause) -> Evidence {
    let mut evidence = Evidence { supports: Vec::new(), speaks_against: Vec::new() };
    errors(kind, found, cause, &mut evidence);
    rivals(cause, &mut evidence);
    numbers(cause, &mut evidence);
    constants(found, &mut evidence);
    if found.verdict == Verdict::Unexplained {
        let sentence = format!(
            "The residuals have structure that nothing in the catalogue explains (error {} times the noise with this cause): the parameters of this cause may be biased by it.",
            multiple(found.times_noise())
        );
        evidence.speaks_against.push(sentence);
    }
    evidence
}

fn errors(kind: PlantKind, found: &Diagnosis, cause: &Cause, evidence: &mut Evidence) {
    if let ("sensor-quantisation", Some(step)) = (cause.kind, cause.parameters.first()) {
        let words = format!(
            "Its readings are multiples of {} {}: only rounding produces such readings.",
            figure(Some(step.value)),
            step.unit
        );
        evidence.supports.push(words);
    }
    let Some(contribution) = &cause.contribution else { return };
    let records = if found.error_breakdown.unseen { "validation records" } else { "the records of the fit" };
    let words = |changes: &Changes| -> Vec<String> {
        let each = changes.iter();
        each.map(|(k, without, with)| format!("{} from {} to {}", kind.outputs()[*k].name, multiple(*without), multiple(*with)))
            .collect()
    };
    let [moved, worse] = contribution.changes().each_ref().map(words);
    if !moved.is_empty() {
        evidence.supports.push(format!("On {records} it lowers the error, in multiples of the noise: {}.", moved.join(", ")));
    }
    if !worse.is_empty() {
        evidence
            .speaks_against
            .push(format!("On {records} it raises the error, in multiples of the noise: {}.", worse.join(", ")));
    }
    let (none, all) = (contribution.without_gain(), contribution.records.len());
    let judged = if found.error_breakdown.unseen { "validation record" } else { "record of the fit" };
    let plural = if all == 1 { "" } else { "s" };
    if none.is_empty() {
        let each = if all == 1 { "The only".to_string() } else { format!("Every one of the {all}") };
        evidence.supports.push(format!("{each} {judged}{plural} is simulated better with it than without."));
    } else {
        evidence.speaks_against.push(format!(
            "{} of {all} {judged}{plural} gain nothing from it: {}.",
            none.len(),
            none.join(", ")
        ));
    }
    if let Some(place) = contribution.wrong_regions.first() {
        evidence.supports.push(format!("Without it {}.", words::place(kind, place)));
    }
    if !found.error_breakdown.unseen {
        evidence
            .speaks_against
            .push("There is no validation record: the gain is computed on the records of the fit.".to_string());
    }
}

fn rivals(cause: &Cause, evidence: &mut Evidence) {
    if !cause.indistinguishable_from.is_empty() {
        let names = cause.indistinguishable_from.join(", ");
        evidence.speaks_against.push(format!(
            "These records do not distinguish it from {names}: a simulation with that in its place fits equally well."
        ));
    }
    let behind = cause.rivals.iter().find(|(name, _)| !cause.indistinguishable_from.contains(name));
    match behind {
        Some((name, behind)) => evidence.supports.push(format!(
            "The best alternative, {name}, in its place and with all parameters fitted again, gains {:.0} % of what this cause gains.",
            // A rival whose fit did not converge may even increase the error.
            100.0 * (1.0 - behind / cause.gain).max(0.0)
        )),
        _ if !cause.rivals_tested => {
            let words = "Alternatives in its place were not tested: the search reached its work limit before.";
            evidence.speaks_against.push(words.to_string());
        }
        None if cause.indistinguishable_from.is_empty() && cause.contribution.is_some() => {
            evidence.supports.push("No other entry of the catalogue had a first-order gain large enough to be fitted in its place.".to_string());
        }
        None => {}
    }
    // Below 0.5 the cause is more probably wrong than right.
    if cause.confidence < 0.5 {
        evidence.speaks_against.push(format!(
            "Its rivals and causes outside the catalogue are together more probable than this cause: confidence {:.2}.",
            cause.confidence
        ));
    }
}

fn numbers(cause: &Cause, evidence: &mut Evidence) {
    for name in &cause.by_holdout {
        let text = format!("No training row depends on {name}: its value is fitted to the validation records.");
        evidence.speaks_against.push(text);
    }
    for number in &cause.parameters {
        if !number.is_determined() {
            evidence
                .speaks_against
                .push(format!("These records do not determine {}: no simulated row changes with it.", number.name));
        }
        let Some(share) = Cause::relative_error(number) else { continue };
        let unit = if number.unit == "1" { String::new() } else { format!(" {}", number.unit) };
        let text = format!("{} = {}{unit} +- {} % (95 %)", number.name, figure(Some(number.value)), percent(share));
        if share < WIDE_INTERVAL {
            evidence.supports.push(format!("Its parameter is well determined: {text}."));
        } else {
            evidence.speaks_against.push(format!("Its parameter is poorly determined: {text}."));
        }
    }
}

fn constants(found: &Diagnosis, evidence: &mut Evidence) {
    let Some(most) = found.moved_most() else { return };
    let text = format!("{} moved most, by {:.1} standard deviations of its tolerance", most.name, most.sds.abs());
    if most.sds.abs() < NEAR_LIMIT {
        evidence.supports.push(format!("The constants of the plant stay within the tolerances of the plant file: {text}."));
    } else {
        evidence
            .speaks_against
            .push(format!("A constant of the plant is at the limit of its tolerance in the plant file: {text}."));
    }
}

fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if value < 0.095 {
        "less than 0.1".to_string()
    } else if value < 9.5 {
        format!("{value:.1}")
    } else {
        format!("{value:.0}")
    }
}

/// The reason for rejecting a hypothesis, in words.
pub fn why(found: &Diagnosis, why: &Reason) -> String {
    let least = format!("{:.0}", found.threshold);
    match why {
        Reason::Refused(why) => format!("tried and rejected: {why}"),
        Reason::Confounded(cause) => format!("not distinguishable from {cause} in these records"),
        Reason::FitsWorse { cause, by } => format!("fitted in place of {cause}: its gain is smaller by {}", figure(Some(*by))),
        Reason::LowPredictedGain => {
            format!("its first-order gain is less than {least}, the threshold of significance and effect size")
        }
        Reason::Explained(left) => format!("the causes explain most of its first-order gain: {} is left", figure(Some(*left))),
        Reason::NotKept => {
            format!("the full fit did not confirm its first-order gain: less than {least}, or no gain on validation records")
        }
    }
}

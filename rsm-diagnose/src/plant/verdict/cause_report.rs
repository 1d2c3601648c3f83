//! The report of a cause: its parameters with intervals and units, and its sentence.
//!
//! In: an entry of a fitted plant, or the rounding of an output. Out: a [`Cause`]. Makes no decision.

use super::super::cause::{Cause, Contribution, Interval};
use super::super::levenberg::Fit;
use super::super::model::Place;
use super::super::open_numbers;
use super::super::posterior::Posterior;
use super::super::search::AcceptedCause;
use super::super::whitened_residuals::WhitenedResiduals;
use crate::engine::probability::Probability;
use crate::plant::law::curve::joined;
use rsm_sim::configurations;
use rsm_sim::effect::{Arguments, Role, Subject};
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::Entry;

/// The parameters of an entry of a fit, with their intervals.
pub(crate) fn numbers(fit: &Fit, place: usize) -> Vec<Interval> {
    let entry = &fit.model.file.effects[place];
    let (plant, subject) = (entry.arguments.plant, entry.arguments.subject.as_deref());
    let posterior = Posterior::of(fit);
    let interval = |(name, value): &(&'static str, f64)| {
        let unknown = fit.model.unknowns.iter().position(|it| it.place == Place::Effect { entry: place, number: name });
        let (low, high) = unknown.and_then(|unknown| posterior.interval(fit, unknown)).unwrap_or((*value, *value));
        Interval { name, value: *value, low, high, unit: unit(plant, entry.description, subject, name) }
    };
    entry.arguments.numbers.iter().map(interval).collect()
}

pub(crate) fn cause(
    fit: &Fit,
    place: usize,
    accepted: &AcceptedCause,
    alike: Vec<String>,
    confidence: Probability,
    contribution: Option<Contribution>,
) -> Cause {
    let entry = &fit.model.file.effects[place];
    let subject = entry.arguments.subject.clone();
    let parameters = numbers(fit, place);
    let mut sentence = entry.description.sentence.to_string();
    for argument in entry.description.arguments {
        let its: Vec<&Interval> = parameters.iter().filter(|it| configurations::without(it.name) == argument.name).collect();
        if !its.is_empty() {
            sentence = sentence.replace(&format!("{{{}}}", argument.name), &by_configuration(&its));
        }
    }
    let acts_in: Vec<String> =
        if entry.acts_everywhere() { Vec::new() } else { entry.acts_in().into_iter().map(str::to_string).collect() };
    let name = subject.clone().unwrap_or_default();
    let name = configurations::without(&name);
    sentence = sentence.replace("{parameter}", name).replace("{output}", name);
    while let (Some(open), Some(close)) = (sentence.find('{'), sentence.find('}')) {
        // mutant `> to >=`: a bracket cannot open and close at one position.
        if open > close {
            break;
        }
        sentence.replace_range(open..=close, "");
    }
    if !acts_in.is_empty() {
        sentence = format!("Only in {}: {sentence}", joined(&acts_in));
    }
    Cause {
        kind: entry.description.kind,
        subject,
        of: entry.description.subject,
        parameters,
        confidence: confidence.own,
        confidence_of_any: confidence.of_any,
        indistinguishable_from: alike,
        gain: accepted.gain,
        rivals: accepted.rivals.clone(),
        rivals_tested: accepted.rivals_tested,
        sentence,
        check: entry.description.check,
        contribution,
        only_in: None,
        acts_in,
        by_holdout: open_numbers::by_holdout(fit, place),
    }
}

/// A number with its unit: one for all configurations, or one for each.
fn by_configuration(numbers: &[&Interval]) -> String {
    match numbers {
        [one] => estimate(one),
        several => {
            let each = several.iter().filter_map(|it| {
                let (_, configuration) = configurations::parts(it.name)?;
                Some(format!("{} in {configuration}", estimate(it)))
            });
            joined(&each.collect::<Vec<_>>())
        }
    }
}

/// Rounding as an entry of a file.
pub(super) fn rounding_entry(kind: PlantKind, output: usize, step: f64) -> Option<Entry> {
    let name = kind.outputs()[output].name;
    let description = rsm_sim::equation_plant::with(kind, Role::Rounding, name)?;
    let subject = Some(name.to_string());
    Some(Entry { description, arguments: Arguments { plant: kind, subject, numbers: vec![("step", step)] } })
}

/// The largest deviation of changes of readings from multiples of the step: the uncertainty of the step. It is at least the rounding of the largest
/// reading.
pub(super) fn step_uncertainty(whitened: &WhitenedResiduals, output: usize, step: f64) -> f64 {
    let mut off = 0.0_f64;
    for prepared in &whitened.records {
        let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
        let values = prepared.measured(k);
        off = values.iter().fold(off, |most, value| most.max(4.0 * f64::EPSILON * value.abs()));
        for pair in values.windows(2) {
            let miss = ((pair[1] - pair[0]) - ((pair[1] - pair[0]) / step).round() * step).abs();
            // A change farther from a multiple was not used to find the step.
            if miss < 0.01 * step {
                off = off.max(miss);
            }
        }
    }
    off
}

/// Rounding as a cause: the readings are multiples of the step, and no other cause has this effect.
pub(super) fn rounding(kind: PlantKind, output: usize, step: f64, off: f64, rows: f64) -> Option<Cause> {
    let signal = kind.outputs()[output];
    let description = rsm_sim::equation_plant::with(kind, Role::Rounding, signal.name)?;
    Some(Cause {
        kind: description.kind,
        subject: Some(signal.name.to_string()),
        of: Subject::Output,
        parameters: vec![Interval {
            name: "step",
            value: step,
            low: step - off,
            high: step + off,
            unit: signal.unit.to_string(),
        }],
        // The rest is for a file whose digits were cut.
        confidence: 0.99,
        confidence_of_any: 0.99,
        indistinguishable_from: Vec::new(),
        // All rows are multiples of the step: about one squared standard deviation for each row.
        gain: rows,
        rivals: Vec::new(),
        rivals_tested: true,
        sentence: format!("The sensor of {} rounds to multiples of {step} {}.", signal.name, signal.unit),
        check: description.check,
        contribution: None,
        only_in: None,
        acts_in: Vec::new(),
        by_holdout: Vec::new(),
    })
}

/// A number in a sentence, with its unit; and whether the records say nothing about it.
pub(super) fn estimate(it: &Interval) -> String {
    let value = with_unit(it);
    if it.is_determined() { value } else { format!("{value} (not determined)") }
}

/// A number with four digits and its unit.
pub(crate) fn with_unit(it: &Interval) -> String {
    let digits = format!("{:.3e}", it.value);
    let value: f64 = digits.parse().unwrap_or(it.value);
    if it.unit == "1" { format!("{value}") } else { format!("{value} {}", it.unit.replace('*', " ")) }
}

pub(super) fn unit(plant: PlantKind, description: &rsm_sim::effect::Description, subject: Option<&str>, name: &str) -> String {
    description.argument(name).map_or("1".to_string(), |it| it.unit.on(plant, subject))
}

//! The verdict: intervals, confidence, rivals, the regions of error, the gain of the extension.
//!
//! In: a selection and the records. Out: a [`Diagnosis`], with all its figures from the fits. Fits no cause.

mod cause_report;
mod resolution;
mod rivals;

use rsm_core::order;
use std::collections::BTreeSet;

use super::bootstrap;
use super::cause::Cause;
use super::checks::Finding;
use super::confidence::{self, Evidence};
use super::diagnosis::{Diagnosis, Practical};
use super::effect_size;
use super::error_breakdown::{self, Compared};
use super::experiment::Alias;
use super::final_fit;
use super::gaps;
use super::model::Model;
use super::nested_models;
use super::noise::NoiseFloor;
use super::own_noise::by_own_noise;
use super::posterior::Posterior;
use super::predictors;
use super::search_history::Limit;
use super::selection::Selection;
use super::validation::{self, gain, gain_of};
use super::whitened_residuals::WhitenedResiduals;
use super::whiteness;
use crate::engine::probability::Probability;
use crate::engine::verdict::Verdict;
pub(super) use cause_report::{cause, numbers, with_unit};
use cause_report::{rounding, rounding_entry, step_uncertainty};
use rsm_sim::plant_file::{Entry, PlantFile};

/// Structure below this share of the calibrated plant's squared error counts as none. Two simulations of the same equations with different steps
/// differ by up to 7e-4 of the change by an effect (a contact; the comparison of all effects in `tests/hidden-effects`). A right cause leaves the
/// square of that.
const OF_THE_WHOLE: f64 = 5e-7;

/// The limit for any plant: if the energy above the noise is more than this many times the noise energy (twice its r.m.s.), nothing is explained, and
/// there is a discrepancy.
const MOST_LEFT: f64 = 3.0;

/// The structure allowed if rounding was taken for noise, as a share of the noise energy. Rounding errors are not white in slow motion, and
/// correlated noise before rounding gives a different spectrum at every speed.
const OF_ROUNDING: f64 = 0.3;

/// Structure below a hundredth of the noise energy (half a per cent of its r.m.s.) does not matter in practice.
const FOR_PRACTICE: f64 = 0.01;

/// Nor does structure below this share of the error that the causes remove: three thousandths of its r.m.s. No law of a textbook describes a machine
/// better, and records with so little noise show this difference.
const OF_THE_REMOVED: f64 = 1e-5;

/// The limit for any error: a tenth of the noise energy (a twentieth of its r.m.s.).
const MOST_FOR_PRACTICE: f64 = 0.1;

/// This applies only with causes that remove all but a thousandth of the error.
const NEARLY_ALL: f64 = 0.999;

/// If structure is left, a cause is named only if its probability is at least a half. All others are listed as helpers.
pub(super) const LEAST_CONFIDENCE: f64 = 0.5;

/// The indices of gains, the largest first.
fn by_gain(gains: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..gains.len()).collect();
    order::descending(&mut order, |it| gains[*it]);
    order
}

/// The structure that rounding may leave above the noise: none if the floors of all rounded outputs include the rounding and their noise is white.
fn of_rounding<'a>(mut rounded: impl Iterator<Item = &'a NoiseFloor>) -> f64 {
    if rounded.all(|floor| floor.rounding.is_some() && floor.correlation == 0.0) { 0.0 } else { OF_ROUNDING }
}

/// The whole diagnosis.
#[must_use]
pub fn conclude(
    file: &PlantFile,
    whitened: &WhitenedResiduals,
    unseen: &WhitenedResiduals,
    nominal: &Model,
    selection: Selection,
    findings: Vec<Finding>,
    rounded: &[(usize, f64)],
) -> Diagnosis {
    let Selection {
        calibrated,
        fit,
        causes: accepted,
        refused,
        threshold,
        ranking,
        remaining,
        stopped,
        known_loop,
        all_rows: everywhere,
        numbers,
    } = selection;
    // Causes have the evidence of the search. Their numbers may come from more rows.
    let (fitted, numbers) = numbers.as_ref().map_or((whitened, &fit), |it| (&it.whitened, &it.fit));
    let judged = if unseen.records.is_empty() { whitened } else { unseen };
    let before = validation::fit_initial_states(judged, nominal);
    // From the calibrated plant's initial states or from first readings, whichever fits better.
    let plain = validation::fit_initial_states(judged, &numbers.model);
    let guided = validation::fit_initial_states(judged, &calibrated.model);
    let guided = guided.and_then(|calibrated| validation::fit_from_starts_of(judged, &numbers.model, &calibrated));
    let after = plain.into_iter().chain(guided).min_by(|a, b| a.cost.total_cmp(&b.cost));
    let (nominal_errors, extended_errors) = (
        before.as_ref().map_or_else(Vec::new, |fit| validation::errors(judged, fit)),
        after.as_ref().map_or_else(Vec::new, |fit| validation::errors(judged, fit)),
    );
    let order = by_gain(&accepted.iter().map(|it| it.gain).collect::<Vec<_>>());
    let steps = nested_models::steps(whitened, judged, nominal, &calibrated, &fit, &order);
    let left = whiteness::test(whitened, &fit);
    // On holdout records the parameters of the plant may move within their uncertainty.
    let moved = after.as_ref().filter(|_| !unseen.records.is_empty());
    let moved = moved.and_then(|after| {
        validation::fit_within_uncertainty(unseen, &numbers.model, Posterior::of(numbers).deviations(), after)
    });
    let there = moved.map(|moved| by_own_noise(unseen, moved));
    let left_unseen = there.as_ref().map(|(there, fit)| whiteness::test(there, fit));
    let predicts = there
        .iter()
        .filter_map(|(there, fit)| predictors::best_predictor(there, fit))
        .chain(predictors::best_predictor(whitened, &fit));
    let predicted = predicts.max_by(|a, b| a.excess.total_cmp(&b.excess));
    let wrong = mean_excess(calibrated.cost, calibrated.residual.len());
    let elsewhere = [
        left_unseen.as_ref().map(|it| it.excess),
        predicted.as_ref().map(|it| it.excess),
        everywhere.as_ref().map(|it| it.excess),
    ];
    let most_left = elsewhere.into_iter().flatten().fold(left.excess, f64::max);
    let allowed = allowed_excess(of_rounding(rounded.iter().map(|(output, _)| &whitened.floors[*output])), wrong);
    let (structure, practical) = remaining_structure(most_left, allowed, wrong, accepted.is_empty());
    let calibrated_there = validation::fit_initial_states(judged, &calibrated.model);
    let compared = match (&before, &calibrated_there, &after) {
        (Some(nominal_there), Some(before), Some(after)) => {
            Some(Compared { whitened, unseen, nominal, fit: &fit, nominal_there, before, after, structure })
        }
        _ => None,
    };
    let (error_breakdown, contributions) =
        compared.as_ref().map(|it| error_breakdown::error_breakdown(it, &accepted)).unwrap_or_default();
    let mut aliases: Vec<(f64, Alias)> = Vec::new();
    let mut causes: Vec<Cause> = Vec::new();
    for (place, one) in accepted.iter().enumerate() {
        let decides = effect_size::deciding_difference(threshold, fit.cost, fit.residual.len());
        let same = effect_size::equal(decides, one.gain);
        let one = &rivals::without_general(one);
        aliases.extend(rivals::aliases(one, same).into_iter().map(|it| (one.gain, it)));
        let alike = rivals::equal_rivals(one, same);
        let judged = Evidence {
            gain: one.gain,
            rivals: &one.rivals,
            same,
            not_fitted: rivals::not_fitted(one).count(),
            left: most_left * fit.residual.len() as f64,
            explained: is_explained(structure, stopped),
            rivals_tested: one.rivals_tested,
        };
        let by_law = known_loop.as_ref().is_some_and(|it| it.identifies(file, &fit.model.file.effects[place]));
        let confidence = with_known_law(confidence::confidence(&judged), by_law);
        causes.push(cause(numbers, place, one, alike, confidence, contributions.get(place).cloned().flatten()));
    }
    let present = outputs(whitened);
    let coarse = resolution::reported_as_causes(rounded, present.len(), &whitened.floors);
    for (output, step) in &coarse {
        causes.extend(rounding(
            file.kind,
            *output,
            *step,
            step_uncertainty(whitened, *output, *step),
            fit.residual.len() as f64,
        ));
    }
    let rows = whitened.records.iter().map(|it| it.record.rows()).sum();
    let by_law = known_loop.as_ref().map_or_else(Vec::new, |it| it.further_causes(file, &fit.model.file.effects, rows));
    let (told_by_law, by_law): (Vec<Cause>, Vec<Entry>) = by_law.into_iter().unzip();
    // The result of a known control law about a sensor replaces that of the search.
    replace(&mut causes, told_by_law, |it| (it.kind, it.subject.clone()));
    order::descending(&mut causes, |it| it.gain);
    order::descending(&mut aliases, |it| it.0);
    let verdict = verdict_of(structure, stopped, causes.is_empty());
    let (causes, helpers): (Vec<Cause>, Vec<Cause>) = causes.into_iter().partition(|it| is_named(verdict, it.confidence));
    let mut plant = final_fit::extended_plant_file(file, fitted, nominal, numbers);
    replace(&mut plant.effects, by_law, |it| (it.description.kind, it.arguments.subject.clone()));
    for (output, step) in coarse {
        plant.effects.extend(rounding_entry(file.kind, output, step));
    }
    let gain_interval = before
        .as_ref()
        .zip(after.as_ref())
        .map(|(before, after)| bootstrap::gain_interval(judged, &before.simulated, &after.simulated, gain_of));
    Diagnosis {
        verdict,
        causes,
        helpers,
        own_record: None,
        refused,
        practical,
        gain_interval: gain_interval.unwrap_or_default(),
        gain: gain(&nominal_errors, &extended_errors),
        nominal: nominal_errors,
        extended: extended_errors,
        plant,
        law: None,
        findings,
        unused_rows: None,
        all_rows: everywhere,
        units: Vec::new(),
        filled_gaps: gaps::filled_gaps(whitened.records.iter().chain(&unseen.records)),
        noise: present.iter().map(|k| (*k, whitened.floors[*k].sd, whitened.floors[*k].correlation)).collect(),
        growing: growing(whitened, &present),
        rounded: rounded.to_vec(),
        tails: present.iter().filter_map(|&output| Some((output, whitened.tails[output]?))).collect(),
        threshold,
        ranking,
        remaining,
        steps,
        stopped,
        left,
        left_unseen,
        known_loop,
        equations: None,
        predicted,
        aliases: aliases.into_iter().map(|it| it.1).collect(),
        next: None,
        error_breakdown,
        tested: None,
        claims: Vec::new(),
    }
}

/// The outputs that any record holds, by their place in the plant.
fn outputs(whitened: &WhitenedResiduals) -> Vec<usize> {
    let all: BTreeSet<usize> = whitened.records.iter().flat_map(|it| it.outputs.iter().copied()).collect();
    all.into_iter().collect()
}

/// Outputs whose noise grows with the reading: the standard deviation at a reading of 0 and at the largest one.
fn growing(whitened: &WhitenedResiduals, present: &[usize]) -> Vec<(usize, f64, f64)> {
    let readings = |output: usize| {
        let of = move |it: &'_ super::whitened_residuals::Prepared| it.outputs.iter().position(|found| *found == output);
        whitened.records.iter().filter_map(move |it| of(it).map(|k| it.measured(k))).flatten()
    };
    let largest = |output: usize| readings(output).fold(0.0_f64, |most, value| most.max(value.abs()));
    let grows = present.iter().filter(|output| whitened.floors[**output].growth.is_some());
    grows.map(|&output| (output, whitened.floors[output].sd_at(0.0), whitened.floors[output].sd_at(largest(output)))).collect()
}

/// The mean error of a calibrated plant per row: its squared error over the noise variance, minus 1.
fn mean_excess(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64 - 1.0).max(0.0)
}

/// The figures of causes if what they leave does not matter in practice; `wrong` is the error before.
fn practical(left: f64, wrong: f64) -> Option<Practical> {
    // Without an error before, nothing is removed.
    // mutant `f64::MIN_POSITIVE doubled`: both are far below any residual.
    let removed = 1.0 - left.max(0.0) / wrong.max(f64::MIN_POSITIVE);
    let limit = (OF_THE_REMOVED * wrong).clamp(FOR_PRACTICE, MOST_FOR_PRACTICE);
    (left < limit && removed > NEARLY_ALL).then_some(Practical { removed, left })
}

/// The allowed energy above the noise, divided by the noise energy; `wrong` is the mean error of the calibrated plant per row.
fn allowed_excess(of_rounding: f64, wrong: f64) -> f64 {
    of_rounding.max(OF_THE_WHOLE * wrong).min(MOST_LEFT)
}

/// Whether more is left than allowed and matters; and the practical figures if it does not matter.
fn remaining_structure(left: f64, allowed: f64, wrong: f64, nothing: bool) -> (bool, Option<Practical>) {
    let practical = if left > allowed && !nothing { practical(left, wrong) } else { None };
    (left > allowed && practical.is_none(), practical)
}

/// Whether the causes leave only noise and only the work limit ended the search.
fn is_explained(structure: bool, stopped: Option<Limit>) -> bool {
    !structure && stopped.is_none_or(|limit| limit == Limit::Work)
}

/// A cause that a known control law shows has at least the probability of a cause without rivals.
fn with_known_law(confidence: Probability, by_law: bool) -> Probability {
    confidence.at_least(if by_law { confidence::EXPLAINED } else { 0.0 })
}

/// Whether a cause is named, not a helper.
fn is_named(verdict: Verdict, confidence: f64) -> bool {
    verdict != Verdict::Unexplained || confidence >= LEAST_CONFIDENCE
}

/// Adds new elements to a list. They replace those with the same name.
fn replace<T, Name: PartialEq>(list: &mut Vec<T>, new: Vec<T>, name: impl Fn(&T) -> Name) {
    list.retain(|old| !new.iter().any(|new| name(new) == name(old)));
    list.extend(new);
}

/// The verdict. Causes that leave only noise are accepted, even if tests of rivals were not finished. A search that repeated a set of causes, or that
/// reached the limit of additions or exchanges, has no result.
fn verdict_of(structure: bool, stopped: Option<Limit>, nothing: bool) -> Verdict {
    match (is_explained(structure, stopped), nothing) {
        (false, _) => Verdict::Unexplained,
        (true, true) => Verdict::NoDiscrepancy,
        (true, false) => Verdict::Explained,
    }
}

#[cfg(test)]
mod tests;

//! The error after each cause: a sequence of nested plants from the calibrated one to the extended one.
//!
//! In: the causes and the records. Out: for each step, the causes in the plant and its errors on the evaluation records; for an axis also the error
//! of the inverse model. A cause that contains simpler ones as special cases comes after them, so that a reader sees what each part contributes. The
//! set of causes does not change.

use super::hypotheses::label_of;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::validation::{self, Error};
use super::whitened_residuals::WhitenedResiduals;
use crate::plant::inverse::Motion;
use rsm_sim::plant_file::Entry;

/// Steps of a fit: the same as for a candidate.
const FIT_STEPS: usize = 8;

/// One plant of the sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// The names of its causes; empty at first.
    pub causes: Vec<String>,
    /// Its errors on the evaluation records.
    pub errors: Vec<Error>,
    /// For an axis: the relative error of the force that the measured motion needs (root mean square over those records), if the inverse model can be
    /// evaluated.
    pub force_error: Option<f64>,
}

/// The sequence from the calibrated plant to the extended one. `order` holds the indices of the causes among the fit's effects, the strongest first.
#[must_use]
pub fn steps(
    whitened: &WhitenedResiduals,
    judged: &WhitenedResiduals,
    nominal: &Model,
    calibrated: &Fit,
    fit: &Fit,
    order: &[usize],
) -> Vec<Step> {
    let motions: Vec<Motion> = judged.records.iter().filter_map(|it| Motion::of(&it.record, nominal.file.kind).ok()).collect();
    let step = |model: &Model| -> Option<Step> {
        let fit = validation::fit_initial_states(judged, model)?;
        let entries = model.file.effects.iter();
        let force: Option<Vec<f64>> = motions.iter().map(|motion| motion.relative_error_of(&model.file)).collect();
        let force = force.filter(|list| !list.is_empty());
        Some(Step {
            causes: entries.map(label_of).collect(),
            errors: validation::errors(judged, &fit),
            force_error: force.map(|list| (list.iter().map(|it| it * it).sum::<f64>() / list.len() as f64).sqrt()),
        })
    };
    let mut list: Vec<Step> = step(&calibrated.model).into_iter().collect();
    let effects = &fit.model.file.effects;
    let mut before: Vec<Entry> = Vec::new();
    for (count, &place) in order.iter().enumerate() {
        let Some(entry) = effects.get(place) else { continue };
        for special in special_cases(entry) {
            // A special case that is itself a cause already has its own step.
            let own = |it: &Entry| effects.iter().any(|other| other.description.kind == it.description.kind);
            if special.iter().any(own) {
                continue;
            }
            let model = calibrated.model.with_effects(nominal, [before.clone(), special].concat());
            list.extend(levenberg::fit(whitened, model, FIT_STEPS).and_then(|fit| step(&fit.model)));
        }
        before.push(entry.clone());
        if count + 1 < order.len() {
            let model = calibrated.model.with_effects(nominal, before.clone());
            list.extend(levenberg::fit(whitened, model, FIT_STEPS).and_then(|fit| step(&fit.model)));
        }
    }
    if !order.is_empty() {
        list.extend(step(&fit.model));
    }
    list
}

/// The special cases of a cause, the simplest first.
fn special_cases(entry: &Entry) -> Vec<Vec<Entry>> {
    let forms = entry.description.declared.forms.of(&entry.arguments);
    forms.special.iter().map(|form| form.iter().filter_map(|part| part.entry(entry.arguments.plant)).collect()).collect()
}

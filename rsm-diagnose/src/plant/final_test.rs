//! The final test of a set of causes, on each holdout record separately and on the intervals of the causes.
//!
//! In: the fit of a search with its causes, and holdout records. Out: the accepted causes, and the rejected ones with the reason. A set that improves
//! one record and worsens another may have a better sum, but it is no explanation; so each record is tested separately. Never adds a cause.

use super::candidates::is_physical;
use super::hypotheses::Hypothesis;
use super::levenberg::{self, Fit};
use super::model::{Model, Place, Unknown};
use super::posterior::Posterior;
use super::search::{AcceptedCause, Search};
use super::whitened_residuals::WhitenedResiduals;
use super::{effect_size, plausible, validation};
use rsm_sim::configurations;
use rsm_sim::plant_file::Entry;

/// A cause that was tried and rejected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Its name in lists.
    pub cause: String,
    /// The reason in words.
    pub why: String,
}

/// A parameter counts as at the end of its search within this share of its scale.
const AT_SEARCH_BOUND: f64 = 1e-6;

impl Search<'_> {
    /// Removes causes from a set: causes without a significant effect, with a parameter at the end of its search or beyond the plausible range, or
    /// that make a holdout record worse. One cause is removed at a time, the one with the strongest reason first. The others are then fitted again.
    pub(super) fn without_rejected(
        &self,
        calibrated: &Fit,
        fit: Fit,
        causes: Vec<AcceptedCause>,
        threshold: f64,
    ) -> (Fit, Vec<AcceptedCause>, Vec<Refusal>) {
        let worst = |fit: &Fit, causes: &[AcceptedCause]| {
            self.with_wrong_number(fit).or_else(|| self.harmful(calibrated, fit, causes, threshold))
        };
        self.without(fit, causes, worst)
    }

    /// Removes only causes whose own numbers are a reason. After the final fit, which moves numbers: the reported ones must pass, too.
    pub(super) fn without_wrong_numbers(
        &self,
        fit: Fit,
        causes: Vec<AcceptedCause>,
    ) -> (Fit, Vec<AcceptedCause>, Vec<Refusal>) {
        self.without(fit, causes, |fit, _| self.with_wrong_number(fit))
    }

    /// Removes causes one by one as long as a rule names one.
    fn without(
        &self,
        mut fit: Fit,
        mut causes: Vec<AcceptedCause>,
        worst: impl Fn(&Fit, &[AcceptedCause]) -> Option<(usize, String)>,
    ) -> (Fit, Vec<AcceptedCause>, Vec<Refusal>) {
        let mut refused = Vec::new();
        while causes.len() == fit.model.file.effects.len()
            && let Some((place, why)) = worst(&fit, &causes)
        {
            let without = fit.model.without_cause(self.nominal, place);
            let Some(other) = levenberg::refit(self.whitened, without, self.limits.fit_steps, Some(&fit)) else { break };
            let cause = causes.remove(place).label;
            (self.progress)(&format!("{cause} is refused: {why}"));
            refused.push(Refusal { cause, why });
            fit = other;
            self.update_gains(&fit, &mut causes);
        }
        (fit, causes, refused)
    }

    /// The gain of each cause in the smaller set.
    fn update_gains(&self, fit: &Fit, causes: &mut [AcceptedCause]) {
        for (place, cause) in causes.iter_mut().enumerate() {
            let without = fit.model.without_cause(self.nominal, place);
            if let Some(base) = levenberg::refit(self.whitened, without, self.limits.fit_steps, Some(fit)) {
                cause.gain = base.cost - fit.cost;
                cause.without = base.model;
            }
        }
    }

    /// The first cause with a number that is implausible, at the end of its search, or without an effect; with the reason.
    fn with_wrong_number(&self, fit: &Fit) -> Option<(usize, String)> {
        let of_itself = |(place, entry): (usize, &Entry)| {
            let implausible =
                plausible::implausibility(entry, self.survey, &self.nominal.file).filter(|_| !self.leaves_no_structure(fit));
            let impossible = || (!is_physical(entry)).then(|| "no machine has these numbers together".to_string());
            let why = implausible
                .or_else(impossible)
                .or_else(|| at_search_bound(fit, place))
                .or_else(|| neutral(fit, place, self.hypotheses));
            why.map(|why| (place, why))
        };
        fit.model.file.effects.iter().enumerate().find_map(of_itself)
    }

    /// The cause that makes a holdout record worse by more than the deciding difference, or that contributes most if the set as a whole does.
    fn harmful(&self, calibrated: &Fit, fit: &Fit, causes: &[AcceptedCause], threshold: f64) -> Option<(usize, String)> {
        if causes.is_empty() || self.unseen.records.is_empty() {
            return None;
        }
        let with = by_record(self.unseen, &fit.model, &[&calibrated.model], Some(fit))?;
        let without: Vec<Vec<f64>> =
            causes.iter().map(|it| by_record(self.unseen, &it.without, &[&calibrated.model], None)).collect::<Option<_>>()?;
        // How much worse a record is, as a multiple of the deciding difference.
        let worse = |record: usize, with: f64, without: f64| {
            (with - without)
                / effect_size::deciding_difference(
                    threshold,
                    without.min(with),
                    WhitenedResiduals::length(&self.unseen.records[record]),
                )
        };
        let mut worst: Option<(f64, usize, String)> = None;
        for (place, before) in without.iter().enumerate() {
            for (record, (after, before)) in with.iter().zip(before).enumerate() {
                let by = worse(record, *after, *before);
                if by > 1.0 && worst.as_ref().is_none_or(|it| by > it.0) {
                    worst = Some((by, place, self.worsening(record, *before, *after)));
                }
            }
        }
        if let Some((_, place, why)) = worst {
            return Some((place, why));
        }
        // If no single cause makes a record worse, the whole set may: it is compared with the nominal and the calibrated plant, whichever is nearer.
        let plain = [self.nominal, &calibrated.model].map(|model| by_record(self.unseen, model, &[], None));
        let [Some(nominal), Some(calibrated)] = plain else { return None };
        for (record, after) in with.iter().enumerate() {
            let before = nominal[record].min(calibrated[record]);
            if worse(record, *after, before) > 1.0 {
                let member = (0..causes.len()).min_by(|a, b| without[*a][record].total_cmp(&without[*b][record]))?;
                return Some((member, self.worsening(record, before, *after)));
            }
        }
        None
    }

    fn worsening(&self, record: usize, before: f64, after: f64) -> String {
        let prepared = &self.unseen.records[record];
        let times = |square: f64| (square / WhitenedResiduals::length(prepared).max(1) as f64).sqrt();
        format!(
            "{} becomes worse: {:.2} times the noise without it, {:.2} with it",
            super::regions::name_of(&prepared.record.file),
            times(before),
            times(after)
        )
    }
}

/// The squared residual of a model on each record: the best of several initial states, from first readings and from those of other models. With a
/// fit, its parameters may also move within their uncertainty.
fn by_record(unseen: &WhitenedResiduals, model: &Model, guides: &[&Model], fit: Option<&Fit>) -> Option<Vec<f64>> {
    let plain = validation::fit_initial_states(unseen, model)?;
    let mut fits = vec![plain];
    for guide in guides {
        let guided = validation::fit_initial_states(unseen, guide)
            .and_then(|guide| validation::fit_from_starts_of(unseen, model, &guide));
        fits.extend(guided);
    }
    if let Some(fit) = fit {
        let best = fits.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        let moved = validation::fit_within_uncertainty(unseen, model, Posterior::of(fit).deviations(), best);
        fits.extend(moved);
    }
    let of = |fit: &Fit, record: usize| {
        let first = unseen.first(record);
        let part = &fit.residual[first..first + WhitenedResiduals::length(&unseen.records[record])];
        crate::engine::columns::dot(part, part)
    };
    Some((0..unseen.records.len()).map(|record| fits.iter().map(|fit| of(fit, record)).fold(f64::INFINITY, f64::min)).collect())
}

/// Whether a parameter of an entry is at an end of its search that is no physical bound; the reason in words.
fn at_search_bound(fit: &Fit, entry: usize) -> Option<String> {
    let its = |unknown: &&Unknown| matches!(unknown.place, Place::Effect { entry: its, .. } if its == entry);
    let places = (0..fit.model.unknowns.len()).filter(|k| its(&&fit.model.unknowns[*k]));
    let mut ends = places.filter_map(|k| {
        let unknown = &fit.model.unknowns[k];
        let Place::Effect { number, .. } = unknown.place else { return None };
        if !unknown.logarithmic {
            return None;
        }
        let at = unknown.to_search_scale(fit.model.value(k));
        let near = |end: f64| (at - unknown.to_search_scale(end)).abs() < AT_SEARCH_BOUND * unknown.scale;
        (near(unknown.low) || near(unknown.high))
            .then(|| format!("{number} reached the bound of its search, {:.4}", fit.model.value(k)))
    });
    ends.next()
}

/// Whether the 95 % interval of the scaling parameter of an entry contains the value without effect; the reason in words.
fn neutral(fit: &Fit, entry: usize, hypotheses: &[Hypothesis]) -> Option<String> {
    let its = &fit.model.file.effects[entry];
    let hypothesis = hypotheses.iter().find(|it| it.describes(its))?;
    let (place, without) = hypothesis.guesses.first()?.neutral?;
    // With numbers by configuration, it has no effect if it has none in any of them.
    let scaling = its.description.arguments.get(place)?.name;
    let posterior = Posterior::of(fit);
    let mut why = None;
    for (name, value) in its.arguments.numbers.iter().filter(|it| configurations::without(it.0) == scaling) {
        let unknown = fit.model.unknowns.iter().position(|it| it.place == Place::Effect { entry, number: name })?;
        let (low, high) = posterior.interval(fit, unknown)?;
        if without < low || high < without {
            return None;
        }
        why = Some(if low.is_finite() || high.is_finite() {
            format!(
                "{name} = {value:.4}, and its 95 % interval, {low:.4} to {high:.4}, contains {without}, at which it has no effect"
            )
        } else {
            format!("{name} = {value:.4} is not determined: no simulated row depends on it")
        });
    }
    why
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, hypotheses, survey};
    use super::*;

    const TOLERANCES: &str = "mass = 0.02\nviscous_friction = 0.02";

    /// What is refused of dry friction that was fitted to an axis with so much of it, where a holdout record is of an axis with so much.
    fn refused(seen: f64, unseen: f64) -> Vec<String> {
        let file = |force: f64| {
            let effects = if force == 0.0 { String::new() } else { axis_under_steps::friction(force) };
            axis_under_steps::file(TOLERANCES, &effects)
        };
        let (whitened, nominal) = axis_under_steps::whitened(&file(0.0), &file(seen), true);
        let (other, _) = axis_under_steps::whitened(&file(0.0), &file(unseen), true);
        let calibrated = levenberg::fit(&whitened, nominal.clone(), 8).unwrap();
        let survey = survey::survey(&whitened, &calibrated);
        let all = hypotheses::all(nominal.file.kind, &survey, &[0]);
        let search = axis_under_steps::search(&whitened, &other, &nominal, &all, &survey);
        let with = nominal.with_effects(&nominal, file(0.1).effects);
        let fit = levenberg::fit(&whitened, with, 20).unwrap();
        let accepted = AcceptedCause {
            label: "coulomb-friction".to_string(),
            gain: calibrated.cost - fit.cost,
            rivals: Vec::new(),
            rival_models: Vec::new(),
            aliases_not_fitted: Vec::new(),
            rivals_tested: true,
            without: calibrated.model.clone(),
        };
        let (fit, causes, refused) = search.without_rejected(&calibrated, fit, vec![accepted], 30.0);
        assert_eq!((fit.model.file.effects.len(), causes.len() + refused.len()), (causes.len(), 1));
        refused.into_iter().map(|it| it.why).collect()
    }

    #[test]
    fn a_cause_that_makes_an_unseen_record_worse_is_refused_and_so_is_one_that_does_nothing() {
        assert_eq!(refused(0.8, 0.8), Vec::<String>::new());
        let worse = refused(0.8, 0.0);
        assert!(worse.len() == 1 && worse[0].contains("becomes worse"), "{worse:?}");
        let nothing = refused(0.0, 0.0);
        assert!(nothing.len() == 1 && nothing[0].contains("at which it has no effect"), "{nothing:?}");
    }
}

//! The choice of one more cause: the best hypotheses are fitted in full, and at most one of them is accepted.
//!
//! In: a fit and the results of its screen. Out: candidates, the best first, and the one to accept, if any. A candidate is evaluated on training and
//! validation records together. Parameters are fitted to training records only. Independent of how the fit was found.

use super::hypotheses::{Hypothesis, label_of};
use super::levenberg::{self, Fit};
use super::model::Model;
use super::refined_guesses::{group_of, split_duplicates};
use super::screen::Screened;
use super::search::Search;
use super::{effect_size, multistart, validation, waves, whiteness};
use crate::engine::significance::best_gain_by_chance;
use rsm_core::order;
use rsm_sim::plant_file::Entry;

/// The best candidate gets this many times the steps. A law with kinks converges by only a factor of three in each step.
const FINAL_STEPS: usize = 3;

/// The fit of a rival continues if this many times the gain that its derivatives predict would make it as good as the best candidate. In a curved
/// valley the minimum may be lower than they predict.
const OPEN_GAINS: f64 = 2.0;

/// Steps of a free-run fit of a wave. Where the axis creeps over crests, nearby solutions separate, so each step is short.
const WAVE_STEPS: usize = 16;

/// A free-run fit is done if a wave leaves at most this many times the noise energy.
const NEAR_NOISE: f64 = 2.0;

/// A hypothesis after its full fit.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Its name in lists.
    pub label: String,
    /// The fit with it.
    pub fit: Fit,
    /// The number of parameters that it adds.
    pub numbers: usize,
    /// Squared residual of training and validation records together.
    pub score: f64,
    /// The squared residual on validation records.
    pub unseen: f64,
    /// Hypotheses with the same trace and the same predicted gain, which were therefore not fitted.
    pub aliases_not_fitted: Vec<String>,
}

impl Search<'_> {
    /// Refines the best guesses of the screen, fits the best of them in full, and evaluates them. The best comes first.
    pub(super) fn fit_candidates(&self, fit: &Fit, screened: &[Screened], threshold: f64) -> Vec<Candidate> {
        let split = split_duplicates(screened, self.deciding_difference(fit, threshold));
        let fitted = self.side_by_side(&self.refined(fit, &split.kept, threshold), |search, it| {
            (self.progress)(&format!("fitting {}", self.hypotheses[it.hypothesis].label()));
            let mut found = search.fitted(fit, &it.entry)?;
            if let Some(group) = group_of(&split.kept, it.form()) {
                let same = split.duplicates.iter().filter(|it| it.0 == group);
                found.aliases_not_fitted = same.map(|it| self.hypotheses[it.1].label()).collect();
            }
            Some(found)
        });
        let mut candidates: Vec<Candidate> = fitted.into_iter().flatten().collect();
        order::ascending(&mut candidates, |it| it.score);
        // The best candidate is fitted until it converges. Otherwise the rest of its error would look like one more cause.
        if let Some(best) = candidates.first_mut()
            && let Some(settled) = self.converged(fit, best, threshold)
        {
            best.replace_fit(settled);
        }
        self.continue_rivals(fit, &mut candidates, threshold);
        // All of them: with one number for all configurations, a wrong cause may be the best one.
        for it in &mut candidates {
            self.separate_numbers(fit, it, threshold);
        }
        order::ascending(&mut candidates, |it| it.score);
        self.keep_plausible(&mut candidates);
        candidates
    }

    /// Drops candidates with implausible numbers if a plausible one leaves only noise as well.
    pub(super) fn keep_plausible(&self, candidates: &mut Vec<Candidate>) {
        let is_plausible = |it: &Candidate| it.fit.model.file.effects.iter().all(|it| self.is_plausible(it));
        if !candidates.iter().all(is_plausible)
            && candidates.iter().any(|it| is_plausible(it) && self.leaves_no_structure(&it.fit))
        {
            candidates.retain(is_plausible);
        }
    }

    /// Replaces a candidate by the same cause with numbers by configuration, if the records need them.
    pub(super) fn separate_numbers(&self, fit: &Fit, candidate: &mut Candidate, threshold: f64) {
        let effects = |it: &Fit| it.model.file.effects.last().map(|it| it.arguments.numbers.clone());
        let before = effects(&candidate.fit);
        let place = candidate.fit.model.file.effects.len() - 1;
        let found = self.with_own_numbers(candidate.fit.clone(), place, threshold);
        if effects(&found).map(|it| it.len()) != before.map(|it| it.len())
            && let Some(found) = self.evaluated(fit, found)
        {
            candidate.replace_fit(found);
        }
    }

    /// Continues the fits of those candidates that may still become as good as the first one. A rival that stopped far from its minimum would seem to
    /// be refuted by the records.
    fn continue_rivals(&self, fit: &Fit, candidates: &mut [Candidate], threshold: f64) {
        let Some((best, rivals)) = candidates.split_first_mut() else { return };
        let decides = effect_size::deciding_difference(threshold, best.fit.cost, self.whitened.rows());
        let gain = fit.cost - best.fit.cost;
        let enough = |it: &Candidate| best.fit.cost + effect_size::equal_rival(decides, gain, it.numbers < best.numbers);
        let is_open =
            |it: &&mut Candidate| it.fit.cost > enough(it) && it.fit.cost - OPEN_GAINS * it.fit.gain_to_minimum() < enough(it);
        let mut open: Vec<&mut Candidate> = rivals.iter_mut().filter(is_open).collect();
        let further = self.side_by_side(&open, |search, it| {
            let further = levenberg::settled(search.whitened, &it.fit, FINAL_STEPS * self.limits.fit_steps)?;
            search.evaluated(fit, further).filter(|further| further.score < it.score)
        });
        for (rival, further) in open.iter_mut().zip(further) {
            if let Some(further) = further {
                rival.replace_fit(further);
            }
        }
    }

    /// A candidate with more steps. If no parameter scales the cause, the fit also tries other local minima. `None` if that changes nothing.
    fn converged(&self, fit: &Fit, found: &Candidate, threshold: f64) -> Option<Candidate> {
        let enough = 0.1 * threshold;
        let steps = self.limits.fit_steps;
        let mut further = levenberg::refit(self.whitened, found.fit.model.clone(), FINAL_STEPS * steps, Some(&found.fit))?;
        let entry = further.model.file.effects.last()?;
        let several = entry.arguments.numbers.len() > 1;
        let scales = |it: &Hypothesis| it.guesses.iter().all(|guess| guess.neutral.is_some());
        let scales = self.hypotheses.iter().any(|it| it.describes(entry) && scales(it));
        if !scales {
            further = multistart::line_search_escape(self.whitened, further, steps, enough);
        }
        let hops = if several && !scales { multistart::MOST_FAILED_HOPS } else { 0 };
        if hops > 0 || multistart::in_few_parts(self.whitened, &further) {
            further = multistart::basin_hopping(self.whitened, further, steps, hops, enough);
        }
        if found.fit.cost - further.cost > enough { self.evaluated(fit, further) } else { None }
    }

    /// A full fit with this entry, with the best whole number if it has one. `None` if it cannot be simulated, or if it is a parameter error within
    /// the tolerance of calibration.
    pub(super) fn fitted(&self, fit: &Fit, entry: &Entry) -> Option<Candidate> {
        let joint = waves::is_wave(entry.description, entry.arguments.plant)
            .then(|| waves::joint_fit(self.whitened, fit, self.nominal, entry, &waves::REACHES))
            .flatten();
        let found = match joint {
            // The derivatives of a plant without the wave are of no use for a plant with it.
            Some((model, predicted)) if predicted < NEAR_NOISE * self.whitened.rows() as f64 => {
                // Where the axis creeps over a crest, a free run may diverge late and strongly. Most of the record is before that.
                let surely = multistart::robust_fit(self.whitened, model.clone()).unwrap_or(model);
                self.continued_wave_fit(levenberg::fit(self.whitened, surely, WAVE_STEPS)?)
            }
            Some((model, _)) => levenberg::fit(self.whitened, model, self.limits.fit_steps)?,
            None => {
                let model = fit.model.joined(self.nominal, entry.clone());
                levenberg::refit(self.whitened, model, self.limits.fit_steps, Some(fit))?
            }
        };
        self.evaluated(fit, self.with_best_whole_number(found, self.limits.fit_steps))
    }

    /// Evaluates a fit with one more cause. `None` if that cause is a parameter error within the tolerance of calibration, if any cause has
    /// implausible parameters and structure is left, or if a wave does not repeat.
    pub(super) fn evaluated(&self, without: &Fit, fit: Fit) -> Option<Candidate> {
        let entry = fit.model.file.effects.last()?;
        let is_refused = |it: &Entry| {
            let is_possible = is_physical(it) && waves::has_whole_period(self.whitened, it);
            !is_possible || self.is_far_from_its_guess(it) && self.compensates(without, &fit)
        };
        if within_tolerance(self.nominal, entry) || fit.model.file.effects.iter().any(is_refused) {
            return None;
        }
        let unseen = validation::squared_residual(self.unseen, &fit.model)?;
        let label = label_of(entry);
        (self.progress)(&format!("{label} gains {:.0}", without.cost - fit.cost));
        // Integers and rounding steps count as parameters although no fit changes them: each was chosen among many.
        let numbers = entry.arguments.numbers.len();
        Some(Candidate { label, score: fit.cost + unseen, unseen, numbers, fit, aliases_not_fitted: Vec::new() })
    }

    /// Whether the parameters are consistent with physics, and each is plausible.
    pub(super) fn is_plausible(&self, entry: &Entry) -> bool {
        is_physical(entry) && !self.is_far_from_its_guess(entry)
    }

    /// Whether a parameter is outside of its plausible range.
    fn is_far_from_its_guess(&self, entry: &Entry) -> bool {
        super::plausible::implausibility(entry, self.survey, &self.nominal.file).is_some()
    }

    /// Whether implausible numbers of a fit may compensate for an error that the catalogue does not contain. They do not if all structure of the fit
    /// before it is gone: what such an error does differs from the effect somewhere.
    fn compensates(&self, without: &Fit, fit: &Fit) -> bool {
        self.leaves_no_structure(without) || !self.leaves_no_structure(fit)
    }

    /// Whether the residual of a fit is noise.
    pub(super) fn leaves_no_structure(&self, fit: &Fit) -> bool {
        whiteness::test(self.whitened, fit).excess <= 0.0
    }

    /// A fit with a wave that reached a poor local minimum. Starting again from a wave fit along the readings may improve it.
    fn continued_wave_fit(&self, mut fit: Fit) -> Fit {
        for reach in waves::REACHES_FROM_RUN {
            if self.leaves_no_structure(&fit) {
                break;
            }
            let place = fit.model.file.effects.len() - 1;
            let again = waves::joint_fit_from_run(self.whitened, &fit, self.nominal, place, reach);
            let other = again.and_then(|model| levenberg::fit(self.whitened, model, WAVE_STEPS));
            fit = other.filter(|other| other.cost < fit.cost).unwrap_or(fit);
        }
        fit
    }

    /// Which of two explanations to prefer: the better one, or the one with fewer parameters if it is as good.
    pub(super) fn prefers(&self, one: &Fit, other: &Fit, calibrated: &Fit, threshold: f64) -> bool {
        let score =
            |fit: &Fit| validation::squared_residual(self.unseen, &fit.model).map_or(f64::INFINITY, |unseen| fit.cost + unseen);
        let (a, b) = (score(one), score(other));
        let (best, least) = if a < b { (one, a) } else { (other, b) };
        let tie = self.tie(best, score(calibrated) - least, least, threshold);
        let (few, many) = (count(&one.model), count(&other.model));
        if (a - b).abs() <= tie && few != many { few < many } else { a < b }
    }

    /// The candidate to accept: it must gain enough on training records and must not be worse on unseen ones. If several are equal (noise alone can
    /// make the difference of one parameter), an effect is preferred to an error of the plant file.
    pub(super) fn winner<'c>(&self, fit: &Fit, candidates: &'c [Candidate], threshold: f64) -> Option<&'c Candidate> {
        let unseen = validation::squared_residual(self.unseen, &fit.model)?;
        let before = fit.cost + unseen;
        let least = self.deciding_difference(fit, threshold);
        let least_unseen = effect_size::least_gain(unseen, self.unseen.rows());
        let pays = |it: &&Candidate| {
            fit.cost - it.fit.cost > least
                && (self.unseen.records.is_empty() || it.unseen < unseen && unseen - it.unseen > least_unseen)
        };
        let paying: Vec<&Candidate> = candidates.iter().filter(pays).collect();
        let best = paying.iter().min_by(|a, b| a.score.total_cmp(&b.score))?;
        let enough = best.score + self.tie(&best.fit, before - best.score, best.score, threshold);
        let simple: Vec<&Candidate> = paying.into_iter().filter(|it| it.score <= enough).collect();
        let first = simple.iter().copied().min_by(|a, b| a.numbers.cmp(&b.numbers).then(a.score.total_cmp(&b.score)))?;
        let equal =
            simple.into_iter().filter(|it| it.numbers == first.numbers && it.score <= first.score + best_gain_by_chance(1, 1));
        equal.min_by(|a, b| a.is_parameter_error().cmp(&b.is_parameter_error()).then(a.score.total_cmp(&b.score)))
    }

    /// How much worse a simpler explanation may be than the best one and still be preferred: the gain by chance or, if the best one leaves structure,
    /// as much as that structure, limited to a small share of the gain. A better explanation that removes more than half of the simpler one's
    /// residual is always preferred.
    pub(super) fn tie(&self, best: &Fit, gain: f64, score: f64, threshold: f64) -> f64 {
        let rows = self.whitened.rows() + self.unseen.rows();
        let left = whiteness::test(self.whitened, best).excess * rows as f64;
        threshold.max(effect_size::tie(left.min((1.0 - effect_size::AS_GOOD) * gain), score, rows))
    }
}

impl Candidate {
    /// Takes a better fit of the same cause.
    pub(super) fn replace_fit(&mut self, found: Candidate) {
        *self = Candidate { aliases_not_fitted: std::mem::take(&mut self.aliases_not_fitted), ..found };
    }

    /// Whether it says that a parameter of the plant file is wrong. The author of the file knew such a parameter within its tolerance. Effects that
    /// the file does not contain (wind, a slope, a dragging brake) were never measured.
    fn is_parameter_error(&self) -> bool {
        let last = self.fit.model.file.effects.last();
        last.is_some_and(|entry| entry.description.subject == rsm_sim::effect::Subject::Parameter)
    }
}

/// The number of parameters of all causes of a model.
#[must_use]
pub fn count(model: &Model) -> usize {
    model.file.effects.iter().map(|entry| entry.arguments.numbers.len()).sum()
}

/// Whether a real machine can have the numbers together, as the file of the effect says.
#[must_use]
pub fn is_physical(entry: &Entry) -> bool {
    entry.variants().iter().all(|it| it.description.declared.possible.of(&it.arguments))
}

/// Whether a parameter error is within the range of calibration, in each configuration in which it acts: two standard deviations of its tolerance.
#[must_use]
pub fn within_tolerance(nominal: &Model, entry: &Entry) -> bool {
    entry.variants().iter().all(|it| is_within_tolerance(nominal, it))
}

fn is_within_tolerance(nominal: &Model, entry: &Entry) -> bool {
    let Some(subject) = entry.arguments.subject.as_deref() else { return false };
    let Some((_, tolerance)) = nominal.file.tolerance.iter().find(|(name, _)| *name == subject) else { return false };
    let (Some(value), Some(nominal)) = (entry.arguments.optional("value"), nominal.file.parameters.optional(subject)) else {
        return false;
    };
    (value - nominal).abs() <= 2.0 * tolerance * nominal.abs()
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, survey};
    use super::*;
    use rsm_sim::effect::Arguments;
    use rsm_sim::equation_plant::{effect, pmac};

    /// An axis with this friction and further effects; the friction that a search evaluates as its only cause, where its plausible range ends at a
    /// hundredth of it.
    fn evaluated_far_from_its_guess(force: f64, further: &str) -> Option<Candidate> {
        let file = |effects: &str| axis_under_steps::file("mass = 0.02\nviscous_friction = 0.02", effects);
        let truth = file(&format!("{}{further}", axis_under_steps::friction(force)));
        let (whitened, nominal) = axis_under_steps::whitened(&file(""), &truth, true);
        let calibrated = levenberg::fit(&whitened, nominal.clone(), 8).unwrap();
        let mut survey = survey::survey(&whitened, &calibrated);
        let sizes = survey.scales.iter_mut().flat_map(|it| &mut it.sizes);
        sizes.filter(|it| it.0 == "effort_scale").for_each(|it| it.1 = force * 1e-4 / 0.2);
        let search = axis_under_steps::search(&whitened, &whitened, &nominal, &[], &survey);
        let friction = file(&axis_under_steps::friction(0.5 * force)).effects.remove(0);
        assert!(!search.is_plausible(&friction));
        search.fitted(&calibrated, &friction)
    }

    #[test]
    fn a_number_far_from_its_guess_is_refused_if_structure_is_left_or_none_was_there() {
        let found = evaluated_far_from_its_guess(0.8, "").expect("it explains the records");
        let force = found.fit.model.file.effects[0].arguments.numbers[0].1;
        assert!((force - 0.8).abs() < 0.02, "{force}");
        // An error that a friction does not explain.
        let delayed = "[[effects]]\nkind = \"input-delay\"\nparameters = { delay = 0.003 }\n";
        assert!(evaluated_far_from_its_guess(0.8, delayed).is_none());
        // As large as what noise alone may ask for.
        assert!(evaluated_far_from_its_guess(1e-4, "").is_none());
    }

    #[test]
    fn friction_that_falls_towards_rest_or_is_gone_at_speed_is_not_physical() {
        let entry = |coulomb: f64, rest: f64| Entry {
            description: effect(pmac(), "stribeck-friction").unwrap(),
            arguments: Arguments {
                plant: pmac(),
                subject: None,
                numbers: vec![("coulomb", coulomb), ("static", rest), ("stribeck_velocity", 5.0)],
            },
        };
        assert!(is_physical(&entry(0.1, 0.2)) && !is_physical(&entry(0.2, 0.1)) && !is_physical(&entry(0.0, 0.2)));
    }
}

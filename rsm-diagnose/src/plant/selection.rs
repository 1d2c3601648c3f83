//! The selection of causes: a cause is added while it is significant, and removed if it is no longer significant. `exchange` then tests its rivals.
//!
//! In: whitened residuals, the calibrated plant, hypotheses. Out: the causes, with the rivals of each. Null simulations and the smallest effect size
//! give the gain that a cause needs. In a tie the simpler cause wins. Validation records take part in decisions; only numbers on
//! which no training row depends are fitted to them (`open_numbers.rs`).

use super::all_rows::AllRows;
use super::candidates::{Candidate, count, within_tolerance};
use super::final_test::Refusal;
use super::hypotheses::{Hypothesis, labels};
use super::known_loop::KnownLoop;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::more_rows::FitToMoreRows;
use super::nuisance::Nuisance;
use super::refined_guesses::{best_guesses, form_of, leading};
use super::screen::{Pair, Screened, null, pairs, screen};
use super::search::{AcceptedCause, Ended, Search, WorkLimits};
use super::search_history::{Limit, SearchHistory};
use super::variable_projection::project;
use super::{waves, whiteness};
use crate::engine::significance::best_gain_by_chance;
use rsm_core::order;
use rsm_sim::effect::Subject;
use rsm_sim::plant_file::Entry;

/// A cause must remove this share of the noise energy. For one output with 24,000 residuals that is 36 squared standard deviations, less than a tenth
/// of a per cent of its r.m.s. error. Smaller effects may be real, but are not worth reporting.
const LEAST_EFFECT: f64 = 0.0015;

/// The number of guesses of each hypothesis used in pairs.
const PAIR_GUESSES: usize = 2;

/// The number of draws of the null simulation: 60 give the mean of the largest gain to an eighth of its standard deviation, and that to a tenth.
const DRAWS: usize = 60;

/// The outcome of a selection.
#[derive(Debug, Clone)]
pub struct Selection {
    /// The calibrated plant without causes.
    pub calibrated: Fit,
    /// The plant with all causes.
    pub fit: Fit,
    /// The causes, in the order of the effects of the fit.
    pub causes: Vec<AcceptedCause>,
    /// Causes that were accepted for a time and rejected at the end.
    pub refused: Vec<Refusal>,
    /// The gain that a cause needs.
    pub threshold: f64,
    /// The gains that the screen of the calibrated plant predicted, by hypothesis, the best first.
    pub ranking: Vec<(String, f64)>,
    /// The gains that the last screen predicted, with the causes that had been added by then.
    pub remaining: Vec<(String, f64)>,
    /// The work limit that stopped the search, if any.
    pub stopped: Option<Limit>,
    /// The check of the sensors by a known control law, independent of the search.
    pub known_loop: Option<KnownLoop>,
    /// The check of the result on all rows of records that are too long for the search.
    pub all_rows: Option<AllRows>,
    /// The plant with its numbers fitted to more rows, if the search used only a part of them.
    pub numbers: Option<FitToMoreRows>,
}

impl Selection {
    /// The fit with the numbers of the answer.
    #[must_use]
    pub fn final_fit(&self) -> &Fit {
        self.numbers.as_ref().map_or(&self.fit, |it| &it.fit)
    }
}

impl Search<'_> {
    /// Searches from the calibrated plant, to the end.
    #[must_use]
    pub fn run(&self, calibrated: Fit) -> Selection {
        let whole = Search { limits: WorkLimits { one_cause: false, ..self.limits }, ..*self };
        whole.run_until(calibrated, None, &|_| false).unwrap_or_else(|_| unreachable!("nothing ends this search early"))
    }

    /// Searches from the calibrated plant, or from fitted causes that are known beforehand. They may be exchanged and removed like all others.
    ///
    /// # Errors
    /// The reason: `noise_is_wrong` holds for the fit of a first cause that leaves only noise, or the search is for one cause.
    pub fn run_until(
        &self,
        calibrated: Fit,
        seed: Option<Fit>,
        noise_is_wrong: &dyn Fn(&Fit) -> bool,
    ) -> Result<Selection, Ended> {
        (self.progress)("screening the catalogue");
        let mut screened = screen(self.whitened, &calibrated, self.nominal, self.hypotheses);
        let least_effect = LEAST_EFFECT * calibrated.residual.len() as f64;
        let guesses = screened.len() + self.further_guesses;
        let numbers = screened.iter().map(|it| form_of(it).1).max().unwrap_or(1);
        let threshold = null(self.whitened, &calibrated, &screened, self.rounded, DRAWS)
            .max(best_gain_by_chance(guesses, numbers))
            .max(least_effect);
        let strongest = best_guesses(&screened, PAIR_GUESSES);
        let strongest = leading(strongest, self.limits.profiled, PAIR_GUESSES, |it| form_of(it));
        let pairs = pairs(&calibrated, self.hypotheses, &strongest);
        screened.iter_mut().for_each(Screened::without_traces);
        let ranking = self.ranking(&screened);
        let mut remaining = ranking.clone();
        let until = self.whitened.work.done() + self.limits.work;
        let mut path = SearchHistory::until(until, self.limits.work_for_rivals);
        self.whitened.work.set_limit(until);
        let mut competed: Vec<(String, Vec<Candidate>)> = Vec::new();
        let first = seed.as_ref().map_or(Some(screened), |_| None);
        let begin = seed.unwrap_or_else(|| calibrated.clone());
        path.visit(labels(&begin.model));
        let one = Search { limits: WorkLimits { causes: begin.model.file.effects.len() + 1, ..self.limits }, ..*self };
        let mut stages = one.forward_selection(begin.clone(), first, threshold, &mut competed, &mut remaining, &mut path);
        if let Some(one) = stages.last().cloned() {
            if self.leaves_noise(&one, threshold) && noise_is_wrong(&one) {
                return Err(Ended::WrongNoise(Box::new(one)));
            }
            if path.stopped().is_none() {
                stages.extend(self.forward_selection(one, None, threshold, &mut competed, &mut remaining, &mut path));
            }
        }
        let mut fit = stages.last().cloned().unwrap_or(begin);
        let alone = fit.model.file.effects.len() <= 1 && self.leaves_noise(&fit, threshold);
        if self.limits.one_cause && !alone {
            return Err(Ended::SeveralCauses);
        }
        let most = if alone { count(&fit.model) } else { usize::MAX };
        if most > 2 {
            // If one cause is not sufficient, or has more parameters than two causes together, a pair is tried. Two causes that mask each other may
            // mislead a search for single causes.
            let two = stages.iter().position(|it| it.model.file.effects.len() == 2).map(|place| stages.swap_remove(place));
            let against = two.unwrap_or_else(|| fit.clone());
            if let Some(pair) = self.best_pair(&calibrated, &pairs, most, threshold, &mut path)
                && self.prefers(&pair, &against, &calibrated, threshold)
                && path.visit(labels(&pair.model))
            {
                (self.progress)(&format!("found {}", labels(&pair.model).join(" with ")));
                let mut after = remaining.clone();
                let grown = self
                    .forward_selection(pair.clone(), None, threshold, &mut competed, &mut after, &mut path)
                    .pop()
                    .unwrap_or(pair);
                if self.prefers(&grown, &fit, &calibrated, threshold) {
                    (fit, remaining) = (grown, after);
                }
            }
        }
        if !self.leaves_noise(&fit, threshold)
            && let Some(from_equations) =
                self.equation_error_sets(&calibrated).last().filter(|it| path.visit(labels(&it.model)))
        {
            (self.progress)("continuing from the errors of the equations");
            let mut after = remaining.clone();
            let from = self.forward_selection(from_equations.clone(), None, threshold, &mut competed, &mut after, &mut path);
            let from = from.into_iter().next_back().unwrap_or_else(|| from_equations.clone());
            if self.prefers(&from, &fit, &calibrated, threshold) {
                (fit, remaining) = (from, after);
            }
        }
        let fit = self.split(self.narrowed(self.levelled(fit), threshold));
        let fit = self.by_configuration(fit, threshold, true);
        self.whitened.work.set_limit(until + self.limits.work_for_rivals);
        let fit = self.merged(fit, threshold, &mut path);
        let (fit, causes) = self.exchanged(&calibrated, fit, &competed, threshold, &mut path);
        let (fit, causes, refused) = self.without_rejected(&calibrated, fit, causes, threshold);
        let stopped = path.stopped();
        if let Some(limit) = stopped {
            (self.progress)(&format!("the search stopped {limit}"));
        }
        Ok(Selection {
            calibrated,
            fit,
            causes,
            refused,
            threshold,
            ranking,
            remaining,
            stopped,
            known_loop: None,
            all_rows: None,
            numbers: None,
        })
    }

    /// Adds causes one at a time while they gain enough. Returns the fit after each addition; empty if none gains enough.
    fn forward_selection(
        &self,
        mut fit: Fit,
        mut screened: Option<Vec<Screened>>,
        threshold: f64,
        competed: &mut Vec<(String, Vec<Candidate>)>,
        remaining: &mut Vec<(String, f64)>,
        path: &mut SearchHistory,
    ) -> Vec<Fit> {
        let mut stages = Vec::new();
        while fit.model.file.effects.len() < self.limits.causes && self.has_work_left(path) && path.may_compete() {
            let screened = screened.take().unwrap_or_else(|| {
                let mut screened = screen(self.whitened, &fit, self.nominal, self.hypotheses);
                screened.iter_mut().for_each(Screened::without_traces);
                screened
            });
            *remaining = self.ranking(&screened);
            let mut candidates = self.fit_candidates(&fit, &screened, threshold);
            self.add_equation_error_cause(&fit, &mut candidates, threshold);
            if !self.winner(&fit, &candidates, threshold).is_some_and(|it| self.leaves_noise(&it.fit, threshold)) {
                self.add_from_first_horizon(&fit, &mut candidates, threshold);
                self.add_other_places(&fit, &mut candidates, threshold);
            }
            self.keep_plausible(&mut candidates);
            let Some(winner) = self.winner(&fit, &candidates, threshold) else { break };
            if !path.may_add() {
                break;
            }
            (self.progress)(&format!("found {}", winner.label));
            let name = winner.label.clone();
            fit = self.backward_elimination(winner.fit.clone(), threshold);
            fit = self.by_configuration(fit, threshold, false);
            competed.push((name, candidates));
            stages.push(fit.clone());
            // Another way to causes that leave only noise confirms them.
            let causes = labels(&fit.model);
            let is_new = if self.leaves_noise(&fit, threshold) { path.visit(causes) } else { path.visit_once(causes) };
            if !is_new {
                break;
            }
        }
        stages
    }

    /// A single cause from the equation errors competes with the other candidates for the first place.
    fn add_equation_error_cause(&self, fit: &Fit, candidates: &mut Vec<Candidate>, threshold: f64) {
        let alone =
            self.equation_error_fits.first().filter(|it| it.model.file.effects.len() == 1 && fit.model.file.effects.is_empty());
        let Some(mut from_equations) = alone.and_then(|it| self.evaluated(fit, it.clone())) else { return };
        self.separate_numbers(fit, &mut from_equations, threshold);
        compete(candidates, from_equations);
        order::ascending(candidates, |it| it.score);
    }

    /// If the best candidate leaves structure, its effect at other places competes. Where it changes the motion much, a guess of the catalogue is too
    /// far off for a fit, so each fit begins with the numbers that were found at the first place.
    fn add_other_places(&self, fit: &Fit, candidates: &mut Vec<Candidate>, threshold: f64) {
        let Some(best) = self.winner(fit, candidates, threshold).filter(|it| !self.leaves_noise(&it.fit, threshold)) else {
            return;
        };
        let Some(entry) = best.fit.model.file.effects.last().filter(|it| it.description.subject == Subject::Site) else {
            return;
        };
        let number = |name: &str| entry.arguments.numbers.iter().find(|it| it.0 == name).map_or(f64::NAN, |it| it.1);
        let elsewhere = |it: &&Hypothesis| {
            let is_free = !fit.model.file.effects.iter().any(|there| it.describes(there));
            it.description.kind == entry.description.kind && it.configuration.is_none() && !it.describes(entry) && is_free
        };
        let there = self.hypotheses.iter().filter(elsewhere).map(|it| {
            let values: Vec<f64> = it.description.arguments.iter().map(|argument| number(argument.name)).collect();
            it.entry(fit.model.file.kind, &values)
        });
        let fitted = self.side_by_side(&there.collect::<Vec<Entry>>(), |search, entry| search.fitted(fit, entry));
        fitted.into_iter().flatten().for_each(|it| compete(candidates, it));
        order::ascending(candidates, |it| it.score);
    }

    /// Sets of several causes from the equation errors, as starting points without other causes, if each cause is allowed; the smallest sets first.
    fn equation_error_sets(&self, fit: &Fit) -> impl Iterator<Item = &Fit> {
        let none = fit.model.file.effects.is_empty();
        let sound = |it: &Entry| {
            !within_tolerance(self.nominal, it) && self.is_plausible(it) && waves::has_whole_period(self.whitened, it)
        };
        self.equation_error_fits.iter().filter(move |it| {
            let effects = &it.model.file.effects;
            none && effects.len() > 1 && effects.iter().all(sound)
        })
    }

    /// Whether the work limit allows one more competition or pair.
    fn has_work_left(&self, path: &mut SearchHistory) -> bool {
        path.has_work_left(self.whitened.work.done())
    }

    /// Whether the residual of a fit is noise, so that no further cause can gain enough.
    fn leaves_noise(&self, fit: &Fit, threshold: f64) -> bool {
        whiteness::test(self.whitened, fit).excess * fit.residual.len() as f64 <= threshold
    }

    /// The best of the most promising pairs, fitted in full; only pairs with fewer than `most` parameters.
    fn best_pair(
        &self,
        calibrated: &Fit,
        pairs: &[Pair],
        most: usize,
        threshold: f64,
        path: &mut SearchHistory,
    ) -> Option<Fit> {
        let nuisance = Nuisance::new(calibrated);
        let kind = calibrated.model.file.kind;
        let mut tried: Vec<(Vec<String>, Model)> = Vec::new();
        for pair in pairs {
            if tried.len() == self.limits.fitted || !self.has_work_left(path) {
                break;
            }
            let mut model = calibrated.model.clone();
            for (which, values) in &pair.parts {
                model = model.with_cause(self.nominal, self.hypotheses[*which].entry(kind, values));
            }
            let mut names = labels(&model);
            names.sort_unstable();
            let is_known = path.has_visited(&names) || tried.iter().any(|it| it.0 == names);
            if count(&model) < most && !is_known && model.is_possible() {
                tried.push((names, model));
            }
        }
        let fitted = self.side_by_side(&tried, |search, (names, model)| {
            (self.progress)(&format!("fitting {}", names.join(" with ")));
            let (model, _) = project(search.whitened, &nuisance, model.clone(), 0, self.limits.profile_steps)?;
            let fit = levenberg::refit(search.whitened, model, self.limits.fit_steps, Some(calibrated))?;
            let sound = |it: &Entry| {
                !within_tolerance(self.nominal, it) && self.is_plausible(it) && waves::has_whole_period(self.whitened, it)
            };
            fit.model.file.effects.iter().all(sound).then_some(fit)
        });
        let better = |best: Fit, fit: Fit| if self.prefers(&fit, &best, calibrated, threshold) { fit } else { best };
        fitted.into_iter().flatten().reduce(better)
    }

    fn ranking(&self, screened: &[Screened]) -> Vec<(String, f64)> {
        let mut list: Vec<(String, f64)> = Vec::new();
        for it in best_guesses(screened, 1) {
            list.push((self.hypotheses[it.hypothesis].label(), it.gain));
        }
        list
    }

    /// Removes causes that no longer gain enough.
    pub(super) fn backward_elimination(&self, mut fit: Fit, threshold: f64) -> Fit {
        'again: loop {
            let count = fit.model.file.effects.len();
            // The last one has just gained enough.
            for place in 0..count.saturating_sub(1) {
                let without = fit.model.without_cause(self.nominal, place);
                if let Some(other) = levenberg::refit(self.whitened, without, self.limits.fit_steps, Some(&fit))
                    && other.cost - fit.cost < self.deciding_difference(&fit, threshold)
                {
                    fit = other;
                    continue 'again;
                }
            }
            return fit;
        }
    }
}

/// Adds a candidate to a competition, or replaces a worse fit of the same cause.
fn compete(candidates: &mut Vec<Candidate>, found: Candidate) {
    match candidates.iter_mut().find(|it| it.label == found.label) {
        Some(known) if found.score < known.score => known.replace_fit(found),
        Some(_) => {}
        None => candidates.push(found),
    }
}

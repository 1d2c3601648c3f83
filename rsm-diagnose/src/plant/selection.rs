//! The selection of causes: a cause is added while it is significant, exchanged if another one fits better, and removed if it is no longer
//! significant.
//!
//! In: whitened residuals, the calibrated plant, hypotheses. Out: the causes, with the rivals of each. Null simulations and the smallest effect size
//! give the gain that a cause needs. In a tie the simpler cause wins. Validation records take part in decisions; only numbers on
//! which no training row depends are fitted to them (`open_numbers.rs`).

use super::all_rows::AllRows;
use super::candidates::{Candidate, best_guesses, count, form_of, leading, within_tolerance};
use super::final_test::Refusal;
use super::hypotheses::label_of;
use super::known_loop::KnownLoop;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::more_rows::FitToMoreRows;
use super::nuisance::Nuisance;
use super::screen::{Pair, Screened, null, pairs, screen};
use super::search::{AcceptedCause, Ended, Search, WorkLimits};
use super::search_history::{Limit, SearchHistory};
use super::variable_projection::project;
use super::{waves, whiteness};
use crate::engine::significance::best_gain_by_chance;
use rsm_core::order;
use rsm_sim::plant_file::Entry;

/// A cause must remove this share of the noise energy. For one output with 24,000 residuals that is 36 squared standard deviations, less than a tenth
/// of a per cent of its r.m.s. error. Smaller effects may be real, but are not worth reporting.
const LEAST_EFFECT: f64 = 0.0015;

/// The number of guesses of each hypothesis used in pairs.
const PAIR_GUESSES: usize = 2;

/// A single cause may replace two if its predicted gain is at least this share of their joint gain, because the first order sees most of it.
const LEAST_SHARE_OF_PAIR: f64 = 0.8;

/// The number of hypotheses tried in place of two causes.
const MOST_MERGE_TRIALS: usize = 2;

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
            if !path.visit(labels(&fit.model)) {
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
        match candidates.iter_mut().find(|it| it.label == from_equations.label) {
            Some(known) if from_equations.score < known.score => {
                *known = Candidate { aliases_not_fitted: std::mem::take(&mut known.aliases_not_fitted), ..from_equations }
            }
            Some(_) => {}
            None => candidates.push(from_equations),
        }
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
    fn backward_elimination(&self, mut fit: Fit, threshold: f64) -> Fit {
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

    /// Tests the rivals of each cause. A better rival replaces the cause; an equal one is listed as its rival.
    fn exchanged(
        &self,
        calibrated: &Fit,
        mut fit: Fit,
        competed: &[(String, Vec<Candidate>)],
        threshold: f64,
        path: &mut SearchHistory,
    ) -> (Fit, Vec<AcceptedCause>) {
        let mut drops = 0;
        'again: loop {
            let mut causes = Vec::new();
            let entries = fit.model.file.effects.clone();
            for (place, entry) in entries.iter().enumerate() {
                let name = label_of(entry);
                let (base, rivals_tested) = if entries.len() == 1 {
                    // The first competition was for the place of a single cause, so its result can be used again.
                    let known = competed.first().filter(|(_, list)| list.iter().all(|it| it.fit.model.file.effects.len() == 1));
                    match known {
                        Some((_, list)) => (calibrated.clone(), Some(list.clone())),
                        None => (calibrated.clone(), self.new_candidates(calibrated, threshold, path)),
                    }
                } else {
                    (self.progress)(&format!("testing alternatives to {name}"));
                    let without = fit.model.without_cause(self.nominal, place);
                    let Some(base) = levenberg::refit(self.whitened, without, self.limits.fit_steps, Some(&fit)) else {
                        continue;
                    };
                    if base.cost - fit.cost < self.deciding_difference(&fit, threshold) && drops < self.limits.causes {
                        // The cause gained enough only while the others were not yet fitted well.
                        fit = base;
                        drops += 1;
                        continue 'again;
                    }
                    let rivals_tested = self.new_candidates(&base, threshold, path);
                    (base, rivals_tested)
                };
                let (rivals_tested, candidates) = (rivals_tested.is_some(), rivals_tested.unwrap_or_default());
                let least = self.deciding_difference(&fit, threshold);
                let simpler = |it: &Candidate| it.numbers < entry.arguments.numbers.len() && it.fit.cost < fit.cost + least;
                if let Some(winner) = self.winner(&base, &candidates, threshold)
                    && winner.label != name
                    && (winner.fit.cost < fit.cost - least || simpler(winner))
                    && path.may_exchange()
                {
                    let other = self.backward_elimination(winner.fit.clone(), threshold);
                    if path.visit(labels(&other.model)) {
                        (self.progress)(&format!("{} in place of {name}", winner.label));
                        fit = other;
                        continue 'again;
                    }
                }
                let mut rivals: Vec<(String, f64, Model)> = candidates
                    .iter()
                    .filter(|it| it.label != name)
                    .map(|it| (it.label.clone(), it.fit.cost - fit.cost, it.fit.model.clone()))
                    .collect();
                order::ascending(&mut rivals, |it| it.1);
                let mut alike =
                    candidates.iter().find(|it| it.label == name).map_or_else(Vec::new, |it| it.aliases_not_fitted.clone());
                if !rivals_tested {
                    // Even at the work limit, the answer lists the hypotheses with the same trace.
                    alike = self.aliases_of(&base, entry, least);
                }
                causes.push(AcceptedCause {
                    label: name,
                    aliases_not_fitted: alike,
                    gain: base.cost - fit.cost,
                    rivals_tested,
                    rival_models: rivals.iter().map(|it| (it.0.clone(), it.2.clone())).collect(),
                    rivals: rivals.into_iter().map(|it| (it.0, it.1)).collect(),
                    without: base.model,
                });
            }
            return (fit, causes);
        }
    }

    /// Two of three or more causes may be one cause in another form: if all forces of an axis are wrong by the same factor, the mass is wrong. Tries
    /// one hypothesis in place of any two, and keeps it if it fits as well.
    fn merged(&self, mut fit: Fit, threshold: f64, path: &mut SearchHistory) -> Fit {
        'again: loop {
            let count = fit.model.file.effects.len();
            if count < 3 {
                return fit;
            }
            for (a, b) in (1..count).flat_map(|b| (0..b).map(move |a| (a, b))) {
                if !path.has_work_left_for_rivals(self.whitened.work.done()) {
                    return fit;
                }
                let without = fit.model.without_cause(self.nominal, b).without_cause(self.nominal, a);
                let Some(base) = levenberg::refit(self.whitened, without, self.limits.fit_steps, Some(&fit)) else { continue };
                let screened = screen(self.whitened, &base, self.nominal, self.hypotheses);
                // A hypothesis is tried if its predicted gain is a sufficient share of the joint gain of the two causes.
                let promising =
                    best_guesses(&screened, 1).into_iter().filter(|it| it.gain > LEAST_SHARE_OF_PAIR * (base.cost - fit.cost));
                let promising: Vec<Entry> = promising
                    .take(MOST_MERGE_TRIALS)
                    .map(|it| self.hypotheses[it.hypothesis].entry(fit.model.file.kind, &it.values))
                    .collect();
                for entry in promising {
                    let enough = fit.cost + self.deciding_difference(&fit, threshold);
                    let Some(one) = self.fitted(&base, &entry).filter(|it| it.fit.cost < enough) else { continue };
                    if count_of(&one.fit) <= count_of(&fit) && path.visit(labels(&one.fit.model)) {
                        (self.progress)(&format!("{} in place of two", one.label));
                        fit = one.fit;
                        continue 'again;
                    }
                }
            }
            return fit;
        }
    }

    /// Hypotheses whose trace on a plant without the cause is the same, and whose predicted gain is as large, up to the deciding difference.
    fn aliases_of(&self, base: &Fit, entry: &Entry, least: f64) -> Vec<String> {
        let screened = screen(self.whitened, base, self.nominal, self.hypotheses);
        let best = best_guesses(&screened, 1);
        let Some(own) = best.iter().find(|it| self.hypotheses[it.hypothesis].describes(entry) && it.group.is_some()) else {
            return Vec::new();
        };
        let mut labels: Vec<String> = Vec::new();
        for it in best.iter().filter(|it| it.group == own.group && it.gain > own.gain - least) {
            let label = self.hypotheses[it.hypothesis].label();
            if it.hypothesis != own.hypothesis && !labels.contains(&label) {
                labels.push(label);
            }
        }
        labels
    }

    /// The candidates for a place; `None` after the work limit is reached.
    fn new_candidates(&self, base: &Fit, threshold: f64, path: &mut SearchHistory) -> Option<Vec<Candidate>> {
        if !path.has_work_left_for_rivals(self.whitened.work.done()) || !path.may_compete() {
            return None;
        }
        let mut screened = screen(self.whitened, base, self.nominal, self.hypotheses);
        screened.iter_mut().for_each(Screened::without_traces);
        Some(self.fit_candidates(base, &screened, threshold))
    }
}

/// The number of parameters of all causes of a fit.
fn count_of(fit: &Fit) -> usize {
    count(&fit.model)
}

/// The names of a model's causes.
fn labels(model: &Model) -> Vec<String> {
    let entries = model.file.effects.iter();
    entries.map(label_of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::whitened_residuals::WhitenedResiduals;
    use super::super::{axis_under_steps, hypotheses, survey};
    use super::*;

    #[test]
    fn a_cause_about_which_no_rival_was_asked_lists_what_leaves_its_trace() {
        // From rest and in open loop the gain of the command, the force per volt and the gain of the position are one thing.
        let gain = "[[effects]]\nkind = \"input-gain\"\nparameters = { gain = 0.9 }\n";
        let file = |effects: &str| axis_under_steps::file("viscous_friction = 0.02", effects);
        let (whitened, nominal) = axis_under_steps::whitened(&file(""), &file(gain), true);
        let calibrated = levenberg::fit(&whitened, nominal.clone(), 8).unwrap();
        let survey = survey::survey(&whitened, &calibrated);
        let all = hypotheses::all(nominal.file.kind, &survey, &[0]);
        let unseen = WhitenedResiduals::new(Vec::new(), whitened.floors, 1);
        let search = axis_under_steps::search(&whitened, &unseen, &nominal, &all, &survey);
        let fit = levenberg::fit(&whitened, nominal.with_effects(&nominal, file(gain).effects), 20).unwrap();
        // All work is spent.
        let mut path = SearchHistory::until(0, 0);
        let (_, causes) = search.exchanged(&calibrated, fit, &[], 30.0, &mut path);
        assert!(!causes[0].rivals_tested && path.stopped() == Some(Limit::Work));
        for name in ["parameter-error:force_gain", "sensor-gain:position"] {
            assert!(causes[0].aliases_not_fitted.iter().any(|it| it == name), "{name}: {:?}", causes[0].aliases_not_fitted);
        }
        assert!(!causes[0].aliases_not_fitted.iter().any(|it| it.contains("friction")), "{:?}", causes[0].aliases_not_fitted);
    }
}

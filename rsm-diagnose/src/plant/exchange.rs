//! The exchange of accepted causes for better ones: rivals of each, and one cause in place of two.
//!
//! In: a fit with causes, and the candidates that competed for their places. Out: the fit, perhaps with other causes, and each cause with its rivals.
//! Adds no cause.

use rsm_core::order;
use rsm_sim::plant_file::Entry;

use super::candidates::{Candidate, count};
use super::hypotheses::{label_of, labels};
use super::levenberg::{self, Fit};
use super::model::Model;
use super::refined_guesses::best_guesses;
use super::screen::{Screened, screen};
use super::search::{AcceptedCause, Search};
use super::search_history::SearchHistory;

/// A single cause may replace two if its predicted gain is at least this share of their joint gain, because the first order sees most of it.
const LEAST_SHARE_OF_PAIR: f64 = 0.8;

/// The number of hypotheses tried in place of two causes.
const MOST_MERGE_TRIALS: usize = 2;

impl Search<'_> {
    /// Tests the rivals of each cause. A better rival replaces the cause; an equal one is listed as its rival.
    pub(super) fn exchanged(
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
                    if path.visit_once(labels(&other.model)) {
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
    pub(super) fn merged(&self, mut fit: Fit, threshold: f64, path: &mut SearchHistory) -> Fit {
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

#[cfg(test)]
mod tests {
    use super::super::search_history::Limit;
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

//! Which causes: added while they pay, exchanged where another does better, removed when they no longer do.
//!
//! In: a kernel, the calibrated plant, hypotheses. Out: the causes with what competed against each. What a cause must gain comes from null simulations and
//! from what is worth naming; ties go to the simpler cause. Never looks at validation records to fit, only to judge.

use super::chance::best_of;
use super::hypotheses::{Hypothesis, label};
use super::kernel::Kernel;
use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::profile::{Profiled, profile};
use super::screen::{Screened, null, screen};
use super::{validation, worth};
use crate::plant_file::Entry;

/// How much work a stage may be. Counts, not seconds: the same records give the same answer on every machine.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Hypotheses whose own numbers are fitted.
    pub profiled: usize,
    /// Steps of those fits.
    pub profile_steps: usize,
    /// Hypotheses that are fitted together with everything else.
    pub fitted: usize,
    /// Steps of those fits.
    pub fit_steps: usize,
    /// Causes at most.
    pub causes: usize,
}

/// A cause must remove this share of the whitened noise's energy: with 24,000 residuals of one output that are 24 beyond the noise's own, a tenth of a per cent of
/// its r.m.s. error. What is smaller can be real and is not worth a sentence.
const WORTH: f64 = 0.0015;

/// Ties: a simpler cause wins when it reaches this share of the gain.
const AS_GOOD: f64 = 0.995;

/// Additions at most: all causes that an effort allows (four), and two that a removal undid.
const MOST_ADDITIONS: usize = 6;

/// Competitions at most, a competition being a screen with its profiles and fits: every addition, and twice the question what else could stand for each of four
/// causes, with two to spare. All other work lies between them, and each piece of it removes a cause.
const MOST_COMPETITIONS: usize = 16;

/// Exchanges of one cause for another at most; beyond, two causes are likely to take turns.
const MOST_EXCHANGES: usize = 3;

/// Draws of the null simulation: 60 know the mean of the largest gain to an eighth of its standard deviation, and that to a tenth.
const DRAWS: usize = 60;

/// A hypothesis after its full fit.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Its name in lists.
    pub label: String,
    /// The fit with it.
    pub fit: Fit,
    /// How many numbers it adds.
    pub numbers: usize,
    /// Squared residual of training and validation records together.
    pub score: f64,
    /// Squared residual on validation records.
    pub unseen: f64,
}

/// A cause that is believed.
#[derive(Debug, Clone)]
pub struct Believed {
    /// Its name in lists.
    pub label: String,
    /// How much worse the fit is without it.
    pub gain: f64,
    /// What competed, with how much worse it does: the best first.
    pub rivals: Vec<(String, f64)>,
    /// The rivals as models, for the next experiment.
    pub rival_models: Vec<(String, Model)>,
    /// The plant without it, everything else fitted again: what the evidence compares with.
    pub without: Model,
}

/// The outcome.
#[derive(Debug, Clone)]
pub struct Selection {
    /// The calibrated plant without causes.
    pub calibrated: Fit,
    /// The plant with all causes.
    pub fit: Fit,
    /// The causes, in the order of the effects of the fit.
    pub causes: Vec<Believed>,
    /// What a cause has to gain.
    pub threshold: f64,
    /// What the screen of the calibrated plant predicted, by hypothesis: the best first.
    pub ranking: Vec<(String, f64)>,
    /// What the last screen predicted, after the causes that had been added by then.
    pub remaining: Vec<(String, f64)>,
    /// The limit of work at which the search stopped before it was through.
    pub stopped: Option<Limit>,
}

/// What ends a search that would go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// Causes were added as often as is allowed.
    Additions,
    /// Competitions were held as often as is allowed.
    Competitions,
    /// Causes were exchanged as often as is allowed.
    Exchanges,
    /// A set of causes came back that had been left: it goes round in a circle.
    Circle,
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Limit::Additions => write!(f, "after {MOST_ADDITIONS} additions of a cause"),
            Limit::Competitions => write!(f, "after {MOST_COMPETITIONS} competitions between causes"),
            Limit::Exchanges => write!(f, "after {MOST_EXCHANGES} exchanges of a cause"),
            Limit::Circle => write!(f, "at a set of causes that it had been at before"),
        }
    }
}

/// What a search has done, so that it ends: sets of causes where it was, and counts against the limits.
#[derive(Debug, Default)]
pub struct Path {
    visited: Vec<Vec<String>>,
    additions: usize,
    competitions: usize,
    exchanges: usize,
    stopped: Option<Limit>,
}

impl Path {
    /// Goes to a set of causes; false where the search was there before. The order of causes is no difference.
    pub fn visit(&mut self, mut causes: Vec<String>) -> bool {
        causes.sort_unstable();
        if self.visited.contains(&causes) {
            return self.stop(Limit::Circle);
        }
        self.visited.push(causes);
        true
    }

    /// Whether one more addition is allowed; counts it.
    pub fn adds(&mut self) -> bool {
        self.additions += 1;
        self.additions <= MOST_ADDITIONS || self.stop(Limit::Additions)
    }

    /// Whether one more competition is allowed; counts it.
    pub fn competes(&mut self) -> bool {
        self.competitions += 1;
        self.competitions <= MOST_COMPETITIONS || self.stop(Limit::Competitions)
    }

    /// Whether one more exchange is allowed; counts it.
    pub fn exchanges(&mut self) -> bool {
        self.exchanges += 1;
        self.exchanges <= MOST_EXCHANGES || self.stop(Limit::Exchanges)
    }

    /// The first limit that was met.
    #[must_use]
    pub fn stopped(&self) -> Option<Limit> {
        self.stopped
    }

    fn stop(&mut self, limit: Limit) -> bool {
        self.stopped = self.stopped.or(Some(limit));
        false
    }
}

/// The search and what it needs.
pub struct Search<'a> {
    /// Training records.
    pub kernel: &'a Kernel,
    /// Validation records; may be empty.
    pub unseen: &'a Kernel,
    /// The nominal plant.
    pub nominal: &'a Model,
    /// The hypotheses.
    pub hypotheses: &'a [Hypothesis],
    /// How many more guesses were looked at before these were chosen.
    pub looks: usize,
    /// How much work.
    pub effort: Effort,
    /// Told what happens.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl Search<'_> {
    /// From the calibrated plant to causes.
    #[must_use]
    pub fn run(&self, calibrated: Fit) -> Selection {
        (self.progress)("screening the catalogue");
        let mut screened = screen(self.kernel, &calibrated, self.nominal, self.hypotheses);
        let worth = WORTH * calibrated.residual.len() as f64;
        let looks = screened.len() + self.looks;
        let numbers = screened.iter().map(|it| form_of(it).1).max().unwrap_or(1);
        let threshold = null(self.kernel, &calibrated, &screened, DRAWS).max(best_of(looks, numbers)).max(worth);
        screened.iter_mut().for_each(Screened::slim);
        let ranking = self.ranking(&screened);
        let mut fit = calibrated.clone();
        let mut path = Path::default();
        path.visit(labels(&fit.model));
        let mut competed: Vec<(String, Vec<Candidate>)> = Vec::new();
        while fit.model.file.effects.len() < self.effort.causes {
            if !path.competes() {
                break;
            }
            let candidates = self.compete(&fit, &screened, threshold);
            let Some(winner) = self.winner(&fit, &candidates, threshold) else { break };
            if !path.adds() {
                break;
            }
            (self.progress)(&format!("found {}", winner.label));
            let name = winner.label.clone();
            fit = winner.fit.clone();
            competed.push((name, candidates));
            fit = self.without_needless(fit, threshold);
            if !path.visit(labels(&fit.model)) || fit.model.file.effects.len() >= self.effort.causes {
                break;
            }
            screened = screen(self.kernel, &fit, self.nominal, self.hypotheses);
            screened.iter_mut().for_each(Screened::slim);
        }
        let remaining = self.ranking(&screened);
        let (fit, causes) = self.exchanged(&calibrated, fit, &competed, threshold, &mut path);
        let stopped = path.stopped();
        if let Some(limit) = stopped {
            (self.progress)(&format!("the search stopped {limit}"));
        }
        Selection { calibrated, fit, causes, threshold, ranking, remaining, stopped }
    }

    fn ranking(&self, screened: &[Screened]) -> Vec<(String, f64)> {
        let mut list: Vec<(String, f64)> = Vec::new();
        for it in self.best_guesses(screened, 1) {
            list.push((self.hypotheses[it.hypothesis].label(), it.gain));
        }
        list
    }

    /// The best guesses of each hypothesis, hypotheses by gain.
    fn best_guesses<'s>(&self, screened: &'s [Screened], each: usize) -> Vec<&'s Screened> {
        let mut order: Vec<&Screened> = screened.iter().collect();
        order.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut taken: Vec<(usize, usize)> = Vec::new();
        order.retain(|it| {
            let before = taken.iter().filter(|form| **form == form_of(it)).count();
            taken.push(form_of(it));
            before < each
        });
        order
    }

    /// Fits the best of the screen and judges them, the best first.
    fn compete(&self, fit: &Fit, screened: &[Screened], threshold: f64) -> Vec<Candidate> {
        let mut guesses = self.best_guesses(screened, 2);
        // What promises a third of what is needed may hold more: the screen sees the first order only.
        guesses.retain(|it| it.gain > 0.3 * threshold);
        guesses.truncate(2 * self.effort.profiled);
        let mut distinct: Vec<(usize, usize)> = Vec::new();
        let mut profiled: Vec<Profiled> = Vec::new();
        for it in guesses {
            if !distinct.contains(&form_of(it)) {
                if distinct.len() == self.effort.profiled {
                    continue;
                }
                distinct.push(form_of(it));
            }
            let steps = self.effort.profile_steps;
            profiled.extend(profile(self.kernel, fit, self.nominal, self.hypotheses, it.hypothesis, &it.values, steps));
        }
        profiled.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut fitted: Vec<(usize, usize)> = Vec::new();
        let mut candidates = Vec::new();
        for it in &profiled {
            let form = (it.hypothesis, it.entry.arguments.numbers.len());
            if fitted.contains(&form) || fitted.len() >= self.effort.fitted {
                continue;
            }
            fitted.push(form);
            (self.progress)(&format!("fitting {}", self.hypotheses[it.hypothesis].label()));
            candidates.extend(self.fitted(fit, &it.entry));
        }
        candidates.sort_by(|a, b| a.score.total_cmp(&b.score));
        candidates
    }

    fn fitted(&self, fit: &Fit, entry: &Entry) -> Option<Candidate> {
        let model = merged(&fit.model, self.nominal, entry);
        let fit = levenberg::onward(self.kernel, model, self.effort.fit_steps, Some(fit))?;
        let place = fit.model.file.effects.len() - 1;
        let entry = &fit.model.file.effects[place];
        if within_tolerance(self.nominal, entry) {
            return None;
        }
        let own = |unknown: &&super::model::Unknown| matches!(unknown.place, Place::Effect { entry, .. } if entry == place);
        // A whole number was chosen among many: it counts as much as one that was fitted.
        let numbers = fit.model.unknowns.iter().filter(own).count().max(entry.arguments.numbers.len());
        let unseen = validation::squared_residual(self.unseen, &fit.model)?;
        let label = label(entry.description.kind, entry.arguments.subject.as_deref());
        Some(Candidate { label, score: fit.cost + unseen, unseen, numbers, fit })
    }

    /// The candidate to believe, if any gains enough on training records and does no harm on unseen ones.
    fn winner<'c>(&self, fit: &Fit, candidates: &'c [Candidate], threshold: f64) -> Option<&'c Candidate> {
        let unseen = validation::squared_residual(self.unseen, &fit.model)?;
        let before = fit.cost + unseen;
        let least = threshold.max(worth::least(fit.cost, self.kernel.rows()));
        let least_unseen = worth::least(unseen, self.unseen.rows());
        let pays = |it: &&Candidate| {
            fit.cost - it.fit.cost > least
                && (self.unseen.records.is_empty() || it.unseen < unseen && unseen - it.unseen > least_unseen)
        };
        let best = candidates.iter().filter(pays).map(|it| it.score).fold(f64::INFINITY, f64::min);
        if !best.is_finite() {
            return None;
        }
        let tie = worth::tie((1.0 - AS_GOOD) * (before - best), best, self.kernel.rows() + self.unseen.rows());
        let enough = best + tie.max(threshold);
        let simple = candidates.iter().filter(pays).filter(|it| it.score <= enough);
        simple.min_by(|a, b| a.numbers.cmp(&b.numbers).then(a.score.total_cmp(&b.score)))
    }

    /// Removes causes that no longer pay.
    fn without_needless(&self, mut fit: Fit, threshold: f64) -> Fit {
        'again: loop {
            let count = fit.model.file.effects.len();
            // The last one has just paid.
            for place in 0..count.saturating_sub(1) {
                let without = fit.model.minus(self.nominal, place);
                if let Some(other) = levenberg::onward(self.kernel, without, self.effort.fit_steps, Some(&fit))
                    && other.cost - fit.cost < threshold
                {
                    fit = other;
                    continue 'again;
                }
            }
            return fit;
        }
    }

    /// Asks of each cause what would do in its place: better, then it takes the place; as well, then it is a rival.
    fn exchanged(
        &self,
        calibrated: &Fit,
        mut fit: Fit,
        competed: &[(String, Vec<Candidate>)],
        threshold: f64,
        path: &mut Path,
    ) -> (Fit, Vec<Believed>) {
        let mut rounds = 0;
        let mut drops = 0;
        'again: loop {
            let mut causes = Vec::new();
            let entries = fit.model.file.effects.clone();
            for (place, entry) in entries.iter().enumerate() {
                let name = label(entry.description.kind, entry.arguments.subject.as_deref());
                let (base, candidates) = if entries.len() == 1 {
                    let known = competed.iter().find(|(label, _)| *label == name).filter(|_| rounds == 0);
                    let known = known.filter(|(_, list)| list.iter().any(|it| it.fit.model.file.effects.len() == 1));
                    match known {
                        Some((_, list)) => (calibrated.clone(), list.clone()),
                        None => (calibrated.clone(), self.anew(calibrated, threshold, path)),
                    }
                } else {
                    (self.progress)(&format!("asking what else could stand for {name}"));
                    let without = fit.model.minus(self.nominal, place);
                    let Some(base) = levenberg::onward(self.kernel, without, self.effort.fit_steps, Some(&fit)) else {
                        continue;
                    };
                    if base.cost - fit.cost < threshold && drops < self.effort.causes {
                        // It paid while the others were not at their best.
                        fit = base;
                        drops += 1;
                        continue 'again;
                    }
                    let candidates = self.anew(&base, threshold, path);
                    (base, candidates)
                };
                let simpler = |it: &Candidate| it.numbers < entry.arguments.numbers.len() && it.fit.cost < fit.cost + threshold;
                if let Some(winner) = self.winner(&base, &candidates, threshold)
                    && winner.label != name
                    && (winner.fit.cost < fit.cost - threshold || simpler(winner))
                    && path.exchanges()
                {
                    let other = self.without_needless(winner.fit.clone(), threshold);
                    if path.visit(labels(&other.model)) {
                        (self.progress)(&format!("{} in place of {name}", winner.label));
                        fit = other;
                        rounds += 1;
                        continue 'again;
                    }
                }
                let mut rivals: Vec<(String, f64, Model)> = candidates
                    .iter()
                    .filter(|it| it.label != name)
                    .map(|it| (it.label.clone(), it.fit.cost - fit.cost, it.fit.model.clone()))
                    .collect();
                rivals.sort_by(|a, b| a.1.total_cmp(&b.1));
                causes.push(Believed {
                    label: name,
                    gain: base.cost - fit.cost,
                    rival_models: rivals.iter().map(|it| (it.0.clone(), it.2.clone())).collect(),
                    rivals: rivals.into_iter().map(|it| (it.0, it.1)).collect(),
                    without: base.model,
                });
            }
            return (fit, causes);
        }
    }

    /// What competes for a place; nobody, once the limit of work is met.
    fn anew(&self, base: &Fit, threshold: f64, path: &mut Path) -> Vec<Candidate> {
        if !path.competes() {
            return Vec::new();
        }
        let mut screened = screen(self.kernel, base, self.nominal, self.hypotheses);
        screened.iter_mut().for_each(Screened::slim);
        self.compete(base, &screened, threshold)
    }
}

/// The names of a model's causes.
fn labels(model: &Model) -> Vec<String> {
    let entries = model.file.effects.iter();
    entries.map(|it| label(it.description.kind, it.arguments.subject.as_deref())).collect()
}

/// A hypothesis with and without its optional numbers is two: each is fitted, and the simpler one wins a tie.
fn form_of(it: &Screened) -> (usize, usize) {
    (it.hypothesis, it.values.iter().filter(|value| value.is_finite()).count())
}

/// Whether one cause holds another as its special case: it then always fits as well, and that says nothing.
#[must_use]
pub fn generalises(general: &str, special: &str) -> bool {
    matches!((general, special), ("asymmetric-friction" | "stribeck-friction", "coulomb-friction"))
}

/// The model with one more cause. A special case of it that is believed already goes into its levels: friction is one thing, not two.
fn merged(model: &Model, nominal: &Model, entry: &Entry) -> Model {
    let mut entries = model.file.effects.clone();
    let mut entry = entry.clone();
    let special = entries.iter().position(|it| generalises(entry.description.kind, it.description.kind));
    if let Some(place) = special {
        let level = entries.remove(place).arguments.numbers.first().map_or(0.0, |number| number.1);
        for (name, value) in &mut entry.arguments.numbers {
            if ["forward", "backward", "coulomb", "static"].contains(name) {
                *value += level;
            }
        }
    }
    entries.push(entry);
    model.with_effects(nominal, entries)
}

/// Whether a parameter error is what calibration may do: within two standard deviations of its tolerance.
fn within_tolerance(nominal: &Model, entry: &Entry) -> bool {
    let Some(subject) = entry.arguments.subject.as_deref() else { return false };
    let Some((_, tolerance)) = nominal.file.tolerance.iter().find(|(name, _)| *name == subject) else { return false };
    let (Some(value), Some(nominal)) = (entry.arguments.optional("value"), nominal.file.parameters.optional(subject)) else {
        return false;
    };
    (value - nominal).abs() <= 2.0 * tolerance * nominal.abs()
}

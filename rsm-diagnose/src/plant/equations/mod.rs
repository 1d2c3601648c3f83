//! The screen by prediction errors: every cause of the catalogue is tested along the recorded signals, without the free run that may have diverged
//! from them.
//!
//! ```text
//!   readings --filter--> prediction errors --cross_validation--> ordered terms --> plants from which the search goes on
//! ```
//!
//! In: prepared records, the nominal plant, hypotheses. Out: an ordered list of terms with their parameters, chosen by forward selection and
//! evaluated on blocks of time that were not used to fit them. The readings correct the states at every row, so it does not matter how far a free
//! run has diverged, or what its rotor angle is. Small effects are harder to see than over a whole free run. Nothing is therefore decided here: the
//! plant with these terms is a starting point for the free run, and one candidate among others. The guesses of the catalogue stay unchanged, so an
//! equal hypothesis is found as for any other cause. Only integer parameters, which no fit changes, are added.
//!
//! Source: L. Ljung, System Identification, 1999, section 7.3 (equation errors and prediction errors); S. A. Billings, Nonlinear System
//! Identification, 2013, chapter 3 (forward selection).

pub mod cross_validation;
pub mod filter;
#[cfg(test)]
mod tests;
pub mod turning;
mod wave_terms;

use rsm_core::order;
use std::sync::atomic::{AtomicU64, Ordering};

use super::hypotheses::{Hypothesis, generalises};
use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::screen::scaled;
use super::whitened_residuals::{WhitenedResiduals, side_by_side};
use crate::engine::significance::best_gain_by_chance;
use cross_validation::{Base, Blocks, Prior, blocks};
use filter::Filter;
use rsm_core::threads::in_threads;
use rsm_sim::effect::{Guess, Role};
use rsm_sim::plant_file::{Entry, PlantFile};
use wave_terms::{Wave, order_of};

/// The largest number of rows of all records together, from their beginnings. With two hundred guesses they take half a second.
const MOST_ROWS: usize = 12_000;

/// The largest number of terms: the same as the largest number of causes in a search.
const MOST_TERMS: usize = 4;

/// A term must remove this share of the error on holdout rows: the same as a cause. The errors from the noise of other readings, and from rates that
/// change within a row, are no causes.
const LEAST_SHARE: f64 = 0.05;

/// Delays in rows, in addition to those of the catalogue. They are about an octave apart. Between two of them, the trace is proportional to the
/// delay if the motion is slower than the delay.
const DELAYS: [f64; 7] = [1.0, 2.0, 5.0, 10.0, 20.0, 35.0, 60.0];

/// Of the terms with at least this share of the best gain, the one with the fewest parameters is chosen. A more general law always gains as much;
/// where readings are smoothed over a reversal it gains a tenth more.
const AS_GOOD: f64 = 0.9;

/// The step of a finite difference, in units of an unknown's scale.
const STEP: f64 = 0.1;

/// Gauss-Newton steps after each term.
const STEPS: usize = 4;

/// The number of rotor orders that are passed to the search. A free run over a whole record distinguishes waves that blocks of rows do not.
const ORDERS: usize = 10;

/// Steps of the first fit to a free run: the same as in a competition.
const FIT_STEPS: usize = 8;

/// Plants whose prediction errors are computed together.
const CHUNK: usize = 64;

/// A term of the equations.
#[derive(Debug, Clone)]
pub struct Term {
    /// The cause with its parameters.
    pub entry: Entry,
    /// Its name in lists.
    pub label: String,
    /// The error that is left with it and the terms before it on rows that did not fit them, as a share of the nominal plant's error.
    pub left: f64,
}

/// The result of the screen by equation errors.
#[derive(Debug, Clone)]
pub struct EquationScreen {
    /// The names of the outputs whose predictions are compared.
    pub equations: Vec<&'static str>,
    /// The error that calibration leaves, as a share of the nominal plant's error.
    pub calibrated: f64,
    /// Terms, in the order in which they were chosen.
    pub terms: Vec<Term>,
    /// The plant with the first term, with the first two, and so on, with the parameters from the equations.
    pub models: Vec<Model>,
    /// First guesses of rotor waves at the orders with the largest gain, by hypothesis.
    pub orders: Vec<(usize, Guess)>,
    /// The number of guesses from which terms and orders were chosen.
    pub looks: usize,
    /// The number of predicted rows, of all plants together.
    pub work: u64,
}

/// A guess with the columns that it adds to the equations.
struct Candidate {
    hypothesis: usize,
    guess: Guess,
    columns: Vec<Blocks>,
}

/// Tests all causes by prediction errors; `None` if the plant can follow no record.
#[must_use]
pub fn screen(whitened: &WhitenedResiduals, nominal: &Model, hypotheses: &[Hypothesis]) -> Option<EquationScreen> {
    let equations = Equations::of(whitened, nominal)?;
    let mut candidates = equations.catalogue(nominal, hypotheses);
    let without_orders = candidates.len();
    let motions = equations.motions(nominal, hypotheses);
    candidates.extend(equations.orders(&motions));
    let with_orders = candidates.len();
    let periods = wave_terms::looks(&motions);
    let looks = candidates.len() + periods;
    let mut model = nominal.clone();
    let mut base = equations.base(&model)?;
    let (first, whole) = base.left();
    if whole <= 0.0 {
        return None;
    }
    let mut left = first;
    let mut orders = Vec::new();
    for round in 0..=MOST_TERMS {
        candidates.truncate(with_orders);
        candidates.extend(equations.periods(&motions, &base));
        let judged = equations.judged(&base, &candidates, &model, hypotheses);
        let least = best_gain_by_chance(candidates.len(), 2).max(LEAST_SHARE * left);
        let largest = judged.iter().map(|it| it.gain).fold(least, f64::max);
        let as_good = judged.iter().filter(|it| it.gain >= AS_GOOD * largest);
        let best = as_good.min_by(|a, b| a.numbers().cmp(&b.numbers()).then(b.gain.total_cmp(&a.gain)));
        let next = best.filter(|it| round < MOST_TERMS && it.gain > least).and_then(|best| {
            let hypothesis = &hypotheses[candidates[best.candidate].hypothesis];
            let entry = hypothesis.entry(model.file.kind, &best.values);
            let with = equations.fitted_to_equations(model.joined(nominal, entry))?;
            let base = equations.base(&with)?;
            (base.left().0 < left - least).then_some((with, base))
        });
        let Some((with, its)) = next else {
            // With all terms present: a larger term may hide a wave.
            orders.extend(best_orders(&judged, &candidates, without_orders));
            break;
        };
        (model, base) = (with, its);
        left = base.left().0;
    }
    model = equations.backward_elimination(model, nominal, left);
    orders.extend(model.file.effects.iter().filter_map(|entry| order_of(entry, hypotheses)));
    let (terms, models) = equations.nested_models(&model, nominal, whole);
    Some(EquationScreen {
        equations: equations.names.clone(),
        calibrated: first / whole,
        terms,
        models,
        orders,
        looks,
        work: equations.work.load(Ordering::Relaxed),
    })
}

/// The effect of a candidate together with a base.
struct CandidateGain {
    candidate: usize,
    gain: f64,
    /// Its fitted parameters.
    values: Vec<f64>,
}

impl CandidateGain {
    /// The number of its parameters; NaN marks one that is absent.
    fn numbers(&self) -> usize {
        self.values.iter().filter(|value| value.is_finite()).count()
    }
}

/// The rotor orders with the largest gain. Candidates from `first` on are orders.
fn best_orders(judged: &[CandidateGain], candidates: &[Candidate], first: usize) -> Vec<(usize, Guess)> {
    let mut waves: Vec<&CandidateGain> = judged.iter().filter(|it| it.gain > 0.0 && it.candidate >= first).collect();
    order::descending(&mut waves, |it| it.gain);
    let guess = |it: &CandidateGain| {
        let candidate = &candidates[it.candidate];
        (candidate.hypothesis, Guess { values: it.values.clone(), ..candidate.guess.clone() })
    };
    waves.into_iter().take(ORDERS).map(guess).collect()
}

impl EquationScreen {
    /// Adds its orders to the guesses of the catalogue.
    pub fn add_orders(&self, hypotheses: &mut [Hypothesis]) {
        for (place, guess) in &self.orders {
            let known = &mut hypotheses[*place].guesses;
            if known.iter().all(|it| it.values[1] != guess.values[1]) {
                known.push(guess.clone());
            }
        }
    }

    /// The plant with the first term, with the first two and so on, each fitted to a free run, from the initial states of another fit.
    #[must_use]
    pub fn fitted(&self, whitened: &WhitenedResiduals, calibrated: &Fit) -> Vec<Fit> {
        let its = |model: &Model| Model { starts: calibrated.model.starts.clone(), ..model.clone() };
        self.models.iter().filter_map(|model| levenberg::fit(whitened, its(model), FIT_STEPS)).collect()
    }
}

/// The prediction errors of all records.
struct Equations<'w> {
    whitened: &'w WhitenedResiduals,
    /// The filters, each with the index of its record.
    filters: Vec<(usize, Filter)>,
    names: Vec<&'static str>,
    work: AtomicU64,
}

/// The errors of a plant: for each record, for each of its outputs, one value per row.
type Errors = Vec<Vec<Vec<f64>>>;

impl<'w> Equations<'w> {
    /// The filters of some records for the nominal plant.
    fn of(whitened: &'w WhitenedResiduals, nominal: &Model) -> Option<Self> {
        let kind = nominal.file.kind;
        let records: Vec<usize> = (0..whitened.records.len()).filter(|k| !whitened.records[*k].outputs.is_empty()).collect();
        let each = MOST_ROWS / records.len().max(1);
        let filters = in_threads(&records, whitened.threads, |&record| {
            let prepared = &whitened.records[record];
            let prepared = if prepared.record.rows() > each { prepared.shortened(each) } else { prepared.clone() };
            let noise: Vec<f64> = prepared.outputs.iter().map(|output| whitened.floors[*output].sd).collect();
            let filter = Filter::new(&prepared, &nominal.for_record(record, &prepared.record), &noise)?;
            Some((record, filter))
        });
        let filters: Vec<(usize, Filter)> = filters.into_iter().flatten().collect();
        let mut present: Vec<usize> = filters.iter().flat_map(|it| it.1.prepared.outputs.clone()).collect();
        present.sort_unstable();
        present.dedup();
        let names = present.into_iter().map(|output| kind.outputs()[output].name).collect();
        (!filters.is_empty()).then_some(Equations { whitened, filters, names, work: AtomicU64::new(0) })
    }

    /// The prediction errors of plants, in units of their standard deviation; `None` for a plant that cannot follow a record.
    fn errors(&self, models: &[Model]) -> Vec<Option<Vec<Vec<f64>>>> {
        let jobs: Vec<(usize, &Model)> =
            models.iter().flat_map(|model| (0..self.filters.len()).map(move |place| (place, model))).collect();
        let all = side_by_side(&jobs, self.whitened.threads, |group| {
            let (record, filter) = &self.filters[jobs[group[0]].0];
            let its = &filter.prepared.record;
            self.work.fetch_add((group.len() * its.rows()) as u64, Ordering::Relaxed);
            let files: Vec<PlantFile> = group.iter().map(|place| jobs[*place].1.for_record(*record, its)).collect();
            let mut found = filter.errors(&files);
            for values in found.iter_mut().flatten() {
                for (values, sd) in values.iter_mut().zip(&filter.sd) {
                    values.iter_mut().for_each(|value| *value /= sd);
                }
            }
            found
        });
        let mut all = all.into_iter();
        let records = self.filters.len();
        let whole = |_| -> Option<Vec<Vec<f64>>> {
            let of_records: Vec<Option<Vec<Vec<f64>>>> = all.by_ref().take(records).collect();
            Some(of_records.into_iter().collect::<Option<Errors>>()?.into_iter().flatten().collect())
        };
        models.iter().map(whole).collect()
    }

    /// The prediction errors of one plant.
    fn errors_of(&self, model: &Model) -> Option<Vec<Vec<f64>>> {
        self.errors(std::slice::from_ref(model)).remove(0)
    }

    /// The errors of a model, with a column for each of its parameters.
    fn base(&self, model: &Model) -> Option<Base> {
        Some(self.linear(model)?.0)
    }

    /// The same, with the unknowns of the columns.
    fn linear(&self, model: &Model) -> Option<(Base, Vec<usize>)> {
        let places: Vec<usize> =
            (0..model.unknowns.len()).filter(|k| !matches!(model.unknowns[*k].place, Place::Start { .. })).collect();
        let mut models = vec![model.clone()];
        models.extend(places.iter().map(|k| model.moved(&[*k], &[STEP * model.unknowns[*k].scale])));
        let mut found = self.errors(&models).into_iter();
        let own = found.next().flatten()?;
        let mut base: (Vec<Blocks>, Vec<Prior>, Vec<usize>) = Default::default();
        for (k, moved) in places.into_iter().zip(found) {
            let Some(column) = moved.and_then(|moved| change(&own, moved, STEP)) else { continue };
            let unknown = &model.unknowns[k];
            base.0.push(column);
            // A factor is in units of the scale, and the scale is the standard deviation of the tolerance.
            base.1.push(unknown.prior.map(|(centre, _)| (model.value(k) - centre) / unknown.scale));
            base.2.push(k);
        }
        Some((Base::new(base.0, base.1, own.into_iter().map(Some).collect()), base.2))
    }

    /// A model with its parameters fitted to the equations: the last step that reduces the error.
    fn fitted_to_equations(&self, mut model: Model) -> Option<Model> {
        let (mut base, mut places) = self.linear(&model)?;
        for _ in 0..STEPS {
            let change: Vec<f64> =
                base.factors().iter().zip(&places).map(|(factor, k)| factor * model.unknowns[*k].scale).collect();
            let next = model.moved(&places, &change);
            let Some((its, there)) = self.linear(&next) else { break };
            if !next.is_possible() || its.left().1 >= base.left().1 {
                break;
            }
            (model, base, places) = (next, its, there);
        }
        Some(model)
    }

    /// A model without the terms that later terms have made unnecessary.
    fn backward_elimination(&self, mut model: Model, nominal: &Model, mut left: f64) -> Model {
        let mut place = 0;
        while model.file.effects.len() > 1 && place < model.file.effects.len() {
            let without = self.fitted_to_equations(model.without_cause(nominal, place));
            match without.and_then(|it| Some((self.base(&it)?.left().0, it))) {
                Some((its, without)) if its < left + (LEAST_SHARE * left).max(best_gain_by_chance(1, 2)) => {
                    (model, left, place) = (without, its, 0);
                }
                _ => place += 1,
            }
        }
        model
    }

    /// The terms of a model in their order, each with the error that is left with the terms up to it, and the models with the terms up to each.
    fn nested_models(&self, model: &Model, nominal: &Model, whole: f64) -> (Vec<Term>, Vec<Model>) {
        let count = model.file.effects.len();
        let up_to = |k: usize| {
            let first = model.with_effects(nominal, model.file.effects[..=k].to_vec());
            let settled = if k + 1 == count { model.clone() } else { self.fitted_to_equations(first)? };
            let entry = model.file.effects[k].clone();
            let label = super::hypotheses::label_of(&entry);
            Some((Term { label, left: self.base(&settled)?.left().0 / whole, entry }, settled))
        };
        (0..count).map_while(up_to).unzip()
    }

    /// Every guess of every hypothesis, and more delays than the catalogue has, with their columns for the nominal plant.
    fn catalogue(&self, nominal: &Model, hypotheses: &[Hypothesis]) -> Vec<Candidate> {
        let Some(without) = self.errors_of(nominal) else { return Vec::new() };
        let kind = nominal.file.kind;
        let period = self.filters[0].1.prepared.record.period;
        let mut asked: Vec<(usize, Guess)> = Vec::new();
        for (k, hypothesis) in hypotheses.iter().enumerate() {
            let role = hypothesis.description.declared.role;
            // Rounding has no derivative, and waves are tested separately.
            if role == Role::Rounding || Wave::of(hypothesis).is_some() {
                continue;
            }
            asked.extend(hypothesis.guesses.iter().map(|guess| (k, guess.clone())));
            if let (Role::Delay, Some(like)) = (role, hypothesis.guesses.first()) {
                asked.extend(DELAYS.map(|rows| (k, Guess { values: vec![rows * period], ..like.clone() })));
            }
        }
        let with = |k: usize, values: &[f64]| nominal.joined(nominal, hypotheses[k].entry(kind, values));
        let mut models: Vec<Model> = Vec::new();
        for (k, guess) in &asked {
            models.push(with(*k, &guess.values));
            if let Some(phase) = guess.phase {
                let mut shifted = guess.values.clone();
                shifted[phase] += std::f64::consts::FRAC_PI_2;
                models.push(with(*k, &shifted));
            }
        }
        let mut found = Vec::with_capacity(models.len());
        // A few at a time, because their errors need much memory.
        for some in models.chunks(CHUNK) {
            found.extend(self.errors(some).into_iter().map(|it| it.and_then(|with| change(&without, with, 1.0))));
        }
        let mut found = found.into_iter();
        let one = |(hypothesis, guess): (usize, Guess)| {
            let count = if guess.phase.is_some() { 2 } else { 1 };
            let columns: Option<Vec<Blocks>> = found.by_ref().take(count).collect::<Vec<_>>().into_iter().collect();
            Some(Candidate { hypothesis, guess, columns: columns? })
        };
        asked.into_iter().filter_map(one).collect()
    }

    /// The effect of each candidate together with a base, without candidates that are already in the model.
    fn judged(&self, base: &Base, candidates: &[Candidate], model: &Model, hypotheses: &[Hypothesis]) -> Vec<CandidateGain> {
        let kind = model.file.kind;
        let places: Vec<usize> = (0..candidates.len()).collect();
        let judged = in_threads(&places, self.whitened.threads, |&place| {
            let candidate = &candidates[place];
            let hypothesis = &hypotheses[candidate.hypothesis];
            // Friction has one law. The free run decides which.
            let kinds = |entry: &Entry| (entry.description.kind, hypothesis.description.kind);
            let there = |entry: &Entry| {
                let (a, b) = kinds(entry);
                hypothesis.describes(entry) || generalises(a, b) || generalises(b, a)
            };
            if model.file.effects.iter().any(there) {
                return None;
            }
            let given = base.with_columns(&candidate.columns);
            let values = scaled(&candidate.guess, &given.factors, hypothesis, kind)?;
            Some(CandidateGain { candidate: place, gain: given.gain, values })
        });
        judged.into_iter().flatten().collect()
    }
}

/// The change of the errors by a change of the plant, divided by a step.
fn change(without: &[Vec<f64>], mut with: Vec<Vec<f64>>, step: f64) -> Option<Blocks> {
    for (with, without) in with.iter_mut().zip(without) {
        with.iter_mut().zip(without).for_each(|(with, without)| *with = (without - *with) / step);
    }
    blocks(with)
}

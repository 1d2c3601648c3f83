//! The screen by equation errors: every cause of the catalogue is tested along the recorded signals, without the free run that may have diverged from
//! them.
//!
//! ```text
//!   readings --innovations--> errors of the equations --cross_validation--> ordered terms --> plants from which the search goes on
//! ```
//!
//! In: prepared records, the nominal plant, hypotheses. Out: an ordered list of terms with their parameters, chosen by forward selection and
//! evaluated on blocks of time that were not used to fit them. There is no free run and no initial state, so it does not matter how far a simulation
//! has diverged, or what its rotor angle is. Signals that no column holds (a twist, a slipping vehicle) have no equation here, and small effects are
//! harder to see than over a whole free run. Nothing is therefore decided here: the plant with these terms is a starting point for the free run, and
//! one candidate among others. The guesses of the catalogue stay unchanged, so an equal hypothesis is found as for any other cause. Only integer
//! parameters, which no fit changes, are added.
//!
//! Source: L. Ljung, System Identification, 1999, section 7.3 (equation errors and prediction errors); S. A. Billings, Nonlinear System
//! Identification, 2013, chapter 3 (forward selection).

pub mod cross_validation;
pub mod innovations;
pub mod readings;
#[cfg(test)]
mod tests;
pub mod turning;

use std::sync::atomic::{AtomicU64, Ordering};

use super::hypotheses::{Hypothesis, generalises};
use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::screen::scaled;
use super::waves::is_wave;
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use crate::engine::significance::best_gain_by_chance;
use cross_validation::{Base, Blocks, Prior, blocks};
use innovations::{innovations, names};
use readings::{Readings, Version};
use rsm_sim::effect::{Guess, Role};
use rsm_sim::hooks::Hooks;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::plants::Plant;
use rsm_sim::plants::pmac::Pmac;
use rsm_sim::threads::in_threads;
use turning::Turning;

/// The largest number of rows of all records together, from their beginnings. With two hundred guesses they take half a second.
const MOST_ROWS: usize = 12_000;

/// The largest number of terms: the same as the largest number of causes in a search.
const MOST_TERMS: usize = 4;

/// A term must remove this share of the error on holdout rows: the same as a cause. The errors from the noise of other readings, and from rates that
/// change within a row, are no causes.
const LEAST_SHARE: f64 = 0.05;

/// Delays in rows, in addition to those of the catalogue. They are about an octave apart. Between two of them, the trace is proportional to the delay
/// if the motion is slower than the delay.
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
    /// The names of the equations.
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
    /// The number of evaluations of a plant's rates.
    pub work: u64,
}

/// A guess with the columns that it adds to the equations.
struct Candidate {
    hypothesis: usize,
    guess: Guess,
    columns: Vec<Blocks>,
}

/// Tests all causes on the equations; `None` if no record has the columns for an equation.
#[must_use]
pub fn screen(whitened: &WhitenedResiduals, nominal: &Model, hypotheses: &[Hypothesis]) -> Option<EquationScreen> {
    let equations = Equations::of(whitened, nominal)?;
    let mut candidates = equations.catalogue(nominal, hypotheses);
    let without_orders = candidates.len();
    candidates.extend(equations.orders(nominal, hypotheses));
    let looks = candidates.len();
    let mut model = nominal.clone();
    let mut base = equations.base(&model)?;
    let (first, whole) = base.left();
    if whole <= 0.0 {
        return None;
    }
    let mut left = first;
    let mut orders = Vec::new();
    for round in 0..=MOST_TERMS {
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
        if model.file.effects.last().is_some_and(|it| it.arguments.subject.as_deref() == Some("speed")) {
            // The rotor angle follows from the speed, so it changes with a speed sensor's error.
            candidates.truncate(without_orders);
            candidates.extend(equations.orders(&model, hypotheses));
        }
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
    waves.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let guess = |it: &CandidateGain| {
        let candidate = &candidates[it.candidate];
        (candidate.hypothesis, Guess { values: it.values.clone(), ..candidate.guess.clone() })
    };
    waves.into_iter().take(ORDERS).map(guess).collect()
}

/// The guess of a term, if the term is a rotor order; otherwise `None`.
fn order_of(entry: &Entry, hypotheses: &[Hypothesis]) -> Option<(usize, Guess)> {
    if entry.description.declared.role != Role::Waves || is_wave(entry.description, entry.arguments.plant) {
        return None;
    }
    let place = hypotheses.iter().position(|it| it.describes(entry))?;
    let values = ["amplitude", "cycles", "phase"].map(|name| entry.arguments.number(name)).to_vec();
    Some((place, Guess { values, neutral: Some((0, 0.0)), phase: Some(2) }))
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

/// The equations of all records.
struct Equations {
    records: Vec<(Prepared, Readings)>,
    names: Vec<&'static str>,
    /// The noise of each equation of each record, in its unit.
    scales: Vec<Vec<f64>>,
    threads: usize,
    work: AtomicU64,
}

impl Equations {
    /// The equations of some records and the nominal plant.
    fn of(whitened: &WhitenedResiduals, nominal: &Model) -> Option<Self> {
        let kind = nominal.file.kind;
        let known: Vec<&Prepared> = whitened.records.iter().filter(|it| !names(it, kind).is_empty()).collect();
        let each = MOST_ROWS / known.len().max(1);
        let records: Vec<(Prepared, Readings)> = known
            .into_iter()
            .map(|it| if it.record.rows() > each { it.shortened(each) } else { it.clone() })
            .map(|it| (it.clone(), Readings::new(&it, kind)))
            .collect();
        let mut equations = Equations {
            names: names(&records.first()?.0, kind),
            records,
            scales: Vec::new(),
            threads: whitened.threads,
            work: AtomicU64::new(0),
        };
        let all = equations.innovations(&nominal.file, Version::Raw)?;
        equations.scales = all.iter().map(|record| record.iter().map(|values| noise(values)).collect()).collect();
        Some(equations)
    }

    /// The errors of all equations of all records, each in its own unit.
    fn innovations(&self, file: &PlantFile, version: Version) -> Option<Vec<Vec<Vec<f64>>>> {
        let each = self.records.iter().map(|(prepared, readings)| {
            let found = innovations(prepared, readings, version, file)?;
            self.work.fetch_add(found.work, Ordering::Relaxed);
            Some(found.equations)
        });
        each.collect()
    }

    /// The same divided by the noise; rows that do not count are 0.
    fn whitened(&self, mut all: Vec<Vec<Vec<f64>>>) -> Vec<Vec<f64>> {
        for ((record, scales), (_, readings)) in all.iter_mut().zip(&self.scales).zip(&self.records) {
            for (values, scale) in record.iter_mut().zip(scales) {
                for (value, counts) in values.iter_mut().zip(&readings.counts) {
                    *value = if *counts { *value / scale } else { 0.0 };
                }
            }
        }
        all.into_iter().flatten().collect()
    }

    /// The change of the errors between two plant files, for smoothed readings; `without` holds the errors of the first.
    fn change(&self, without: &[Vec<f64>], file: &PlantFile, step: f64) -> Option<Blocks> {
        let mut with = self.whitened(self.innovations(file, Version::Smooth)?);
        for (with, without) in with.iter_mut().zip(without) {
            with.iter_mut().zip(without).for_each(|(with, without)| *with = (without - *with) / step);
        }
        blocks(with)
    }

    /// The errors of a model, with a column for each of its parameters.
    fn base(&self, model: &Model) -> Option<Base> {
        Some(self.linear(model)?.0)
    }

    /// The same, with the unknowns of the columns.
    fn linear(&self, model: &Model) -> Option<(Base, Vec<usize>)> {
        let asked = self.whitened(self.innovations(&model.file, Version::Raw)?).into_iter().map(Some).collect();
        let smooth = self.whitened(self.innovations(&model.file, Version::Smooth)?);
        let places: Vec<usize> =
            (0..model.unknowns.len()).filter(|k| !matches!(model.unknowns[*k].place, Place::Start { .. })).collect();
        let columns = in_threads(&places, self.threads, |&k| {
            let step = STEP * model.unknowns[k].scale;
            self.change(&smooth, &model.moved(&[k], &[step]).file, STEP)
        });
        let mut base: (Vec<Blocks>, Vec<Prior>, Vec<usize>) = Default::default();
        for (k, column) in places.into_iter().zip(columns) {
            let Some(column) = column else { continue };
            let unknown = &model.unknowns[k];
            base.0.push(column);
            // A factor is in units of the scale, and the scale is the standard deviation of the tolerance.
            base.1.push(unknown.prior.map(|(centre, _)| (model.value(k) - centre) / unknown.scale));
            base.2.push(k);
        }
        Some((Base::new(base.0, base.1, asked), base.2))
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
            let label = super::hypotheses::label(entry.description.kind, entry.arguments.subject.as_deref());
            Some((Term { label, left: self.base(&settled)?.left().0 / whole, entry }, settled))
        };
        (0..count).map_while(up_to).unzip()
    }

    /// Every guess of every hypothesis, and more delays than the catalogue has, with their columns for the nominal plant.
    fn catalogue(&self, nominal: &Model, hypotheses: &[Hypothesis]) -> Vec<Candidate> {
        let Some(missed) = self.innovations(&nominal.file, Version::Smooth) else { return Vec::new() };
        let smooth = self.whitened(missed);
        let kind = nominal.file.kind;
        let period = self.records[0].0.record.period;
        let mut asked: Vec<(usize, Guess)> = Vec::new();
        for (k, hypothesis) in hypotheses.iter().enumerate() {
            let role = hypothesis.description.declared.role;
            // Rounding has no derivative, and rotor orders are tested separately.
            if role == Role::Rounding || role == Role::Waves && !is_wave(hypothesis.description, kind) {
                continue;
            }
            asked.extend(hypothesis.guesses.iter().map(|guess| (k, guess.clone())));
            if let (Role::Delay, Some(like)) = (role, hypothesis.guesses.first()) {
                asked.extend(DELAYS.map(|rows| (k, Guess { values: vec![rows * period], ..like.clone() })));
            }
        }
        let columns = in_threads(&asked, self.threads, |(k, guess)| {
            let with = |values: &[f64]| {
                let model = nominal.joined(nominal, hypotheses[*k].entry(kind, values));
                model.is_possible().then(|| self.change(&smooth, &model.file, 1.0)).flatten()
            };
            let mut columns = vec![with(&guess.values)?];
            if let Some(phase) = guess.phase {
                let mut shifted = guess.values.clone();
                shifted[phase] += std::f64::consts::FRAC_PI_2;
                columns.push(with(&shifted)?);
            }
            Some(columns)
        });
        let found = asked.into_iter().zip(columns);
        found.filter_map(|((hypothesis, guess), columns)| Some(Candidate { hypothesis, guess, columns: columns? })).collect()
    }

    /// Waves of torque over the rotor angle, at every order that the records resolve.
    fn orders(&self, model: &Model, hypotheses: &[Hypothesis]) -> Vec<Candidate> {
        let Some(hypothesis) = hypotheses.iter().position(|it| it.description.declared.role == Role::Waves) else {
            return Vec::new();
        };
        if !model.file.kind.is("pmac") {
            return Vec::new();
        }
        let hooks = Hooks::new(&model.file, Pmac::STATES);
        let inertia = model.file.parameters.number("inertia");
        let rotors: Vec<Turning> = self
            .records
            .iter()
            .map(|(prepared, readings)| {
                let record = &prepared.record;
                let speed = readings.truth(2, Version::Smooth, &model.file, &hooks, record);
                Turning::new(&speed.unwrap_or_default(), record.start("angle").unwrap_or(0.0), record.period)
            })
            .collect();
        // Over less than a turn, an order looks like a smooth torque.
        if rotors.iter().map(Turning::turns).fold(0.0, f64::max) < 1.0 {
            return Vec::new();
        }
        let orders: Vec<usize> = (1..=turning::MOST).collect();
        let columns = in_threads(&orders, self.threads, |order| {
            let waves: Vec<[Vec<f64>; 2]> = rotors.iter().map(|rotor| rotor.wave(*order, inertia)).collect();
            [0, 1].map(|quarter| {
                let speeds = self.records.iter().zip(&waves).map(|((prepared, _), wave)| {
                    let mut equations = vec![vec![0.0; prepared.record.rows()]; self.names.len()];
                    equations.pop();
                    equations.push(wave[quarter].clone());
                    equations
                });
                blocks(self.whitened(speeds.collect()))
            })
        });
        let at = |(order, [sin, cos]): (usize, [Option<Blocks>; 2])| {
            let guess = Guess { values: vec![1.0, order as f64, 0.0], neutral: Some((0, 0.0)), phase: Some(2) };
            Some(Candidate { hypothesis, guess, columns: vec![sin?, cos?] })
        };
        orders.into_iter().zip(columns).filter_map(at).collect()
    }

    /// The effect of each candidate together with a base, without candidates that are already in the model.
    fn judged(&self, base: &Base, candidates: &[Candidate], model: &Model, hypotheses: &[Hypothesis]) -> Vec<CandidateGain> {
        let kind = model.file.kind;
        let places: Vec<usize> = (0..candidates.len()).collect();
        let judged = in_threads(&places, self.threads, |&place| {
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

/// The noise of an equation error, from the differences of neighbouring rows.
fn noise(values: &[f64]) -> f64 {
    let steps = values.windows(2).map(|w| (w[1] - w[0]) * (w[1] - w[0]));
    let size = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    (0.5 * steps.sum::<f64>() / values.len().max(1) as f64).sqrt().max(1e-9 * size).max(f64::MIN_POSITIVE)
}

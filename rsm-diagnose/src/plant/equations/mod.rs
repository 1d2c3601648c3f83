//! The screen by equation error: every cause of the catalogue asked along the recorded signals, beside the free run that may have left them.
//!
//! ```text
//!   readings --led--> what each equation misses --held_out--> ordered terms --> plants from which the search goes on
//! ```
//!
//! In: prepared records, the nominal plant, hypotheses. Out: an ordered list of terms with their numbers, chosen forward and judged on blocks of time that did not make them. No free run and no start: what a missing cause has made of a simulation after a second, and where in its turning the
//! simulated rotor is, do not matter. What no column holds (a twist, a vehicle that slips) has no equation here, and small effects stand out less than over a whole free run:
//! nothing is decided here. The plant with these terms is where the free run may begin, and a candidate among all others. Guesses of the catalogue stay as they are, so that what is equal to a term is found as it
//! is for any other cause; only whole numbers, which no fit moves, are added to them.
//!
//! Source: L. Ljung, System Identification, 1999, section 7.3 (equation errors and prediction errors); S. A. Billings, Nonlinear System Identification, 2013, chapter 3 (forward selection).

pub mod held_out;
pub mod led;
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
use crate::engine::significance::best_of;
use held_out::{Base, Blocks, Prior, blocks};
use led::{missed, names};
use readings::{Readings, Version};
use rsm_sim::effect::{Guess, Role};
use rsm_sim::hooks::Hooks;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::plants::Plant;
use rsm_sim::plants::pmac::Pmac;
use rsm_sim::threads::in_threads;
use turning::Turning;

/// Rows at most, of all records together, the beginnings of each: with two hundred guesses half a second.
const MOST_ROWS: usize = 12_000;

/// Terms at most: as many as a search has causes.
const MOST_TERMS: usize = 4;

/// What a term must remove of what is left on held-out rows: as much as a cause must to be worth its name. What is left by the readings of the other states, and by a rate that changes within a row, is no cause.
const LEAST_SHARE: f64 = 0.05;

/// Delays in rows, beside those of the catalogue: an octave apart a delay is in proportion to its neighbour's trace where the motion is slower than itself.
const DELAYS: [f64; 7] = [1.0, 2.0, 5.0, 10.0, 20.0, 35.0, 60.0];

/// Among terms that give this share of the best one, that with the fewest numbers is chosen: a wider law always gives as much, and where readings are smoothed over a reversal a tenth more.
const AS_GOOD: f64 = 0.9;

/// The step of a difference, in units of an unknown's scale.
const STEP: f64 = 0.1;

/// Steps of Gauss and Newton after each term.
const STEPS: usize = 4;

/// Orders of a rotor that are handed to the search: a free run over a whole record tells waves that blocks of rows do not.
const ORDERS: usize = 10;

/// Steps of the first fit to a free run: those of a competition's.
const FIT_STEPS: usize = 8;

/// A term of the equations.
#[derive(Debug, Clone)]
pub struct Term {
    /// The cause with its numbers.
    pub entry: Entry,
    /// Its name in lists.
    pub label: String,
    /// What is left with it and those before it on rows that did not make them, as a share of what the nominal plant misses.
    pub left: f64,
}

/// What the equations say.
#[derive(Debug, Clone)]
pub struct Said {
    /// The names of the equations.
    pub equations: Vec<&'static str>,
    /// What calibration leaves, as a share of what the nominal plant misses.
    pub calibrated: f64,
    /// Terms, in the order in which they were chosen.
    pub terms: Vec<Term>,
    /// The plant with the first term, with the first two, and so on, as the equations have them.
    pub models: Vec<Model>,
    /// First guesses of waves of a rotor at the orders that promise most, by hypothesis.
    pub orders: Vec<(usize, Guess)>,
    /// Guesses among which terms and orders were chosen.
    pub looks: usize,
    /// Evaluations of a plant's rates that all took.
    pub work: u64,
}

/// A guess with what it adds to the equations.
struct Candidate {
    hypothesis: usize,
    guess: Guess,
    columns: Vec<Blocks>,
}

/// Asks the equations; `None` where no record has the columns for one.
#[must_use]
pub fn look(whitened: &WhitenedResiduals, nominal: &Model, hypotheses: &[Hypothesis]) -> Option<Said> {
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
        let least = best_of(candidates.len(), 2).max(LEAST_SHARE * left);
        let largest = judged.iter().map(|it| it.gain).fold(least, f64::max);
        let as_good = judged.iter().filter(|it| it.gain >= AS_GOOD * largest);
        let best = as_good.min_by(|a, b| a.numbers().cmp(&b.numbers()).then(b.gain.total_cmp(&a.gain)));
        let next = best.filter(|it| round < MOST_TERMS && it.gain > least).and_then(|best| {
            let hypothesis = &hypotheses[candidates[best.candidate].hypothesis];
            let entry = hypothesis.entry(model.file.kind, &best.values);
            let with = equations.settled(model.joined(nominal, entry))?;
            let base = equations.base(&with)?;
            (base.left().0 < left - least).then_some((with, base))
        });
        let Some((with, its)) = next else {
            // Beside all that is known: a wave may stand behind what is larger.
            orders.extend(best_orders(&judged, &candidates, without_orders));
            break;
        };
        (model, base) = (with, its);
        left = base.left().0;
        if model.file.effects.last().is_some_and(|it| it.arguments.subject.as_deref() == Some("speed")) {
            // Where the rotor was follows from its speed.
            candidates.truncate(without_orders);
            candidates.extend(equations.orders(&model, hypotheses));
        }
    }
    model = equations.needed(model, nominal, left);
    orders.extend(model.file.effects.iter().filter_map(|entry| order_of(entry, hypotheses)));
    let (terms, models) = equations.one_by_one(&model, nominal, whole);
    Some(Said {
        equations: equations.names.clone(),
        calibrated: first / whole,
        terms,
        models,
        orders,
        looks,
        work: equations.work.load(Ordering::Relaxed),
    })
}

/// What a candidate gives beside a base.
struct Judged {
    candidate: usize,
    gain: f64,
    /// Its numbers as the rows ask for them.
    values: Vec<f64>,
}

impl Judged {
    /// How many numbers it has; NaN leaves one out.
    fn numbers(&self) -> usize {
        self.values.iter().filter(|value| value.is_finite()).count()
    }
}

/// The orders of a rotor that give most; candidates from `first` on are orders.
fn best_orders(judged: &[Judged], candidates: &[Candidate], first: usize) -> Vec<(usize, Guess)> {
    let mut waves: Vec<&Judged> = judged.iter().filter(|it| it.gain > 0.0 && it.candidate >= first).collect();
    waves.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let guess = |it: &Judged| {
        let candidate = &candidates[it.candidate];
        (candidate.hypothesis, Guess { values: it.values.clone(), ..candidate.guess.clone() })
    };
    waves.into_iter().take(ORDERS).map(guess).collect()
}

/// The guess that a term of a rotor's order is; `None` for all other terms.
fn order_of(entry: &Entry, hypotheses: &[Hypothesis]) -> Option<(usize, Guess)> {
    if entry.description.kind != "cogging-torque" || entry.arguments.plant != PlantKind::Pmac {
        return None;
    }
    let place = hypotheses.iter().position(|it| it.is(entry))?;
    let values = ["amplitude", "cycles", "phase"].map(|name| entry.arguments.number(name)).to_vec();
    Some((place, Guess { values, neutral: Some((0, 0.0)), phase: Some(2) }))
}

impl Said {
    /// Puts its orders beside those of the catalogue.
    pub fn hand_over(&self, hypotheses: &mut [Hypothesis]) {
        for (place, guess) in &self.orders {
            let known = &mut hypotheses[*place].guesses;
            if known.iter().all(|it| it.values[1] != guess.values[1]) {
                known.push(guess.clone());
            }
        }
    }

    /// The plant with the first term, with the first two and so on, each fitted to a free run, from the starts of another fit.
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
    /// Of records and the plant as its file has it.
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
        let all = equations.missed(&nominal.file, Version::Raw)?;
        equations.scales = all.iter().map(|record| record.iter().map(|values| noise(values)).collect()).collect();
        Some(equations)
    }

    /// What all equations of all records miss, in their units.
    fn missed(&self, file: &PlantFile, version: Version) -> Option<Vec<Vec<Vec<f64>>>> {
        let each = self.records.iter().map(|(prepared, readings)| {
            let found = missed(prepared, readings, version, file)?;
            self.work.fetch_add(found.work, Ordering::Relaxed);
            Some(found.equations)
        });
        each.collect()
    }

    /// The same over the noise, rows that do not count as 0.
    fn white(&self, mut all: Vec<Vec<Vec<f64>>>) -> Vec<Vec<f64>> {
        for ((record, scales), (_, readings)) in all.iter_mut().zip(&self.scales).zip(&self.records) {
            for (values, scale) in record.iter_mut().zip(scales) {
                for (value, counts) in values.iter_mut().zip(&readings.counts) {
                    *value = if *counts { *value / scale } else { 0.0 };
                }
            }
        }
        all.into_iter().flatten().collect()
    }

    /// What another file says beyond this one, whose misses of smooth readings are given: what it explains.
    fn change(&self, without: &[Vec<f64>], file: &PlantFile, step: f64) -> Option<Blocks> {
        let mut with = self.white(self.missed(file, Version::Smooth)?);
        for (with, without) in with.iter_mut().zip(without) {
            with.iter_mut().zip(without).for_each(|(with, without)| *with = (without - *with) / step);
        }
        blocks(with)
    }

    /// What a model misses, with the columns of all its numbers.
    fn base(&self, model: &Model) -> Option<Base> {
        Some(self.linear(model)?.0)
    }

    /// The same, with the unknowns of the columns.
    fn linear(&self, model: &Model) -> Option<(Base, Vec<usize>)> {
        let asked = self.white(self.missed(&model.file, Version::Raw)?).into_iter().map(Some).collect();
        let smooth = self.white(self.missed(&model.file, Version::Smooth)?);
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
            // A factor is in units of the scale; the standard deviation of a tolerance is one.
            base.1.push(unknown.prior.map(|(centre, _)| (model.value(k) - centre) / unknown.scale));
            base.2.push(k);
        }
        Some((Base::new(base.0, base.1, asked), base.2))
    }

    /// A model with its numbers as the equations have them; the last step that lowers what is left.
    fn settled(&self, mut model: Model) -> Option<Model> {
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

    /// A model without the terms that others have made needless.
    fn needed(&self, mut model: Model, nominal: &Model, mut left: f64) -> Model {
        let mut place = 0;
        while model.file.effects.len() > 1 && place < model.file.effects.len() {
            let without = self.settled(model.minus(nominal, place));
            match without.and_then(|it| Some((self.base(&it)?.left().0, it))) {
                Some((its, without)) if its < left + (LEAST_SHARE * left).max(best_of(1, 2)) => {
                    (model, left, place) = (without, its, 0);
                }
                _ => place += 1,
            }
        }
        model
    }

    /// The terms of a model in their order, with what is left with those up to each, and the models up to each.
    fn one_by_one(&self, model: &Model, nominal: &Model, whole: f64) -> (Vec<Term>, Vec<Model>) {
        let count = model.file.effects.len();
        let up_to = |k: usize| {
            let first = model.with_effects(nominal, model.file.effects[..=k].to_vec());
            let settled = if k + 1 == count { model.clone() } else { self.settled(first)? };
            let entry = model.file.effects[k].clone();
            let label = super::hypotheses::label(entry.description.kind, entry.arguments.subject.as_deref());
            Some((Term { label, left: self.base(&settled)?.left().0 / whole, entry }, settled))
        };
        (0..count).map_while(up_to).unzip()
    }

    /// Every guess of every hypothesis, and delays beside those of the catalogue, as the nominal plant answers them.
    fn catalogue(&self, nominal: &Model, hypotheses: &[Hypothesis]) -> Vec<Candidate> {
        let Some(missed) = self.missed(&nominal.file, Version::Smooth) else { return Vec::new() };
        let smooth = self.white(missed);
        let kind = nominal.file.kind;
        let period = self.records[0].0.record.period;
        let mut asked: Vec<(usize, Guess)> = Vec::new();
        for (k, hypothesis) in hypotheses.iter().enumerate() {
            let role = hypothesis.description.declared.role;
            // Rounding has no derivative, and orders of a rotor are asked one by one.
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

    /// Waves of torque over the turning of a rotor, at every order that its records show.
    fn orders(&self, model: &Model, hypotheses: &[Hypothesis]) -> Vec<Candidate> {
        let Some(hypothesis) = hypotheses.iter().position(|it| it.description.declared.role == Role::Waves) else {
            return Vec::new();
        };
        if model.file.kind != PlantKind::Pmac {
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
                Turning::new(&speed.unwrap_or_default(), record.angle.unwrap_or(0.0), record.period)
            })
            .collect();
        // Of less than a turn an order is a smooth torque.
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
                blocks(self.white(speeds.collect()))
            })
        });
        let at = |(order, [sin, cos]): (usize, [Option<Blocks>; 2])| {
            let guess = Guess { values: vec![1.0, order as f64, 0.0], neutral: Some((0, 0.0)), phase: Some(2) };
            Some(Candidate { hypothesis, guess, columns: vec![sin?, cos?] })
        };
        orders.into_iter().zip(columns).filter_map(at).collect()
    }

    /// What each candidate gives beside a base; none that says what the model has already.
    fn judged(&self, base: &Base, candidates: &[Candidate], model: &Model, hypotheses: &[Hypothesis]) -> Vec<Judged> {
        let kind = model.file.kind;
        let places: Vec<usize> = (0..candidates.len()).collect();
        let judged = in_threads(&places, self.threads, |&place| {
            let candidate = &candidates[place];
            let hypothesis = &hypotheses[candidate.hypothesis];
            // Friction is one thing: its law is the free run's to say.
            let kinds = |entry: &Entry| (entry.description.kind, hypothesis.description.kind);
            let there = |entry: &Entry| {
                let (a, b) = kinds(entry);
                hypothesis.is(entry) || generalises(a, b) || generalises(b, a)
            };
            if model.file.effects.iter().any(there) {
                return None;
            }
            let given = base.beside(&candidate.columns);
            let values = scaled(&candidate.guess, &given.factors, hypothesis, kind)?;
            Some(Judged { candidate: place, gain: given.gain, values })
        });
        judged.into_iter().flatten().collect()
    }
}

/// The noise of what an equation misses: from row to row it is what is new there.
fn noise(values: &[f64]) -> f64 {
    let steps = values.windows(2).map(|w| (w[1] - w[0]) * (w[1] - w[0]));
    let size = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    (0.5 * steps.sum::<f64>() / values.len().max(1) as f64).sqrt().max(1e-9 * size).max(f64::MIN_POSITIVE)
}

//! The screen: how much each hypothesis could explain, from one simulation a guess.
//!
//! In: a fitted model and the hypotheses. Out: the predicted gain in squared residual of each guess, jointly with everything that is free anyway
//! (starts, calibration, causes already believed): their derivatives are projected out, through normal equations, so that a cause gets no credit
//! for what they can do. Also the gain that noise alone would give the best of them. Never fits.

use super::chance;
use super::hypotheses::Hypothesis;
use super::kernel::{Kernel, dot};
use super::levenberg::Fit;
use super::model::Model;
use super::noise::Random;
use super::normal::Normal;
use super::selection::generalises;
use crate::effect::{Guess, Subject};
use crate::plant_file::Entry;

/// What a hypothesis keeps of its trace after projection, at least, as a share of its square: less is a trace that the free unknowns make as well, and finite
/// differences hold no more digits.
const LEAST_OF_ITS_OWN: f64 = 1e-7;

/// A guess that was simulated.
#[derive(Debug, Clone)]
pub struct Screened {
    /// Which hypothesis.
    pub hypothesis: usize,
    /// Its numbers, scaled to what the residual asks.
    pub values: Vec<f64>,
    /// Predicted gain.
    pub gain: f64,
    /// Its traces: whitened changes of the simulation.
    traces: Vec<Vec<f64>>,
}

/// Everything that is free anyway, ready to be projected out.
pub struct Nuisance<'a> {
    fit: &'a Fit,
    normal: Normal,
    /// What the residual asks of it, and what of that is solved.
    pull: Vec<f64>,
}

impl<'a> Nuisance<'a> {
    /// Of a fit.
    #[must_use]
    pub fn new(fit: &'a Fit) -> Self {
        Nuisance { fit, normal: Normal::new(&fit.matrix(), fit.free.len(), 0.0), pull: fit.pull() }
    }

    /// Inner products of a trace with the free derivatives.
    #[must_use]
    pub fn products(&self, trace: &[f64]) -> Vec<f64> {
        self.fit.columns.iter().map(|column| column.with(trace)).collect()
    }

    /// The inner product of two traces without what is free, from their products.
    #[must_use]
    pub fn between(&self, plain: f64, a: &[f64], b: &[f64]) -> f64 {
        plain - dot(a, &self.normal.solve(b))
    }

    /// The inner product of a trace with the residual, without what is free; priors pull too.
    #[must_use]
    pub fn with_residual(&self, trace: &[f64], products: &[f64]) -> f64 {
        dot(trace, &self.fit.residual) - dot(products, &self.normal.solve(&self.pull))
    }

    /// The squared residual that is left when the free unknowns move as they like, in first order.
    #[must_use]
    pub fn left(&self, residual: &[f64]) -> f64 {
        let products: Vec<f64> = self.products(residual);
        // Priors ask for what the fit's own pull has beyond its residual's.
        let own: Vec<f64> = self.products(&self.fit.residual);
        let right: Vec<f64> = products.iter().zip(&self.pull).zip(&own).map(|((now, pull), own)| now + pull - own).collect();
        dot(residual, residual) - dot(&right, &self.normal.solve(&right))
    }
}

/// Screens all guesses. The list is as long as the guesses that could be simulated, in their order.
#[must_use]
pub fn screen(kernel: &Kernel, fit: &Fit, nominal: &Model, hypotheses: &[Hypothesis]) -> Vec<Screened> {
    let nuisance = Nuisance::new(fit);
    let kind = fit.model.file.kind;
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut guesses: Vec<(usize, Guess)> = Vec::new();
    for (k, hypothesis) in hypotheses.iter().enumerate() {
        let there = |entry: &Entry| hypothesis.is(entry) || generalises(entry.description.kind, hypothesis.description.kind);
        if fit.model.file.effects.iter().any(there) {
            continue;
        }
        guesses.extend(hypothesis.guesses.iter().map(|guess| (k, about_now(fit, hypothesis, guess))));
    }
    let mut list = Vec::new();
    // Some at a time: their simulations are large.
    for some in guesses.chunks(32) {
        let mut models = Vec::new();
        for (k, guess) in some {
            let mut shifted = guess.values.clone();
            models.push(at(&fit.model, nominal, &hypotheses[*k], &guess.values, kind));
            if let Some(phase) = guess.phase {
                shifted[phase] += quarter;
                models.push(at(&fit.model, nominal, &hypotheses[*k], &shifted, kind));
            }
        }
        let mut runs = kernel.run_all(&models).into_iter();
        for (k, guess) in some {
            let first = runs.next().flatten();
            let second = if guess.phase.is_some() { runs.next().flatten() } else { None };
            let runs: Vec<_> =
                if guess.phase.is_some() && second.is_none() { Vec::new() } else { first.into_iter().chain(second).collect() };
            let traces: Vec<Vec<f64>> = runs.iter().map(|run| kernel.changes(&fit.simulated, run, 1.0)).collect();
            if !traces.is_empty()
                && let Some(screened) = judge(&nuisance, *k, guess, traces)
            {
                list.push(screened);
            }
        }
    }
    list
}

/// A parameter error begins at the value that calibration left, not at what the plant file says: it may be pressed against the end of its tolerance.
fn about_now(fit: &Fit, hypothesis: &Hypothesis, guess: &Guess) -> Guess {
    let subject = hypothesis.subject.filter(|_| hypothesis.description.subject == Subject::Parameter);
    let Some(now) = subject.and_then(|name| fit.model.file.parameters.optional(name)) else { return guess.clone() };
    let without = guess.neutral.map_or(now, |(_, without)| without);
    Guess { values: guess.values.iter().map(|value| value - without + now).collect(), neutral: Some((0, now)), ..guess.clone() }
}

/// The fitted model with a hypothesis at some numbers, nothing else moved.
fn at(model: &Model, nominal: &Model, hypothesis: &Hypothesis, values: &[f64], kind: crate::kind::PlantKind) -> Model {
    let mut with = model.plus(nominal, hypothesis.entry(kind, values));
    if !with.is_possible() {
        with = model.clone();
    }
    with
}

fn judge(nuisance: &Nuisance<'_>, hypothesis: usize, guess: &Guess, traces: Vec<Vec<f64>>) -> Option<Screened> {
    let products: Vec<Vec<f64>> = traces.iter().map(|trace| nuisance.products(trace)).collect();
    let n = traces.len();
    let mut matrix = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            matrix[i * n + j] = nuisance.between(dot(&traces[i], &traces[j]), &products[i], &products[j]);
        }
        let plain = dot(&traces[i], &traces[i]);
        let own = matrix[i * n + i];
        if own.is_nan() || own <= LEAST_OF_ITS_OWN * plain {
            return None;
        }
    }
    let right: Vec<f64> = (0..n).map(|i| nuisance.with_residual(&traces[i], &products[i])).collect();
    let mut share = Normal::new(&matrix, n, 0.0).solve(&right);
    let mut gain: f64 = share.iter().zip(&right).map(|(share, right)| share * right).sum();
    let mut values = guess.values.clone();
    match (guess.neutral, guess.phase) {
        (Some((place, _)), Some(phase)) => {
            // share_0 sin(x) + share_1 cos(x) = R sin(x + angle)
            values[place] *= share[0].hypot(share[1]);
            values[phase] += share[1].atan2(share[0]);
        }
        (Some((place, without)), None) => {
            // Beyond ten times the guess nothing is in proportion any more.
            share[0] = share[0].clamp(-10.0, 10.0);
            values[place] = without + share[0] * (values[place] - without);
        }
        _ => {
            if share[0] <= 0.0 {
                gain = 0.0;
            }
        }
    }
    gain.is_finite().then_some(Screened { hypothesis, values, gain: gain.max(0.0), traces })
}

/// The gain that noise alone gives the best of all hypotheses, at most, in 99 of 100 cases: residuals of noise as the floors have it, with the traces and free
/// unknowns of the screen. No further simulation: to first order a fit to noise gains what its trace has in common with it.
#[must_use]
pub fn null(kernel: &Kernel, fit: &Fit, screened: &[Screened], draws: usize) -> f64 {
    let nuisance = Nuisance::new(fit);
    let mut random = Random::new(1);
    let parts: Vec<(Vec<Vec<f64>>, Normal)> = screened
        .iter()
        .map(|it| {
            let products: Vec<Vec<f64>> = it.traces.iter().map(|trace| nuisance.products(trace)).collect();
            let n = it.traces.len();
            let mut matrix = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..n {
                    matrix[i * n + j] = nuisance.between(dot(&it.traces[i], &it.traces[j]), &products[i], &products[j]);
                }
            }
            (products, Normal::new(&matrix, n, 0.0))
        })
        .collect();
    let mut largest: Vec<f64> = Vec::new();
    for _ in 0..draws {
        let noise = chance::noise(kernel, &mut random);
        let solved = nuisance.normal.solve(&nuisance.products(&noise));
        let gains = screened.iter().zip(&parts).map(|(it, (products, normal))| {
            let right: Vec<f64> =
                it.traces.iter().zip(products).map(|(trace, products)| dot(trace, &noise) - dot(products, &solved)).collect();
            normal.solve(&right).iter().zip(&right).map(|(share, right)| share * right).sum::<f64>()
        });
        largest.push(gains.fold(0.0, f64::max));
    }
    chance::point(&largest)
}

impl Screened {
    /// Forgets the traces, which are large.
    pub fn slim(&mut self) {
        self.traces = Vec::new();
    }
}

//! Screening: the first-order gain of each hypothesis, from one simulation for each first guess.
//!
//! In: a fitted model and the hypotheses. Out: the predicted gain in squared residual of each guess, jointly with everything that is always free
//! (initial states, calibration, causes already accepted). Their derivatives are projected out through normal equations, so a cause gets no credit
//! for what they can explain. Also the gain that noise alone would give the best hypothesis. Fits nothing.

use super::hypotheses::{Hypothesis, generalises};
use super::levenberg::Fit;
use super::model::Model;
use super::nuisance::{Nuisance, Released};
use super::null;
use super::position_traces::PositionTraces;
use super::waves;
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::normal::{Normal, symmetric};
use crate::engine::significance::point_of_largest;
use rsm_core::order;
use rsm_core::threads::in_threads;
use rsm_fit::random::Random;
use rsm_sim::effect::{Guess, Subject};
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::Entry;
use rsm_sim::record::Record;

/// The smallest share of a trace, as a square, that must be left after projection. With less, the free unknowns can make the same trace, within the
/// accuracy of finite differences.
const LEAST_INDEPENDENT_SHARE: f64 = 1e-7;

/// If a trace is longer than the residual by this factor, the guess is too large for a linear approximation.
const LINEAR_UP_TO: f64 = 3.0;

/// Two traces count as equal if the square of the sine of their angle is below this. Two smoothings, or two sizes of one cause, differ by as much.
const COLLINEAR: f64 = 1e-3;

/// The number of guesses, those with the largest predicted gain, that are grouped. The others are not fitted.
const GROUPED: usize = 40;

/// A simulated guess.
#[derive(Debug, Clone)]
pub struct Screened {
    /// The index of the hypothesis.
    pub hypothesis: usize,
    /// Its parameters, scaled to the residual.
    pub values: Vec<f64>,
    /// Predicted gain.
    pub gain: f64,
    /// Guesses with one parameter in the same group have the same trace after the free unknowns are projected out. `None` for guesses with several
    /// traces and for those with little gain.
    pub group: Option<usize>,
    /// The guess as simulated.
    guess: Guess,
    /// Its traces: the whitened changes of the simulation.
    traces: Vec<Vec<f64>>,
    /// The inner products of its traces with the derivatives of the free unknowns.
    products: Vec<Vec<f64>>,
}

/// Screens all guesses. The list has one entry for each guess that could be simulated, in their order.
#[must_use]
pub fn screen(whitened: &WhitenedResiduals, fit: &Fit, nominal: &Model, hypotheses: &[Hypothesis]) -> Vec<Screened> {
    let nuisance = Nuisance::new(fit);
    let mut guesses: Vec<(usize, Guess)> = Vec::new();
    for (k, hypothesis) in hypotheses.iter().enumerate() {
        let there =
            |entry: &Entry| hypothesis.describes(entry) || generalises(entry.description.kind, hypothesis.description.kind);
        if fit.model.file.effects.iter().any(there) {
            continue;
        }
        guesses.extend(hypothesis.guesses.iter().map(|guess| (k, relative_to_fit(fit, hypothesis, guess))));
    }
    let mut list = Vec::new();
    let asked = dot(&fit.residual, &fit.residual).sqrt();
    // A few at a time, because their simulations need much memory.
    for some in guesses.chunks(32) {
        let mut simulated = traces(whitened, fit, nominal, hypotheses, some);
        // A guess for a plant without causes may change it far more than the remaining residual, where its response is not linear. Such a guess is
        // made smaller.
        let mut smaller: Vec<(usize, (usize, Guess))> = Vec::new();
        for (place, ((k, guess), traces)) in some.iter().zip(&simulated).enumerate() {
            let longest = traces.iter().map(|trace| dot(trace, trace).sqrt()).fold(0.0, f64::max);
            if let Some((number, without)) = guess.neutral
                && longest > LINEAR_UP_TO * asked
                && longest.is_finite()
            {
                let mut guess = guess.clone();
                guess.values[number] = without + asked / longest * (guess.values[number] - without);
                smaller.push((place, (*k, guess)));
            }
        }
        let again: Vec<(usize, Guess)> = smaller.iter().map(|(_, it)| it.clone()).collect();
        let mut some = some.to_vec();
        for ((place, it), traces) in smaller.into_iter().zip(traces(whitened, fit, nominal, hypotheses, &again)) {
            if !traces.is_empty() {
                (some[place], simulated[place]) = (it, traces);
            }
        }
        for ((k, guess), traces) in some.iter().zip(simulated) {
            if !traces.is_empty()
                && let Some(screened) = judge(&nuisance, hypotheses, *k, guess, traces)
            {
                list.push(screened);
            }
        }
    }
    grouped(&nuisance, &mut list);
    list
}

/// Groups guesses that have the same trace after projection. The one with the largest predicted gain leads.
fn grouped(nuisance: &Nuisance<'_>, list: &mut [Screened]) {
    let mut order: Vec<usize> = (0..list.len()).filter(|k| list[*k].traces.len() == 1 && list[*k].gain > 0.0).collect();
    order::descending(&mut order, |it| list[*it].gain);
    order.truncate(GROUPED);
    let between =
        |a: &Screened, b: &Screened| nuisance.between(dot(&a.traces[0], &b.traces[0]), &a.products[0], &b.products[0], 0);
    let mut leaders: Vec<(usize, f64)> = Vec::new();
    for place in order {
        let own = between(&list[place], &list[place]);
        let same = leaders.iter().position(|(leader, its)| {
            let both = between(&list[*leader], &list[place]);
            both * both > (1.0 - COLLINEAR) * own * its
        });
        list[place].group = Some(same.unwrap_or(leaders.len()));
        if same.is_none() {
            leaders.push((place, own));
        }
    }
}

/// The traces of guesses: whitened changes of the simulation; two if a phase is free, none if one cannot be simulated.
fn traces(
    whitened: &WhitenedResiduals,
    fit: &Fit,
    nominal: &Model,
    hypotheses: &[Hypothesis],
    guesses: &[(usize, Guess)],
) -> Vec<Vec<Vec<f64>>> {
    let kind = fit.model.file.kind;
    let is_wave = |k: usize| waves::is_wave(hypotheses[k].description, kind);
    let traces = guesses.iter().any(|(k, _)| is_wave(*k)).then(|| PositionTraces::new(whitened, fit));
    let mut models = Vec::new();
    let mut configurations = Vec::new();
    for (k, guess) in guesses.iter().filter(|(k, _)| !is_wave(*k)) {
        let mut shifted = guess.values.clone();
        models.push(at(&fit.model, nominal, &hypotheses[*k], &guess.values, kind));
        if let Some(phase) = guess.phase {
            shifted[phase] += std::f64::consts::FRAC_PI_2;
            models.push(at(&fit.model, nominal, &hypotheses[*k], &shifted, kind));
        }
        configurations.resize(models.len(), hypotheses[*k].configuration);
    }
    // A cause of one configuration changes the records of this configuration only, unless it replaces another cause.
    let changes = |model: usize, record: &Record| {
        let replaces = models[model].file.effects.len() != fit.model.file.effects.len() + 1;
        replaces || configurations[model].is_none_or(|its| record.configuration_name(kind) == Some(its))
    };
    let mut runs = whitened.run_changed(&models, &fit.simulated, &changes).into_iter();
    // Waves need no simulation.
    let mut of = |(k, guess): &(usize, Guess)| -> Option<Vec<Vec<Simulated>>> {
        let taken = (!is_wave(*k)).then(|| runs.by_ref().take(if guess.phase.is_some() { 2 } else { 1 }));
        taken.map(|it| it.collect::<Option<Vec<_>>>().unwrap_or_default())
    };
    let all: Vec<(&(usize, Guess), _)> = guesses.iter().map(|guess| (guess, of(guess))).collect();
    in_threads(&all, whitened.threads, |((k, guess), runs)| match runs {
        Some(runs) => runs.iter().map(|run| whitened.changes(&fit.simulated, run, 1.0)).collect(),
        None => {
            // With a wave, the simulated position differs from the true one. The record has the true position.
            let wave = waves::of(&hypotheses[*k].entry(kind, &guess.values).arguments);
            traces.as_ref().zip(wave).map_or_else(Vec::new, |(traces, wave)| traces.traces(&wave).into())
        }
    })
}

/// A guess relative to the current fit. A parameter error starts at the calibrated value, not at the value of the file, because calibration may have
/// reached the end of the tolerance. A general case takes the level of its accepted special case.
fn relative_to_fit(fit: &Fit, hypothesis: &Hypothesis, guess: &Guess) -> Guess {
    let mut special = fit.model.file.effects.iter().filter(|it| generalises(hypothesis.description.kind, it.description.kind));
    if let Some(level) = special.next().and_then(|it| it.arguments.numbers.first()).map(|number| number.1) {
        return from_level(hypothesis, guess, level);
    }
    let subject = hypothesis.subject.filter(|_| hypothesis.description.subject == Subject::Parameter);
    let Some(now) = subject.and_then(|name| fit.model.file.parameters.optional(name)) else { return guess.clone() };
    let without = guess.neutral.map_or(now, |(_, without)| without);
    Guess { values: guess.values.iter().map(|value| value - without + now).collect(), neutral: Some((0, now)), ..guess.clone() }
}

/// A guess with the lowest level equal to the accepted one and the others higher by half of it: near enough for a first-order screen.
fn from_level(hypothesis: &Hypothesis, guess: &Guess, level: f64) -> Guess {
    let is_level: Vec<bool> = hypothesis.description.arguments.iter().map(|it| it.is_level).collect();
    let levels = guess.values.iter().zip(&is_level).filter(|(_, is)| **is).map(|(value, _)| *value);
    let (low, high) = order::ends(levels);
    let spread = if high > low { 0.5 * level / (high - low) } else { 0.0 };
    let each = guess.values.iter().zip(&is_level).map(|(value, is)| if *is { level + spread * (value - low) } else { *value });
    Guess { values: each.collect(), ..guess.clone() }
}

/// The fitted model with a hypothesis at these parameters and nothing else changed.
fn at(model: &Model, nominal: &Model, hypothesis: &Hypothesis, values: &[f64], kind: PlantKind) -> Model {
    let mut with = model.joined(nominal, hypothesis.entry(kind, values));
    if !with.is_possible() {
        with = model.clone();
    }
    with
}

/// The joint gain of some traces, and the share of each. `None` if one is dependent on the free unknowns.
fn joint_gain(nuisance: &Nuisance<'_>, traces: &[&[f64]], products: &[&[f64]]) -> Option<(Vec<f64>, f64)> {
    let mut back = nuisance.all_released();
    while let Some((share, gain)) = joint_gain_released(nuisance, traces, products, back) {
        let still = nuisance.still_released(&share, products, back);
        if still == back {
            return Some((share, gain));
        }
        back = still;
    }
    // A released unknown can also make the trace. Of the sets of released unknowns that are consistent with the trace, the one with the largest gain
    // is used.
    let sets = (0..back).filter(|set| set & back == *set);
    let stand = sets.filter_map(|set| {
        let found = joint_gain_released(nuisance, traces, products, set)?;
        (nuisance.still_released(&found.0, products, set) == set).then_some(found)
    });
    stand.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// The same with these unknowns released.
fn joint_gain_released(
    nuisance: &Nuisance<'_>,
    traces: &[&[f64]],
    products: &[&[f64]],
    back: Released,
) -> Option<(Vec<f64>, f64)> {
    let n = traces.len();
    let matrix = symmetric(n, |i, j| nuisance.between(dot(traces[i], traces[j]), products[i], products[j], back));
    let has_own = |i: usize| matrix[i * n + i] > LEAST_INDEPENDENT_SHARE * dot(traces[i], traces[i]);
    if !(0..n).all(has_own) {
        return None;
    }
    let right: Vec<f64> = (0..n).map(|i| nuisance.with_residual(traces[i], products[i], back)).collect();
    let (share, gain) = Normal::new(&matrix, n, 0.0).gain(&right);
    gain.is_finite().then(|| (share, gain + nuisance.gain_of(back)))
}

/// The parameters of a guess for these shares of its traces; `None` if physics forbids the sign.
pub(super) fn scaled(guess: &Guess, share: &[f64], hypothesis: &Hypothesis, kind: PlantKind) -> Option<Vec<f64>> {
    let mut values = guess.values.clone();
    match (guess.neutral, guess.phase) {
        (Some((place, _)), Some(phase)) => {
            // share_0 sin(x) + share_1 cos(x) = R sin(x + angle)
            values[place] *= share[0].hypot(share[1]);
            values[phase] += share[1].atan2(share[0]);
        }
        (Some((place, without)), None) => {
            // Beyond ten times the guess, the linear approximation is not valid.
            values[place] = without + share[0].clamp(-10.0, 10.0) * (values[place] - without);
        }
        _ if share[0] <= 0.0 => return None,
        _ => {}
    }
    hypothesis.has_signs(kind, &values).then_some(values)
}

fn judge(
    nuisance: &Nuisance<'_>,
    hypotheses: &[Hypothesis],
    which: usize,
    guess: &Guess,
    traces: Vec<Vec<f64>>,
) -> Option<Screened> {
    let products: Vec<Vec<f64>> = traces.iter().map(|trace| nuisance.products(trace)).collect();
    let lists: (Vec<&[f64]>, Vec<&[f64]>) =
        (traces.iter().map(Vec::as_slice).collect(), products.iter().map(Vec::as_slice).collect());
    let (share, gain) = joint_gain(nuisance, &lists.0, &lists.1)?;
    let asked = scaled(guess, &share, &hypotheses[which], nuisance.fit.model.file.kind);
    let gain = if asked.is_some() { gain.max(0.0) } else { 0.0 };
    let values = asked.unwrap_or_else(|| guess.values.clone());
    Some(Screened { hypothesis: which, values, gain, group: None, guess: guess.clone(), traces, products })
}

/// Two guesses that together explain what neither explains alone.
#[derive(Debug, Clone)]
pub struct Pair {
    /// The hypotheses with their parameters, scaled jointly to the residual.
    pub parts: [(usize, Vec<f64>); 2],
    /// Predicted gain.
    pub gain: f64,
    /// The gain beyond that of the better part alone.
    pub beyond: f64,
}

/// A pair with less than this share of the best predicted gain is not tried. A first-order prediction is not as wrong as that.
const NEAR_THE_BEST: f64 = 0.8;

/// The joint gain of all pairs of some screened guesses, because a guess that another one masks has no gain alone. The list alternates between the
/// pair with the largest gain and the pair with the largest gain beyond its parts. All pairs with the largest gain contain the strongest single
/// cause, and a search that adds one cause at a time tries those anyway.
#[must_use]
pub fn pairs(fit: &Fit, hypotheses: &[Hypothesis], screened: &[&Screened]) -> Vec<Pair> {
    let nuisance = Nuisance::new(fit);
    let kind = fit.model.file.kind;
    let mut list: Vec<Pair> = Vec::new();
    for (k, a) in screened.iter().enumerate() {
        for b in &screened[..k] {
            let kinds = [a, b].map(|it| hypotheses[it.hypothesis].description.kind);
            let [one, other] = [a, b].map(|it| &hypotheses[it.hypothesis]);
            // An effect in all configurations and in one of them is one effect.
            let is_one = one.subject == other.subject && kinds[0] == kinds[1];
            if is_one || generalises(kinds[0], kinds[1]) || generalises(kinds[1], kinds[0]) {
                continue;
            }
            let traces: Vec<&[f64]> = a.traces.iter().chain(&b.traces).map(Vec::as_slice).collect();
            let products: Vec<&[f64]> = a.products.iter().chain(&b.products).map(Vec::as_slice).collect();
            let Some((share, gain)) = joint_gain(&nuisance, &traces, &products) else { continue };
            let (first, second) = share.split_at(a.traces.len());
            let first = scaled(&a.guess, first, &hypotheses[a.hypothesis], kind);
            let second = scaled(&b.guess, second, &hypotheses[b.hypothesis], kind);
            if let (Some(first), Some(second)) = (first, second) {
                let parts = [(a.hypothesis, first), (b.hypothesis, second)];
                list.push(Pair { parts, gain, beyond: gain - a.gain.max(b.gain) });
            }
        }
    }
    order::descending(&mut list, |it| it.gain);
    let least = list.first().map_or(0.0, |best| NEAR_THE_BEST * best.gain);
    list.retain(|it| it.gain >= least);
    let mut joint = list.clone();
    order::descending(&mut joint, |it| it.beyond);
    joint.into_iter().zip(list).flat_map(|(joint, strong)| [joint, strong]).collect()
}

/// The gain that noise alone gives the best of all hypotheses in 99 of 100 cases. It is computed from residuals drawn with the noise floors, and the
/// traces and free unknowns of the screen. No further simulation is needed: to first order, the gain is the projection of the noise on the trace.
/// Rounded outputs (place, step) get the error of rounding the simulation plus its noise, which is not white if the motion is slow or periodic.
#[must_use]
pub fn null(whitened: &WhitenedResiduals, fit: &Fit, screened: &[Screened], rounded: &[(usize, f64)], draws: usize) -> f64 {
    let nuisance = Nuisance::new(fit);
    let mut random = Random::new(1);
    let normal = |it: &Screened| {
        let between = |i: usize, j: usize| dot(&it.traces[i], &it.traces[j]);
        let matrix = symmetric(it.traces.len(), |i, j| nuisance.between(between(i, j), &it.products[i], &it.products[j], 0));
        Normal::new(&matrix, it.traces.len(), 0.0)
    };
    let normals: Vec<Normal> = screened.iter().map(normal).collect();
    let mut largest: Vec<f64> = Vec::new();
    // Numbers are drawn one after the other; what follows does not change them.
    let threads = whitened.threads.max(1);
    for first in (0..draws).step_by(threads) {
        let noises: Vec<Vec<f64>> =
            (first..draws.min(first + threads)).map(|_| drawn(whitened, fit, rounded, &mut random)).collect();
        largest.extend(in_threads(&noises, threads, |noise| {
            let solved = nuisance.solved(&nuisance.products(noise));
            let gains = screened.iter().zip(&normals).map(|(it, normal)| {
                let each = it.traces.iter().zip(&it.products);
                normal.gain(&each.map(|(trace, products)| dot(trace, noise) - dot(products, &solved)).collect::<Vec<_>>()).1
            });
            gains.fold(0.0, f64::max)
        }));
    }
    point_of_largest(&largest)
}

/// A drawn whitened residual of a plant without any discrepancy.
fn drawn(whitened: &WhitenedResiduals, fit: &Fit, rounded: &[(usize, f64)], random: &mut Random) -> Vec<f64> {
    let mut stack = null::noise(whitened, random);
    let mut first = 0;
    for (prepared, simulated) in whitened.records.iter().zip(&fit.simulated) {
        for (k, values) in simulated.iter().enumerate() {
            let output = prepared.outputs[k];
            if let Some((_, step)) = rounded.iter().find(|(it, _)| *it == output) {
                let floor = &whitened.floors[output];
                // If the noise before rounding is not known, step^2/12 of the floor's variance is attributed to rounding.
                let before = floor.rounding.map_or((floor.sd * floor.sd - step * step / 12.0).max(0.0).sqrt(), |it| it.noise);
                // Its correlation from row to row is at least that of the floor.
                let correlation = floor.correlation;
                let mut noise = before * random.normal();
                let errors: Vec<f64> = values
                    .iter()
                    .map(|value| {
                        noise = correlation * noise + before * (1.0 - correlation * correlation).sqrt() * random.normal();
                        step * ((value + noise) / step).round() - floor.mean_reading(*value)
                    })
                    .collect();
                let mut white = Vec::with_capacity(errors.len());
                floor.whiten(&errors, &prepared.used[k], &mut white);
                stack[first..first + white.len()].copy_from_slice(&white);
            }
            first += values.len();
        }
    }
    stack
}

impl Screened {
    /// For tests: a guess with one parameter and a predicted gain.
    #[cfg(test)]
    pub fn with_gain(hypothesis: usize, gain: f64, group: Option<usize>) -> Self {
        let guess = Guess::scaled(vec![1.0], 0.0);
        Screened { hypothesis, values: vec![1.0], gain, group, guess, traces: Vec::new(), products: Vec::new() }
    }

    /// Removes the traces, which need much memory.
    pub fn without_traces(&mut self) {
        self.traces = Vec::new();
    }
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, hypotheses, levenberg, survey};
    use super::*;
    use rsm_sim::equation_plant::{effect, servo_axis};

    #[test]
    fn causes_of_one_trace_are_one_group_and_others_are_not() {
        // From rest and in open loop the gain of the command, the force per volt and the gain of the position are one; friction is another, and so is
        // a bias beside a free start.
        let file = |effects: &str| axis_under_steps::file("", effects);
        let (whitened, model) = axis_under_steps::whitened(&file(""), &file(&axis_under_steps::friction(0.02)), true);
        let fit = levenberg::fit(&whitened, model.clone(), 8).unwrap();
        let all = hypotheses::all(model.file.kind, &survey::survey(&whitened, &fit), &[0]);
        let screened = screen(&whitened, &fit, &model, &all);
        let group = |label: &str| {
            let it = screened.iter().filter(|it| all[it.hypothesis].label() == label && it.group.is_some());
            it.max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap().group
        };
        assert_eq!(group("input-gain"), group("parameter-error:force_gain"));
        assert_eq!(group("input-gain"), group("sensor-gain:position"));
        assert_ne!(group("input-gain"), group("coulomb-friction"));
    }

    #[test]
    fn a_guess_that_stops_the_plant_is_taken_smaller() {
        let file = |effects: &str| axis_under_steps::file("", effects);
        let (whitened, model) = axis_under_steps::whitened(&file(""), &file(&axis_under_steps::friction(0.02)), false);
        let fit = levenberg::fit(&whitened, model.clone(), 8).unwrap();
        // The largest effort is 8 N: 20 N hold the axis where it is.
        let guesses = vec![Guess::scaled(vec![20.0], 0.0)];
        let hypotheses = [Hypothesis {
            description: effect(servo_axis(), "coulomb-friction").unwrap(),
            subject: None,
            configuration: None,
            guesses,
        }];
        let screened = screen(&whitened, &fit, &model, &hypotheses);
        // A smooth law of friction is in proportion but for what the few rows at rest differ.
        assert!((screened[0].values[0] / 0.02 - 1.0).abs() < 0.2, "{:?}", screened[0].values);
        assert!(screened[0].gain > 0.9 * fit.cost, "{} of {}", screened[0].gain, fit.cost);
    }
}

//! Directions in parameter space that the records do not determine. Example: if a force, a mass and a friction grow by the same factor, no output
//! changes, so only tolerances determine this factor.
//!
//! In: a fit. Out: the same fit, converged within a tenth of a standard deviation in every direction, with derivatives that are valid along open
//! directions too. A one-sided derivative for a single unknown has an error from the curvature over its step. Along a direction in which the
//! contributions of several unknowns cancel, only these errors are left, and they look like information that the records do not contain. Derivatives
//! are therefore computed again along those directions, as central differences over one standard deviation. Does not change the set of unknowns.

use super::levenberg::{Equations, Fit};
use super::model::{Model, Place};
use super::whitened_residuals::{Column, WhitenedResiduals};
use crate::engine::normal::Normal;

/// A direction is open if its posterior standard deviation is more than this share of its prior one. Errors from curvature can simulate information
/// down to a thousandth.
const UNIDENTIFIED: f64 = 1e-3;

/// The number of rounds in which directions are measured. The first ones are too short, because of the curvature errors; later ones are longer.
const MEASURING_ROUNDS: usize = 3;

/// A direction has its final length if it grew by less than this share.
const SAME_LENGTH: f64 = 0.05;

/// Rounds of steps.
const ROUNDS: usize = 4;

/// Steps of a round with one set of derivatives. The minimum along an open direction is curved, so a step ends beside it and the next one corrects
/// that.
const STEPS: usize = 6;

/// A step with a smaller predicted gain, in squared standard deviations, changes no parameter by more than a tenth of its standard deviation.
const AT_ITS_END: f64 = 0.01;

/// A direction, one standard deviation long.
struct Direction {
    /// The change of each unknown, on the scale of its search.
    step: Vec<f64>,
    /// For each unknown, the factor that gives its share of a derivative: the inverse of `step` among all directions.
    share: Vec<f64>,
    /// The posterior standard deviation along it, as a share of the prior one.
    left: f64,
}

/// The converged fit. If it cannot be improved it is returned with accurate derivatives.
#[must_use]
pub fn converged(whitened: &WhitenedResiduals, fit: Fit) -> Fit {
    let mut best = fit;
    for _ in 0..ROUNDS {
        let columns = corrected(whitened, &best);
        let (mut model, mut simulated, mut residual) = (best.model.clone(), best.simulated.clone(), best.residual.clone());
        let mut end = Equations::new(&model, &columns, &residual);
        for _ in 0..STEPS {
            let change = end.newton(&model);
            let predicted = end.predicted_gain(&change);
            if predicted.is_nan() || predicted < AT_ITS_END {
                break;
            }
            let moved = end.moved(&model, &change);
            let Some(run) = whitened.run(&moved) else { break };
            residual = whitened.residual(&run);
            (model, simulated) = (moved, run);
            end = Equations::new(&model, &columns, &residual);
        }
        let there = end.fit(model, simulated, residual);
        let gained = best.cost - there.cost;
        let from = Equations::new(&best.model, &columns, &best.residual);
        best = if gained > 0.0 { there } else { from.fit(best.model, best.simulated, best.residual) };
        if gained < AT_ITS_END {
            break;
        }
    }
    best
}

/// Derivatives for all unknowns of a fit in their order, measured along open directions.
fn corrected(whitened: &WhitenedResiduals, fit: &Fit) -> Vec<Column> {
    let mut columns: Vec<Option<Column>> = vec![None; fit.model.unknowns.len()];
    for (k, column) in fit.free.iter().zip(&fit.columns) {
        columns[*k] = Some(column.clone());
    }
    for held in &fit.held {
        columns[held.unknown] = Some(held.column.clone());
    }
    // Every unknown is either free or held.
    let mut columns: Vec<Column> = columns.into_iter().flatten().collect();
    let mut lengths: Vec<f64> = Vec::new();
    for _ in 0..MEASURING_ROUNDS {
        let directions = directions(&fit.model, &columns);
        let now: Vec<f64> = directions.iter().map(|it| it.left).collect();
        let is_same = |(a, b): (&f64, &f64)| (a / b - 1.0).abs() < SAME_LENGTH;
        if directions.is_empty() || lengths.len() == now.len() && lengths.iter().zip(&now).all(is_same) {
            break;
        }
        lengths = now;
        for direction in &directions {
            let Some(seen) = along(whitened, &fit.model, &direction.step) else { continue };
            let mut missed = seen;
            for (step, column) in direction.step.iter().zip(&columns) {
                for (missed, value) in missed[column.first..].iter_mut().zip(&column.values) {
                    *missed -= step * value;
                }
            }
            for (share, column) in direction.share.iter().zip(&mut columns) {
                if *share != 0.0 {
                    for (value, missed) in column.values.iter_mut().zip(&missed[column.first..]) {
                        *value += share * missed;
                    }
                }
            }
        }
    }
    columns
}

/// The whitened change of all records along a direction, as a central difference; `None` if the plant cannot be simulated there.
fn along(whitened: &WhitenedResiduals, model: &Model, step: &[f64]) -> Option<Vec<f64>> {
    let to = |sign: f64| {
        let mut moved = model.clone();
        for (k, step) in step.iter().enumerate() {
            let unknown = &model.unknowns[k];
            let searched = unknown.to_search_scale(model.value(k)) + sign * step;
            // A tolerance limits a search; derivatives beyond it are valid.
            let value = if unknown.logarithmic { searched.exp() } else { searched };
            let is_possible = matches!(unknown.place, Place::Nominal(_)) || (unknown.low..=unknown.high).contains(&value);
            if !is_possible {
                return None;
            }
            moved.set(k, value);
        }
        whitened.run(&moved)
    };
    let (back, forth) = (to(-1.0)?, to(1.0)?);
    Some(whitened.changes(&back, &forth, 2.0))
}

/// Open directions: combinations of the unknowns with priors that are determined mostly by the priors, with the changes of all other unknowns.
fn directions(model: &Model, columns: &[Column]) -> Vec<Direction> {
    let all: Vec<usize> = (0..model.unknowns.len()).collect();
    let priors: Vec<(usize, f64)> = all.iter().filter_map(|&k| model.unknowns[k].prior.map(|(_, sd)| (k, sd))).collect();
    let normal = Normal::fine(&super::levenberg::gram(model, &all, columns), all.len());
    let covariances: Vec<Vec<f64>> = priors.iter().map(|(k, _)| normal.covariances(*k)).collect();
    let n = priors.len();
    let mut left = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            left[i * n + j] = covariances[i][priors[j].0] / (priors[i].1 * priors[j].1);
        }
    }
    let mut list = Vec::new();
    for (value, vector) in eigen(left, n) {
        if value < UNIDENTIFIED * UNIDENTIFIED || value.is_nan() {
            continue;
        }
        // v = C P^(1/2) w/sqrt(value), of length one by the posterior, and its inverse H v = P^(1/2) w/sqrt(value).
        let weights: Vec<f64> = vector.iter().zip(&priors).map(|(w, (_, sd))| w / (sd * value.sqrt())).collect();
        let step = all.iter().map(|&k| weights.iter().zip(&covariances).map(|(w, c)| w * c[k]).sum()).collect();
        let mut share = vec![0.0; all.len()];
        for (weight, (k, _)) in weights.iter().zip(&priors) {
            share[*k] = *weight;
        }
        list.push(Direction { step, share, left: value.sqrt() });
    }
    list
}

/// Eigenvalues and eigenvectors of a small symmetric matrix, by rotations (C. G. J. Jacobi, 1846), in a fixed order.
fn eigen(mut a: Vec<f64>, n: usize) -> Vec<(f64, Vec<f64>)> {
    let mut vectors = vec![0.0; n * n];
    (0..n).for_each(|k| vectors[k * n + k] = 1.0);
    // Each sweep squares the off-diagonal elements; ten are more than enough for f64.
    for _ in 0..10 {
        for p in 0..n {
            for q in p + 1..n {
                if a[p * n + q] == 0.0 {
                    continue;
                }
                let theta = (a[q * n + q] - a[p * n + p]) / (2.0 * a[p * n + q]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a[k * n + p], a[k * n + q]);
                    (a[k * n + p], a[k * n + q]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[p * n + k], a[q * n + k]);
                    (a[p * n + k], a[q * n + k]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (vectors[k * n + p], vectors[k * n + q]);
                    (vectors[k * n + p], vectors[k * n + q]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    (0..n).map(|k| (a[k * n + k], (0..n).map(|row| vectors[row * n + k]).collect())).collect()
}

#[cfg(test)]
mod tests {
    use super::super::noise::NoiseFloor;
    use super::super::posterior::{Posterior, REACH};
    use super::super::{axis_under_steps, levenberg};
    use super::*;
    use rsm_fit::random::Random;
    use rsm_sim::kind::OUTPUTS;

    const TOLERANCES: &str = "mass = 0.02\nviscous_friction = 0.02";

    /// Standard deviation of a good encoder, in m: the axis moves by 10^5 times as much, and derivatives by one unknown alone miss most where
    /// readings are best.
    const NOISE: f64 = 1e-7;

    /// An axis of which mass, friction and gain may grow together, parameters off as their tolerances say: a fit of it, and what is true of its
    /// unknowns.
    fn symmetric(random: &mut Random) -> (WhitenedResiduals, Fit, Vec<Option<f64>>) {
        let mut off = || loop {
            // What is beyond two standard deviations of a tolerance is a cause.
            let off = random.normal();
            if off.abs() < 2.0 {
                break off;
            }
        };
        let (mass, friction) = (2.0 * (1.0 + 0.02 * off()), 3.0 * (1.0 + 0.02 * off()));
        let effects = axis_under_steps::friction(0.8) + "[[effects]]\nkind = \"input-gain\"\nparameters = { gain = 0.9 }\n";
        let mut truth = axis_under_steps::file(TOLERANCES, &effects);
        truth.parameters.set("mass", mass);
        truth.parameters.set("viscous_friction", friction);
        let (mut whitened, nominal) = axis_under_steps::whitened(&axis_under_steps::file(TOLERANCES, ""), &truth, false);
        for value in whitened.records[0].record.measured[0].as_mut().unwrap() {
            *value += NOISE * random.normal();
        }
        whitened.floors = [NoiseFloor::white(NOISE); OUTPUTS];
        let fit = levenberg::fit(&whitened, nominal.with_effects(&nominal, truth.effects.clone()), 8).unwrap();
        let true_value = |place| match place {
            Place::Nominal("mass") => Some(mass),
            Place::Nominal(_) => Some(friction),
            Place::Effect { number: "gain", .. } => Some(0.9),
            Place::Effect { .. } => Some(0.8),
            Place::Start { .. } => None,
        };
        let truths = fit.model.unknowns.iter().map(|it| true_value(it.place)).collect();
        (whitened, fit, truths)
    }

    #[test]
    fn intervals_beside_a_symmetry_hold_the_truth_and_those_of_one_deviation_do_not() {
        let mut random = Random::new(17);
        let draws = 120;
        let (mut held, mut by_one_deviation) = ([0; 4], [0; 4]);
        for _ in 0..draws {
            let (whitened, fit, truths) = symmetric(&mut random);
            let fit = converged(&whitened, fit);
            let posterior = Posterior::of(&fit);
            for (k, truth) in truths.iter().enumerate().filter_map(|(k, truth)| Some((k, (*truth)?))) {
                let (low, high) = posterior.interval(&fit, k).unwrap();
                let value = fit.model.value(k);
                held[k] += usize::from(low <= truth && truth <= high);
                let narrow = |end: f64| value + (end - value) / REACH;
                by_one_deviation[k] += usize::from(narrow(low) <= truth && truth <= narrow(high));
            }
        }
        // 95 % of 120 is 114, with a standard deviation of 2.4, three times.
        let as_wanted = |held: &[usize; 4]| held.iter().all(|held| (107..draws).contains(held));
        assert!(as_wanted(&held) && !as_wanted(&by_one_deviation), "{held:?}, by one standard deviation {by_one_deviation:?}");
        assert!(by_one_deviation.iter().all(|held| *held < 107), "{by_one_deviation:?}");
    }

    #[test]
    fn eigenvectors_by_hand() {
        // [2 1; 1 2]: 1 along (1, -1), 3 along (1, 1).
        let mut found = eigen(vec![2.0, 1.0, 1.0, 2.0], 2);
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert!((found[0].0 - 1.0).abs() < 1e-14 && (found[1].0 - 3.0).abs() < 1e-14, "{found:?}");
        assert!((found[0].1[0] + found[0].1[1]).abs() < 1e-14 && (found[1].1[0] - found[1].1[1]).abs() < 1e-14);
    }
}

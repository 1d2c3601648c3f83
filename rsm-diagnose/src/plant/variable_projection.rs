//! Hypotheses fitted by their own numbers, with all other free unknowns eliminated to first order (variable projection; G. H. Golub, V. Pereyra, 1973).
//!
//! In: a fitted model, the same model with further causes, numbers to begin with. Out: the best numbers and the squared residual there. It takes one simulation for each number and step, so
//! every hypothesis that the screen keeps can be fitted. Never moves a start or a calibration for good.

use super::model::{Model, Place};
use super::normal::Normal;
use super::nuisance::Nuisance;
use super::whitened_residuals::{WhitenedResiduals, dot};
use rsm_sim::plant_file::Entry;

/// A step that gains less, in units of squared residuals whose noise is one, ends the search.
const ENOUGH: f64 = 1.0;

/// A per mille of what is left is less than what full fits decide later.
const ENOUGH_SHARE: f64 = 1e-3;

/// A hypothesis with its best numbers.
#[derive(Debug, Clone)]
pub struct Projected {
    /// Which hypothesis.
    pub hypothesis: usize,
    /// Its entry.
    pub entry: Entry,
    /// Squared residual that is left, in first order of what is free.
    pub cost: f64,
}

/// Improves the numbers of the causes from `first` on, in at most so many steps; also their cost. `None` where it cannot be simulated.
#[must_use]
pub fn project(
    whitened: &WhitenedResiduals,
    nuisance: &Nuisance<'_>,
    model: Model,
    first: usize,
    steps: usize,
) -> Option<(Model, f64)> {
    let mut model = model;
    let own: Vec<usize> = (0..model.unknowns.len())
        .filter(|&k| matches!(model.unknowns[k].place, Place::Effect { entry, .. } if entry >= first))
        .collect();
    // Numbers of a guess may lie beyond what physics allows.
    for &k in &own {
        let unknown = &model.unknowns[k];
        let value = model.value(k).max(unknown.low).min(unknown.high);
        model.set(k, value);
    }
    if !model.is_possible() {
        return None;
    }
    let mut simulated = whitened.run(&model)?;
    let mut residual = whitened.residual(&simulated);
    let (mut cost, mut back) = nuisance.left(&residual);
    let mut damping = 1e-3;
    for _ in 0..steps {
        if whitened.pace.is_spent() {
            break;
        }
        let columns = whitened.derivatives(&model, &simulated, &own)?;
        let n = own.len();
        if n == 0 {
            break;
        }
        let products: Vec<Vec<f64>> = columns.iter().map(|column| nuisance.products(&column.values)).collect();
        let mut matrix = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                matrix[i * n + j] = nuisance.between(columns[i].and(&columns[j]), &products[i], &products[j], back);
            }
        }
        let left = nuisance.products(&residual);
        let pull: Vec<f64> =
            (0..n).map(|i| nuisance.between(dot(&columns[i].values, &residual), &products[i], &left, back)).collect();
        let before = cost;
        for _ in 0..4 {
            let change = Normal::new(&matrix, n, damping).solve(&pull);
            let promised: f64 = change.iter().zip(&pull).map(|(change, pull)| change * pull).sum();
            if promised < ENOUGH.max(ENOUGH_SHARE * cost) {
                break;
            }
            let mut trial = model.clone();
            for (&k, change) in own.iter().zip(&change) {
                let unknown = &model.unknowns[k];
                let limit = if unknown.logarithmic { 1.5 } else { f64::INFINITY };
                let at = unknown.inward(model.value(k)) + change.clamp(-limit, limit);
                trial.set(k, unknown.outward(at));
            }
            let better = if trial.is_possible() { whitened.run(&trial) } else { None };
            let better = better.map(|simulated| {
                let residual = whitened.residual(&simulated);
                (nuisance.left(&residual), simulated, residual)
            });
            match better {
                Some(((trial_cost, trial_way), trial_simulated, trial_residual)) if trial_cost < cost => {
                    (model, simulated, residual, cost) = (trial, trial_simulated, trial_residual, trial_cost);
                    back = trial_way;
                    damping = (damping / 10.0).max(1e-9);
                    break;
                }
                _ => damping = (damping * 10.0).max(1e-6),
            }
        }
        if before - cost < ENOUGH.max(ENOUGH_SHARE * cost) {
            break;
        }
    }
    Some((model, cost))
}

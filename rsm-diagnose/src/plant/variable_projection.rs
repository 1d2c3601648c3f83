//! Hypotheses fitted by their own parameters, with all other free unknowns eliminated to first order (variable projection; G. H. Golub, V. Pereyra,
//! 1973).
//!
//! In: a fitted model, the same model with further causes, first values of their parameters. Out: the best parameters and the squared residual. A
//! step takes one simulation for each parameter, so every hypothesis that passes the screen can be fitted. Initial states and calibration are not
//! changed permanently.

use super::model::{Model, Place};
use super::nuisance::{Nuisance, Released};
use super::whitened_residuals::{Column, Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::levenberg::{CostTolerance, Problem, Rules, descend};
use crate::engine::normal::{Normal, symmetric};
use rsm_sim::plant_file::Entry;

/// A step that gains less, in squared residuals with unit noise, ends the search.
const LEAST_GAIN: f64 = 1.0;

/// The same relative to the cost; full fits decide later on larger differences.
const LEAST_GAIN_SHARE: f64 = 1e-3;

/// The largest change of a logarithm in a step: a factor of 4.5.
const LARGEST_LOG_STEP: f64 = 1.5;

/// A hypothesis with its fitted parameters.
#[derive(Debug, Clone)]
pub struct Projected {
    /// The index of the hypothesis.
    pub hypothesis: usize,
    /// Its entry.
    pub entry: Entry,
    /// The squared residual after a first-order step of the free unknowns.
    pub cost: f64,
}

/// The current point of the search.
struct Iterate {
    model: Model,
    simulated: Vec<Simulated>,
    residual: Vec<f64>,
    /// The squared residual after a first-order step of the other free unknowns, and which unknowns that step releases from their bounds.
    left: (f64, Released),
}

/// The parameters of some causes, with all other free unknowns eliminated.
struct OwnParameters<'a> {
    whitened: &'a WhitenedResiduals,
    nuisance: &'a Nuisance<'a>,
    /// The indices of the parameters among the unknowns.
    own: Vec<usize>,
}

impl OwnParameters<'_> {
    fn iterate(&self, model: Model) -> Option<Iterate> {
        let simulated = model.is_possible().then(|| self.whitened.run(&model))??;
        let residual = self.whitened.residual(&simulated);
        Some(Iterate { left: self.nuisance.remaining_square(&residual), model, simulated, residual })
    }
}

impl Problem for OwnParameters<'_> {
    type Iterate = Iterate;
    type Derivatives = Vec<Column>;
    /// The matrix and the right-hand side after the free unknowns are projected out.
    type Equations = (Vec<f64>, Vec<f64>);

    fn cost(&self, at: &Iterate) -> f64 {
        at.left.0
    }

    fn derivatives(&self, at: &Iterate) -> Option<Vec<Column>> {
        self.whitened.derivatives(&at.model, &at.simulated, &self.own)
    }

    fn equations(&self, at: &Iterate, columns: &Vec<Column>) -> Self::Equations {
        let (n, nuisance, back) = (columns.len(), self.nuisance, at.left.1);
        let products: Vec<Vec<f64>> = columns.iter().map(|column| nuisance.products(&column.values)).collect();
        let matrix = symmetric(n, |i, j| nuisance.between(columns[i].dot(&columns[j]), &products[i], &products[j], back));
        let left = nuisance.products(&at.residual);
        let asked = |i: usize| nuisance.between(dot(&columns[i].values, &at.residual), &products[i], &left, back);
        (matrix, (0..n).map(asked).collect())
    }

    fn step(&self, _: &Iterate, (matrix, pull): &Self::Equations, damping: f64) -> (Vec<f64>, f64) {
        Normal::new(matrix, pull.len(), damping).gain(pull)
    }

    fn moved(&self, at: &Iterate, _: &Self::Equations, step: &[f64]) -> Option<Iterate> {
        let mut model = at.model.clone();
        for (&k, change) in self.own.iter().zip(step) {
            let unknown = &at.model.unknowns[k];
            let limit = if unknown.logarithmic { LARGEST_LOG_STEP } else { f64::INFINITY };
            model.set(k, unknown.plant_value(unknown.to_search_scale(at.model.value(k)) + change.clamp(-limit, limit)));
        }
        self.iterate(model)
    }

    fn may_continue(&self) -> bool {
        !self.whitened.work.is_limit_reached()
    }
}

/// Improves the parameters of the causes from `first` on, in at most `steps` steps. Returns the cost too. `None` if the model cannot be simulated.
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
    // The parameters of a guess may be beyond their physical bounds.
    for &k in &own {
        let unknown = &model.unknowns[k];
        let value = model.value(k).max(unknown.low).min(unknown.high);
        model.set(k, value);
    }
    let problem = OwnParameters { whitened, nuisance, own };
    let start = problem.iterate(model)?;
    if steps == 0 || problem.own.is_empty() || !problem.may_continue() {
        return Some((start.model, start.left.0));
    }
    let enough = CostTolerance { absolute: LEAST_GAIN, relative: LEAST_GAIN_SHARE };
    let rules = Rules {
        steps,
        tries: [4; 2],
        least_predicted_gain: Some(enough),
        retries_undamped: false,
        least_gain: enough,
        least_gain_ratio: 0.0,
        follows_valleys: false,
        ends_exact: false,
    };
    let (at, _) = descend(&problem, start, None, &rules)?;
    Some((at.model, at.left.0))
}

//! Hypotheses fitted by their own numbers, with all other free unknowns eliminated to first order (variable projection; G. H. Golub, V. Pereyra, 1973).
//!
//! In: a fitted model, the same model with further causes, numbers to begin with. Out: the best numbers and the squared residual there. It takes one simulation for each number and step, so
//! every hypothesis that the screen keeps can be fitted. Never moves a start or a calibration for good.

use super::model::{Model, Place};
use super::nuisance::{Back, Nuisance};
use super::whitened_residuals::{Column, Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::levenberg::{Amount, Problem, Rules, descend};
use crate::engine::normal::{Normal, symmetric};
use rsm_sim::plant_file::Entry;

/// A step that gains less, in units of squared residuals whose noise is one, ends the search.
const ENOUGH: f64 = 1.0;

/// A per mille of what is left is less than what full fits decide later.
const ENOUGH_SHARE: f64 = 1e-3;

/// A logarithm may not jump by more in a step: a factor of 4.5.
const FARTHEST: f64 = 1.5;

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

/// Where a search for numbers stands.
struct Standing {
    model: Model,
    simulated: Vec<Simulated>,
    residual: Vec<f64>,
    /// What is left when all that is free otherwise moves as it likes, and which unknowns come back from their bounds for that.
    left: (f64, Back),
}

/// The numbers of some causes, with all that is free otherwise eliminated.
struct OwnNumbers<'a> {
    whitened: &'a WhitenedResiduals,
    nuisance: &'a Nuisance<'a>,
    /// Places of the numbers among the unknowns.
    own: Vec<usize>,
}

impl OwnNumbers<'_> {
    fn standing(&self, model: Model) -> Option<Standing> {
        let simulated = model.is_possible().then(|| self.whitened.run(&model))??;
        let residual = self.whitened.residual(&simulated);
        Some(Standing { left: self.nuisance.left(&residual), model, simulated, residual })
    }
}

impl Problem for OwnNumbers<'_> {
    type Place = Standing;
    type Derivatives = Vec<Column>;
    /// Inner products without what is free, and what the residual asks.
    type Equations = (Vec<f64>, Vec<f64>);

    fn cost(&self, at: &Standing) -> f64 {
        at.left.0
    }

    fn derivatives(&self, at: &Standing) -> Option<Vec<Column>> {
        self.whitened.derivatives(&at.model, &at.simulated, &self.own)
    }

    fn equations(&self, at: &Standing, columns: &Vec<Column>) -> Self::Equations {
        let (n, nuisance, back) = (columns.len(), self.nuisance, at.left.1);
        let products: Vec<Vec<f64>> = columns.iter().map(|column| nuisance.products(&column.values)).collect();
        let matrix = symmetric(n, |i, j| nuisance.between(columns[i].and(&columns[j]), &products[i], &products[j], back));
        let left = nuisance.products(&at.residual);
        let asked = |i: usize| nuisance.between(dot(&columns[i].values, &at.residual), &products[i], &left, back);
        (matrix, (0..n).map(asked).collect())
    }

    fn step(&self, _: &Standing, (matrix, pull): &Self::Equations, damping: f64) -> (Vec<f64>, f64) {
        Normal::new(matrix, pull.len(), damping).gain(pull)
    }

    fn moved(&self, at: &Standing, _: &Self::Equations, step: &[f64]) -> Option<Standing> {
        let mut model = at.model.clone();
        for (&k, change) in self.own.iter().zip(step) {
            let unknown = &at.model.unknowns[k];
            let limit = if unknown.logarithmic { FARTHEST } else { f64::INFINITY };
            model.set(k, unknown.outward(unknown.inward(at.model.value(k)) + change.clamp(-limit, limit)));
        }
        self.standing(model)
    }

    fn goes_on(&self) -> bool {
        !self.whitened.pace.is_spent()
    }
}

/// Improves the numbers of the causes from `first` on, in at most this many steps; also their cost. `None` where it cannot be simulated.
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
    let problem = OwnNumbers { whitened, nuisance, own };
    let start = problem.standing(model)?;
    if steps == 0 || problem.own.is_empty() || !problem.goes_on() {
        return Some((start.model, start.left.0));
    }
    let enough = Amount { least: ENOUGH, share: ENOUGH_SHARE };
    let rules =
        Rules { steps, tries: [4; 2], worth: Some(enough), undamps: false, enough, kept_promise: 0.0, ends_exact: false };
    let (at, _) = descend(&problem, start, None, &rules)?;
    Some((at.model, at.left.0))
}

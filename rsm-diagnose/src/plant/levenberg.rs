//! Fits over all unknowns of a model at once, with bounds and Gaussian priors.
//!
//! In: prepared records with their whitening, and a model. Out: the fitted model with residual, derivatives and cost. An unknown at a bound whose
//! gradient points outwards is fixed for that step. Does not change the set of unknowns.

use super::model::{Model, Place};
use super::whitened_residuals::{Column, Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::levenberg::{CostTolerance, LEAST_DAMPING, Problem, Rules, descend};
use crate::engine::normal::{Normal, symmetric};

/// A step with a smaller predicted gain, in squared residuals with unit noise, is not worth its simulations.
const LEAST_GAIN: f64 = 0.3;

/// The same relative to the cost, for records far above their noise.
const LEAST_GAIN_SHARE: f64 = 1e-6;

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model.
    pub model: Model,
    /// Its simulation along all records.
    pub simulated: Vec<Simulated>,
    /// The whitened residual.
    pub residual: Vec<f64>,
    /// Squared residual plus priors.
    pub cost: f64,
    /// The free unknowns: those that are not held at a bound.
    pub free: Vec<usize>,
    /// The derivatives for `free`.
    pub columns: Vec<Column>,
    /// The unknowns that are held at a bound.
    pub held: Vec<Held>,
}

/// An unknown that is held at a bound.
#[derive(Debug, Clone)]
pub struct Held {
    /// The unknown.
    pub unknown: usize,
    /// Its derivative.
    pub column: Column,
    /// True at the lower bound, false at the upper one.
    pub at_low: bool,
}

impl Fit {
    /// The matrix of inner products of the derivatives, plus the curvature of the priors.
    #[must_use]
    pub fn matrix(&self) -> Vec<f64> {
        gram(&self.model, &self.free, &self.columns)
    }

    /// The matrix and the right-hand side: first for the free unknowns, then for those that are held.
    #[must_use]
    pub fn equations_with_held(&self) -> (Vec<f64>, Vec<f64>) {
        let which: Vec<usize> = self.free.iter().copied().chain(self.held.iter().map(|held| held.unknown)).collect();
        let columns: Vec<Column> =
            self.columns.iter().cloned().chain(self.held.iter().map(|held| held.column.clone())).collect();
        (gram(&self.model, &which, &columns), negative_gradient(&self.model, &which, &columns, &self.residual))
    }

    /// The derivative for an unknown of another model, if this fit has the same unknown.
    fn column_of(&self, model: &Model, unknown: usize) -> Option<Column> {
        let place = model.unknowns[unknown].place;
        if let Place::Effect { entry, .. } = place {
            let (ours, other) = (self.model.file.effects.get(entry)?, &model.file.effects[entry]);
            if ours.description.kind != other.description.kind || ours.arguments.subject != other.arguments.subject {
                return None;
            }
        }
        let column = self.free.iter().position(|&k| self.model.unknowns[k].place == place)?;
        Some(self.columns[column].clone())
    }

    /// How far the cost is above its minimum, to first order: the gain that the derivatives predict for a whole step of the free unknowns.
    #[must_use]
    pub fn gain_to_minimum(&self) -> f64 {
        let right = self.negative_gradient();
        let change =
            solved_within_bounds(&self.model, &self.free, &self.matrix(), &right, |small, m| Normal::new(small, m, 0.0));
        dot(&change, &right)
    }

    /// The negative gradient of the cost, from residual and priors, for each free unknown.
    #[must_use]
    pub fn negative_gradient(&self) -> Vec<f64> {
        negative_gradient(&self.model, &self.free, &self.columns, &self.residual)
    }
}

/// The squared residual of a model plus its priors.
#[must_use]
pub fn cost(model: &Model, residual: &[f64]) -> f64 {
    let mut cost = dot(residual, residual);
    for (k, unknown) in model.unknowns.iter().enumerate() {
        if let Some((centre, sd)) = unknown.prior {
            let off = (model.value(k) - centre) / sd;
            cost += off * off;
        }
    }
    cost
}

pub(super) fn gram(model: &Model, free: &[usize], columns: &[Column]) -> Vec<f64> {
    let n = free.len();
    let mut matrix = symmetric(n, |i, j| columns[i].dot(&columns[j]));
    for i in 0..n {
        if let Some((_, sd)) = model.unknowns[free[i]].prior {
            matrix[i * n + i] += 1.0 / (sd * sd);
        }
    }
    matrix
}

pub(super) fn negative_gradient(model: &Model, free: &[usize], columns: &[Column], residual: &[f64]) -> Vec<f64> {
    let each = free.iter().zip(columns);
    each.map(|(&k, column)| {
        let prior = model.unknowns[k].prior.map_or(0.0, |(centre, sd)| (centre - model.value(k)) / (sd * sd));
        column.dot_stack(residual) + prior
    })
    .collect()
}

/// A fit at the current values of a model: simulation and derivatives, without a step.
#[must_use]
pub fn linearised(whitened: &WhitenedResiduals, model: Model) -> Option<Fit> {
    fit(whitened, model, 0)
}

/// Fits all unknowns, in at most `steps` steps.
#[must_use]
pub fn fit(whitened: &WhitenedResiduals, model: Model, steps: usize) -> Option<Fit> {
    refit(whitened, model, steps, None)
}

/// The current point of a fit.
struct Iterate {
    model: Model,
    simulated: Vec<Simulated>,
    residual: Vec<f64>,
    cost: f64,
}

impl Iterate {
    fn of(whitened: &WhitenedResiduals, model: Model) -> Option<Self> {
        let simulated = whitened.run(&model)?;
        let residual = whitened.residual(&simulated);
        Some(Iterate { cost: cost(&model, &residual), model, simulated, residual })
    }
}

/// All unknowns of a model along records.
///
/// Derivatives are the main cost of a fit: one simulation for each unknown. They change little from step to step, so a step corrects them along its
/// own direction (C. G. Broyden, 1965). They are computed again if a step gains much less than predicted, and once before the end, so that the final
/// point has exact derivatives.
struct AllUnknowns<'a>(&'a WhitenedResiduals);

impl Problem for AllUnknowns<'_> {
    type Iterate = Iterate;
    type Derivatives = Vec<Column>;
    type Equations = Equations;

    fn cost(&self, at: &Iterate) -> f64 {
        at.cost
    }

    fn derivatives(&self, at: &Iterate) -> Option<Vec<Column>> {
        let all: Vec<usize> = (0..at.model.unknowns.len()).collect();
        self.0.derivatives(&at.model, &at.simulated, &all)
    }

    fn equations(&self, at: &Iterate, columns: &Vec<Column>) -> Equations {
        Equations::new(&at.model, columns, &at.residual)
    }

    fn step(&self, at: &Iterate, equations: &Equations, damping: f64) -> (Vec<f64>, f64) {
        let change = equations.change(&at.model, damping);
        let predicted = equations.predicted_gain(&change);
        (change, predicted)
    }

    fn moved(&self, at: &Iterate, equations: &Equations, step: &[f64]) -> Option<Iterate> {
        Iterate::of(self.0, equations.moved(&at.model, step))
    }

    fn corrected(&self, mut columns: Vec<Column>, from: &Iterate, to: &Iterate) -> Option<Vec<Column>> {
        correct(&mut columns, &from.model, &to.model, self.0.changes(&from.simulated, &to.simulated, 1.0));
        Some(columns)
    }
}

/// Fits all unknowns. Starts with the derivatives of an earlier fit to the same records, for the unknowns that both have.
#[must_use]
pub fn refit(whitened: &WhitenedResiduals, model: Model, steps: usize, earlier: Option<&Fit>) -> Option<Fit> {
    descended(whitened, model, earlier, steps, false)
}

/// Continues a fit until it converges, also along a curved valley, in at most `steps` steps.
#[must_use]
pub fn settled(whitened: &WhitenedResiduals, fit: &Fit, steps: usize) -> Option<Fit> {
    descended(whitened, fit.model.clone(), Some(fit), steps, true)
}

fn descended(
    whitened: &WhitenedResiduals,
    model: Model,
    earlier: Option<&Fit>,
    steps: usize,
    follows_valleys: bool,
) -> Option<Fit> {
    let start = Iterate::of(whitened, model)?;
    let all = 0..start.model.unknowns.len();
    let known: Vec<Option<Column>> = all.clone().map(|k| earlier.and_then(|fit| fit.column_of(&start.model, k))).collect();
    let missing: Vec<usize> = all.filter(|k| known[*k].is_none()).collect();
    let exact = missing.len() == known.len();
    let mut fresh = whitened.derivatives(&start.model, &start.simulated, &missing)?.into_iter();
    let columns: Vec<Column> = known.into_iter().map(|column| column.or_else(|| fresh.next())).collect::<Option<_>>()?;
    let enough = CostTolerance { absolute: LEAST_GAIN, relative: LEAST_GAIN_SHARE };
    // Five dampings cover a factor of ten thousand. If none of them improves the cost, the point is a minimum. With corrected derivatives only two
    // are tried, because exact ones can be computed.
    let rules = Rules {
        steps,
        tries: [5, 2],
        least_predicted_gain: Some(enough),
        retries_undamped: true,
        least_gain: enough,
        least_gain_ratio: 0.5,
        follows_valleys,
        ends_exact: true,
    };
    let (at, equations) = descend(&AllUnknowns(whitened), start, Some((columns, exact)), &rules)?;
    Some(equations.fit(at.model, at.simulated, at.residual))
}

/// Marks the numbers of effects on which no row depends.
fn with_open_numbers(mut model: Model, free: &[usize], columns: &[Column]) -> Model {
    for unknown in &mut model.unknowns {
        unknown.open = false;
    }
    for (k, column) in free.iter().zip(columns) {
        let unknown = &mut model.unknowns[*k];
        let is_free_number = matches!(unknown.place, Place::Effect { .. }) && unknown.prior.is_none();
        unknown.open = is_free_number && column.values.iter().all(|value| *value == 0.0);
    }
    model
}

/// Normal equations of the unknowns that are not held at a bound.
pub(super) struct Equations {
    free: Vec<usize>,
    columns: Vec<Column>,
    held: Vec<Held>,
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl Equations {
    /// Normal equations from the derivatives for all unknowns. An unknown is held if its bound is still active after all others have taken their
    /// step. The gradient before that step is not a reliable test.
    pub(super) fn new(model: &Model, columns: &[Column], residual: &[f64]) -> Self {
        let all: Vec<usize> = (0..model.unknowns.len()).collect();
        let asked = negative_gradient(model, &all, columns, residual);
        let pressed: Vec<usize> = all.iter().copied().filter(|&k| is_bound_active(model, k, asked[k])).collect();
        let released = released(model, &pressed, &asked, columns);
        let (held, free): (Vec<usize>, Vec<usize>) =
            all.into_iter().partition(|k| pressed.contains(k) && !released.contains(k));
        let held = held.into_iter().map(|k| Held { unknown: k, column: columns[k].clone(), at_low: asked[k] < 0.0 }).collect();
        let columns: Vec<Column> = free.iter().map(|&k| columns[k].clone()).collect();
        let right = free.iter().map(|&k| asked[k]).collect();
        Equations { matrix: gram(model, &free, &columns), free, columns, held, right }
    }

    /// The damped step of the free unknowns.
    pub(super) fn change(&self, model: &Model, damping: f64) -> Vec<f64> {
        solved_within_bounds(model, &self.free, &self.matrix, &self.right, |small, m| Normal::new(small, m, damping))
    }

    /// The undamped step.
    pub(super) fn newton(&self, model: &Model) -> Vec<f64> {
        solved_within_bounds(model, &self.free, &self.matrix, &self.right, Normal::fine)
    }

    /// A fit at the point of these equations.
    pub(super) fn fit(self, model: Model, simulated: Vec<Simulated>, residual: Vec<f64>) -> Fit {
        let cost = cost(&model, &residual);
        let model = with_open_numbers(model, &self.free, &self.columns);
        Fit { model, simulated, residual, cost, free: self.free, columns: self.columns, held: self.held }
    }

    /// The first-order gain of a step.
    pub(super) fn predicted_gain(&self, change: &[f64]) -> f64 {
        dot(change, &self.right)
    }

    /// The model after a step.
    pub(super) fn moved(&self, model: &Model, change: &[f64]) -> Model {
        model.moved(&self.free, change)
    }
}

/// Corrects derivatives by the observed change of a step, along that step only. The derivatives of initial states stay: they concern one record and
/// hardly change.
fn correct(columns: &mut [Column], from: &Model, to: &Model, seen: Vec<f64>) {
    let mut missed = seen;
    let mut steps = Vec::new();
    for (k, (unknown, column)) in from.unknowns.iter().zip(columns.iter()).enumerate() {
        let step = unknown.to_search_scale(to.value(k)) - unknown.to_search_scale(from.value(k));
        if step != 0.0 {
            for (missed, value) in missed[column.first..].iter_mut().zip(&column.values) {
                *missed -= step * value;
            }
        }
        let of_one_record = matches!(unknown.place, Place::Start { .. });
        // Each unknown takes its share of the correction, in units of its scale.
        steps.push(if of_one_record { 0.0 } else { step / unknown.scale });
    }
    let length: f64 = steps.iter().map(|step| step * step).sum();
    if length == 0.0 {
        return;
    }
    for ((column, step), unknown) in columns.iter_mut().zip(&steps).zip(&from.unknowns) {
        let share = step / (length * unknown.scale);
        if share != 0.0 {
            for (value, missed) in column.values.iter_mut().zip(&missed) {
                *value += share * missed;
            }
        }
    }
}

/// The damped step. An unknown that would cross a bound is set to the bound, and the others are solved again.
fn solved_within_bounds(
    model: &Model,
    free: &[usize],
    matrix: &[f64],
    right: &[f64],
    normal: impl Fn(&[f64], usize) -> Normal,
) -> Vec<f64> {
    let n = free.len();
    let mut fixed: Vec<Option<f64>> = vec![None; n];
    loop {
        let moving: Vec<usize> = (0..n).filter(|i| fixed[*i].is_none()).collect();
        let m = moving.len();
        let mut small = vec![0.0; m * m];
        let mut asked = vec![0.0; m];
        for (a, &i) in moving.iter().enumerate() {
            asked[a] = right[i] - (0..n).map(|j| fixed[j].map_or(0.0, |step| matrix[i * n + j] * step)).sum::<f64>();
            for (b, &j) in moving.iter().enumerate() {
                small[a * m + b] = matrix[i * n + j];
            }
        }
        let solved = normal(&small, m).solve(&asked);
        let mut beyond = false;
        for (&i, step) in moving.iter().zip(&solved) {
            let unknown = &model.unknowns[free[i]];
            let at = unknown.to_search_scale(model.value(free[i]));
            // A logarithm may change by at most 2 in a step: a factor of e^2.
            let limit = if unknown.logarithmic { 2.0 } else { f64::INFINITY };
            let wanted = at + step.clamp(-limit, limit);
            let (low, high) = (unknown.to_search_scale(unknown.low), unknown.to_search_scale(unknown.high));
            if wanted < low || wanted > high {
                fixed[i] = Some(wanted.clamp(low, high) - at);
                beyond = true;
            }
        }
        if !beyond {
            let mut steps = vec![0.0; n];
            for (&i, step) in moving.iter().zip(&solved) {
                let limit = if model.unknowns[free[i]].logarithmic { 2.0 } else { f64::INFINITY };
                steps[i] = step.clamp(-limit, limit);
            }
            for (i, step) in fixed.iter().enumerate() {
                steps[i] = step.unwrap_or(steps[i]);
            }
            return steps;
        }
    }
}

/// Of the unknowns held at a bound, the ones to release after the others have moved: their multiplier has the other sign. One at a time, the one with
/// the largest inward gradient first.
fn released(model: &Model, pressed: &[usize], asked: &[f64], columns: &[Column]) -> Vec<usize> {
    let mut released = Vec::new();
    if pressed.is_empty() {
        return released;
    }
    let n = asked.len();
    let all: Vec<usize> = (0..n).collect();
    let matrix = gram(model, &all, columns);
    loop {
        let is_held = |k: &usize| pressed.contains(k) && !released.contains(k);
        let free: Vec<usize> = all.iter().copied().filter(|k| !is_held(k)).collect();
        let all_of = &matrix;
        let small: Vec<f64> = free.iter().flat_map(|i| free.iter().map(move |j| all_of[i * n + j])).collect();
        let right: Vec<f64> = free.iter().map(|k| asked[*k]).collect();
        let step = solved_within_bounds(model, &free, &small, &right, |small, m| Normal::new(small, m, LEAST_DAMPING));
        let multiplier = |k: usize| asked[k] - free.iter().zip(&step).map(|(j, step)| matrix[k * n + j] * step).sum::<f64>();
        // Relative to the standard deviation of the unknown alone.
        let inwards = |k: usize| -multiplier(k) * asked[k].signum() / matrix[k * n + k].max(f64::MIN_POSITIVE).sqrt();
        let most = all.iter().copied().filter(is_held).map(|k| (k, inwards(k))).max_by(|a, b| a.1.total_cmp(&b.1));
        match most {
            Some((k, inwards)) if inwards > 0.0 => released.push(k),
            _ => return released,
        }
    }
}

/// Whether an unknown is at a bound and the gradient points outwards.
fn is_bound_active(model: &Model, k: usize, pull: f64) -> bool {
    let unknown = &model.unknowns[k];
    if matches!(unknown.place, Place::Start { .. }) {
        return false;
    }
    let value = model.value(k);
    let near = 1e-9 * unknown.scale;
    (value <= unknown.low + near && pull < 0.0 && unknown.low.is_finite())
        || (value >= unknown.high - near && pull > 0.0 && unknown.high.is_finite())
}

#[cfg(test)]
mod tests {
    use super::super::axis_under_steps;
    use super::super::model::Place;
    use super::*;

    /// An axis with dry friction, its record with noise, and the same axis without friction, all of it free.
    fn axis() -> (WhitenedResiduals, Model) {
        let file =
            |force: f64| axis_under_steps::file("mass = 0.1\nviscous_friction = 0.5", &axis_under_steps::friction(force));
        let (whitened, nominal) = axis_under_steps::whitened(&file(0.1), &file(1.2), true);
        let entries = nominal.file.effects.clone();
        (whitened, nominal.with_effects(&nominal, entries))
    }

    #[test]
    fn corrected_derivatives_lead_to_the_same_best_as_fresh_ones() {
        let (whitened, model) = axis();
        let whole = fit(&whitened, model.clone(), 20).unwrap();
        // White noise over 600 rows: four standard deviations, 4 sqrt(2 * 600).
        assert!((whole.cost - 600.0).abs() < 139.0, "{}", whole.cost);
        // Derivatives from where the search begins, far from its end.
        let elsewhere = linearised(&whitened, model.clone()).unwrap();
        let again = refit(&whitened, model, 20, Some(&elsewhere)).unwrap();
        // What ends a fit promises less than this.
        assert!((again.cost - whole.cost).abs() < LEAST_GAIN, "{} {}", again.cost, whole.cost);
    }

    #[test]
    fn a_correction_makes_the_derivatives_tell_the_step_that_was_seen() {
        let (whitened, model) = axis();
        let mut fit = linearised(&whitened, model.clone()).unwrap();
        let mut to = model.clone();
        for (k, share) in [(0, 0.7), (1, -1.3), (2, 2.0)] {
            let unknown = &model.unknowns[k];
            to.set(k, unknown.plant_value(unknown.to_search_scale(model.value(k)) + share * unknown.scale));
        }
        let simulated = whitened.run(&to).unwrap();
        let seen = whitened.changes(&fit.simulated, &simulated, 1.0);
        correct(&mut fit.columns, &model, &to, seen.clone());
        for (row, seen) in seen.iter().enumerate() {
            let told: f64 = (0..model.unknowns.len())
                .map(|k| {
                    let step =
                        model.unknowns[k].to_search_scale(to.value(k)) - model.unknowns[k].to_search_scale(model.value(k));
                    step * fit.columns[k].values[row]
                })
                .sum();
            // Rounding of sums of numbers up to some thousands.
            assert!((told - seen).abs() < 1e-9 * (1.0 + seen.abs()), "row {row}: {told} {seen}");
        }
    }

    #[test]
    fn a_direction_that_only_tolerances_curve_is_followed() {
        // Of mass, friction and gain an axis in open loop shows two ratios: all three times as much move alike.
        let with_gain = |gain: f64| format!("[[effects]]\nkind = \"input-gain\"\nparameters = {{ gain = {gain} }}\n");
        let file = |gain: f64| axis_under_steps::file("mass = 0.02\nviscous_friction = 0.02", &with_gain(gain));
        let (whitened, nominal) = axis_under_steps::whitened(&file(0.9), &file(0.9), true);
        let mut model = nominal.with_effects(&nominal, nominal.file.effects.clone());
        for k in 0..model.unknowns.len() {
            match model.unknowns[k].place {
                Place::Nominal(_) | Place::Effect { .. } => model.set(k, 1.03 * model.value(k)),
                Place::Start { .. } => {}
            }
        }
        let mass = |fit: &Fit| fit.model.file.parameters.number("mass");
        let begun = linearised(&whitened, model.clone()).unwrap();
        assert!((mass(&begun) - 2.06).abs() < 1e-9 && begun.cost < 740.0, "{}", begun.cost);
        let found = fit(&whitened, model, 20).unwrap();
        // Both priors ask for the nominal mass, and noise moves the ratio of the two by its own hundredth: half a standard deviation of the
        // tolerance, 0.02.
        assert!((mass(&found) - 2.0).abs() < 0.02, "{}", mass(&found));
    }
}

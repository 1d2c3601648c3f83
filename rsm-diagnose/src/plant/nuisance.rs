//! All unknowns that are always free (initial states, calibration, causes already accepted), projected out of traces and residuals.
//!
//! In: a fit with its derivatives. Out: inner products after the projection onto the complement of the free unknowns, to first order. An unknown held
//! at its bound may be released: a missing cause may have pushed it there, and without the release the gain would not include the cost of the bound.
//! Runs no simulation.

use super::levenberg::Fit;
use super::whitened_residuals::Column;
use crate::engine::columns::dot;
use crate::engine::normal::Normal;

/// The largest number of unknowns at bounds that may be released. If there are more, none is released. Each set of them needs its own normal
/// equations.
const MOST_HELD: usize = 4;

/// The free unknowns of a fit, prepared for projection.
pub struct Nuisance<'a> {
    /// The fit.
    pub fit: &'a Fit,
    /// One entry for each set of released unknowns; the index is the set as bits.
    parts: Vec<Part>,
}

/// A set of unknowns with its normal equations.
struct Part {
    /// Their indices among all columns.
    columns: Vec<usize>,
    normal: Normal,
    /// The negative gradient of the cost, from residual and priors.
    pull: Vec<f64>,
}

impl Part {
    fn pick(&self, products: &[f64]) -> Vec<f64> {
        self.columns.iter().map(|k| products[*k]).collect()
    }
}

/// A set of released unknowns, as bits.
pub type Released = usize;

impl<'a> Nuisance<'a> {
    /// Of a fit.
    #[must_use]
    pub fn new(fit: &'a Fit) -> Self {
        let (matrix, pull) = fit.equations_with_held();
        let (free, all) = (fit.columns.len(), pull.len());
        let held = fit.held.len().min(MOST_HELD);
        let part = |back: Released| {
            let columns: Vec<usize> = (0..free).chain((0..held).filter(|k| back >> k & 1 == 1).map(|k| free + k)).collect();
            let small: Vec<f64> =
                columns.iter().flat_map(|i| columns.iter().map(move |j| i * all + j)).map(|at| matrix[at]).collect();
            let normal = Normal::new(&small, columns.len(), 0.0);
            Part { normal, pull: columns.iter().map(|k| pull[*k]).collect(), columns }
        };
        Nuisance { fit, parts: (0..1 << held).map(part).collect() }
    }

    /// The set of all held unknowns: the first one to try.
    #[must_use]
    pub fn all_released(&self) -> Released {
        self.parts.len() - 1
    }

    /// Inner products of a trace with the derivatives of the free unknowns, then with those of the held ones.
    #[must_use]
    pub fn products(&self, trace: &[f64]) -> Vec<f64> {
        let held = self.fit.held.iter().map(|held| &held.column);
        self.fit.columns.iter().chain(held).map(|column: &Column| column.dot_stack(trace)).collect()
    }

    /// The same for a trace that is zero except in some records.
    #[must_use]
    pub fn products_of(&self, trace: &Column) -> Vec<f64> {
        let held = self.fit.held.iter().map(|held| &held.column);
        self.fit.columns.iter().chain(held).map(|column: &Column| column.dot(trace)).collect()
    }

    /// The projection of a residual on such traces after the free unknowns are projected out; priors included.
    #[must_use]
    pub fn projections<T>(&self, traces: &[(T, Column)], products: &[Vec<f64>], residual: &[f64]) -> Vec<f64> {
        let part = &self.parts[0];
        let (new, own) = (self.products(residual), self.products(&self.fit.residual));
        let right: Vec<f64> = part.columns.iter().zip(&part.pull).map(|(k, pull)| new[*k] + pull - own[*k]).collect();
        let free = part.normal.solve(&right);
        traces
            .iter()
            .zip(products)
            .map(|((_, trace), products)| trace.dot_stack(residual) - dot(&part.pick(products), &free))
            .collect()
    }

    /// The first-order step of the free unknowns for these products.
    #[must_use]
    pub fn solved(&self, products: &[f64]) -> Vec<f64> {
        self.parts[0].normal.solve(&self.parts[0].pick(products))
    }

    /// The inner product of two traces after the free unknowns are projected out, from their products.
    #[must_use]
    pub fn between(&self, plain: f64, a: &[f64], b: &[f64], back: Released) -> f64 {
        let part = &self.parts[back];
        plain - dot(&part.pick(a), &part.normal.solve(&part.pick(b)))
    }

    /// The inner product of a trace with the residual after the free unknowns are projected out; priors included.
    #[must_use]
    pub fn with_residual(&self, trace: &[f64], products: &[f64], back: Released) -> f64 {
        let part = &self.parts[back];
        dot(trace, &self.fit.residual) - dot(&part.pick(products), &part.normal.solve(&part.pull))
    }

    /// The released unknowns that move inwards when traces are added with these shares.
    #[must_use]
    pub fn still_released(&self, shares: &[f64], products: &[&[f64]], back: Released) -> Released {
        let part = &self.parts[back];
        let taken = |k: usize| shares.iter().zip(products).map(|(share, products)| share * products[k]).sum::<f64>();
        let right: Vec<f64> = part.columns.iter().zip(&part.pull).map(|(k, pull)| pull - taken(*k)).collect();
        self.inwards(&part.normal.solve(&right), back)
    }

    /// The unknowns of a set that a step moves inwards.
    fn inwards(&self, step: &[f64], back: Released) -> Released {
        let free = self.fit.columns.len();
        let mut still = 0;
        for (k, step) in self.parts[back].columns.iter().zip(step).filter(|(k, _)| **k >= free) {
            if *step == 0.0 || (*step > 0.0) == self.fit.held[k - free].at_low {
                still |= 1 << (k - free);
            }
        }
        still
    }

    /// The reduction of the squared residual if these bounds were absent. A trace that makes the bounds unnecessary gains this too.
    #[must_use]
    pub fn gain_of(&self, back: Released) -> f64 {
        let of = |part: &Part| dot(&part.pull, &part.normal.solve(&part.pull));
        of(&self.parts[back]) - of(&self.parts[0])
    }

    /// The squared residual after a first-order step of the free unknowns, and which held ones are released.
    #[must_use]
    pub fn remaining_square(&self, residual: &[f64]) -> (f64, Released) {
        let products: Vec<f64> = self.products(residual);
        // The priors contribute the difference between the fit's gradient and its residual's gradient.
        let own: Vec<f64> = self.products(&self.fit.residual);
        let mut back = self.all_released();
        loop {
            let part = &self.parts[back];
            let right: Vec<f64> = part.columns.iter().zip(&part.pull).map(|(k, pull)| products[*k] + pull - own[*k]).collect();
            let step = part.normal.solve(&right);
            let still = self.inwards(&step, back);
            if still == back {
                return (dot(residual, residual) - dot(&right, &step), back);
            }
            back = still;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::Model;
    use super::super::{axis_under_steps, levenberg};
    use super::*;

    #[test]
    fn what_presses_a_parameter_against_its_tolerance_gets_credit_for_letting_it_go() {
        // Dry friction that the axis lacks presses the viscous friction, known to 2 %, against the upper end. With the friction it comes back.
        let file = |effects: &str| axis_under_steps::file("viscous_friction = 0.02", effects);
        let truth = file(&axis_under_steps::friction(0.8));
        let (whitened, model) = axis_under_steps::whitened(&file(""), &truth, false);
        let fit = levenberg::fit(&whitened, model, 8).unwrap();
        assert_eq!(fit.held.len(), 1);
        let nuisance = Nuisance::new(&fit);
        let with = Model { file: truth, ..fit.model.clone() };
        let residual = whitened.residual(&whitened.run(&with).unwrap());
        let (left, back) = nuisance.remaining_square(&residual);
        assert_eq!(back, 1);
        // Held, the viscous friction would be 4 % too high, by far the larger part of what is left; and without the friction it stays where it is.
        let held_still = dot(&residual, &residual);
        assert!(left < 0.2 * held_still, "{left} {held_still}");
        assert_eq!(nuisance.remaining_square(&fit.residual).1, 0);
    }
}

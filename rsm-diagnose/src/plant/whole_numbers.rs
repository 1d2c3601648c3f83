//! Whole numbers of a cause, such as the periods of a wave per turn. A simulation has no derivative with respect to them, so no fit moves them.
//!
//! In: a fit whose last cause has such a number. Out: the fit with the best number beside it, as long as each one is better than the one before.
//! Moves nothing if the residual is noise already.

use super::hypotheses::declared;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::search::Search;
use super::whitened_residuals::Simulated;
use rsm_sim::plant_file::Entry;
use rsm_sim::quantity::Bound;
use std::f64::consts::FRAC_PI_2;

/// The largest number of moves to a neighbour. Guesses of a catalogue are at most a third apart, for example 8 and 12, and the best one is chosen.
const MOST_MOVES: usize = 6;

/// A neighbour is better if its squared residual is lower by more than the effect of noise on one parameter.
const ENOUGH: f64 = 1.0;

/// Phases at which a neighbour starts, in quarters of a period. One of them is within an eighth of a period of the best, where a fit converges.
const QUARTERS: usize = 4;

/// The place of a whole number among the numbers of a cause.
fn place_of_whole_number(entry: &Entry) -> Option<usize> {
    entry.arguments.numbers.iter().position(|it| declared(entry, it.0).is_some_and(|it| it.bound == Bound::Count))
}

impl Search<'_> {
    /// The fit with the best whole number of its last cause.
    pub(super) fn with_best_whole_number(&self, mut fit: Fit, steps: usize) -> Fit {
        // Most causes have none: then the residual need not be tested.
        let Some(whole) = fit.model.file.effects.last().and_then(place_of_whole_number) else { return fit };
        for _ in 0..MOST_MOVES {
            if self.leaves_no_structure(&fit) || self.whitened.work.is_limit_reached() {
                break;
            }
            let others =
                self.neighbours(&fit, whole).into_iter().filter_map(|model| levenberg::fit(self.whitened, model, steps));
            let Some(better) = others.min_by(|a, b| a.cost.total_cmp(&b.cost)).filter(|it| it.cost < fit.cost - ENOUGH) else {
                break;
            };
            fit = better;
        }
        fit
    }

    /// The models with one more and one less in the place `whole`, each with the best of its starting phases.
    fn neighbours(&self, fit: &Fit, whole: usize) -> Vec<Model> {
        let effects = &fit.model.file.effects;
        let Some((entry, before)) = effects.split_last() else { return Vec::new() };
        let numbers = &entry.arguments.numbers;
        let hypothesis = self.hypotheses.iter().find(|it| it.describes(entry));
        let phase = hypothesis.and_then(|it| it.guesses.first()?.phase).filter(|place| *place < numbers.len());
        let mut list = Vec::new();
        for value in [numbers[whole].1 - 1.0, numbers[whole].1 + 1.0].into_iter().filter(|it| *it >= 1.0) {
            let quarters = if phase.is_some() { QUARTERS } else { 1 };
            let start = |quarter: usize| {
                let mut entry = entry.clone();
                entry.arguments.numbers[whole].1 = value;
                if let Some(place) = phase {
                    entry.arguments.numbers[place].1 += FRAC_PI_2 * quarter as f64;
                }
                fit.model.with_effects(self.nominal, [before, &[entry]].concat())
            };
            let models: Vec<Model> = (0..quarters).map(start).collect();
            let runs = self.whitened.run_all(&models);
            let cost = |(model, run): (&Model, Option<Vec<Simulated>>)| {
                run.map_or(f64::INFINITY, |run| levenberg::cost(model, &self.whitened.residual(&run)))
            };
            let costs: Vec<f64> = models.iter().zip(runs).map(cost).collect();
            let best = costs.iter().zip(models).filter(|it| it.0.is_finite()).min_by(|a, b| a.0.total_cmp(b.0));
            list.extend(best.map(|it| it.1));
        }
        list
    }
}

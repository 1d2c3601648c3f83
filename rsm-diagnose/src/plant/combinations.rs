//! The extended plant with some of its causes: the simulated outputs of each combination of the strongest ones, along the evaluation records.
//!
//! In: the compared plants, the accepted causes. Out: [`Combinations`]. When causes are left out, all other numbers are fitted again to the training
//! records. No verdict depends on it.

use super::compared::Compared;
use super::hypotheses::label_of;
use super::levenberg::{self, Fit};
use super::search::AcceptedCause;
use super::validation::{self, Error};
use super::whitened_residuals::WhitenedResiduals;
pub use crate::engine::combinations::Combinations;
use crate::engine::combinations::MOST;
use rsm_core::order;

/// The largest number of steps of a fit without some causes: the same as in the search without one cause.
const STEPS: usize = 8;

/// The output of a plant along the evaluation records.
#[derive(Debug, Clone, PartialEq)]
pub struct Combined {
    /// The errors of its outputs.
    pub errors: Vec<Error>,
    /// The simulated values: one list for each of [`super::error_breakdown::ErrorBreakdown::traces`], in the same order and unit.
    pub simulated: Vec<Vec<f64>>,
}

/// The indices of the strongest causes among the accepted causes, the strongest first.
pub(super) fn strongest(accepted: &[AcceptedCause]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..accepted.len()).collect();
    order::descending(&mut order, |it| accepted[*it].gain);
    order.truncate(MOST);
    order
}

/// The combinations. `without` holds, for each of the strongest causes, the plant without this one cause along the evaluation records.
pub(super) fn combinations(it: &Compared<'_>, accepted: &[AcceptedCause], without: &[Option<Fit>]) -> Combinations<Combined> {
    let order = strongest(accepted);
    let judged = it.evaluation_records();
    // The search has ended. This work does not count against its limit.
    let mut training = it.whitened.clone();
    training.work = it.whitened.work.with_new_count();
    let effects = &it.fit.model.file.effects;
    let names = order.iter().map(|place| label_of(&effects[*place]));
    Combinations::of(names.collect(), |is_in| {
        let mut out: Vec<usize> = (0..order.len()).filter(|k| !is_in[*k]).collect();
        match out[..] {
            [] => return Some(combined(judged, it.after)),
            _ if out.len() == accepted.len() => return Some(combined(judged, it.before)),
            [alone] => return without[alone].as_ref().map(|fit| combined(judged, fit)),
            _ => {}
        }
        // Remove the highest index first, so that the other indices stay valid.
        out.sort_by_key(|k| std::cmp::Reverse(order[*k]));
        let model = out.iter().fold(it.fit.model.clone(), |model, k| model.without_cause(it.nominal, order[*k]));
        let fit = levenberg::refit(&training, model, STEPS, Some(it.fit))?;
        validation::fit_initial_states(judged, &fit.model).map(|fit| combined(judged, &fit))
    })
}

/// In the order of the traces: by record, then by output.
fn combined(judged: &WhitenedResiduals, fit: &Fit) -> Combined {
    Combined { errors: validation::errors(judged, fit), simulated: fit.simulated.iter().flatten().cloned().collect() }
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, model::Model};
    use super::*;

    #[test]
    fn each_combination_is_the_plant_with_these_causes_fitted_again() {
        let drift = "[[effects]]\nkind = \"sensor-drift\"\nparameters = { output = \"position\", rate = 0.01 }\n";
        let load = "[[effects]]\nkind = \"constant-load\"\nparameters = { force = 0.5 }\n";
        let file = |effects: &str| axis_under_steps::file("mass = 0.02", effects);
        let truth = file(&(axis_under_steps::friction(0.8) + drift + load));
        let (whitened, nominal) = axis_under_steps::whitened(&file(""), &truth, true);
        let fitted = |model: Model| levenberg::fit(&whitened, model, 12).unwrap();
        let fit = fitted(nominal.with_effects(&nominal, truth.effects.clone()));
        let calibrated = fitted(nominal.clone());
        let without = |place: usize| fitted(fit.model.without_cause(&nominal, place)).model;
        // The drift is said to be the strongest, then the load.
        let accepted: Vec<AcceptedCause> = [(0, 10.0), (1, 900.0), (2, 300.0)]
            .map(|(place, gain)| AcceptedCause {
                label: String::new(),
                gain,
                rivals: Vec::new(),
                aliases_not_fitted: Vec::new(),
                rival_models: Vec::new(),
                rivals_tested: true,
                without: without(place),
            })
            .to_vec();
        let none = WhitenedResiduals::new(Vec::new(), whitened.floors, 1);
        let compared = Compared {
            whitened: &whitened,
            unseen: &none,
            nominal: &nominal,
            fit: &fit,
            nominal_there: &calibrated,
            before: &calibrated,
            after: &fit,
            structure: false,
        };
        let alone: Vec<Option<Fit>> = strongest(&accepted)
            .iter()
            .map(|place| validation::fit_initial_states(&whitened, &accepted[*place].without))
            .collect();
        let taken = whitened.work.done();
        let found = combinations(&compared, &accepted, &alone);
        assert_eq!(found.causes, ["sensor-drift:position", "constant-load", "coulomb-friction"]);
        let error = |set: usize| found.of[set].as_ref().unwrap().errors[0].noise_ratio;
        // All causes leave noise (600 rows: 0.9 to 1.1), and none of them what the calibrated plant leaves.
        assert!((0.9..1.1).contains(&error(7)), "{}", error(7));
        let is_of = |set: usize, fit: &Fit| found.of[set].as_ref().unwrap().simulated == [fit.simulated[0][0].clone()];
        // Six is all but the first, the drift.
        assert!(is_of(0, &calibrated) && is_of(6, alone[0].as_ref().unwrap()));
        // With the friction alone: fitted afresh it is the same plant, to a hundredth of its error.
        let friction = fitted(nominal.with_effects(&nominal, truth.effects[..1].to_vec()));
        let anew = validation::errors(&whitened, &friction)[0].noise_ratio;
        assert!((error(4) / anew - 1.0).abs() < 0.01, "{} {anew}", error(4));
        // A plant with more causes is never worse.
        assert!((0..8).all(|set| (0..3).all(|cause| error(set | 1 << cause) < 1.01 * error(set))));
        // What the search may still do does not depend on it, but for the look at the evaluation records.
        assert!(whitened.work.done() - taken < 40 * 600 * 8, "{}", whitened.work.done() - taken);
    }
}

//! Numbers of causes that only holdout records determine.
//!
//! In: the fit of a search, holdout records. Out: the fit, in which such numbers have the values of these records. A limit that no training row
//! reaches is an example. Changes no number that the training records say anything about.

use super::levenberg::{self, Fit};
use super::model::{Place, Unknown};
use super::posterior::Posterior;
use super::validation;
use super::whitened_residuals::WhitenedResiduals;

/// A number is known from a side if the squared residual rises there by this much. With all else fixed it rises by at least 4 for two standard
/// deviations of a number that the rows determine.
const LEAST_RISE: f64 = 1.0;

/// Gives the open numbers of a fit ([`Unknown::open`]) their values from holdout records. The standard deviation there is their prior from now on, so
/// that a fit to the training records keeps them. A number that no holdout row depends on either stays open, at a value that agrees with all records.
pub(super) fn settle(unseen: &WhitenedResiduals, fit: &mut Fit) {
    let open: Vec<usize> = (0..fit.model.unknowns.len()).filter(|k| fit.model.unknowns[*k].open).collect();
    if open.is_empty() || unseen.records.is_empty() {
        return;
    }
    let Some(there) = validation::fit_initial_states(unseen, &fit.model) else { return };
    let posterior = Posterior::of(&there);
    for k in open {
        let place = fit.model.unknowns[k].place;
        let Some(found) = there.model.unknowns.iter().position(|it| it.place == place) else { continue };
        let value = there.model.value(found);
        fit.model.set(k, value);
        let Some(sd) = posterior.deviations()[found].filter(|sd| *sd > 0.0 && sd.is_finite()) else { continue };
        if !is_determined(unseen, &there, found, sd) {
            continue;
        }
        let unknown = &mut fit.model.unknowns[k];
        let sd = unknown.deviation(value, sd);
        (unknown.open, unknown.logarithmic, unknown.prior) = (false, false, Some((value, sd)));
    }
}

/// Whether an unknown is known from both sides: two standard deviations away the residual is larger. A limit at the largest reading has a derivative,
/// but a higher one does as well.
fn is_determined(unseen: &WhitenedResiduals, there: &Fit, unknown: usize, sd: f64) -> bool {
    let value = there.model.value(unknown);
    let moved = [-2.0, 2.0].map(|times| {
        let mut model = there.model.clone();
        model.set(unknown, value + times * sd);
        model
    });
    let runs = unseen.run_all(&moved);
    moved
        .iter()
        .zip(runs)
        .all(|(model, run)| run.is_none_or(|run| levenberg::cost(model, &unseen.residual(&run)) > there.cost + LEAST_RISE))
}

/// The numbers of a cause that have their values from holdout records: those with a prior, which no other number of an effect has.
pub(super) fn by_holdout(fit: &Fit, cause: usize) -> Vec<&'static str> {
    let its = |it: &Unknown| match it.place {
        Place::Effect { entry, number } if entry == cause && it.prior.is_some() => Some(number),
        _ => None,
    };
    fit.model.unknowns.iter().filter_map(its).collect()
}

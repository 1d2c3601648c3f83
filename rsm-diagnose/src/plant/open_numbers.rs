//! Numbers of causes that only holdout records determine.
//!
//! In: the fit of a search, holdout records. Out: the fit, in which such numbers have the values of these records. A limit that no training row
//! reaches is an example. Changes no number that the training records say anything about.

use super::levenberg::Fit;
use super::model::{Place, Unknown};
use super::posterior::Posterior;
use super::validation;
use super::whitened_residuals::WhitenedResiduals;

/// Gives the open numbers of a fit ([`Unknown::open`]) their values from holdout records. The standard deviation there is their prior from now on, so
/// that a fit to the training records keeps them. A number that no holdout row depends on either stays open.
pub(super) fn settle(unseen: &WhitenedResiduals, fit: &mut Fit) {
    let open: Vec<usize> = (0..fit.model.unknowns.len()).filter(|k| fit.model.unknowns[*k].open).collect();
    if open.is_empty() || unseen.records.is_empty() {
        return;
    }
    let Some(there) = validation::fit_initial_states(unseen, &fit.model) else { return };
    let posterior = Posterior::of(&there);
    for k in open {
        let place = fit.model.unknowns[k].place;
        let its = |it: &Unknown| it.place == place;
        let Some(found) = there.model.unknowns.iter().position(its).filter(|it| !there.model.unknowns[*it].open) else {
            continue;
        };
        let Some(sd) = posterior.deviations()[found].filter(|sd| *sd > 0.0 && sd.is_finite()) else { continue };
        let value = there.model.value(found);
        fit.model.set(k, value);
        let unknown = &mut fit.model.unknowns[k];
        let sd = unknown.deviation(value, sd);
        (unknown.open, unknown.logarithmic, unknown.prior) = (false, false, Some((value, sd)));
    }
}

/// The numbers of a cause that have their values from holdout records: those with a prior, which no other number of an effect has.
pub(super) fn by_holdout(fit: &Fit, cause: usize) -> Vec<&'static str> {
    let its = |it: &Unknown| match it.place {
        Place::Effect { entry, number } if entry == cause && it.prior.is_some() => Some(number),
        _ => None,
    };
    fit.model.unknowns.iter().filter_map(its).collect()
}

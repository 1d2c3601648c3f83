//! Rivals that explain the records as well as a cause does.
//!
//! In: an accepted cause with its rivals. Out: the rivals that the records do not distinguish from it, by name and as plants. Fits none.

use super::super::experiment::Alias;
use super::super::hypotheses::generalises;
use super::super::search::AcceptedCause;

/// The cause without those rivals that contain it as a special case.
pub(super) fn without_general(one: &AcceptedCause) -> AcceptedCause {
    let rivals = one.rivals.iter().filter(|it| !generalises(&it.0, &one.label)).cloned().collect();
    AcceptedCause { rivals, ..one.clone() }
}

/// Fitted rivals that fit worse by less than `same`.
fn as_good(one: &AcceptedCause, same: f64) -> impl Iterator<Item = &String> {
    one.rivals.iter().filter(move |it| it.1 < same).map(|it| &it.0)
}

/// Hypotheses with the same trace that were not fitted. They would fit as well.
pub(super) fn not_fitted(one: &AcceptedCause) -> impl Iterator<Item = &String> {
    one.aliases_not_fitted.iter().filter(|it| !one.rivals.iter().any(|rival| rival.0 == **it))
}

/// The names of equal rivals, including those with the same trace that were not fitted.
pub(super) fn equal_rivals(one: &AcceptedCause, same: f64) -> Vec<String> {
    as_good(one, same).chain(not_fitted(one)).cloned().collect()
}

/// The equal rivals that were fitted, each with its plant.
pub(super) fn aliases(one: &AcceptedCause, same: f64) -> Vec<Alias> {
    let alias = |rival: &String| {
        let (_, model) = one.rival_models.iter().find(|it| it.0 == *rival)?;
        Some(Alias { cause: one.label.clone(), rival: rival.clone(), model: model.clone(), limit: same })
    };
    as_good(one, same).filter_map(alias).collect()
}

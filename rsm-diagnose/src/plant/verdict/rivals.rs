//! Rivals that explain the records as well as a cause does.
//!
//! In: a believed cause with its rivals. Out: those that the records do not separate from it, by name and as plants. Never fits one.

use super::super::experiment::Alias;
use super::super::hypotheses::generalises;
use super::super::search::Believed;

/// Rivals are alike when they do worse by less than this share of the gain: between integrators and smoothings, formulas of one cause differ that much.
const ALIKE: f64 = 1e-5;

/// Rivals that do worse by less are no worse, where so much decides between two explanations.
pub(super) fn same(decides: f64, gain: f64) -> f64 {
    decides.max(ALIKE * gain)
}

/// The cause without those rivals that have it as their special case.
pub(super) fn without_general(one: &Believed) -> Believed {
    let rivals = one.rivals.iter().filter(|it| !generalises(&it.0, &one.label)).cloned().collect();
    Believed { rivals, ..one.clone() }
}

/// Fitted rivals that do worse by less than `same`.
fn as_good(one: &Believed, same: f64) -> impl Iterator<Item = &String> {
    one.rivals.iter().filter(move |it| it.1 < same).map(|it| &it.0)
}

/// What leaves the same trace and was not fitted: it would do as well.
pub(super) fn not_fitted(one: &Believed) -> impl Iterator<Item = &String> {
    one.alike.iter().filter(|it| !one.rivals.iter().any(|rival| rival.0 == **it))
}

/// Their names; and of the same trace those that were not fitted, for they would do as well.
pub(super) fn alike(one: &Believed, same: f64) -> Vec<String> {
    as_good(one, same).chain(not_fitted(one)).cloned().collect()
}

/// Those of which there is a plant, with it.
pub(super) fn aliases(one: &Believed, same: f64) -> Vec<Alias> {
    let alias = |rival: &String| {
        let (_, model) = one.rival_models.iter().find(|it| it.0 == *rival)?;
        Some(Alias { cause: one.label.clone(), rival: rival.clone(), model: model.clone(), limit: same })
    };
    as_good(one, same).filter_map(alias).collect()
}

//! Finds a record of another configuration, for example on a steep road or with a heavier load. An effect in only one record is not a fault of the
//! plant, and it would bias every cause that is fitted to all records.
//!
//! In: records and the nominal plant. Out: the one record without which the calibrated plant leaves only noise in all others, prepared for a separate
//! search. If two records differ from the rest, the usual configuration is unknown, and no record is separated. Searches for no cause.

use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::noise::NoiseFloor;
use super::posterior::Posterior;
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use super::{own_noise, validation, whiteness};
use rsm_sim::kind::OUTPUTS;
use rsm_sim::record::Record;

/// Steps of a calibration.
const STEPS: usize = 8;

/// Structure in the other records that counts as none, as a share of the noise energy: the gain that a cause needs before it is named.
const NEGLIGIBLE_STRUCTURE: f64 = 0.0015;

/// The smallest structure of the one record: a twentieth of the noise energy.
const LEAST_STRUCTURE: f64 = 0.05;

/// The smallest number of other records: with two records the usual configuration is unknown.
const LEAST_OTHERS: usize = 2;

/// One record separated from all others.
pub struct SeparateRecord {
    /// Training records without it.
    pub whitened: WhitenedResiduals,
    /// Unseen records without it.
    pub unseen: WhitenedResiduals,
    /// The plant fitted to the other records.
    pub fit: Fit,
    /// That record alone.
    pub alone: WhitenedResiduals,
    /// The nominal plant for that record: parameters may move within their uncertainty from the other records.
    pub nominal: Model,
}

impl SeparateRecord {
    /// Whether the causes found in the record alone leave only noise in all others too, with their numbers as they are. Then they are causes
    /// of the plant that the other records do not excite, such as the limit of an input, and the record is of no other configuration.
    #[must_use]
    pub fn others_accept(&self, found: &Fit) -> bool {
        let sds = Posterior::of(found).deviations().to_vec();
        let accept = |others: &WhitenedResiduals| structure(others, found, &sds).is_some_and(|it| it <= NEGLIGIBLE_STRUCTURE);
        !found.model.file.effects.is_empty() && accept(&self.whitened) && accept(&self.unseen)
    }
}

/// The record that differs from all others, if there is exactly one. `floors` estimates the noise from the residual of a fit.
#[must_use]
pub fn separate_record(
    whitened: &WhitenedResiduals,
    unseen: &WhitenedResiduals,
    nominal: &Model,
    floors: &dyn Fn(&WhitenedResiduals, &Fit) -> [NoiseFloor; OUTPUTS],
) -> Option<SeparateRecord> {
    let (trained, judged) = (whitened.records.len(), unseen.records.len());
    if trained + judged <= LEAST_OTHERS {
        return None;
    }
    let mut found = None;
    for which in 0..trained + judged {
        let it = match which.checked_sub(trained) {
            None if trained > 1 => without(&whitened.records, which)
                .map_or((whitened.clone(), unseen.clone()), |it| (whitened.with_records(it), unseen.clone())),
            None => continue,
            Some(place) => (whitened.clone(), unseen.with_records(without(&unseen.records, place)?)),
        };
        let record = if which < trained { &whitened.records[which] } else { &unseen.records[which - trained] };
        // A record that is the only one of its configuration in the plant file is told by causes of this configuration.
        let all = || whitened.records.iter().chain(&unseen.records).map(|it| &it.record);
        let is_like = |it: &&Record| it.configuration == record.record.configuration;
        if record.record.configuration.is_some() && all().filter(is_like).count() == 1 {
            continue;
        }
        let Some(it) = is_separate(it, record, nominal, floors) else { continue };
        if found.is_some() {
            return None;
        }
        found = Some(it);
    }
    found
}

/// All records but one.
fn without(records: &[Prepared], which: usize) -> Option<Vec<Prepared>> {
    (which < records.len()).then(|| records.iter().enumerate().filter(|(k, _)| *k != which).map(|(_, it)| it.clone()).collect())
}

/// Whether a calibration to the others leaves only noise there, and structure in this record.
fn is_separate(
    (mut whitened, mut unseen): (WhitenedResiduals, WhitenedResiduals),
    record: &Prepared,
    nominal: &Model,
    floors: &dyn Fn(&WhitenedResiduals, &Fit) -> [NoiseFloor; OUTPUTS],
) -> Option<SeparateRecord> {
    let mut fit = levenberg::fit(&whitened, on_records(nominal, &whitened), STEPS)?;
    whitened.floors = floors(&whitened, &fit);
    fit = levenberg::fit(&whitened, fit.model, STEPS)?;
    unseen.floors = whitened.floors;
    let sds = Posterior::of(&fit).deviations().to_vec();
    if whiteness::test(&whitened, &fit).excess > NEGLIGIBLE_STRUCTURE || structure(&unseen, &fit, &sds)? > NEGLIGIBLE_STRUCTURE
    {
        return None;
    }
    let alone = whitened.with_records(vec![record.clone()]);
    if structure(&alone, &fit, &sds)? < LEAST_STRUCTURE {
        return None;
    }
    let mut its = on_records(&fit.model, &alone);
    for (unknown, (of_others, sd)) in its.unknowns.iter_mut().zip(fit.model.unknowns.iter().zip(&sds)) {
        if let (Place::Nominal(name), Some(sd)) = (unknown.place, sd.filter(|sd| *sd > 0.0)) {
            debug_assert_eq!(unknown.place, of_others.place);
            let value = fit.model.file.parameters.number(name);
            (unknown.prior, unknown.low, unknown.high, unknown.scale) =
                (Some((value, sd)), value - 2.0 * sd, value + 2.0 * sd, sd);
        }
    }
    Some(SeparateRecord { whitened, unseen, fit, alone, nominal: its })
}

/// A model with the initial states of these records.
fn on_records(model: &Model, whitened: &WhitenedResiduals) -> Model {
    let mut model = model.clone();
    let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
    model.take_starts(&records, whitened.floors.map(|floor| floor.sd));
    model
}

/// The structure that a fit to other records leaves on these. Its parameters may move within their uncertainty.
fn structure(whitened: &WhitenedResiduals, fit: &Fit, sds: &[Option<f64>]) -> Option<f64> {
    if whitened.records.is_empty() {
        return Some(0.0);
    }
    let there = validation::fit_initial_states(whitened, &fit.model)?;
    let moved = validation::fit_within_uncertainty(whitened, &fit.model, sds, &there)?;
    Some(own_noise::remaining_structure(whitened, moved, 1).excess)
}

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
use rsm_core::threads::in_threads;
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

/// Estimates the noise from the residual of a fit.
type Floors<'a> = dyn Fn(&WhitenedResiduals, &Fit) -> [NoiseFloor; OUTPUTS] + Sync + 'a;

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

/// The record that differs from all others, if there is exactly one.
#[must_use]
pub fn separate_record(
    whitened: &WhitenedResiduals,
    unseen: &WhitenedResiduals,
    nominal: &Model,
    floors: &Floors<'_>,
) -> Option<SeparateRecord> {
    let (trained, judged) = (whitened.records.len(), unseen.records.len());
    if trained + judged <= LEAST_OTHERS {
        return None;
    }
    // A record that is the only one of its configuration in the plant file is told by causes of this configuration.
    let all = || whitened.records.iter().chain(&unseen.records).map(|it| it.record.configuration);
    let is_asked = |it: &Prepared| {
        let its = it.record.configuration;
        its.is_none() || all().filter(|other| *other == its).count() > 1
    };
    // Each plant is fitted by one thread: without a training record, or to all of them.
    let by_one_thread = |it: &WhitenedResiduals| WhitenedResiduals { threads: 1, ..it.clone() };
    let (trains, judges) = (by_one_thread(whitened), by_one_thread(unseen));
    let plants: Vec<Option<usize>> = (0..trained).filter(|_| trained > 1).map(Some).chain([None]).collect();
    let found = in_threads(&plants, whitened.threads, |left_out| -> Vec<SeparateRecord> {
        let asked: Vec<&Prepared> = match left_out {
            Some(record) => vec![&trains.records[*record]],
            None => judges.records.iter().collect(),
        };
        if !asked.iter().any(|it| is_asked(it)) {
            return Vec::new();
        }
        let others = match left_out {
            Some(record) => trains.with_records(without(&trains.records, *record)),
            None => trains.clone(),
        };
        let Some(fitted) = Fitted::to(others, nominal, floors) else { return Vec::new() };
        let one = |(place, record): (usize, &Prepared)| {
            let others = match left_out {
                Some(_) => judges.clone(),
                None => judges.with_records(without(&judges.records, place)),
            };
            is_asked(record).then(|| fitted.separated(others, record)).flatten()
        };
        asked.into_iter().enumerate().filter_map(one).collect()
    });
    let mut found = found.into_iter().flatten();
    let mut one = found.next().filter(|_| found.next().is_none())?;
    for it in [&mut one.whitened, &mut one.unseen, &mut one.alone] {
        it.threads = whitened.threads;
    }
    Some(one)
}

/// All records but one.
fn without(records: &[Prepared], which: usize) -> Vec<Prepared> {
    records.iter().enumerate().filter(|(k, _)| *k != which).map(|(_, it)| it.clone()).collect()
}

/// A plant that is calibrated to records and leaves only noise there.
struct Fitted {
    whitened: WhitenedResiduals,
    fit: Fit,
    /// The standard deviations of its unknowns.
    sds: Vec<Option<f64>>,
}

impl Fitted {
    /// `None` if the calibration leaves structure.
    fn to(mut whitened: WhitenedResiduals, nominal: &Model, floors: &Floors<'_>) -> Option<Fitted> {
        let fit = levenberg::fit(&whitened, on_records(nominal, &whitened), STEPS)?;
        whitened.floors = floors(&whitened, &fit);
        let fit = levenberg::fit(&whitened, fit.model, STEPS)?;
        if whiteness::test(&whitened, &fit).excess > NEGLIGIBLE_STRUCTURE {
            return None;
        }
        let sds = Posterior::of(&fit).deviations().to_vec();
        Some(Fitted { whitened, fit, sds })
    }

    /// A record, separated, if the plant leaves only noise in the other unseen records, and structure in this one.
    fn separated(&self, mut unseen: WhitenedResiduals, record: &Prepared) -> Option<SeparateRecord> {
        let Fitted { whitened, fit, sds } = self;
        unseen.floors = whitened.floors;
        if structure(&unseen, fit, sds)? > NEGLIGIBLE_STRUCTURE {
            return None;
        }
        let alone = whitened.with_records(vec![record.clone()]);
        if structure(&alone, fit, sds)? < LEAST_STRUCTURE {
            return None;
        }
        let mut its = on_records(&fit.model, &alone);
        for (unknown, (of_others, sd)) in its.unknowns.iter_mut().zip(fit.model.unknowns.iter().zip(sds)) {
            if let (Place::Nominal(name), Some(sd)) = (unknown.place, sd.filter(|sd| *sd > 0.0)) {
                debug_assert_eq!(unknown.place, of_others.place);
                let value = fit.model.file.parameters.number(name);
                (unknown.prior, unknown.low, unknown.high, unknown.scale) =
                    (Some((value, sd)), value - 2.0 * sd, value + 2.0 * sd, sd);
            }
        }
        Some(SeparateRecord { whitened: whitened.clone(), unseen, fit: fit.clone(), alone, nominal: its })
    }
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

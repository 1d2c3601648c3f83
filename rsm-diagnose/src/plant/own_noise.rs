//! The noise floors of holdout records, estimated from these records.
//!
//! In: holdout records with a fit to them. Out: their noise floors, the residual whitened by these, the remaining error. Structure does not enter the
//! noise floors.

use super::calibration;
use super::levenberg::Fit;
use super::noise::NoiseFloor;
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use super::whiteness::{self, RemainingStructure};
use rsm_sim::kind::OUTPUTS;

/// Holdout records may have up to this many times the noise of the others, as a standard deviation, for example from a warmer sensor or another
/// cable. Any excess counts as structure.
const MOST_NOISE: f64 = 1.5;

/// The residual on holdout records relative to their own noise, as one of `tests` tests.
pub(crate) fn remaining_structure(unseen: &WhitenedResiduals, moved: Fit, tests: usize) -> RemainingStructure {
    let (there, fit) = by_own_noise(unseen, moved);
    whiteness::test_among(&there, &fit, tests)
}

/// Holdout records with their own noise, and a fit with it. The noise level changes from day to day, so the level of the other records is not
/// accurate enough. If the noise is much larger, or if the records are too short to estimate it, the noise of the others is used.
pub(super) fn by_own_noise(unseen: &WhitenedResiduals, moved: Fit) -> (WhitenedResiduals, Fit) {
    let all_own = |floors: &[NoiseFloor; OUTPUTS], whitened: &WhitenedResiduals, simulated: &[Simulated]| {
        let mut floors = *floors;
        for (floor, shown) in floors.iter_mut().zip(calibration::noise_estimates(whitened, simulated)) {
            *floor = with_own_floor(floor, shown.floor);
        }
        floors
    };
    let mut there = unseen.clone();
    there.floors = all_own(&unseen.floors, unseen, &moved.simulated);
    // Each record may have its own noise model, so each is tested with its own. The larger error of such an estimate counts for all of them.
    let mut residual = Vec::with_capacity(moved.residual.len());
    let pooled = there.floors;
    for (record, simulated) in unseen.records.iter().zip(&moved.simulated) {
        let simulated = std::slice::from_ref(simulated);
        let mut alone = unseen.with_records(vec![record.clone()]);
        alone.floors = all_own(&pooled, &alone, simulated);
        for (floor, own) in there.floors.iter_mut().zip(&alone.floors) {
            floor.error = floor.error.max(own.error);
        }
        residual.extend(alone.residual(simulated));
    }
    (there, Fit { residual, ..moved })
}

/// The noise of a record in place of that of the others, if it can be estimated and is not much larger.
fn with_own_floor(others: &NoiseFloor, shown: Option<NoiseFloor>) -> NoiseFloor {
    let own = shown.map(|own| own.at_least(others.least));
    own.filter(|own| others.rounding.is_none() && own.sd < MOST_NOISE * others.sd).unwrap_or(*others)
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, levenberg};
    use super::*;

    #[test]
    fn louder_noise_on_unseen_records_is_no_structure_and_a_swing_is() {
        let file = axis_under_steps::file("mass = 0.02", "");
        let (whitened, nominal) = axis_under_steps::whitened(&file, &file, true);
        let fit = levenberg::fit(&whitened, nominal, 4).unwrap();
        // The residual times `louder`, and a swing of this many times the noise beside it, ten to the record.
        let left = |louder: f64, swing: f64| {
            let mut unseen = whitened.clone();
            let measured = unseen.records[0].record.measured[0].as_mut().unwrap();
            for (row, value) in measured.iter_mut().enumerate() {
                let simulated = fit.simulated[0][0][row];
                let swing = swing * whitened.floors[0].sd * (0.1 * row as f64).sin();
                *value = simulated + louder * (*value - simulated) + swing;
            }
            remaining_structure(&unseen, fit.clone(), 1).excess
        };
        assert_eq!(left(1.0, 0.0), 0.0);
        assert_eq!(left(1.4, 0.0), 0.0);
        assert!(left(1.8, 0.0) > 0.5, "{}", left(1.8, 0.0));
        assert!(left(1.0, 0.7) > 0.05, "{}", left(1.0, 0.7));
    }

    #[test]
    fn records_have_their_own_noise_where_they_show_it_and_far_more_is_none() {
        let others = NoiseFloor::white(2.0);
        let rounded = NoiseFloor { rounding: Some(super::super::rounding::Rounding { step: 0.3, noise: 0.1 }), ..others };
        assert_eq!(with_own_floor(&others, None), others);
        assert_eq!(with_own_floor(&others, Some(NoiseFloor::white(2.9))), NoiseFloor::white(2.9));
        assert_eq!(with_own_floor(&others, Some(NoiseFloor::white(0.5))), NoiseFloor::white(0.5));
        assert_eq!(with_own_floor(&others, Some(NoiseFloor::white(3.0))), others);
        assert_eq!(with_own_floor(&rounded, Some(NoiseFloor::white(1.9))), rounded);
    }

    #[test]
    fn each_unseen_record_is_judged_by_its_own_noise_and_all_by_what_is_known_worst() {
        let file = axis_under_steps::file("mass = 0.02", "");
        let (whitened, nominal) = axis_under_steps::whitened(&file, &file, true);
        let fit = levenberg::fit(&whitened, nominal, 4).unwrap();
        // Another with noise that is louder by 0.3.
        let mut louder = whitened.records[0].clone();
        let simulated = &fit.simulated[0][0];
        louder.record.measured[0] =
            Some(whitened.records[0].measured(0).iter().zip(simulated).map(|(a, b)| b + 1.3 * (a - b)).collect());
        let of = |records: Vec<super::super::whitened_residuals::Prepared>| {
            let simulated = vec![fit.simulated[0].clone(); records.len()];
            let (there, fit) = by_own_noise(&whitened.with_records(records), Fit { simulated, ..fit.clone() });
            (there.floors[0], fit.residual)
        };
        let quiet = whitened.records[0].clone();
        let [(one, own), (other, others)] = [&quiet, &louder].map(|it| of(vec![it.clone()]));
        let (both, residual) = of(vec![quiet, louder]);
        // Each residual is that of its record alone, and the level is that of both.
        assert_eq!(residual, [own, others].concat());
        assert!(
            (other.sd / one.sd - 1.3).abs() < 1e-9 && both.sd > 1.1 * one.sd && both.sd < 0.95 * other.sd,
            "{one:?} {both:?}"
        );
        // Twice the rows know the correlation better; it counts as well as each record knows its own.
        assert_eq!(both.error, one.error.max(other.error));
        assert!(both.error > 0.0);
    }
}

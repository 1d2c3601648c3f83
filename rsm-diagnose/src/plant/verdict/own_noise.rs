//! The noise of holdout records, by which they are judged.
//!
//! In: holdout records with a fit to them. Out: their noise floors, the residual whitened by these, what is left. Never takes structure for noise.

use super::super::calibration;
use super::super::levenberg::Fit;
use super::super::noise::Floor;
use super::super::whitened_residuals::{Simulated, WhitenedResiduals};
use super::super::whiteness::{self, Left};
use rsm_sim::kind::OUTPUTS;

/// Unseen records may have so many times the noise of the others, in standard deviations, and be no more wrong for it: what a warmer sensor or another cable adds. What
/// is beyond shows as structure.
const MOST_NOISE: f64 = 1.5;

/// What is left on unseen records, by the noise that they have themselves, as one of so many looks.
pub(crate) fn left_there(unseen: &WhitenedResiduals, moved: Fit, looks: usize) -> Left {
    let (there, fit) = by_own_noise(unseen, moved);
    whiteness::look_among(&there, &fit, looks)
}

/// Unseen records with the noise that they have themselves, and a fit by it: its level is known from the others to a per cent, and a day's is not that of the next.
/// Far more of it is none, and records that are too short to show theirs have that of the others.
pub(super) fn by_own_noise(unseen: &WhitenedResiduals, moved: Fit) -> (WhitenedResiduals, Fit) {
    let all_own = |floors: &[Floor; OUTPUTS], whitened: &WhitenedResiduals, simulated: &[Simulated]| {
        let mut floors = *floors;
        for (floor, shown) in floors.iter_mut().zip(calibration::shown(whitened, simulated)) {
            *floor = its_own(floor, shown.floor);
        }
        floors
    };
    let mut there = unseen.clone();
    there.floors = all_own(&unseen.floors, unseen, &moved.simulated);
    // A record may have noise of its own law, too: each is judged by its own, and what that is known worse by counts for all.
    let mut residual = Vec::with_capacity(moved.residual.len());
    let pooled = there.floors;
    for (record, simulated) in unseen.records.iter().zip(&moved.simulated) {
        let simulated = std::slice::from_ref(simulated);
        let mut alone = unseen.on(vec![record.clone()]);
        alone.floors = all_own(&pooled, &alone, simulated);
        for (floor, own) in there.floors.iter_mut().zip(&alone.floors) {
            floor.error = floor.error.max(own.error);
        }
        residual.extend(alone.residual(simulated));
    }
    (there, Fit { residual, ..moved })
}

/// Noise that a record shows, in place of that of the others, where it shows any and far more is none.
pub(super) fn its_own(others: &Floor, shown: Option<Floor>) -> Floor {
    shown.filter(|own| others.rounding.is_none() && own.sd < MOST_NOISE * others.sd).unwrap_or(*others)
}

//! Null draws: noise with the statistics of the noise floors.
//!
//! In: records with noise floors. Out: whitened residuals of a plant without any discrepancy. Residuals are not used.

use super::whitened_residuals::WhitenedResiduals;
use rsm_fit::random::Random;

/// Slower noise than this is a drift.
const SLOWEST_DRAWN: f64 = 0.995;

/// Noise as it comes out of the whitening: white but for the error of the floor's correlation, which is drawn, too.
#[must_use]
pub(super) fn noise(whitened: &WhitenedResiduals, random: &mut Random) -> Vec<f64> {
    let off: Vec<f64> = whitened
        .floors
        .iter()
        .map(|floor| {
            (floor.correlation + floor.error * random.normal()).clamp(-SLOWEST_DRAWN, SLOWEST_DRAWN) - floor.correlation
        })
        .collect();
    let mut stack = Vec::with_capacity(whitened.rows());
    for prepared in &whitened.records {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let correlation = whitened.floors[*output].correlation + off[*output];
            // In units of what is new in a row; it begins as it goes on.
            let mut last = random.normal() / (1.0 - correlation * correlation).sqrt();
            for used in &prepared.used[k] {
                let new = random.normal();
                // (1 - found B)/(1 - true B) on white noise
                stack.push(if *used { new + off[*output] * last } else { 0.0 });
                last = correlation * last + new;
            }
        }
    }
    stack
}

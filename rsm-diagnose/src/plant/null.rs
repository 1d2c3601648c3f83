//! Null draws: noise with the statistics of the noise floors.
//!
//! In: records with noise floors. Out: whitened residuals of a plant without any discrepancy. The actual residuals are not used.

use super::whitened_residuals::WhitenedResiduals;
use rsm_fit::random::Random;

/// Noise with a larger correlation counts as a drift and is not drawn.
const SLOWEST_DRAWN: f64 = 0.995;

/// Noise after whitening. It is white except for the error of the floor's correlation, which is drawn too.
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
            // In units of the innovation. The first value has the stationary distribution.
            let mut last = random.normal() / (1.0 - correlation * correlation).sqrt();
            for used in &prepared.used[k] {
                let new = random.normal();
                // The filter (1 - estimated B)/(1 - true B) on white noise; B is a delay of one row.
                stack.push(if *used { new + off[*output] * last } else { 0.0 });
                last = correlation * last + new;
            }
        }
    }
    stack
}

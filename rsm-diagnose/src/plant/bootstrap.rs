//! The interval of a gain: a moving-block bootstrap over the rows on which the gain is evaluated (H. R. Künsch, 1989).
//!
//! In: errors of two models on the same records. Out: a 95 % interval of the gain. Runs no simulation.

use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_core::order;
use rsm_fit::random::Random;
use rsm_sim::kind::OUTPUTS;

/// The number of draws. The ends of a 95 % interval are the 25th values from either end.
const DRAWS: usize = 1000;

/// The smallest number of blocks for a bootstrap. If there would be fewer, blocks are shorter.
const LEAST_BLOCKS: usize = 16;

/// Sums over a block, by output: the squared error over the noise before, the same after, and the number of rows.
type Sums = [[f64; 3]; OUTPUTS];

/// The interval of the removed share of the squared error above the noise.
#[must_use]
pub fn gain_interval(
    whitened: &WhitenedResiduals,
    before: &[Simulated],
    after: &[Simulated],
    gain: impl Fn(&Sums) -> f64,
) -> (f64, f64) {
    let rows: usize = whitened.records.iter().map(|it| it.record.rows()).sum();
    let length = block(whitened, before, after).clamp(1, (rows / LEAST_BLOCKS).max(1));
    let mut blocks: Vec<Sums> = Vec::new();
    for (record, prepared) in whitened.records.iter().enumerate() {
        let rows = prepared.record.rows();
        for start in (0..rows).step_by(length) {
            let mut sums: Sums = Default::default();
            for (k, output) in prepared.outputs.iter().enumerate() {
                let floor = &whitened.floors[*output];
                let measured = prepared.measured(k);
                for row in (start..(start + length).min(rows)).filter(|row| prepared.used[k][*row]) {
                    let error =
                        |simulated: &[Simulated]| (measured[row] - floor.mean_reading(simulated[record][k][row])) / floor.sd;
                    let sum = &mut sums[*output];
                    sum[0] += error(before) * error(before);
                    sum[1] += error(after) * error(after);
                    sum[2] += 1.0;
                }
            }
            blocks.push(sums);
        }
    }
    let mut random = Random::new(3);
    let mut gains: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let mut sums: Sums = Default::default();
            for _ in 0..blocks.len() {
                let drawn = &blocks[random.below(blocks.len() as u64) as usize];
                sums.iter_mut().flatten().zip(drawn.iter().flatten()).for_each(|(sum, value)| *sum += value);
            }
            gain(&sums)
        })
        .collect();
    order::sort(&mut gains);
    (gains[DRAWS / 40], gains[DRAWS - 1 - DRAWS / 40])
}

/// The number of rows after which errors are uncorrelated: twice the first lag at which the autocorrelation of the change by the extension is below a
/// tenth, over all records and outputs.
fn block(whitened: &WhitenedResiduals, before: &[Simulated], after: &[Simulated]) -> usize {
    let mut longest = 1;
    for (record, prepared) in whitened.records.iter().enumerate() {
        for k in 0..prepared.outputs.len() {
            let measured = prepared.measured(k);
            let change: Vec<f64> = (0..measured.len())
                .map(|row| {
                    let error = |simulated: &[Simulated]| measured[row] - simulated[record][k][row];
                    error(before) * error(before) - error(after) * error(after)
                })
                .collect();
            let mean = change.iter().sum::<f64>() / change.len().max(1) as f64;
            let off: Vec<f64> = change.iter().map(|value| value - mean).collect();
            let squares: f64 = off.iter().map(|value| value * value).sum();
            let mut lag = 1;
            // Lags grow in steps of an eighth. The length of a block need not be more exact.
            while lag < off.len() / LEAST_BLOCKS {
                let products: f64 = off.iter().zip(&off[lag..]).map(|(a, b)| a * b).sum();
                if products < 0.1 * squares {
                    break;
                }
                lag += (lag / 8).max(1);
            }
            longest = longest.max(2 * lag);
        }
    }
    longest
}

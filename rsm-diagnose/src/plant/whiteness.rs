//! Tests whether the residuals with all causes are noise.
//!
//! In: the whitened residual of a fit. Out: for each output and octave of frequencies its energy relative to noise, and whether it exceeds the value
//! that noise exceeds once in 200 cases. The kind of structure is not identified here.

use super::levenberg::Fit;
use super::octave_spectrum::{LEAST_LINES, OCTAVES, Octave, octaves};
use super::rounding::Rounding;
use super::whitened_residuals::WhitenedResiduals;
use crate::engine::significance::quantile;
use rsm_sim::kind::OUTPUTS;

/// The probability that noise alone is taken for structure, over all octaves of all outputs in both tests. The search uses the rest of the 5 % of
/// false alarms of a diagnosis.
const FALSE_ALARM_OF_STRUCTURE: f64 = 0.01;

/// A verdict makes two tests: on the training records and on the holdout records.
pub(super) const TESTS: usize = 2;

/// The smallest variance of rounded readings that is assumed, as a share of the floor's variance. A value that is wrong by a hundredth of a step
/// changes the residual by more.
const LEAST_SCATTER: f64 = 0.01;

/// The energy of an output in a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The octave; 0 is the highest.
    pub octave: usize,
    /// Lowest frequency, in Hz.
    pub low: f64,
    /// Highest frequency, in Hz.
    pub high: f64,
    /// The energy divided by the noise energy: 1 for noise.
    pub ratio: f64,
    /// The number of independent lines of the spectrum in it.
    pub lines: usize,
    /// The deviation from noise in standard deviations; the error of the floor is included.
    pub deviation: f64,
}

/// The structure that is left in a residual.
#[derive(Debug, Clone)]
pub struct RemainingStructure {
    /// Bands of all outputs.
    pub bands: Vec<Band>,
    /// The value that the largest deviation of noise alone exceeds once in two hundred cases.
    pub point: f64,
    /// The energy above the noise in the bands that exceed the point, divided by the noise energy of all bands.
    pub excess: f64,
}

/// The value that the largest of this many deviations of noise exceeds once in two hundred cases, divided among this many tests.
#[must_use]
pub fn point(bands: usize, tests: usize) -> f64 {
    quantile(FALSE_ALARM_OF_STRUCTURE / (TESTS * bands.max(1) * tests.max(1)) as f64)
}

/// Tests the residual of a fit.
#[must_use]
pub fn test(whitened: &WhitenedResiduals, fit: &Fit) -> RemainingStructure {
    test_among(whitened, fit, 1)
}

/// The same, as one of `tests` tests with a common false alarm rate.
#[must_use]
pub fn test_among(whitened: &WhitenedResiduals, fit: &Fit, tests: usize) -> RemainingStructure {
    let mut sums = [[Octave::default(); OCTAVES]; OUTPUTS];
    let mut rate = 0.0_f64;
    let mut first = 0;
    for prepared in &whitened.records {
        let rows = prepared.record.rows();
        rate = rate.max(1.0 / prepared.record.period);
        for (k, output) in prepared.outputs.iter().enumerate() {
            octaves(&fit.residual[first..first + rows], &prepared.used[k], &mut sums[*output]);
            first += rows;
        }
    }
    let mut bands = Vec::new();
    for (output, list) in sums.iter_mut().enumerate() {
        if let Some(rounding) = whitened.floors[output].rounding {
            uneven(whitened, fit, output, rounding, list);
        }
        for (k, octave) in list.iter().enumerate().filter(|(_, octave)| octave.lines >= LEAST_LINES) {
            let high = 0.5 * rate * 0.5_f64.powi(k as i32);
            bands.push(Band {
                output,
                octave: k,
                low: if k == OCTAVES - 1 { 0.0 } else { high / 2.0 },
                high,
                ratio: octave.ratio(),
                lines: octave.lines.round() as usize,
                deviation: octave.deviation(&whitened.floors[output], k),
            });
        }
    }
    let point = point(bands.len(), tests);
    let all: f64 = bands.iter().map(|band| band.lines as f64).sum();
    let beyond = bands.iter().filter(|band| band.deviation > point);
    // The sum of no numbers is -0 in the standard library.
    let excess = beyond.fold(0.0, |sum, band| sum + (band.ratio - 1.0) * band.lines as f64) / all.max(1.0);
    RemainingStructure { bands, point, excess }
}

/// The octaves of rounded readings. Their variance v is large between two steps and small on a step, so the noise level differs from record to
/// record. Because it is uneven, its power scatters more than that of uniform noise: with L lines and N rows by mean(v^2)/(L mean(v)^2) + mean(m - 3
/// v^2)/(N mean(v)^2), where m is the fourth moment (M. B. Priestley, "Spectral analysis and time series", 1981, section 6.2). The result has as many
/// lines as uniform noise with that scatter.
fn uneven(whitened: &WhitenedResiduals, fit: &Fit, output: usize, rounding: Rounding, octaves: &mut [Octave; OCTAVES]) {
    let (mut rows, mut sums) = (0.0, [0.0; 3]);
    for (prepared, simulated) in whitened.records.iter().zip(&fit.simulated) {
        let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
        for (value, _) in simulated[k].iter().zip(&prepared.used[k]).filter(|(_, used)| **used) {
            let [_, variance, fourth] = rounding.moments(*value);
            rows += 1.0;
            sums[0] += variance;
            sums[1] += variance * variance;
            sums[2] += fourth - 3.0 * variance * variance;
        }
    }
    let [mean, square, beyond] = sums.map(|sum| sum / f64::max(rows, 1.0));
    // If all values are on a step, nothing scatters, and a share of the floor's variance is used.
    let noise = mean.max(LEAST_SCATTER * whitened.floors[output].sd.powi(2));
    let even = whitened.floors[output].sd.powi(2) / noise;
    for octave in octaves {
        let scatter = (square + beyond * octave.lines / f64::max(rows, 1.0)) / (noise * noise);
        let share = 1.0 / scatter.max(1.0);
        octave.power *= even * share;
        octave.lines *= share;
    }
}

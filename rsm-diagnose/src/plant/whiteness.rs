//! Tests whether the residuals with all causes are noise.
//!
//! In: the whitened residual of a fit. Out: for each output and octave of frequencies its energy relative to noise, and whether it exceeds what noise
//! shows in 199 of 200 cases. The kind of structure is not identified here.

use super::levenberg::Fit;
use super::octave_spectrum::{LEAST_LINES, OCTAVES, Octave, octaves};
use super::rounding::Rounding;
use super::whitened_residuals::WhitenedResiduals;
use crate::engine::significance::quantile;
use rsm_sim::kind::OUTPUTS;

/// How rarely noise alone may pass for structure, over all octaves of all outputs in both looks. Of the 5 % of false alarms that a diagnosis may have, the search takes the rest.
const ALARM_OF_STRUCTURE: f64 = 0.01;

/// A verdict looks twice: at the records that were fitted, and at those that were not.
pub(super) const LOOKS: usize = 2;

/// Records in which rounded readings scatter by less than this share of the floor's variance count as if they did by as much: a value that is off by a hundredth of a step
/// changes what is left by more.
const LEAST_SCATTER: f64 = 0.01;

/// Energy of an output in a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The octave, from the highest down.
    pub octave: usize,
    /// Lowest frequency, in Hz.
    pub low: f64,
    /// Highest frequency, in Hz.
    pub high: f64,
    /// Energy over that of noise: 1 where it is noise.
    pub ratio: f64,
    /// How many independent lines of the spectrum it holds.
    pub lines: usize,
    /// How far that is above noise, in standard deviations, the floor's own error among them.
    pub deviation: f64,
}

/// What is left.
#[derive(Debug, Clone)]
pub struct Left {
    /// Bands of all outputs.
    pub bands: Vec<Band>,
    /// What the largest deviation of noise alone passes once in two hundred times.
    pub point: f64,
    /// Energy beyond that of noise in the bands that pass the point, over the energy of noise in all bands.
    pub excess: f64,
}

/// What the largest of this many deviations of noise passes once in two hundred times, if there are this many such looks.
#[must_use]
pub fn point(bands: usize, looks: usize) -> f64 {
    quantile(ALARM_OF_STRUCTURE / (LOOKS * bands.max(1) * looks.max(1)) as f64)
}

/// Looks at the residual of a fit.
#[must_use]
pub fn look(whitened: &WhitenedResiduals, fit: &Fit) -> Left {
    look_among(whitened, fit, 1)
}

/// The same, as one of this many looks that may not raise a false alarm together.
#[must_use]
pub fn look_among(whitened: &WhitenedResiduals, fit: &Fit, looks: usize) -> Left {
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
    let point = point(bands.len(), looks);
    let all: f64 = bands.iter().map(|band| band.lines as f64).sum();
    let beyond = bands.iter().filter(|band| band.deviation > point);
    let excess = beyond.map(|band| (band.ratio - 1.0) * band.lines as f64).sum::<f64>() / all.max(1.0);
    Left { bands, point, excess }
}

/// Octaves of readings that are rounded. Their scatter v is large between two steps and small on one: so what noise is differs from record to record, and since it is uneven,
/// and a reading is one of few, its power scatters more than that of even noise: in L lines of N rows by mean(v^2)/(L mean(v)^2) + mean(m - 3 v^2)/(N mean(v)^2),
/// with m the fourth moment (M. B. Priestley, "Spectral analysis and time series", 1981, section 6.2). As many lines as have that scatter of even noise are left.
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
    // Where all values lie on steps nothing scatters, and the floor's own noise stands for it.
    let noise = mean.max(LEAST_SCATTER * whitened.floors[output].sd.powi(2));
    let even = whitened.floors[output].sd.powi(2) / noise;
    for octave in octaves {
        let scatter = (square + beyond * octave.lines / f64::max(rows, 1.0)) / (noise * noise);
        let share = 1.0 / scatter.max(1.0);
        octave.power *= even * share;
        octave.lines *= share;
    }
}

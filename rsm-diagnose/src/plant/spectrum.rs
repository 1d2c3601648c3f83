//! The error by frequency: power spectra before and after, with the spectrum of the noise.
//!
//! In: simulations before and after, along the same records. Out: the power spectral density of each output (P. D. Welch, 1967: half-overlapping Hann
//! segments), lines that exceed their neighbours, and the octave that holds most of the error. Names no cause.

use rsm_core::order;
use std::f64::consts::TAU;

use super::noise_floor::{NoiseFloor, shape};
use super::octave_spectrum::transform;
use super::regions::{Region, SIGNIFICANT, Side};
use super::whitened_residuals::{Simulated, WhitenedResiduals};

/// The longest segment: 2048 samples at 1 kHz resolve half a hertz.
const LONGEST_SEGMENT: usize = 2048;

/// The shortest useful segment.
const SHORTEST_SEGMENT: usize = 64;

/// The smallest number of segments in an average: with eight, the scatter is about a third.
const SEGMENTS: usize = 8;

/// In one of 100 reports, chance alone may give a line.
const CHANCE: f64 = 0.01;

/// The largest number of lines named for an output.
const NAMED_LINES: usize = 3;

/// The spectra of an output.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// The output, by its place in the plant.
    pub output: usize,
    /// Frequencies, in Hz, without 0.
    pub frequency: Vec<f64>,
    /// Power spectral density of the first error: the output's unit squared per Hz.
    pub before: Vec<f64>,
    /// The same of the second error.
    pub after: Vec<f64>,
    /// The same of the estimated noise.
    pub noise: Vec<f64>,
    /// The number of segments averaged in each value.
    pub averages: usize,
}

/// A line that exceeds its neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Its index in the spectrum.
    pub place: usize,
    /// Its power divided by the power of its neighbours.
    pub ratio: f64,
}

/// The spectra of all outputs. Empty if the records are too short.
#[must_use]
pub fn spectra(whitened: &WhitenedResiduals, before: &[Simulated], after: &[Simulated]) -> Vec<Spectrum> {
    // Records with another sample period have other frequencies. Only records with the period of the first one are averaged.
    let Some(period) = whitened.records.first().map(|it| it.record.period) else { return Vec::new() };
    let alike: Vec<usize> =
        (0..whitened.records.len()).filter(|k| (whitened.records[*k].record.period / period - 1.0).abs() < 0.01).collect();
    let rows: usize = alike.iter().map(|k| whitened.records[*k].record.rows()).sum();
    let shortest = alike.iter().map(|k| whitened.records[*k].record.rows()).min().unwrap_or(0);
    let mut size = LONGEST_SEGMENT;
    while size > SHORTEST_SEGMENT && (size > shortest || 2 * rows < (SEGMENTS + 1) * size) {
        size /= 2;
    }
    let window: Vec<f64> = (0..size).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / size as f64).cos()).collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    // One-sided: positive and negative frequencies are added.
    let density = 2.0 * period / energy;
    let mut list = Vec::new();
    for output in 0..whitened.floors.len() {
        let mut sums = [vec![0.0; size / 2], vec![0.0; size / 2]];
        let mut averages = 0;
        for &record in &alike {
            let prepared = &whitened.records[record];
            let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
            let (measured, used) = (prepared.measured(k), &prepared.used[k]);
            for start in (0..).map(|k| k * size / 2).take_while(|start| start + size <= measured.len()) {
                if used[start..start + size].iter().any(|used| !used) {
                    continue;
                }
                // One transform of two real signals: the first is the real part, the second is the imaginary part.
                let part = |simulated: &[Simulated]| -> Vec<f64> {
                    (0..size).map(|i| window[i] * (measured[start + i] - simulated[record][k][start + i])).collect()
                };
                let (mut re, mut im) = (part(before), part(after));
                transform(&mut re, &mut im);
                for line in 1..size / 2 {
                    let (a, b) = ((re[line], im[line]), (re[size - line], im[size - line]));
                    let first = (0.5 * (a.0 + b.0), 0.5 * (a.1 - b.1));
                    let second = (0.5 * (a.1 + b.1), 0.5 * (b.0 - a.0));
                    sums[0][line] += first.0 * first.0 + first.1 * first.1;
                    sums[1][line] += second.0 * second.0 + second.1 * second.1;
                }
                averages += 1;
            }
        }
        if averages == 0 {
            continue;
        }
        let floor = &whitened.floors[output];
        let frequency: Vec<f64> = (1..size / 2).map(|line| line as f64 / (size as f64 * period)).collect();
        let scaled = |sums: &[f64]| sums[1..].iter().map(|sum| sum * density / averages as f64).collect();
        let noise = frequency.iter().map(|f| of_noise(floor, *f, period)).collect();
        list.push(Spectrum { output, before: scaled(&sums[0]), after: scaled(&sums[1]), noise, frequency, averages });
    }
    list
}

/// The one-sided power spectral density of a noise floor at a frequency, in its unit squared per Hz.
#[must_use]
pub fn of_noise(floor: &NoiseFloor, frequency: f64, period: f64) -> f64 {
    let r = floor.correlation;
    let innovation = (1.0 - r * r) / shape(r, (TAU * frequency * period).cos());
    2.0 * period * floor.sd * floor.sd * innovation
}

/// Lines that exceed their neighbours, the strongest first. A line is `apart` values wide to either side; its neighbours are the two values beyond.
///
/// The ratio of two averages of n exponential powers has an F distribution with 2n and 2n degrees of freedom. Half its logarithm is approximately
/// normal with variance 1/(2n) (R. A. Fisher, 1924). A normal variable exceeds x standard deviations with probability below exp(-x^2/2) (H. Chernoff,
/// 1952).
#[must_use]
pub fn peaks(power: &[f64], averages: usize, apart: usize) -> Vec<Peak> {
    if averages < 4 || power.len() < 2 * apart + 5 {
        return Vec::new();
    }
    let passes = (2.0 * (power.len() as f64 / CHANCE).ln()).sqrt();
    let least = (2.0 * passes / (2.0 * averages as f64).sqrt()).exp();
    let mut list = Vec::new();
    for place in 0..power.len() {
        let side = |first: Option<usize>, second: Option<usize>| -> Option<f64> {
            let found: Vec<f64> = [first, second].iter().flatten().filter_map(|k| power.get(*k)).copied().collect();
            (!found.is_empty()).then(|| found.iter().sum::<f64>() / found.len() as f64)
        };
        let below = side(place.checked_sub(apart + 1), place.checked_sub(apart + 2));
        let above = side(Some(place + apart + 1), Some(place + apart + 2));
        // On a slope one side is higher, so a line must exceed both sides. At an edge there is only one side, so no line is reported.
        let (Some(below), Some(above)) = (below, above) else { continue };
        let around = below.max(above);
        let is_highest =
            (place.saturating_sub(apart)..=place + apart).all(|k| power.get(k).is_none_or(|it| *it <= power[place]));
        if around > 0.0 && is_highest && power[place] > least * around {
            list.push(Peak { place, ratio: power[place] / around });
        }
    }
    order::descending(&mut list, |it| power[it.place]);
    list
}

impl Spectrum {
    /// The density of one side.
    #[must_use]
    pub fn of(&self, side: Side) -> &[f64] {
        if side == Side::Before { &self.before } else { &self.after }
    }

    /// The octave that holds most of the error above the noise, and the lines that exceed their neighbours. Shares refer to `all`, the error of all
    /// outputs above the noise in squared standard deviations, and to `own`, that of this output. `rows` and `sd` belong to this output.
    #[must_use]
    pub fn regions(&self, side: Side, sd: f64, rows: usize, own: f64, all: f64) -> Vec<Region> {
        let power = self.of(side);
        let Some(step) = self.frequency.first().copied() else { return Vec::new() };
        // Converts a density to squared standard deviations, summed over the rows.
        let energy = |range: std::ops::Range<usize>| -> f64 {
            let beyond: f64 = range.map(|k| power[k] - self.noise[k]).sum();
            beyond * step * rows as f64 / (sd * sd)
        };
        let mut octaves = Vec::new();
        let mut low = 0;
        while low < power.len() {
            let high = (2 * low + 1).min(power.len());
            octaves.push(low..high);
            low = high;
        }
        let count = octaves.len();
        let mut list = Vec::new();
        let strongest = octaves.into_iter().max_by(|a, b| energy(a.clone()).total_cmp(&energy(b.clone())));
        if let Some(octave) = strongest {
            let lines = (octave.len() * self.averages) as f64;
            let noise: f64 = octave.clone().map(|k| self.noise[k]).sum();
            let beyond: f64 = octave.clone().map(|k| power[k] - self.noise[k]).sum();
            if beyond > SIGNIFICANT * noise / lines.sqrt() {
                let (low, high) = (self.frequency[octave.start], self.frequency[octave.end - 1]);
                let region = if octave.start == 0 {
                    format!("frequencies below {} Hz", shown(1.5 * high))
                } else {
                    format!("frequencies between {} and {} Hz", shown(low), shown(high + step))
                };
                let beyond = energy(octave);
                list.push(Region {
                    output: self.output,
                    quantity: "frequency".to_string(),
                    region,
                    share_of_error: (beyond / all).clamp(0.0, 1.0),
                    share_of_output: (beyond / own).clamp(0.0, 1.0),
                    share_of_rows: 1.0 / count as f64,
                });
            }
        }
        // With a Hann window, a line reaches up to two values to each side.
        for peak in peaks(power, self.averages, 2).into_iter().take(NAMED_LINES) {
            let around = peak.place.saturating_sub(1)..(peak.place + 2).min(power.len());
            let beyond = energy(around);
            let region = format!("a line at {} Hz", shown(self.frequency[peak.place]));
            list.push(Region {
                output: self.output,
                quantity: "line".to_string(),
                region,
                share_of_error: (beyond / all).clamp(0.0, 1.0),
                share_of_output: (beyond / own).clamp(0.0, 1.0),
                share_of_rows: 3.0 / power.len() as f64,
            });
        }
        list
    }
}

/// Three significant digits.
fn shown(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn a_line_stands_out_of_a_steep_slope_and_a_slope_alone_has_none() {
        let mut random = Random::new(5);
        let averages = 12;
        let mut power: Vec<f64> = (1..400)
            .map(|k| {
                let mean = (0..averages).map(|_| -random.uniform().ln()).sum::<f64>() / f64::from(averages);
                mean * (1.0 + 1e4 / f64::from(k).powi(2))
            })
            .collect();
        assert_eq!(peaks(&power, 12, 2), vec![]);
        // 40 times its surroundings, with what a window spreads.
        for (k, share) in [(119, 10.0), (120, 40.0), (121, 10.0)] {
            power[k] *= share;
        }
        let found = peaks(&power, 12, 2);
        assert_eq!(found.iter().map(|it| it.place).collect::<Vec<_>>(), [120]);
    }

    #[test]
    fn the_density_of_noise_sums_to_its_variance() {
        // Over all frequencies up to the Nyquist frequency, whatever the correlation.
        for correlation in [0.0, 0.7] {
            let floor = NoiseFloor { correlation, ..NoiseFloor::white(0.3) };
            let (period, lines) = (1e-3, 20_000);
            let step = 500.0 / f64::from(lines);
            let sum: f64 = (0..lines).map(|k| of_noise(&floor, (f64::from(k) + 0.5) * step, period) * step).sum();
            // The midpoint rule of a smooth periodic function is exact to rounding.
            assert!((sum - 0.09).abs() < 1e-9, "{correlation}: {sum}");
        }
    }
}

//! What is left after all causes: is it noise?
//!
//! In: the whitened residual of a fit. Out: for each output and band of frequencies its energy over that of noise, and whether it is more than noise
//! shows in 95 of 100 cases. Never says what the structure is.

use super::kernel::Kernel;
use super::levenberg::Fit;
use super::noise::{Random, transform};

/// Bands below the Nyquist frequency, an octave each; the last holds everything below.
const BANDS: usize = 8;

/// Draws of the null distribution of the largest band.
const DRAWS: usize = 400;

/// Energy of an output in a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// The output, by its place in the plant.
    pub output: usize,
    /// Lowest frequency, in Hz.
    pub low: f64,
    /// Highest frequency, in Hz.
    pub high: f64,
    /// Energy over that of noise: 1 where it is noise.
    pub ratio: f64,
    /// How many lines of the spectrum it holds.
    pub lines: usize,
}

/// What is left.
#[derive(Debug, Clone)]
pub struct Left {
    /// Bands of all outputs.
    pub bands: Vec<Band>,
    /// The 95 % point, under noise alone, of the largest excess in standard deviations.
    pub point: f64,
    /// Energy beyond that of noise in the bands that pass the point, over the energy of noise in all bands.
    pub excess: f64,
}

/// Looks at the residual of a fit.
#[must_use]
pub fn look(kernel: &Kernel, fit: &Fit) -> Left {
    let mut sums = [[(0.0, 0usize); BANDS]; 3];
    let mut rate = 0.0_f64;
    let mut first = 0;
    for prepared in &kernel.records {
        let rows = prepared.record.rows();
        rate = rate.max(1.0 / prepared.record.period);
        for (k, output) in prepared.outputs.iter().enumerate() {
            let values = &fit.residual[first..first + rows];
            first += rows;
            let used = prepared.used[k].iter().filter(|used| **used).count().max(1);
            let size = rows.next_power_of_two();
            let (mut re, mut im) = (values.to_vec(), vec![0.0; size]);
            re.resize(size, 0.0);
            transform(&mut re, &mut im);
            // Lines of a padded transform are not independent: they count as much as the rows.
            for line in 1..size / 2 {
                let power = (re[line] * re[line] + im[line] * im[line]) / used as f64;
                let octave = ((size / 2) as f64 / line as f64).log2().floor() as usize;
                let sum = &mut sums[*output][octave.min(BANDS - 1)];
                sum.0 += power * rows as f64 / size as f64;
                sum.1 += 1;
            }
        }
    }
    let share: f64 =
        kernel.records.iter().map(|it| it.record.rows() as f64 / it.record.rows().next_power_of_two() as f64).sum::<f64>()
            / kernel.records.len().max(1) as f64;
    let mut bands = Vec::new();
    for (output, list) in sums.iter().enumerate() {
        for (octave, (sum, lines)) in list.iter().enumerate() {
            let lines = (*lines as f64 * share).round() as usize;
            if lines < 2 {
                continue;
            }
            let high = 0.5 * rate / f64::powi(2.0, octave as i32);
            let low = if octave == BANDS - 1 { 0.0 } else { high / 2.0 };
            bands.push(Band { output, low, high, ratio: sum / lines as f64, lines });
        }
    }
    let point = null(&bands);
    let all: f64 = bands.iter().map(|band| band.lines as f64).sum();
    let beyond = bands.iter().filter(|band| deviation(band) > point);
    let excess = beyond.map(|band| (band.ratio - 1.0) * band.lines as f64).sum::<f64>() / all.max(1.0);
    Left { bands, point, excess }
}

/// In standard deviations: the power of a line of noise is exponential, with a standard deviation of one.
fn deviation(band: &Band) -> f64 {
    (band.ratio - 1.0) * (band.lines as f64).sqrt()
}

/// The 95 % point of the largest deviation of bands of noise.
fn null(bands: &[Band]) -> f64 {
    let mut random = Random::new(2);
    let mut largest: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let each = bands.iter().map(|band| {
                // Sums of many exponentials are normal, as far as a 95 % point of a few bands asks; those of few are drawn.
                if band.lines > 50 {
                    random.normal()
                } else {
                    let sum: f64 = (0..band.lines).map(|_| -random.uniform().ln()).sum();
                    (sum / band.lines as f64 - 1.0) * (band.lines as f64).sqrt()
                }
            });
            each.fold(0.0, f64::max)
        })
        .collect();
    largest.sort_by(f64::total_cmp);
    largest[DRAWS * 95 / 100]
}

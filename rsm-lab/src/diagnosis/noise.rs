//! The noise floor of an output, estimated from what is left of its records.
//!
//! In: residuals of an output. Out: a first-order autoregressive model of its noise (white where that will do), which whitens residuals.
//!
//! The spectrum is the median over half-overlapping Hann segments (P. D. Welch, 1967) of the residual's second differences, divided by their transfer:
//! slow structure neither leaks into the upper band nor, where it comes and goes, moves a median. The model is fitted to the band above
//! `LOWEST` alone (P. Whittle, 1953) and continued downwards: what stands above it at low frequencies is structure, not noise.

use std::f64::consts::{PI, TAU};

/// Samples of a segment: 125 of them in a record of 8000 rows.
const SEGMENT: usize = 128;

/// The band that counts as noise begins at this share of the sample rate. Mechanical structure lies below it at usual sample rates.
const LOWEST: f64 = 0.1;

/// Correlations that are tried: beyond 0.97 the noise is slower than its band shows.
const MOST_CORRELATED: i32 = 97;

/// Correlations smaller than this are within the scatter of the estimate on a thousand rows: white.
const WHITE: f64 = 0.04;

/// The noise of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floor {
    /// Standard deviation of the noise.
    pub sd: f64,
    /// Correlation from row to row.
    pub correlation: f64,
}

impl Floor {
    /// White noise.
    #[must_use]
    pub fn white(sd: f64) -> Self {
        Floor { sd, correlation: 0.0 }
    }

    /// Standard deviation of what is new in a row.
    #[must_use]
    pub fn innovation(&self) -> f64 {
        self.sd * (1.0 - self.correlation * self.correlation).sqrt()
    }

    /// Whitened values of length one where the noise is as estimated. Rows that are not `used`, and those that need one of them, give 0.
    pub fn whiten(&self, values: &[f64], used: &[bool], into: &mut Vec<f64>) {
        let innovation = self.innovation();
        for (row, value) in values.iter().enumerate() {
            let whitened = if !used[row] {
                0.0
            } else if row == 0 {
                value / self.sd
            } else if self.correlation == 0.0 {
                value / innovation
            } else if used[row - 1] {
                (value - self.correlation * values[row - 1]) / innovation
            } else {
                0.0
            };
            into.push(whitened);
        }
    }

    /// The floor of residuals, one list a record. `None` where there are too few rows.
    #[must_use]
    pub fn estimate(residuals: &[(&[f64], &[bool])]) -> Option<Floor> {
        let spectrum = spectrum(residuals)?;
        let first = (LOWEST * SEGMENT as f64).ceil() as usize;
        let band = &spectrum[first..];
        // Whittle: the mean of ln S + I/S, with the best level for each correlation.
        let mut best = (f64::INFINITY, 0.0, 0.0);
        for percent in -50..=MOST_CORRELATED {
            let rho = f64::from(percent) / 100.0;
            let shape = |k: usize| {
                let w = TAU * (first + k) as f64 / SEGMENT as f64;
                1.0 - 2.0 * rho * w.cos() + rho * rho
            };
            let level = band.iter().enumerate().map(|(k, power)| power * shape(k)).sum::<f64>() / band.len() as f64;
            let slope = (0..band.len()).map(|k| shape(k).ln()).sum::<f64>() / band.len() as f64;
            let cost = level.ln() - slope;
            if cost < best.0 {
                best = (cost, rho, level);
            }
        }
        let (_, rho, level) = best;
        if rho.abs() < WHITE {
            let level = band.iter().sum::<f64>() / band.len() as f64;
            return positive(level).map(|level| Floor::white(level.sqrt()));
        }
        positive(level).map(|level| Floor { sd: (level / (1.0 - rho * rho)).sqrt(), correlation: rho })
    }
}

fn positive(level: f64) -> Option<f64> {
    (level > 0.0 && level.is_finite()).then_some(level)
}

/// Power for each frequency k/SEGMENT of the sample rate, k up to the Nyquist frequency excluded; white noise of variance one gives 1.
fn spectrum(residuals: &[(&[f64], &[bool])]) -> Option<Vec<f64>> {
    let window: Vec<f64> = (0..SEGMENT).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / SEGMENT as f64).cos()).collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let mut powers: Vec<Vec<f64>> = vec![Vec::new(); SEGMENT / 2];
    for (values, used) in residuals {
        let mut start = 2;
        while start + SEGMENT <= values.len() {
            if used[start - 2..start + SEGMENT].iter().all(|used| *used) {
                let mut re: Vec<f64> = (0..SEGMENT)
                    .map(|k| {
                        let row = start + k;
                        window[k] * (values[row] - 2.0 * values[row - 1] + values[row - 2])
                    })
                    .collect();
                let mut im = vec![0.0; SEGMENT];
                transform(&mut re, &mut im);
                for (k, list) in powers.iter_mut().enumerate().skip(1) {
                    // |1 - e^(-jw)|^4 = (2 sin(w/2))^4
                    let transfer = (2.0 * (PI * k as f64 / SEGMENT as f64).sin()).powi(4);
                    list.push((re[k] * re[k] + im[k] * im[k]) / (energy * transfer));
                }
            }
            start += SEGMENT / 2;
        }
    }
    if powers[1].len() < 4 {
        return None;
    }
    // The median of an exponential variable is ln 2 times its mean.
    Some(powers.iter_mut().map(|list| if list.is_empty() { 0.0 } else { median(list) / std::f64::consts::LN_2 }).collect())
}

/// The median; reorders its values.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
}

/// Discrete Fourier transform in place, for lengths that are powers of two (J. W. Cooley, J. W. Tukey, 1965).
pub fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    debug_assert!(n.is_power_of_two());
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut length = 2;
    while length <= n {
        let half = length / 2;
        for k in 0..half {
            let (sin, cos) = (-TAU * k as f64 / length as f64).sin_cos();
            let mut at = k;
            while at < n {
                let (a, b) = (re[at + half] * cos - im[at + half] * sin, re[at + half] * sin + im[at + half] * cos);
                (re[at + half], im[at + half]) = (re[at] - a, im[at] - b);
                (re[at], im[at]) = (re[at] + a, im[at] + b);
                at += length;
            }
        }
        length *= 2;
    }
}

/// Random numbers for null simulations: the same for the same seed on every machine (G. Marsaglia's xorshift64*, 2003).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// Normal, with mean 0 and variance 1 (G. E. P. Box, M. E. Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(correlation: f64, sd: f64, rows: usize) -> Vec<f64> {
        let mut random = Random::new(7);
        let mut last = sd * random.normal();
        (0..rows)
            .map(|_| {
                last = correlation * last + sd * (1.0 - correlation * correlation).sqrt() * random.normal();
                last
            })
            .collect()
    }

    #[test]
    fn noise_is_found_under_slow_structure_a_hundred_times_as_large() {
        // Over sixty seeds the correlation scatters by 0.013, 0.026 and 0.043, the standard deviation by 1.3, 2.2 and 6 %: three of each, on the grid of 0.01.
        for (correlation, off, share) in [(0.0, 0.05, 0.04), (0.3, 0.08, 0.07), (0.6, 0.13, 0.18)] {
            let mut values = noise(correlation, 0.3, 8000);
            for (k, value) in values.iter_mut().enumerate() {
                *value += 30.0 * (k as f64 / 400.0).sin() + if k > 5000 { 5.0 } else { 0.0 };
            }
            let floor = Floor::estimate(&[(&values, &vec![true; 8000])]).unwrap();
            assert!((floor.sd / 0.3 - 1.0).abs() < share, "{correlation}: {floor:?}");
            assert!((floor.correlation - correlation).abs() < off, "{correlation}: {floor:?}");
        }
    }

    #[test]
    fn whitened_noise_is_white() {
        let values = noise(0.8, 2.0, 8000);
        let mut white = Vec::new();
        Floor { sd: 2.0, correlation: 0.8 }.whiten(&values, &vec![true; 8000], &mut white);
        let power = white.iter().map(|w| w * w).sum::<f64>() / 8000.0;
        let next = white.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / 8000.0;
        // Four standard deviations of a mean over 8000 rows: 4 sqrt(2/8000), 4/sqrt(8000).
        assert!((power - 1.0).abs() < 0.063 && next.abs() < 0.045, "{power} {next}");
    }

    #[test]
    fn the_transform_of_a_cosine_is_one_line() {
        let mut re: Vec<f64> = (0..16).map(|k| (TAU * 3.0 * f64::from(k) / 16.0).cos()).collect();
        let mut im = vec![0.0; 16];
        transform(&mut re, &mut im);
        for (k, value) in re.iter().enumerate() {
            let expected = if k == 3 || k == 13 { 8.0 } else { 0.0 };
            // Four stages of rounding of numbers up to 8.
            assert!((value - expected).abs() < 1e-13 && im[k].abs() < 1e-13);
        }
    }
}

//! The power of whitened residuals in octaves of frequency.
//!
//! In: whitened values. Out: for each octave its power, the number of independent lines, and the deviation from noise. Makes no decision.

use std::f64::consts::TAU;

use super::noise_floor::NoiseFloor;
use crate::engine::significance::deviate_of_chi_squared;

/// The number of octaves below the Nyquist frequency. The last one holds all lower frequencies.
pub const OCTAVES: usize = 8;

/// With fewer lines, an octave is not tested.
pub const LEAST_LINES: f64 = 2.0;

/// The power of whitened values in an octave.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Octave {
    /// The sum of the powers of its lines. A line of white noise has mean power 1.
    pub power: f64,
    /// The number of independent lines.
    pub lines: f64,
}

impl Octave {
    /// The energy divided by the noise energy.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.power / self.lines.max(f64::MIN_POSITIVE)
    }

    /// The deviation of its power from noise, as the normal deviate of equal probability. The power of noise is half of chi squared with two degrees
    /// of freedom for each line, and the error of the noise floor is included.
    #[must_use]
    pub fn deviation(&self, floor: &NoiseFloor, octave: usize) -> f64 {
        let normal = deviate_of_chi_squared(2.0 * self.power, 2.0 * self.lines);
        let error = floor.error * floor.slope(centre(octave));
        normal / (1.0 + self.lines * error * error).sqrt()
    }
}

/// The centre of an octave, as a share of the sample rate.
fn centre(octave: usize) -> f64 {
    0.375 * 0.5_f64.powi(octave as i32)
}

/// Adds the powers of whitened values. Rows that are not `used` are 0 in `white`.
pub fn octaves(white: &[f64], used: &[bool], sums: &mut [Octave; OCTAVES]) {
    let rows = used.iter().filter(|used| **used).count().max(1) as f64;
    let size = white.len().next_power_of_two();
    let (mut re, mut im) = (white.to_vec(), vec![0.0; size]);
    re.resize(size, 0.0);
    transform(&mut re, &mut im);
    // The lines of a zero-padded transform are not independent. Their weight makes their number equal to the number of rows.
    let weight = rows / size as f64;
    for line in 1..size / 2 {
        let octave = ((size / 2) as f64 / line as f64).log2().floor() as usize;
        let sum = &mut sums[octave.min(OCTAVES - 1)];
        sum.power += weight * (re[line] * re[line] + im[line] * im[line]) / rows;
        sum.lines += weight;
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn octaves_of_noise_deviate_as_a_normal_variable_does() {
        let floor = NoiseFloor::white(1.0);
        let mut random = Random::new(11);
        let (mut sum, mut squares, mut beyond) = (0.0, 0.0, 0);
        for _ in 0..200 {
            let white: Vec<f64> = (0..1000).map(|_| random.normal()).collect();
            let mut sums = [Octave::default(); OCTAVES];
            octaves(&white, &vec![true; 1000], &mut sums);
            for (k, octave) in sums.iter().enumerate() {
                let deviation = octave.deviation(&floor, k);
                (sum, squares) = (sum + deviation, squares + deviation * deviation);
                beyond += usize::from(deviation > 1.645);
            }
        }
        // 1600 values: three standard errors of a mean (0.075) and of a variance (0.106); 80 of them beyond the 95 % point, with three times
        // sqrt(76).
        assert!((sum / 1600.0).abs() < 0.075 && (squares / 1600.0 - 1.0).abs() < 0.106, "{sum} {squares}");
        assert!((54..=106).contains(&beyond), "{beyond}");
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

//! Zero-phase low-pass filters, which run forwards and backwards.
//!
//! In: a uniformly sampled signal. Out: the low-pass filtered signal, of the same length. Filters have even order, as second-order sections (one
//! polynomial of eighth order is inaccurate if its cutoff is low). Never used to compare a simulation with a record: those signals stay unfiltered.

use std::f64::consts::PI;

/// A low-pass filter of even order.
#[derive(Debug, Clone, PartialEq)]
pub struct LowPass {
    /// b0, b1, b2, a1, a2 of each section. Each section has the gain 1 at frequency 0.
    sections: Vec<[f64; 5]>,
    /// The gain of the whole filter at frequency 0.
    gain: f64,
}

impl LowPass {
    /// Butterworth filter (S. Butterworth, 1930): -3 dB at the cutoff, which is a share of the Nyquist frequency.
    #[must_use]
    pub fn butterworth(pairs: usize, cutoff: f64) -> Self {
        let poles = (0..pairs).map(|k| {
            let angle = PI * (2 * k + 1) as f64 / (4 * pairs) as f64;
            (-angle.sin(), angle.cos())
        });
        LowPass { sections: sections(poles, cutoff), gain: 1.0 }
    }

    /// Chebyshev filter of the first kind: a ripple in dB up to the cutoff, which is a share of the Nyquist frequency.
    #[must_use]
    pub fn chebyshev(pairs: usize, ripple_db: f64, cutoff: f64) -> Self {
        // |H|^2 = 1/(1 + epsilon^2 T_n^2). Its poles lie on an ellipse with half axes sinh(mu) and cosh(mu).
        let epsilon = (10.0_f64.powf(ripple_db / 10.0) - 1.0).sqrt();
        let mu = (1.0 / epsilon).asinh() / (2 * pairs) as f64;
        let poles = (0..pairs).map(|k| {
            let angle = PI * (2 * k + 1) as f64 / (4 * pairs) as f64;
            (-mu.sinh() * angle.sin(), mu.cosh() * angle.cos())
        });
        // T_n(0) is 1 or -1 for even n, so the gain at frequency 0 is the minimum of the ripple.
        LowPass { sections: sections(poles, cutoff), gain: 1.0 / (1.0 + epsilon * epsilon).sqrt() }
    }

    /// Filters forwards and then backwards. Both ends are extended by point reflection, by three times as many values as the filter has coefficients.
    /// The filter starts in steady state there. A shorter signal is extended as far as its length allows.
    #[must_use]
    pub fn both_ways(&self, values: &[f64]) -> Vec<f64> {
        let n = values.len();
        if n == 0 {
            return Vec::new();
        }
        let more = (3 * (2 * self.sections.len() + 1)).min(n - 1);
        let (first, last) = (values[0], values[n - 1]);
        let mut long: Vec<f64> = (1..=more).rev().map(|k| 2.0 * first - values[k]).collect();
        long.extend_from_slice(values);
        long.extend((1..=more).map(|k| 2.0 * last - values[n - 1 - k]));
        for _ in 0..2 {
            for section in &self.sections {
                pass(section, &mut long);
            }
            long.reverse();
        }
        let gain = self.gain * self.gain;
        long[more..more + n].iter().map(|value| gain * value).collect()
    }
}

/// Sections for the poles in the upper left quarter plane, transformed from a cutoff of 1 rad/s by the bilinear transform s = 2(1 - 1/z)/(1 + 1/z)
/// with a prewarped cutoff.
fn sections(poles: impl Iterator<Item = (f64, f64)>, cutoff: f64) -> Vec<[f64; 5]> {
    let w = 2.0 * (0.5 * PI * cutoff).tan();
    poles
        .map(|(re, im)| {
            let (re, square) = (w * re, w * w * (re * re + im * im));
            let a0 = 4.0 - 4.0 * re + square;
            let b = square / a0;
            [b, 2.0 * b, b, (2.0 * square - 8.0) / a0, (4.0 + 4.0 * re + square) / a0]
        })
        .collect()
}

/// Filters a signal with one section, in transposed direct form, starting in steady state at the first value.
fn pass([b0, b1, b2, a1, a2]: &[f64; 5], values: &mut [f64]) {
    let first = values.first().copied().unwrap_or(0.0);
    let (mut z1, mut z2) = ((1.0 - b0) * first, (b2 - a2) * first);
    for value in values {
        let x = *value;
        let y = b0 * x + z1;
        z1 = b1 * x - a1 * y + z2;
        z2 = b2 * x - a2 * y;
        *value = y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(share_of_nyquist: f64) -> Vec<f64> {
        (0..4000).map(|k| (PI * share_of_nyquist * f64::from(k)).sin()).collect()
    }

    /// Amplitude in the middle, where no end is felt.
    fn middle(values: &[f64]) -> f64 {
        values[1500..2500].iter().fold(0.0, |most: f64, value| most.max(value.abs()))
    }

    #[test]
    fn a_butterworth_has_half_the_power_at_its_cutoff_each_way_and_is_not_late() {
        let filter = LowPass::butterworth(2, 0.2);
        // 1/sqrt(2) each way. The wave has ten samples a period, five of them different: the largest is cos(pi/10) or more of the amplitude.
        let found = middle(&filter.both_ways(&wave(0.2)));
        assert!(found <= 0.5 + 1e-9 && found > 0.5 * (PI / 10.0).cos(), "{found}");
        // |H|^2 = 1/(1 + (tan(pi f/2)/tan(pi f_c/2))^8) at a tenth of the cutoff: 1 - 8e-9.
        let slow = wave(0.02);
        let both = filter.both_ways(&slow);
        let late = slow.iter().zip(&both).skip(1500).take(1000).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(late < 1e-7, "{late}");
    }

    #[test]
    fn a_chebyshev_keeps_its_ripple_up_to_the_cutoff_and_little_beyond() {
        let filter = LowPass::chebyshev(4, 0.05, 0.08);
        // 0.05 dB each way is a factor of 0.98855 in all.
        let lowest = 10.0_f64.powf(-0.1 / 20.0);
        for share in [0.004, 0.03, 0.05] {
            let found = middle(&filter.both_ways(&wave(share)));
            assert!(found > lowest - 0.003 && found < 1.0 + 1e-3, "{share}: {found}");
        }
        assert!((filter.both_ways(&[3.0; 50])[25] - 3.0 * lowest).abs() < 1e-12);
        // T_8(tan(0.08 pi)/tan(0.04 pi)) = T_8(2.03) = 2.5e4: |H|^2 = 1/(0.0116 * 6.3e8) = 1.4e-7.
        let found = middle(&filter.both_ways(&wave(0.16)));
        assert!(found < 3e-7, "{found}");
    }

    #[test]
    fn a_straight_line_stays_one_to_its_ends() {
        let line: Vec<f64> = (0..100).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        let both = LowPass::butterworth(2, 0.3).both_ways(&line);
        // The mirror continues the line; the filter begins 15 values before the end, where its own start has died away to this.
        for (a, b) in line.iter().zip(&both) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }
}

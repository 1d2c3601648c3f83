//! The noise of a band: the part of a residual above some frequency, such as a tenth of the sample rate, above which mechanical structure is rare.
//!
//! In: residuals of an output. Out: their spectrum, the first-order process that fits a band best, whether its spectrum is that of the band, and a
//! test of another process against the band. Lower frequencies are used for one condition only: a process may not have more energy there than the
//! residual has.

use std::f64::consts::{PI, TAU};

use super::noise_floor::{NoiseFloor, shape};
use super::octave_spectrum::{Octave, transform};
use crate::engine::significance::median;

/// The number of samples of a segment: 125 of them in a record of 8000 rows. If many rows are lost, so that fewer than half are in a segment, shorter
/// ones are used.
const SEGMENTS: [usize; 3] = [128, 64, 32];

/// The band that counts as noise begins at this share of the sample rate. Mechanical structure lies below it at usual sample rates.
pub(super) const LOWEST: f64 = 0.1;

/// Correlations are tested up to this many hundredths. Slower noise does not show in the upper band.
pub(super) const MOST_CORRELATED: i32 = 97;

/// A correlation within this many standard errors of 0 counts as 0: the two-sided 95 % point of a normal distribution.
pub(super) const WHITE: f64 = 1.96;

/// The variance of a median over the variance of a mean, for exponential powers: 1/ln(2)^2.
const OF_MEDIAN_POWER: f64 = 2.08;

/// The 99.9 % point of chi squared with two degrees of freedom (correlation and level), -2 ln 0.001. If the estimate from the whole record is
/// rejected wrongly, slow noise must be estimated from the upper band, which hardly shows it. That is worse than accepting a little structure as
/// noise, because whiteness is tested again later.
const REJECTION_POINT: f64 = 13.82;

/// The log power of a line exceeds this many standard deviations once in 10^5 cases for a normal distribution; a Hann window adds a fifth to the
/// scatter. For all lines of the band that is a tenth of a per cent.
const STANDS_OUT: f64 = 5.3;

/// An octave of a band agrees with a process within this many standard deviations: the two-sided 95 % point of a normal distribution. A band that is
/// refused wrongly is replaced by a narrower one, which costs accuracy only.
const AGREES: f64 = 1.96;

/// The lines of a spectrum above a frequency.
pub(super) struct Band<'a> {
    powers: &'a [f64],
    first: usize,
    /// The number of independent powers behind all lines together.
    lines: f64,
}

impl<'a> Band<'a> {
    /// The band above `lowest`, a share of the sample rate.
    pub(super) fn above(lowest: f64, spectrum: &'a [f64], rows: f64) -> Self {
        let first = (lowest * (2 * spectrum.len()) as f64).ceil() as usize;
        // Half a line per row over all frequencies. A median uses the information of one power in `OF_MEDIAN_POWER`.
        Band { powers: &spectrum[first..], first, lines: 0.5 * rows * (1.0 - 2.0 * lowest) / OF_MEDIAN_POWER }
    }

    fn cosines(&self) -> impl Iterator<Item = f64> {
        let first = self.first;
        let size = 2 * (first + self.powers.len());
        (0..self.powers.len()).map(move |k| (TAU * (first + k) as f64 / size as f64).cos())
    }

    /// The best level for a correlation (the power of the innovations), and Whittle's mean of ln S + I/S for it.
    fn at(&self, correlation: f64) -> (f64, f64) {
        let n = self.powers.len() as f64;
        let level = self.powers.iter().zip(self.cosines()).map(|(power, cos)| power * shape(correlation, cos)).sum::<f64>() / n;
        (level, level.ln() + 1.0 - self.cosines().map(|cos| shape(correlation, cos).ln()).sum::<f64>() / n)
    }

    /// The best correlation among those with no more slow noise than the residual has. Impacts in the upper band have a spectrum that falls like slow
    /// noise; extrapolated to low frequencies, it would hide all structure.
    pub(super) fn best(&self, slow: &[(usize, Octave)]) -> Option<NoiseFloor> {
        let grid = (-50..=MOST_CORRELATED).map(|percent| f64::from(percent) / 100.0);
        let grid: Vec<f64> = grid
            .filter(|rho| *rho <= 0.0 || slow.iter().all(|(k, octave)| holds(*octave, *k, *rho, self.at(*rho).0)))
            .collect();
        let rho = grid.iter().copied().min_by(|a, b| self.at(*a).1.total_cmp(&self.at(*b).1))?;
        let least = self.at(rho).1;
        let ratio = |other: f64| 2.0 * self.lines * (self.at(other).1 - least);
        // One standard error away, the log likelihood ratio is 1 (S. S. Wilks, 1938). Near a correlation of 1, correlation and level change all lines
        // of the band alike. The curvature at the optimum is then misleading, and the two sides differ.
        let side = |end: f64| {
            let (mut near, mut far) = (rho, end);
            if ratio(end) < 1.0 {
                return (end - rho).abs();
            }
            // A thousandth of an error of 0.03.
            while (far - near).abs() > 3e-5 {
                let middle = 0.5 * (near + far);
                if ratio(middle) < 1.0 { near = middle } else { far = middle }
            }
            (near - rho).abs()
        };
        let error = side(-0.5).max(side(*grid.last()?));
        if ratio(0.0) < WHITE * WHITE {
            return positive(self.at(0.0).0).map(|level| NoiseFloor { error, ..NoiseFloor::white(level.sqrt()) });
        }
        let innovation = positive(self.at(rho).0);
        innovation.map(|level| NoiseFloor { correlation: rho, error, ..NoiseFloor::white((level / (1.0 - rho * rho)).sqrt()) })
    }

    /// Whether no line exceeds the spectrum of a floor significantly. Such a line would be a wave.
    pub(super) fn is_smooth(&self, floor: &NoiseFloor) -> bool {
        let level = floor.innovation() * floor.innovation();
        let lines = self.lines / self.powers.len() as f64;
        let off =
            self.powers.iter().zip(self.cosines()).map(|(power, cos)| (power * shape(floor.correlation, cos) / level).ln());
        off.fold(0.0_f64, |most, off| most.max(off.abs())) * lines.sqrt() < STANDS_OUT
    }

    /// Whether every octave of the band has the power that a floor has there.
    pub(super) fn agrees(&self, floor: &NoiseFloor) -> bool {
        let level = floor.innovation() * floor.innovation();
        let shares: Vec<f64> =
            self.powers.iter().zip(self.cosines()).map(|(power, cos)| power * shape(floor.correlation, cos) / level).collect();
        let lines = self.lines / self.powers.len() as f64;
        let mut from = 0;
        while from < shares.len() {
            let to = (2 * from + self.first).min(shares.len());
            let octave = &shares[from..to];
            let count = octave.len() as f64;
            let mean = octave.iter().sum::<f64>() / count;
            if (mean - 1.0).abs() * (count * lines).sqrt() > AGREES {
                return false;
            }
            from = to;
        }
        true
    }

    /// Whether the band rejects the correlation of a floor, at 0.1 %, whatever its level: of noise with some louder rows, a median and a mean differ.
    pub(super) fn rejects_correlation(&self, floor: &NoiseFloor) -> bool {
        let (level, _) = self.at(floor.correlation);
        let innovation = (1.0 - floor.correlation * floor.correlation).sqrt();
        self.rejects(&NoiseFloor { sd: level.sqrt() / innovation, ..*floor })
    }

    /// Whether the likelihood ratio against the best fit of this band rejects a floor, at 0.1 %.
    pub(super) fn rejects(&self, floor: &NoiseFloor) -> bool {
        let level = floor.innovation() * floor.innovation();
        let (own, cost) = self.at(floor.correlation);
        let cost = cost - own.ln() - 1.0 + level.ln() + own / level;
        let grid = (-50..=MOST_CORRELATED).map(|percent| self.at(f64::from(percent) / 100.0).1);
        let least = grid.fold(f64::INFINITY, f64::min);
        let ratio = 2.0 * self.lines * (cost - least);
        ratio.is_nan() || ratio >= REJECTION_POINT
    }
}

/// Whether an octave has at least the power of noise with this correlation and level, except in one of a thousand cases by chance.
fn holds(octave: Octave, k: usize, correlation: f64, level: f64) -> bool {
    // The mean over the octave, from eight frequencies. For a steep spectrum it differs from the value at the centre.
    let places = (0..8).map(|place| 0.25 * 0.5_f64.powi(k as i32) * (1.0 + (f64::from(place) + 0.5) / 8.0));
    let expected = places.map(|share| level / shape(correlation, (TAU * share).cos())).sum::<f64>() / 8.0;
    let held = Octave { power: octave.power / expected, lines: octave.lines };
    // 3.66 as in `is_white`.
    held.deviation(&NoiseFloor::white(1.0), k) > -3.66
}

pub(super) fn positive(level: f64) -> Option<f64> {
    (level > 0.0 && level.is_finite()).then_some(level)
}

/// The power at each frequency k/n of the sample rate, for k below n/2, where n is twice the length of the list. White noise of variance one gives 1.
pub(super) fn spectrum(residuals: &[(&[f64], &[bool])]) -> Option<Vec<f64>> {
    let rows: usize = residuals.iter().map(|(_, used)| used.iter().filter(|used| **used).count()).sum();
    let starts = SEGMENTS.map(|size| starts(residuals, size));
    // Half-overlapping segments: this many contain half of the rows.
    let enough = |k: &usize| starts[*k].len() * SEGMENTS[*k] >= rows;
    let most = || (0..SEGMENTS.len()).max_by_key(|k| starts[*k].len() * SEGMENTS[*k]);
    let chosen = (0..SEGMENTS.len()).find(enough).or_else(most)?;
    let (size, starts) = (SEGMENTS[chosen], &starts[chosen]);
    if starts.len() < 4 {
        return None;
    }
    let window: Vec<f64> = (0..size).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / size as f64).cos()).collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let mut powers: Vec<Vec<f64>> = vec![Vec::new(); size / 2];
    for (record, start) in starts {
        let values = residuals[*record].0;
        let second = |row: usize| values[row] - 2.0 * values[row - 1] + values[row - 2];
        let mut re: Vec<f64> = (0..size).map(|k| window[k] * second(start + k)).collect();
        let mut im = vec![0.0; size];
        transform(&mut re, &mut im);
        for (k, list) in powers.iter_mut().enumerate().skip(1) {
            // |1 - e^(-jw)|^4 = (2 sin(w/2))^4. A line of a Hann window holds a sixth of each neighbour, which counts where the transfer is steep.
            let of = |k: usize| (2.0 * (PI * k as f64 / size as f64).sin()).powi(4);
            let transfer = (of(k - 1) + 4.0 * of(k) + of(k + 1)) / 6.0;
            list.push((re[k] * re[k] + im[k] * im[k]) / (energy * transfer));
        }
    }
    // The median of an exponential variable is ln 2 times its mean.
    Some(powers.iter_mut().map(|list| if list.is_empty() { 0.0 } else { median(list) / std::f64::consts::LN_2 }).collect())
}

/// Half-overlapping segments of used rows, with two used rows before each: the record and the first row.
fn starts(residuals: &[(&[f64], &[bool])], size: usize) -> Vec<(usize, usize)> {
    let mut list = Vec::new();
    for (record, (_, used)) in residuals.iter().enumerate() {
        let mut start = 2;
        while start + size <= used.len() {
            match used[start - 2..start + size].iter().rposition(|used| !used) {
                // The next one begins after the row that does not count.
                Some(place) => start += place + 1,
                None => {
                    list.push((record, start));
                    start += size / 2;
                }
            }
        }
    }
    list
}

//! The noise of the upper band: the part of a residual above a tenth of the sample rate, where mechanical structure is rare.
//!
//! In: residuals of an output. Out: their spectrum, the first-order process that fits its upper band best, and how far that band rejects another process. Lower frequencies are used for one
//! condition only: a process may not have more energy there than the residual has.

use std::f64::consts::{PI, TAU};

use super::floor::{Floor, shape};
use super::octave_spectrum::{Octave, transform};
use crate::engine::significance::median;

/// Samples of a segment: 125 of them in a record of 8000 rows. Where rows are lost so often that fewer than half of the rows stand in one, segments are shorter.
const SEGMENTS: [usize; 3] = [128, 64, 32];

/// The band that counts as noise begins at this share of the sample rate. Mechanical structure lies below it at usual sample rates.
pub(super) const LOWEST: f64 = 0.1;

/// Correlations that are tried: beyond 0.97 the noise is slower than its band shows.
pub(super) const MOST_CORRELATED: i32 = 97;

/// A correlation within this many standard errors of 0 is none: the two-sided 95 % point of a normal distribution.
pub(super) const WHITE: f64 = 1.96;

/// The variance of a median over the variance of a mean, for exponential powers: 1/ln(2)^2.
const OF_MEDIAN_POWER: f64 = 2.08;

/// The 99.9 % point of chi squared with two degrees of freedom, -2 ln 0.001: correlation and level. A whole record that is refused without a reason leaves slow noise
/// to the upper band, which hardly sees it: that is dearer than a trace of structure in the noise, which whiteness is asked about again.
const REFUSED: f64 = 13.82;

/// The logarithm of a line's power passes this many of its standard deviations once in 10^5 cases, with a normal distribution (and a Hann window makes lines scatter by a fifth more): a tenth of a per cent for all
/// lines of the band.
const STANDS_OUT: f64 = 5.3;

/// Lines of a spectrum above `LOWEST`.
pub(super) struct Band<'a> {
    powers: &'a [f64],
    first: usize,
    /// How many independent powers stand behind all of them together.
    lines: f64,
}

impl<'a> Band<'a> {
    pub(super) fn upper(spectrum: &'a [f64], rows: f64) -> Self {
        let first = (LOWEST * (2 * spectrum.len()) as f64).ceil() as usize;
        // Half a line a row over the whole band, of which a median uses the information of one in `OF_MEDIAN_POWER`.
        Band { powers: &spectrum[first..], first, lines: 0.5 * rows * (1.0 - 2.0 * LOWEST) / OF_MEDIAN_POWER }
    }

    fn cosines(&self) -> impl Iterator<Item = f64> {
        let first = self.first;
        let size = 2 * (first + self.powers.len());
        (0..self.powers.len()).map(move |k| (TAU * (first + k) as f64 / size as f64).cos())
    }

    /// The level (power of what is new in a row) that suits a correlation best, and Whittle's mean of ln S + I/S there.
    fn at(&self, correlation: f64) -> (f64, f64) {
        let n = self.powers.len() as f64;
        let level = self.powers.iter().zip(self.cosines()).map(|(power, cos)| power * shape(correlation, cos)).sum::<f64>() / n;
        (level, level.ln() + 1.0 - self.cosines().map(|cos| shape(correlation, cos).ln()).sum::<f64>() / n)
    }

    /// The best correlation of those that ask for no more slow noise than the residual holds at all: what knocks in the upper band falls off like slow noise, and
    /// continued downwards it would hide everything.
    pub(super) fn best(&self, slow: &[(usize, Octave)]) -> Option<Floor> {
        let grid = (-50..=MOST_CORRELATED).map(|percent| f64::from(percent) / 100.0);
        let grid: Vec<f64> = grid
            .filter(|rho| *rho <= 0.0 || slow.iter().all(|(k, octave)| holds(*octave, *k, *rho, self.at(*rho).0)))
            .collect();
        let rho = grid.iter().copied().min_by(|a, b| self.at(*a).1.total_cmp(&self.at(*b).1))?;
        let least = self.at(rho).1;
        let ratio = |other: f64| 2.0 * self.lines * (self.at(other).1 - least);
        // One standard error away the likelihood ratio is 1 (S. S. Wilks, 1938). Near 1 a correlation moves all lines of the band alike, as its level does: there a
        // curvature at the best says nothing, and the two sides differ.
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
            return positive(self.at(0.0).0).map(|level| Floor { error, ..Floor::white(level.sqrt()) });
        }
        let innovation = positive(self.at(rho).0);
        innovation.map(|level| Floor { correlation: rho, error, ..Floor::white((level / (1.0 - rho * rho)).sqrt()) })
    }

    /// Whether no line stands out of what a floor says of it: one that does is a wave.
    pub(super) fn is_smooth(&self, floor: &Floor) -> bool {
        let level = floor.innovation() * floor.innovation();
        let lines = self.lines / self.powers.len() as f64;
        let off =
            self.powers.iter().zip(self.cosines()).map(|(power, cos)| (power * shape(floor.correlation, cos) / level).ln());
        off.fold(0.0_f64, |most, off| most.max(off.abs())) * lines.sqrt() < STANDS_OUT
    }

    /// The likelihood ratio against the best of this band, at 0.1 %.
    pub(super) fn refuses(&self, floor: &Floor) -> bool {
        let level = floor.innovation() * floor.innovation();
        let (own, cost) = self.at(floor.correlation);
        let cost = cost - own.ln() - 1.0 + level.ln() + own / level;
        let grid = (-50..=MOST_CORRELATED).map(|percent| self.at(f64::from(percent) / 100.0).1);
        let least = grid.fold(f64::INFINITY, f64::min);
        let ratio = 2.0 * self.lines * (cost - least);
        ratio.is_nan() || ratio >= REFUSED
    }
}

/// Whether an octave holds as much power as noise of this correlation and level would have there, but for what chance takes away once in a thousand cases.
fn holds(octave: Octave, k: usize, correlation: f64, level: f64) -> bool {
    // The mean over the octave, from eight places: that of a steep spectrum is not what its middle has.
    let places = (0..8).map(|place| 0.25 * 0.5_f64.powi(k as i32) * (1.0 + (f64::from(place) + 0.5) / 8.0));
    let expected = places.map(|share| level / shape(correlation, (TAU * share).cos())).sum::<f64>() / 8.0;
    let held = Octave { power: octave.power / expected, lines: octave.lines };
    // 3.66 as in `is_white`.
    held.deviation(&Floor::white(1.0), k) > -3.66
}

pub(super) fn positive(level: f64) -> Option<f64> {
    (level > 0.0 && level.is_finite()).then_some(level)
}

/// Power for each frequency k/n of the sample rate, k up to n/2 excluded, n twice the length of the list; white noise of variance one gives 1.
pub(super) fn spectrum(residuals: &[(&[f64], &[bool])]) -> Option<Vec<f64>> {
    let rows: usize = residuals.iter().map(|(_, used)| used.iter().filter(|used| **used).count()).sum();
    let starts = SEGMENTS.map(|size| starts(residuals, size));
    // Half-overlapping segments: this many hold half of the rows.
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
            // |1 - e^(-jw)|^4 = (2 sin(w/2))^4
            let transfer = (2.0 * (PI * k as f64 / size as f64).sin()).powi(4);
            list.push((re[k] * re[k] + im[k] * im[k]) / (energy * transfer));
        }
    }
    // The median of an exponential variable is ln 2 times its mean.
    Some(powers.iter_mut().map(|list| if list.is_empty() { 0.0 } else { median(list) / std::f64::consts::LN_2 }).collect())
}

/// Half-overlapping segments of used rows, with two rows before each: record and first row.
fn starts(residuals: &[(&[f64], &[bool])], size: usize) -> Vec<(usize, usize)> {
    let mut list = Vec::new();
    for (record, (_, used)) in residuals.iter().enumerate() {
        let mut start = 2;
        while start + size <= used.len() {
            match used[start - 2..start + size].iter().rposition(|used| !used) {
                // The next one begins behind the row that does not count.
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

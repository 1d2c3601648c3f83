//! The noise floor of an output, estimated from the residuals of its records.
//!
//! In: residuals of an output. Out: a first-order autoregressive model of its noise (white noise if that is sufficient), which whitens residuals, and
//! the standard error of its correlation.
//!
//! There are three estimates. The first uses the upper band and is valid whatever slow structure the residual has. Its spectrum is the median over
//! half-overlapping Hann segments (P. D. Welch, 1967) of second differences, divided by their transfer function. The model is fitted above `LOWEST`
//! only (P. Whittle, 1953) and continued to lower frequencies. The second uses a wider band in the same way, if the spectrum of that band agrees with
//! it. The third uses the whole record. It is ten times as precise for slow noise, but wrong where there is structure, so it is used only if it
//! passes two tests: no band rejects it, and the residual that it whitens is white in every octave. Energy above the noise at low frequencies
//! therefore remains structure.

use super::growth::{self, Growth};
pub use super::noise_floor::NoiseFloor;
use super::octave_spectrum::{LEAST_LINES, OCTAVES, Octave, octaves};
use super::rounding::Rounding;
use super::upper_band::{Band, LOWEST, WHITE, positive, spectrum};

/// Wider bands than the upper one that are tried first: above these shares of the sample rate, the widest first. They know slow noise much better
/// (the power of noise with a correlation of 0.8 falls from 0.036 of the sample rate on), and more often hold structure. Below 0.02 are fewer than
/// three lines of a segment.
const WIDER: [f64; 2] = [0.02, 0.04];

/// The largest correlation that is estimated from a whole record. Above it, noise cannot be distinguished from a drift.
const SLOWEST: f64 = 0.999;

impl NoiseFloor {
    /// The floor of a rounding sensor, from simulated values and the residuals about the mean reading, one list for each record: the standard
    /// deviation from the rounding model, and the correlation from row to row.
    #[must_use]
    pub fn of_rounding(rounding: Rounding, simulated: &[&[f64]], left: &[(&[f64], &[bool])]) -> Option<NoiseFloor> {
        let rows: usize = simulated.iter().map(|values| values.len()).sum();
        let variance = simulated.iter().flat_map(|values| values.iter()).map(|value| rounding.moments(*value)[1]).sum::<f64>();
        let sd = positive(variance / rows.max(1) as f64)?.sqrt();
        let neighbours = whole(left, rows as f64).unwrap_or(NoiseFloor::white(sd));
        Some(NoiseFloor { sd, rounding: Some(rounding), ..neighbours })
    }

    /// The floor of noise that grows with the reading, from readings and residuals, one list for each record; `None` if it does not grow. If more
    /// than such noise is left, the law is used as row weights only if the residual has the same correlations at all readings. Otherwise structure at
    /// large readings would count as noise.
    #[must_use]
    pub fn of_growing(lists: &[(&[f64], &[f64], &[bool])]) -> Option<NoiseFloor> {
        let growth = Growth::found(lists)?;
        let even = |(measured, left, _): &(&[f64], &[f64], &[bool])| {
            let mut left = left.to_vec();
            growth.scale_to_uniform(measured, &mut left);
            left
        };
        let even: Vec<Vec<f64>> = lists.iter().map(even).collect();
        let residuals: Vec<(&[f64], &[bool])> = even.iter().zip(lists).map(|(left, it)| (left.as_slice(), it.2)).collect();
        let rows = residuals.iter().map(|(_, used)| used.iter().filter(|used| **used).count()).sum::<usize>() as f64;
        let whole = whole(&residuals, rows)?;
        let spectrum = spectrum(&residuals)?;
        let band = Band::above(LOWEST, &spectrum, rows);
        let floor = if !band.rejects(&whole) && is_white(&whole, &residuals) {
            whole
        } else {
            let even: Vec<_> =
                lists.iter().zip(&even).map(|((measured, _, used), left)| (*measured, left.as_slice(), *used)).collect();
            let upper = band.best(&below(LOWEST, &unwhitened(&residuals)))?;
            (band.is_smooth(&upper) && growth::has_one_correlation(&even)).then_some(upper)?
        };
        Some(NoiseFloor { growth: Some(growth), ..floor })
    }

    /// The noise floor from residuals, one list for each record. `None` if there are too few rows.
    #[must_use]
    pub fn estimate(residuals: &[(&[f64], &[bool])]) -> Option<NoiseFloor> {
        let spectrum = spectrum(residuals)?;
        let rows = residuals.iter().map(|(_, used)| used.iter().filter(|used| **used).count()).sum::<usize>() as f64;
        let band = Band::above(LOWEST, &spectrum, rows);
        let slow = unwhitened(residuals);
        // Wider bands that agree with their own best process, each with it.
        let wider = WIDER.map(|lowest| {
            let wider = Band::above(lowest, &spectrum, rows);
            let best = wider.best(&below(lowest, &slow)).filter(|it| !band.rejects(it) && wider.agrees(it))?;
            Some((wider, best))
        });
        let rejects = |floor: &NoiseFloor| wider.iter().flatten().any(|it| it.0.rejects_correlation(floor));
        let accepted = |whole: &NoiseFloor| !band.rejects(whole) && is_white(whole, residuals) && !rejects(whole);
        let of_a_band = || wider.iter().flatten().map(|it| it.1).next().or_else(|| band.best(&below(LOWEST, &slow)));
        whole(residuals, rows).filter(accepted).or_else(of_a_band)
    }
}

/// The octaves of the unwhitened residual.
fn unwhitened(residuals: &[(&[f64], &[bool])]) -> [Octave; OCTAVES] {
    let mut sums = [Octave::default(); OCTAVES];
    for (values, used) in residuals {
        let kept: Vec<f64> = values.iter().zip(*used).map(|(value, used)| if *used { *value } else { 0.0 }).collect();
        octaves(&kept, used, &mut sums);
    }
    sums
}

/// The octaves below a band, with their places.
fn below(lowest: f64, octaves: &[Octave; OCTAVES]) -> Vec<(usize, Octave)> {
    let is_below = |k: usize| 0.5_f64.powi(k as i32 + 1) <= lowest;
    octaves.iter().copied().enumerate().filter(|(k, octave)| is_below(*k) && octave.lines >= LEAST_LINES).collect()
}

/// The estimate from all frequencies: products of neighbours divided by squares.
fn whole(residuals: &[(&[f64], &[bool])], rows: f64) -> Option<NoiseFloor> {
    let (mut squares, mut before, mut products, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (values, used) in residuals {
        for row in 1..values.len() {
            if used[row] && used[row - 1] {
                squares += values[row] * values[row];
                before += values[row - 1] * values[row - 1];
                products += values[row] * values[row - 1];
                count += 1.0;
            }
        }
    }
    let sd = positive(0.5 * (squares + before) / count)?.sqrt();
    let rho = products / (squares * before).sqrt();
    // M. S. Bartlett, 1946.
    let error = ((1.0 - rho * rho) / rows).sqrt();
    let correlation = if rho.abs() < WHITE * error { 0.0 } else { rho };
    (correlation.abs() < SLOWEST).then_some(NoiseFloor { correlation, error, ..NoiseFloor::white(sd) })
}

/// Whether every octave has the power of noise after whitening by a floor, neither more nor less: at 0.2 % for all octaves together. A slow drift
/// over faster noise has too much power in the lowest octave for a fast process, and too little above it for a slow one.
fn is_white(floor: &NoiseFloor, residuals: &[(&[f64], &[bool])]) -> bool {
    let mut sums = [Octave::default(); OCTAVES];
    for (values, used) in residuals {
        let mut white = Vec::with_capacity(values.len());
        floor.whiten(values, used, &mut white);
        octaves(&white, used, &mut sums);
    }
    let bands = sums.iter().filter(|octave| octave.lines >= LEAST_LINES);
    // A normal variable exceeds 3.66 once in 8000 cases: 0.1 % for eight octaves, on each side.
    bands.enumerate().all(|(k, octave)| octave.deviation(floor, k).abs() < 3.66)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::order;
    use rsm_fit::random::Random;
    use std::f64::consts::{PI, TAU};

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
        // Here the whole record is refused, and the upper band speaks. Over sixty seeds its correlation scatters by 0.013, 0.026 and 0.043, the
        // standard deviation by 1.3, 2.2 and 6 %: three of each, on the grid of 0.01.
        for (correlation, off, share) in [(0.0, 0.05, 0.04), (0.3, 0.08, 0.07), (0.6, 0.13, 0.18)] {
            let mut values = noise(correlation, 0.3, 8000);
            for (k, value) in values.iter_mut().enumerate() {
                *value += 30.0 * (k as f64 / 400.0).sin() + if k > 5000 { 5.0 } else { 0.0 };
            }
            let floor = NoiseFloor::estimate(&[(&values, &vec![true; 8000])]).unwrap();
            assert!((floor.sd / 0.3 - 1.0).abs() < share, "{correlation}: {floor:?}");
            assert!((floor.correlation - correlation).abs() < off, "{correlation}: {floor:?}");
        }
    }

    #[test]
    fn noise_that_is_slow_in_all_of_the_band_is_not_called_white() {
        // There a correlation moves all lines alike, as the level does: the curvature at the best says that it could be anything.
        for correlation in [0.97, 0.99] {
            let values = noise(correlation, 0.3, 4000);
            let spectrum = spectrum(&[(&values, &vec![true; 4000])]).unwrap();
            let floor = Band::above(LOWEST, &spectrum, 4000.0).best(&[]).unwrap();
            // Beyond 0.8 the lines of the band fall alike to 2 %: so far it may be off, and no further.
            assert!(floor.correlation > 0.8 && floor.error < 0.2, "{correlation}: {floor:?}");
        }
    }

    #[test]
    fn what_knocks_in_the_upper_band_does_not_pass_for_slow_noise() {
        // Steps up and down, as of a contact that opens and closes: their spectrum falls like that of a correlation near 1, but for what they return
        // at once.
        let mut values = noise(0.0, 0.3, 8000);
        let mut random = Random::new(9);
        let mut place = 0;
        while place + 4 < values.len() {
            values[place..place + 4].iter_mut().for_each(|value| *value += 3.0);
            values[place + 4..].iter_mut().take(4).for_each(|value| *value -= 3.0);
            place += 8 + (30.0 * random.uniform()) as usize;
        }
        let floor = NoiseFloor::estimate(&[(&values, &vec![true; 8000])]).unwrap();
        // The whole record holds 0.3 and the steps: 3 for 8 of 23 rows.
        assert!(floor.sd < (0.3_f64.powi(2) + 9.0 * 8.0 / 23.0).sqrt(), "{floor:?}");
        assert!(floor.error < 0.2, "{floor:?}");
    }

    #[test]
    fn noise_alone_is_estimated_from_the_whole_record() {
        for correlation in [0.0, 0.3, 0.6, 0.9] {
            let values = noise(correlation, 0.3, 8000);
            let floor = NoiseFloor::estimate(&[(&values, &vec![true; 8000])]).unwrap();
            // Bartlett's error, and that of a variance of a first-order process, halved for its root; three of each.
            let error = ((1.0 - correlation * correlation) / 8000.0_f64).sqrt();
            let of_sd = 0.5 * (2.0 / 8000.0 * (1.0 + correlation * correlation) / (1.0 - correlation * correlation)).sqrt();
            assert!((floor.correlation - correlation).abs() < 3.0 * error, "{correlation}: {floor:?}");
            assert!((floor.sd / 0.3 - 1.0).abs() < 3.0 * of_sd, "{correlation}: {floor:?}");
            assert!((floor.error / error - 1.0).abs() < 0.1, "{correlation}: {floor:?}");
        }
    }

    #[test]
    fn the_whole_record_is_rarely_refused_without_a_reason() {
        for correlation in [0.0, 0.6, 0.9] {
            let mut random = Random::new(8);
            let mut refused = 0;
            for _ in 0..200 {
                let records: Vec<Vec<f64>> = (0..3)
                    .map(|_| {
                        let mut last = random.normal() / (1.0_f64 - correlation * correlation).sqrt();
                        (0..1000)
                            .map(|_| {
                                last = correlation * last + random.normal();
                                last
                            })
                            .collect()
                    })
                    .collect();
                let used = vec![true; 1000];
                let lists: Vec<(&[f64], &[bool])> = records.iter().map(|values| (values.as_slice(), used.as_slice())).collect();
                let whole = whole(&lists, 3000.0).unwrap();
                refused += usize::from(NoiseFloor::estimate(&lists).unwrap() != whole);
            }
            // Two tests at 0.1 % each: 0.4 of 200, and four times the root of that.
            assert!(refused <= 3, "{correlation}: {refused}");
        }
    }

    #[test]
    fn slow_structure_as_large_as_the_noise_is_not_taken_for_noise() {
        // A wave of 800 rows, and a drift that wanders: as a first-order process they would be a correlation near 1.
        let mut wander = noise(0.999, 0.3, 8000).into_iter();
        for correlation in [0.0, 0.6] {
            let mut values = noise(correlation, 0.3, 8000);
            for (k, value) in values.iter_mut().enumerate() {
                *value += if correlation > 0.0 { wander.next().unwrap() } else { 0.4 * (TAU * k as f64 / 800.0).sin() };
            }
            let floor = NoiseFloor::estimate(&[(&values, &vec![true; 8000])]).unwrap();
            // Four of the upper band's errors (0.013 and 0.043): the wandering moves its lowest lines, too.
            let off = if correlation > 0.0 { 0.17 } else { 0.05 };
            assert!((floor.correlation - correlation).abs() < off, "{correlation}: {floor:?}");
            let mut sums = [Octave::default(); OCTAVES];
            let mut white = Vec::new();
            floor.whiten(&values, &vec![true; 8000], &mut white);
            octaves(&white, &vec![true; 8000], &mut sums);
            // What is left of it is found: 5 standard deviations are no chance.
            assert!(sums.iter().enumerate().any(|(k, octave)| octave.deviation(&floor, k) > 5.0), "{correlation}: {floor:?}");
        }
    }

    #[test]
    fn a_drift_over_correlated_noise_does_not_make_the_noise_slow() {
        // Three records of 1000 rows that drift to six times the noise: as one first-order process they would have a correlation of 0.985,
        // and far more power at a hundredth of the sample rate than they have.
        let mut errors = Vec::new();
        for seed in 0..40 {
            let mut random = Random::new(seed);
            let records: Vec<Vec<f64>> = (0..3)
                .map(|_| {
                    let mut last = random.normal();
                    (0..1000)
                        .map(|k| {
                            last = 0.8 * last + 0.6 * random.normal();
                            last + 0.006 * f64::from(k)
                        })
                        .collect()
                })
                .collect();
            let used = vec![true; 1000];
            let lists: Vec<(&[f64], &[bool])> = records.iter().map(|values| (values.as_slice(), used.as_slice())).collect();
            let floor = NoiseFloor::estimate(&lists).unwrap();
            errors.push((floor.correlation - 0.8).abs());
            assert!((floor.correlation - 0.8).abs() < 4.0 * floor.error, "seed {seed}: {floor:?}");
        }
        order::sort(&mut errors);
        // The upper band alone has a median error of 0.08 here, a wider one of 0.02, two steps of its grid.
        assert!(errors[20] < 0.04, "{errors:?}");
    }

    #[test]
    fn rows_lost_now_and_then_leave_the_estimate_as_it_was() {
        for (every, correlation) in [(97, 0.0), (97, 0.6), (40, 0.0)] {
            let mut values = noise(correlation, 0.3, 8000);
            for (k, value) in values.iter_mut().enumerate() {
                *value += 30.0 * (k as f64 / 400.0).sin();
            }
            let used: Vec<bool> = (0..8000).map(|k| k % every > 0).collect();
            let floor = NoiseFloor::estimate(&[(&values, &used)]).unwrap();
            // As of the record without gaps, of which three quarters stand in segments at least.
            let (off, share) = if correlation > 0.0 { (0.15, 0.2) } else { (0.06, 0.05) };
            assert!((floor.sd / 0.3 - 1.0).abs() < share, "{every} {correlation}: {floor:?}");
            assert!((floor.correlation - correlation).abs() < off, "{every} {correlation}: {floor:?}");
        }
    }

    #[test]
    fn growing_noise_is_taken_for_noise_and_a_wave_that_grows_is_not() {
        let readings: Vec<f64> = (0..6000).map(|k| 20.0 * (k as f64 / 500.0).sin()).collect();
        let used = vec![true; 6000];
        let grown = |values: Vec<f64>| -> Vec<f64> {
            values.iter().zip(&readings).map(|(value, reading)| value * (1.0 + 0.2 * reading.abs())).collect()
        };
        let found = |left: &[f64]| NoiseFloor::of_growing(&[(&readings, left, &used)]);
        let noisy = grown(noise(0.0, 0.1, 6000));
        let floor = found(&noisy).unwrap();
        // Twelve parts of 500 rows know their deviations to 5 %, three of each. The sum of both parts and the root of the sum of their squares are
        // not distinguished by so few, and at a reading of 0 one is a third above the other.
        assert!((floor.sd_at(20.0) / 0.5 - 1.0).abs() < 0.15 && (floor.sd_at(0.0) / 0.1 - 1.0).abs() < 0.5, "{floor:?}");
        // A ripple of a tenth of the sample rate whose amplitude grows with the reading.
        let wave = grown((0..6000).map(|k| 0.1 * (0.2 * PI * k as f64).sin()).collect());
        let both: Vec<f64> = wave.iter().zip(noise(0.0, 0.05, 6000)).map(|(wave, noise)| wave + noise).collect();
        assert_eq!(found(&both), None);
        assert_eq!(found(&noise(0.0, 0.1, 6000)), None);
    }

    #[test]
    fn whitened_noise_is_white() {
        let values = noise(0.8, 2.0, 8000);
        let mut white = Vec::new();
        NoiseFloor { correlation: 0.8, ..NoiseFloor::white(2.0) }.whiten(&values, &vec![true; 8000], &mut white);
        let power = white.iter().map(|w| w * w).sum::<f64>() / 8000.0;
        let next = white.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / 8000.0;
        // Four standard deviations of a mean over 8000 rows: 4 sqrt(2/8000), 4/sqrt(8000).
        assert!((power - 1.0).abs() < 0.063 && next.abs() < 0.045, "{power} {next}");
    }
}

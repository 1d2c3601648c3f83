//! Compares the readings of a rounding sensor with a simulation that is not rounded.
//!
//! In: the step, simulated values and their readings. Out: the noise before rounding, the mean reading of a value, and its scatter. The step is
//! given.
//!
//! If the noise is as large as the step, rounding adds only a uniform error. If it is below a third of the step, the rounding error depends on where
//! the value lies between two steps. During slow motion this error is a wave or an offset, and a fit against the simulation itself would take it for
//! a bias or a drift. Relative to the mean reading E[round(x + n)], the error is random from row to row. The likelihood of n is that of an ordered
//! probit (J. Aitchison, S. D. Silvey, 1957).

use crate::engine::significance::normal;
use rsm_core::order;

/// The tested noise before rounding, in steps, in factors of 1.43. With less noise, a value within a fiftieth of a step from an edge would dominate.
/// With 0.5, the mean reading still has a wave of 4 exp(-2 pi^2/4) = 3 % of the step, a tenth of the uniform error's standard deviation; with more
/// noise the wave is negligible.
const NOISES: [f64; 10] = [0.02, 0.0286, 0.0409, 0.0585, 0.0836, 0.1196, 0.171, 0.2445, 0.3497, 0.5];

/// The smallest probability of a reading, so that one outlier does not outweigh a thousand other readings.
const LEAST_PROBABILITY: f64 = 1e-12;

/// A sensor that rounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounding {
    /// Readings are multiples of this.
    pub step: f64,
    /// The standard deviation of the noise before rounding.
    pub noise: f64,
}

impl Rounding {
    /// The noise for which these pairs of reading and simulated value are most likely. `None` if it hides the rounding: then the noise, or the error
    /// of the simulation, is as large as the step.
    pub fn found(step: f64, pairs: &[(f64, f64)]) -> Option<Rounding> {
        let likelihood = |share: f64| {
            let it = Rounding { step, noise: share * step };
            pairs.iter().map(|(reading, value)| it.probability(*reading, *value).max(LEAST_PROBABILITY).ln()).sum::<f64>()
        };
        let all: Vec<f64> = NOISES.iter().map(|share| likelihood(*share)).collect();
        let best = (0..NOISES.len()).max_by(|a, b| all[*a].total_cmp(&all[*b]))?;
        if best + 1 == NOISES.len() {
            return None;
        }
        // A parabola through three points that are evenly spaced in the logarithm.
        let bend = if best == 0 { 0.0 } else { all[best - 1] - 2.0 * all[best] + all[best + 1] };
        let shift = if bend < 0.0 { 0.5 * (all[best - 1] - all[best + 1]) / bend } else { 0.0 };
        let noise = NOISES[best] * step * (NOISES[best + 1] / NOISES[best]).powf(shift);
        Some(Rounding { step, noise })
    }

    fn probability(&self, reading: f64, value: f64) -> f64 {
        let off = reading - value;
        normal((off + 0.5 * self.step) / self.noise) - normal((off - 0.5 * self.step) / self.noise)
    }

    /// For a value: the mean of its readings, their variance and their fourth central moment.
    #[must_use]
    pub fn moments(&self, value: f64) -> [f64; 3] {
        let base = (value / self.step).round();
        // Noise exceeds six standard deviations with a probability of 1e-9.
        let reach = (6.0 * self.noise / self.step).ceil() as i32 + 1;
        let mut share = Vec::with_capacity(2 * reach as usize + 1);
        let mut before = 0.0;
        for k in -reach..=reach {
            let below = if k == reach { 1.0 } else { normal(((base + f64::from(k) + 0.5) * self.step - value) / self.noise) };
            share.push((f64::from(k), below - before));
            before = below;
        }
        let mean: f64 = share.iter().map(|(k, share)| k * share).sum();
        let power = |n: i32| share.iter().map(|(k, share)| (k - mean).powi(n) * share).sum::<f64>() * self.step.powi(n);
        [self.step * (base + mean), power(2), power(4)]
    }

    /// The mean reading of a value.
    #[must_use]
    pub fn expected(&self, value: f64) -> f64 {
        self.moments(value)[0]
    }
}

/// The step of which all readings are multiples, if it is large enough against the noise. Each list has readings and whether each counts; a
/// placeholder for a lost reading need not be a multiple.
#[must_use]
pub fn step_of<'a>(lists: impl Iterator<Item = (&'a [f64], &'a [bool])>, noise: f64) -> Option<f64> {
    let mut steps: Vec<f64> = lists
        .flat_map(|(values, used)| values.windows(2).zip(used.windows(2)))
        .filter(|(_, used)| used[0] && used[1])
        .map(|(w, _)| (w[1] - w[0]).abs())
        .filter(|step| *step > 1e-9 * noise)
        .collect();
    if steps.len() < 50 {
        return None;
    }
    order::sort(&mut steps);
    let step = steps[steps.len() / 100];
    // A step below a fifth of the noise is only the number format of the file.
    if step < 0.2 * noise {
        return None;
    }
    let whole = steps.iter().filter(|it| ((*it / step) - (*it / step).round()).abs() < 0.01).count();
    (whole as f64 > 0.98 * steps.len() as f64).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn a_value_between_two_steps_reads_their_mean_and_one_on_a_step_itself() {
        let it = Rounding { step: 2.0, noise: 0.2 };
        let [mean, variance, _] = it.moments(3.0);
        // Half of the readings are 2 and half are 4.
        assert!((mean - 3.0).abs() < 1e-6 && (variance - 1.0).abs() < 1e-6, "{mean} {variance}");
        let [mean, variance, _] = it.moments(4.0);
        assert!((mean - 4.0).abs() < 1e-6 && variance < 1e-5, "{mean} {variance}");
        // The edge at 3 is one standard deviation off: 15.87 % read 4.
        let [mean, ..] = it.moments(2.8);
        assert!((mean - 2.3173).abs() < 1e-4, "{mean}");
    }

    #[test]
    fn moments_are_those_of_drawn_readings() {
        let mut random = Random::new(3);
        for (noise, value) in [(0.05, 0.47), (0.2, 0.3), (0.4, -1.1)] {
            let it = Rounding { step: 1.0, noise };
            let readings: Vec<f64> = (0..20_000).map(|_| (value + noise * random.normal()).round()).collect();
            let mean = readings.iter().sum::<f64>() / 2e4;
            let variance = readings.iter().map(|reading| (reading - mean) * (reading - mean)).sum::<f64>() / 2e4;
            let [expected, scatter, _] = it.moments(value);
            // Four standard errors; those of a variance of few values are below as much.
            let error = 4.0 * (scatter / 2e4).sqrt();
            assert!((mean - expected).abs() < error && (variance - scatter).abs() < error, "{noise}: {mean} {variance}");
        }
    }

    #[test]
    fn noise_before_rounding_is_found_and_a_wrong_simulation_hides_it() {
        let mut random = Random::new(4);
        let values: Vec<f64> = (0..4000).map(|k| 3.0 * (f64::from(k) / 300.0).sin()).collect();
        let readings: Vec<f64> = values.iter().map(|value| (value + 0.15 * random.normal()).round()).collect();
        let pairs = |values: &[f64]| readings.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
        let found = Rounding::found(1.0, &pairs(&values)).unwrap();
        // Its information is that of the readings near an edge, some thousand: 1/sqrt(2 * 1000), and three of it.
        assert!((found.noise / 0.15 - 1.0).abs() < 0.07, "{found:?}");
        let off: Vec<f64> = values.iter().enumerate().map(|(k, value)| value + (k as f64 / 500.0).cos()).collect();
        assert_eq!(Rounding::found(1.0, &pairs(&off)), None);
    }

    #[test]
    fn a_step_is_that_of_readings_and_not_of_what_stands_for_lost_ones() {
        let mut values: Vec<f64> = (0..400).map(|k| 0.25 * f64::from(k % 3)).collect();
        let mut used = vec![true; values.len()];
        // Every tenth is lost, and the middle of its neighbours stands for it.
        for k in (5..395).step_by(10) {
            values[k] = f64::midpoint(values[k - 1], values[k + 1]);
            used[k] = false;
        }
        let found = |used: &[bool]| step_of([(values.as_slice(), used)].into_iter(), 0.01);
        assert_eq!(found(&used), Some(0.25));
        // As readings they would halve it: the test sees them.
        assert_ne!(found(&vec![true; values.len()]), Some(0.25));
    }
}

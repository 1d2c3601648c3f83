//! Sensor noise: white, normal, from a seed.
//!
//! In: a seed. Out: deviates of mean 0 and variance 1, those of Box and Muller (1958). The same seed gives the same noise on one machine.

use std::f64::consts::TAU;

use rsm_fit::random::Random;

/// A source of random numbers.
#[derive(Debug, Clone)]
pub struct Noise {
    random: Random,
    spare: Option<f64>,
}

impl Noise {
    /// From a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Noise { random: Random::new(seed), spare: None }
    }

    /// A whole number, for the seed of another source.
    pub fn whole(&mut self) -> u64 {
        self.random.below(u64::MAX)
    }

    /// Equally likely in a range.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random.share()
    }

    /// Normal, mean 0, variance 1.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        // 1 - u is never 0.
        let radius = (-2.0 * (1.0 - self.random.share()).ln()).sqrt();
        let (sin, cos) = (TAU * self.random.share()).sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deviates_are_normal() {
        let mut noise = Noise::new(5);
        let count = 100_000;
        let values: Vec<f64> = (0..count).map(|_| noise.normal()).collect();
        let moment = |power: i32| values.iter().map(|value| value.powi(power)).sum::<f64>() / f64::from(count);
        // Mean, variance and fourth moment of a normal deviate are 0, 1 and 3; five standard errors of each: sqrt(1, 2, 96)/sqrt(count).
        assert!(moment(1).abs() < 0.016 && (moment(2) - 1.0).abs() < 0.023 && (moment(4) - 3.0).abs() < 0.16);
        assert!(Noise::new(5).normal() == values[0] && Noise::new(6).normal() != values[0]);
    }
}

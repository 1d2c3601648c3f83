//! Random numbers that are the same for one seed on every machine and in every release.
//!
//! In: a seed. Out: integers below a limit, numbers in [0, 1) and (0, 1], normal numbers, shuffles. The stream of ChaCha8 is fixed by its definition,
//! and the conversions are fixed here. Independent of clock and machine.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A stream of random numbers.
///
/// ```
/// use rsm_fit::random::Random;
///
/// let (mut one, mut other) = (Random::new(7), Random::new(7));
/// assert_eq!(one.share(), other.share());
/// assert!(one.below(6) < 6);
/// ```
#[derive(Debug, Clone)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Random(ChaCha8Rng::seed_from_u64(seed))
    }

    /// An integer below `limit`, uniformly distributed: draws beyond the last full multiple are discarded.
    ///
    /// # Panics
    /// If `limit` is 0.
    pub fn below(&mut self, limit: u64) -> u64 {
        let full = u64::MAX - u64::MAX % limit;
        loop {
            let draw = self.0.next_u64();
            if draw < full {
                return draw % limit;
            }
        }
    }

    /// A uniformly distributed number in [0, 1), a multiple of 2^-53.
    pub fn share(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A uniformly distributed number in (0, 1], a multiple of 2^-53, for a logarithm.
    pub fn uniform(&mut self) -> f64 {
        1.0 - self.share()
    }

    /// A normal number, with mean 0 and variance 1 (G. E. P. Box, M. E. Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.share()).cos()
    }

    /// Shuffles items; every order is equally likely (Fisher and Yates; Durstenfeld 1964).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last as u64 + 1) as usize);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_of_three_comes_equally_often() {
        let mut random = Random::new(1);
        let mut count = std::collections::BTreeMap::new();
        for _ in 0..6000 {
            let mut items = [0, 1, 2];
            random.shuffle(&mut items);
            *count.entry(items).or_insert(0) += 1;
        }
        // 1000 each with a standard deviation of 29; 5 of them leave one seed in 10^6 out, and the seed is fixed.
        assert!(count.len() == 6 && count.values().all(|n: &i32| (n - 1000).abs() < 145), "{count:?}");
        let mean = (0..10_000).map(|_| random.share()).sum::<f64>() / 1e4;
        // Standard deviation of the mean: sqrt(1/12/10^4) = 0.0029.
        assert!((mean - 0.5).abs() < 0.015, "{mean}");
    }

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut random = Random::new(2);
        let values: Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
        let moment = |power: i32| values.iter().map(|value| value.powi(power)).sum::<f64>() / 1e5;
        // Mean, variance and fourth moment are 0, 1 and 3; five standard errors of each: sqrt(1, 2, 96)/sqrt(10^5).
        assert!(moment(1).abs() < 0.016 && (moment(2) - 1.0).abs() < 0.023 && (moment(4) - 3.0).abs() < 0.16);
    }
}

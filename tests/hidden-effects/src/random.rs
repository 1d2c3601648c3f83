//! Random numbers of this package only, so that a change of a library changes no case.
//!
//! In: a seed and the name of a case. Out: uniform and normal numbers, the same on every machine. The clock is never used.

/// The generator xoshiro256++ (D. Blackman, S. Vigna, "Scrambled linear pseudorandom number generators", ACM TOMS 47, 2021), seeded by splitmix64.
#[derive(Debug, Clone)]
pub struct Random {
    state: [u64; 4],
}

impl Random {
    /// A separate stream for every name: a case added to a list changes no other.
    pub fn new(seed: u64, name: &str) -> Self {
        // FNV-1a, 64 bits: offset basis and prime as published (G. Fowler, L. Noll, K. Vo).
        let hash = name.bytes().fold(0xcbf29ce484222325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100000001b3));
        let mut z = seed.wrapping_mul(0x9e3779b97f4a7c15) ^ hash;
        let state = std::array::from_fn(|_| {
            z = z.wrapping_add(0x9e3779b97f4a7c15);
            let mut x = z;
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58476d1ce4e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d049bb133111eb);
            x ^ (x >> 31)
        });
        Random { state }
    }

    fn next(&mut self) -> u64 {
        let [a, b, c, d] = self.state;
        let result = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let c = c ^ a;
        let d = d ^ b;
        self.state = [a ^ d, b ^ c, c ^ (b << 17), d.rotate_left(45)];
        result
    }

    /// Uniform in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        // 53 bits: every multiple of 2^-53 in [0, 1) has the same probability.
        low + (high - low) * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    /// Uniform in the logarithm, for a magnitude of unknown order.
    pub fn spread(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    /// An integer from `low..=high`.
    pub fn whole(&mut self, low: u64, high: u64) -> u64 {
        low + (self.uniform(0.0, (high - low + 1) as f64) as u64).min(high - low)
    }

    /// One of the choices.
    pub fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.whole(0, choices.len() as u64 - 1) as usize]
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f64 {
        self.one_of(&[1.0, -1.0])
    }

    /// Standard normal, by the polar method (G. Marsaglia, T. Bray, SIAM Review 6, 1964); the second number of a pair is not used.
    pub fn normal(&mut self) -> f64 {
        loop {
            let (x, y) = (self.uniform(-1.0, 1.0), self.uniform(-1.0, 1.0));
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                return x * (-2.0 * square.ln() / square).sqrt();
            }
        }
    }

    /// `rows` samples of noise with standard deviation `sigma`: e_k = a e_(k-1) + white, a = `colour`; 0 is white.
    pub fn noise(&mut self, rows: usize, sigma: f64, colour: f64) -> Vec<f64> {
        let mut last = self.normal();
        let white = (1.0 - colour * colour).sqrt();
        (0..rows)
            .map(|_| {
                last = colour * last + white * self.normal();
                sigma * last
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_stated_deviation_and_colour() {
        let noise = Random::new(1, "noise").noise(40000, 2.0, 0.6);
        let mean_square = noise.iter().map(|e| e * e).sum::<f64>() / 40000.0;
        let lag_one = noise.windows(2).map(|e| e[0] * e[1]).sum::<f64>() / 39999.0;
        // The standard error of the mean square of 40000 samples with correlation 0.6 is 4 sqrt(2/40000 (1+0.36)/(1-0.36)) = 0.041; the limit is four
        // of it.
        assert!((mean_square - 4.0).abs() < 0.17, "{mean_square}");
        assert!((lag_one / mean_square - 0.6).abs() < 0.02, "{lag_one}");
    }

    #[test]
    fn streams_of_other_names_and_seeds_differ() {
        let first = |seed, name| Random::new(seed, name).next();
        assert_ne!(first(1, "a"), first(1, "b"));
        assert_ne!(first(1, "a"), first(2, "a"));
        assert_eq!(first(1, "a"), first(1, "a"));
    }

    #[test]
    fn whole_numbers_reach_both_ends() {
        let mut random = Random::new(3, "whole");
        let drawn: Vec<u64> = (0..200).map(|_| random.whole(2, 5)).collect();
        assert_eq!((drawn.iter().min(), drawn.iter().max()), (Some(&2), Some(&5)));
    }
}

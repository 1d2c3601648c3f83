//! Distributions of a varied number.
//!
//! In: a share between 0 and 1. Out: the quantile of the distribution at this share. Random shares give random values, the shares of a design give a
//! design. This module draws no random numbers.

use statrs::distribution::{ContinuousCDF as _, Normal};

/// The distribution of a number.
#[derive(Debug, Clone, PartialEq)]
pub enum Distribution {
    /// Normal; truncated at two ends if they are given.
    Normal {
        /// Its mean.
        mean: f64,
        /// Its standard deviation, above 0.
        sd: f64,
        /// The two ends, if it is truncated.
        within: Option<[f64; 2]>,
    },
    /// Uniform between two ends.
    Uniform([f64; 2]),
    /// Uniform in the logarithm between two ends above 0.
    LogUniform([f64; 2]),
    /// One of these values, with equal probability.
    List(Vec<f64>),
}

/// The shares nearest to 0 and 1 at which a normal distribution is evaluated: a share is a multiple of 2^-53.
const LEAST: f64 = 1.0 / (1u64 << 54) as f64;

impl Distribution {
    /// The quantile at a share.
    ///
    /// ```
    /// use rsm_sweep::distribution::Distribution;
    ///
    /// assert!((Distribution::LogUniform([1.0, 100.0]).quantile(0.5) - 10.0).abs() < 1e-13);
    /// assert_eq!(Distribution::List(vec![2.0, 3.0]).quantile(0.5), 3.0);
    /// ```
    #[must_use]
    pub fn quantile(&self, share: f64) -> f64 {
        match self {
            Distribution::Normal { mean, sd, within } => {
                let unit = Normal::standard();
                let share = within.map_or(share, |ends| {
                    let [low, high] = ends.map(|end| unit.cdf((end - mean) / sd));
                    low + share * (high - low)
                });
                let value = mean + sd * unit.inverse_cdf(share.clamp(LEAST, 1.0 - 2.0 * LEAST));
                // Rounding of the two functions could exceed an end.
                within.map_or(value, |[low, high]| value.clamp(low, high))
            }
            Distribution::Uniform([low, high]) => low * (1.0 - share) + high * share,
            Distribution::LogUniform([low, high]) => (low.ln() * (1.0 - share) + high.ln() * share).exp().clamp(*low, *high),
            Distribution::List(values) => values[((share * values.len() as f64) as usize).min(values.len() - 1)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_tables() {
        let normal = Distribution::Normal { mean: 10.0, sd: 2.0, within: None };
        // Tables have 1.959964 and 2.326348 for 0.975 and 0.01.
        for (share, expected) in [(0.5, 10.0), (0.975, 10.0 + 2.0 * 1.959964), (0.01, 10.0 - 2.0 * 2.326348)] {
            assert!((normal.quantile(share) - expected).abs() < 1e-5, "{share}");
        }
        assert!(normal.quantile(0.0).is_finite() && normal.quantile(1.0).is_finite());
        assert_eq!(Distribution::Uniform([2.0, 6.0]).quantile(0.25), 3.0);
        let log = Distribution::LogUniform([1e-3, 1e3]);
        assert!((log.quantile(0.75) - 10f64.powf(1.5)).abs() < 1e-12 * 31.7);
        // The exponential of a logarithm has an error in its last bits, but is never beyond an end.
        assert!(log.quantile(0.0) >= 1e-3 && log.quantile(0.0) < 1e-3 * (1.0 + 1e-14));
        assert!(log.quantile(1.0) <= 1e3 && log.quantile(1.0) > 1e3 * (1.0 - 1e-14));
        let list = Distribution::List(vec![5.0, 7.0, 9.0]);
        assert_eq!([0.0, 0.33, 0.34, 0.99, 1.0].map(|share| list.quantile(share)), [5.0, 5.0, 7.0, 9.0, 9.0]);
    }

    #[test]
    fn a_cut_distribution_stays_within_its_ends_and_keeps_its_shape() {
        let cut = Distribution::Normal { mean: 0.0, sd: 1.0, within: Some([0.0, 1.0]) };
        assert!(cut.quantile(0.0).abs() < 1e-9 && (cut.quantile(1.0) - 1.0).abs() < 1e-9);
        // Half of the mass between 0 and 1: cdf = (0.5 + 0.841345)/2 = 0.670672, which a table has at 0.44177.
        assert!((cut.quantile(0.5) - 0.44177).abs() < 1e-4, "{}", cut.quantile(0.5));
    }
}

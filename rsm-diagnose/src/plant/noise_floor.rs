//! The noise floor of an output: standard deviation, autocorrelation, and growth with the reading.
//!
//! In: values of rows. Out: whitened values, standard deviations. [`super::noise`] estimates it.

use std::f64::consts::TAU;

use super::growth::Growth;
use super::rounding::Rounding;
use crate::engine::autoregression::innovations;

/// The noise of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseFloor {
    /// Standard deviation of the noise.
    pub sd: f64,
    /// Correlation from row to row.
    pub correlation: f64,
    /// Standard error of the correlation; 0 where it is not an estimate.
    pub error: f64,
    /// How the sensor rounds, if its step is coarse. The noise is then the scatter that rounding leaves about the mean reading.
    pub rounding: Option<Rounding>,
    /// How the noise grows with the reading, if it does. `sd` is then the root mean square over all rows.
    pub growth: Option<Growth>,
    /// The smallest standard deviation that it may have, because of the error of the simulation; 0 where this error is far below the noise.
    pub least: f64,
}

impl NoiseFloor {
    /// White noise.
    #[must_use]
    pub fn white(sd: f64) -> Self {
        NoiseFloor { sd, correlation: 0.0, error: 0.0, rounding: None, growth: None, least: 0.0 }
    }

    /// This noise, or white noise of the smallest standard deviation that it may have.
    #[must_use]
    pub fn at_least(self, least: f64) -> Self {
        let floor = if self.sd >= least { self } else { NoiseFloor::white(least) };
        NoiseFloor { least: least.max(self.least), ..floor }
    }

    /// The mean reading for a true value.
    #[must_use]
    pub fn mean_reading(&self, value: f64) -> f64 {
        self.rounding.map_or(value, |rounding| rounding.expected(value))
    }

    /// The standard deviation of the innovation of a row.
    #[must_use]
    pub fn innovation(&self) -> f64 {
        self.sd * (1.0 - self.correlation * self.correlation).sqrt()
    }

    /// Scales the values of rows to uniform noise, if the noise grows with the reading.
    pub fn scale_to_uniform(&self, measured: &[f64], values: &mut [f64]) {
        if let Some(growth) = self.growth {
            growth.scale_to_uniform(measured, values);
        }
    }

    /// Standard deviation of the noise at a reading.
    #[must_use]
    pub fn sd_at(&self, reading: f64) -> f64 {
        self.sd * self.growth.map_or(1.0, |growth| growth.at(reading.abs()))
    }

    /// Whitened values: their standard deviation is one if the noise is as estimated. Rows that are not `used` give 0. The correlation with the last
    /// used row falls with the gap: over n rows it is the n-th power.
    pub fn whiten(&self, values: &[f64], used: &[bool], into: &mut Vec<f64>) {
        let first = into.len();
        into.resize(first + values.len(), 0.0);
        let kept = values.iter().enumerate().filter(|(row, _)| used[*row]).map(|(row, value)| (row, *value));
        for new in innovations(self.correlation, kept) {
            into[first + new.row] = new.value / (self.sd * new.sd);
        }
    }

    /// The derivative of the logarithm of the power with respect to the correlation, at a frequency; `share` is the frequency over the sample rate.
    #[must_use]
    pub fn slope(&self, share: f64) -> f64 {
        let cos = (TAU * share).cos();
        (2.0 * cos - 2.0 * self.correlation) / shape(self.correlation, cos)
    }
}

/// The power of a first-order process is inversely proportional to this. `cos` is the cosine of the frequency in radians per row.
pub(super) fn shape(correlation: f64, cos: f64) -> f64 {
    1.0 - 2.0 * correlation * cos + correlation * correlation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_is_missing_costs_no_other_one() {
        let floor = NoiseFloor { correlation: 0.6, ..NoiseFloor::white(2.0) };
        let (values, used) = ([2.0, 9.0, 3.0, 1.0], [true, false, true, true]);
        let mut white = Vec::new();
        floor.whiten(&values, &used, &mut white);
        // Two rows on the correlation is 0.36: (3 - 0.36 2)/(2 sqrt(1 - 0.36^2)); one row on (1 - 0.6 3)/(2 0.8).
        let expected = [1.0, 0.0, 2.28 / (2.0 * (1.0_f64 - 0.1296).sqrt()), -0.5];
        assert!(white.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{white:?}");
    }
}

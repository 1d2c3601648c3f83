//! Noise that grows with the reading.
//!
//! In: the residual of an output, with its readings. Out: the standard deviation of the noise as a function of the size of the reading, if it differs
//! significantly from a constant. Only differences between neighbouring rows are used, so slow structure does not count. Medians over parts of equal
//! size make it robust against a few outliers.

use super::rounding::step_of;
use crate::engine::significance::median;
use rsm_core::order;

/// The range of readings is divided into this many parts with equal numbers of rows.
const PARTS: usize = 12;

/// The smallest number of rows in a part. The standard deviation from its median then has an error of a sixth.
const LEAST_ROWS: usize = 50;

/// Rows on either side that give the size of the reading at a row. Its own reading is excluded; otherwise noise would choose its own weight.
const NEIGHBOURS: usize = 4;

/// The variance of the logarithm of a standard deviation that comes from a median, multiplied by the number of independent rows (P. J. Huber, "Robust
/// statistics", 1981, section 5.1).
const OF_DEVIATION: f64 = 1.36;

/// The number of second differences of white noise that count as one independent row. Their correlations are -2/3 and 1/6, so squares have
/// correlations 4/9 and 1/36, on both sides.
const ROWS_A_DIFFERENCE: f64 = 1.94;

/// For white noise: the median of |reading - mean of both neighbours| divided by the standard deviation, 0.6745 sqrt(1.5).
const OF_SECOND_DIFFERENCE: f64 = 0.826;

/// The log likelihood ratio that growth must reach. Chi squared with one degree of freedom exceeds 20 once in 130,000 cases. Two laws are tried at
/// every rate, for three outputs, about ten times in a diagnosis. With four independent trials in each, a false alarm occurs once in a thousand
/// diagnoses: a tenth of the limit for structure (`whiteness`).
const LEAST_RATIO_OF_GROWTH: f64 = 20.0;

/// Growth by less than this factor, from the smallest to the largest reading, is ignored.
const LEAST_GROWTH: f64 = 1.25;

/// Student's t with ten degrees of freedom exceeds this once in 1000 cases, two-sided: twelve parts with a line through them.
const OTHER_SHAPE: f64 = 4.59;

/// With fewer rows of a record in a part, its correlations are not tested.
const LEAST_OF_SHAPE: usize = 30;

/// How the standard deviation depends on the size of a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// At a reading of 0 the law is 1. The rate is the growth for each unit of the reading.
    pub rate: f64,
    /// Whether the two parts are added; otherwise their squares are, as for independent errors of scale and offset.
    pub sum: bool,
    /// The root mean square of the law over the rows from which it came. The law is divided by it, so that the mean noise is unchanged.
    pub norm: f64,
    /// The mean size of the largest twelfth of the readings.
    pub largest: f64,
}

impl Growth {
    fn plain(&self, size: f64) -> f64 {
        let grown = self.rate * size;
        if self.sum { 1.0 + grown } else { (1.0 + grown * grown).sqrt() }
    }

    /// The standard deviation at a size of reading, relative to the mean one.
    #[must_use]
    pub fn at(&self, size: f64) -> f64 {
        self.plain(size) / self.norm
    }

    /// Divides the values of rows by the relative standard deviation of the noise there.
    pub fn scale_to_uniform(&self, measured: &[f64], values: &mut [f64]) {
        for (value, size) in values.iter_mut().zip(sizes(measured)) {
            *value /= self.at(size);
        }
    }

    /// The growth law from the residual of an output, one list for each record: readings, residuals, rows that count. `None` if the noise does not
    /// grow significantly.
    #[must_use]
    pub fn found(lists: &[(&[f64], &[f64], &[bool])]) -> Option<Growth> {
        let mut rows: Vec<(f64, f64)> = Vec::new();
        for (measured, left, used) in lists {
            let sizes: Vec<f64> = sizes(measured).collect();
            for row in 1..left.len().saturating_sub(1) {
                if used[row - 1] && used[row] && used[row + 1] {
                    rows.push((sizes[row], (left[row] - 0.5 * (left[row - 1] + left[row + 1])).abs()));
                }
            }
        }
        let count = rows.len() / PARTS;
        if count < LEAST_ROWS {
            return None;
        }
        let least = of_rounding(lists, &rows);
        order::ascending(&mut rows, |it| it.0);
        let mut parts: Vec<(f64, f64)> = Vec::new();
        for part in rows.chunks(count).take(PARTS) {
            let size = part.iter().map(|it| it.0).sum::<f64>() / part.len() as f64;
            let deviation = median(&mut part.iter().map(|it| it.1).collect::<Vec<_>>()).max(least);
            if deviation <= 0.0 {
                return None;
            }
            parts.push((size, deviation.ln()));
        }
        let variance = OF_DEVIATION * ROWS_A_DIFFERENCE / count as f64;
        // The squared deviation of the logarithms from a law with a free level, in units of their error.
        let misfit = |law: &dyn Fn(f64) -> f64| {
            let off: Vec<f64> = parts.iter().map(|(size, log)| log - law(*size).ln()).collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            off.iter().map(|off| (off - mean).powi(2)).sum::<f64>() / variance
        };
        let even = misfit(&|_| 1.0);
        let largest = parts.last()?.0;
        let (mut best, mut least) = (None, even - LEAST_RATIO_OF_GROWTH);
        for sum in [true, false] {
            // The growth at the largest readings: from a tenth to a hundred times the noise at 0, in steps of 5 %.
            for step in 0..=142 {
                let rate = 0.1 * 1.05_f64.powi(step) / largest.max(f64::MIN_POSITIVE);
                let growth = Growth { rate, sum, norm: 1.0, largest };
                let left = misfit(&|size| growth.plain(size));
                if left < least {
                    (best, least) = (Some(growth), left);
                }
            }
        }
        let best: Growth = best?;
        if best.plain(largest) < LEAST_GROWTH * best.plain(parts[0].0) {
            return None;
        }
        let squares = rows.iter().map(|it| best.plain(it.0).powi(2)).sum::<f64>() / rows.len() as f64;
        Some(Growth { norm: squares.sqrt(), ..best })
    }
}

/// The median contribution of rounding alone to second differences, if readings are multiples of a step; otherwise 0. A coarse sensor repeats its
/// reading at rest, and has a uniform rounding error when it moves. That is not growth.
fn of_rounding(lists: &[(&[f64], &[f64], &[bool])], rows: &[(f64, f64)]) -> f64 {
    let middle = median(&mut rows.iter().map(|it| it.1).collect::<Vec<_>>());
    let step = step_of(lists.iter().map(|(measured, _, used)| (*measured, *used)), middle / OF_SECOND_DIFFERENCE);
    step.map_or(0.0, |step| OF_SECOND_DIFFERENCE * step / 12.0_f64.sqrt())
}

/// Whether two laws differ by a tenth in the relative weight of small and large readings.
#[must_use]
pub fn differ(one: Option<Growth>, other: Option<Growth>) -> bool {
    let size = [one, other].iter().flatten().map(|it| it.largest).fold(0.0, f64::max);
    let over = |law: Option<Growth>| law.map_or(1.0, |law| law.at(size) / law.at(0.0));
    (over(one) / over(other)).ln().abs() > 0.1
}

/// Whether the residual has the same correlations at small and at large readings, apart from its size. Noise that grows has. Structure at large
/// readings (a ripple, an oscillation, a contact) has different correlations there. Lists as in [`Growth::found`].
#[must_use]
pub fn has_one_correlation(lists: &[(&[f64], &[f64], &[bool])]) -> bool {
    // Products of each second difference with those one and two rows later, and squares, by the size of the reading.
    let mut rows: Vec<(f64, [f64; 3])> = Vec::new();
    for (measured, left, used) in lists {
        let sizes: Vec<f64> = sizes(measured).collect();
        let second = |row: usize| left[row] - 0.5 * (left[row - 1] + left[row + 1]);
        for row in 1..left.len().saturating_sub(3) {
            if used[row - 1..row + 4].iter().all(|used| *used) {
                let [a, b, c] = [second(row), second(row + 1), second(row + 2)];
                rows.push((sizes[row], [a * b, a * c, 0.5 * (a * a + b * b)]));
            }
        }
    }
    let count = rows.len() / PARTS;
    if count < LEAST_OF_SHAPE {
        return false;
    }
    order::ascending(&mut rows, |it| it.0);
    let of = |part: &[(f64, [f64; 3])]| {
        let sum = |k: usize| part.iter().map(|it| it.1[k]).sum::<f64>();
        [0, 1].map(|k| sum(k) / sum(2).max(f64::MIN_POSITIVE))
    };
    let parts: Vec<[f64; 2]> = rows.chunks(count).take(PARTS).map(of).collect();
    // A line through the parts in their order: its slope divided by the error of the slope.
    let middle = 0.5 * (PARTS - 1) as f64;
    let spread: f64 = (0..PARTS).map(|k| (k as f64 - middle).powi(2)).sum();
    [0, 1].iter().all(|&k| {
        let mean = parts.iter().map(|it| it[k]).sum::<f64>() / PARTS as f64;
        let slope = parts.iter().enumerate().map(|(n, it)| (n as f64 - middle) * it[k]).sum::<f64>() / spread;
        let left = parts.iter().enumerate().map(|(n, it)| (it[k] - mean - slope * (n as f64 - middle)).powi(2)).sum::<f64>();
        let error = (left / (PARTS - 2) as f64 / spread).sqrt();
        slope.abs() < OTHER_SHAPE * error
    })
}

/// The size of the reading at each row, from the rows beside it.
fn sizes(measured: &[f64]) -> impl Iterator<Item = f64> + '_ {
    let mut sum: f64 = measured.iter().take(NEIGHBOURS).sum();
    (0..measured.len()).map(move |row| {
        sum += measured.get(row + NEIGHBOURS).copied().unwrap_or(0.0);
        let first = row.saturating_sub(NEIGHBOURS);
        let count = (row + NEIGHBOURS).min(measured.len() - 1) - first;
        let size = ((sum - measured[row]) / count.max(1) as f64).abs();
        if row >= NEIGHBOURS {
            sum -= measured[row - NEIGHBOURS];
        }
        size
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    fn record(rows: usize, seed: u64, law: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let mut random = Random::new(seed);
        let truth: Vec<f64> = (0..rows).map(|k| 20.0 * (k as f64 / 150.0).sin()).collect();
        let left: Vec<f64> = truth.iter().map(|value| law(value.abs()) * random.normal()).collect();
        (truth.iter().zip(&left).map(|(truth, left)| truth + left).collect(), left)
    }

    fn found(rows: usize, seed: u64, law: impl Fn(f64) -> f64) -> Option<Growth> {
        let (measured, left) = record(rows, seed, law);
        Growth::found(&[(&measured, &left, &vec![true; rows])])
    }

    #[test]
    fn growth_is_found_and_even_noise_has_none() {
        let growth = found(6000, 1, |size| 0.1 * (1.0 + 0.2 * size)).unwrap();
        // 12 parts of 500 rows: each deviation to 7 %.
        assert!((growth.plain(20.0) / growth.plain(0.0) / 5.0 - 1.0).abs() < 0.3, "{growth:?}");
        let (measured, mut left) = record(6000, 2, |size| 0.1 * (1.0 + 0.2 * size));
        let before = left.iter().map(|it| it * it).sum::<f64>();
        growth.scale_to_uniform(&measured, &mut left);
        // The usual deviation stays; 6000 rows of uneven squares know it to 3 %, and the law to as much.
        let after = left.iter().map(|it| it * it).sum::<f64>();
        assert!((after / before - 1.0).abs() < 0.12, "{after} {before}");
        assert!((0..100).all(|seed| found(2000, seed, |_| 0.1).is_none()));
    }

    #[test]
    fn a_coarse_sensor_that_rests_has_no_growth_and_noise_of_many_steps_keeps_its_own() {
        let mut random = Random::new(6);
        // Half of the time the plant rests at a step, where noise of a fifth of a step is rounded away.
        let truth: Vec<f64> = (0..6000).map(|k| if k % 3000 < 1500 { 0.0 } else { 20.0 * (k as f64 / 150.0).sin() }).collect();
        let mut found = |law: fn(f64) -> f64| {
            let measured: Vec<f64> = truth.iter().map(|it| (it + law(it.abs()) * random.normal()).round()).collect();
            let left: Vec<f64> = measured.iter().zip(&truth).map(|(measured, truth)| measured - truth).collect();
            Growth::found(&[(&measured, &left, &vec![true; 6000])])
        };
        assert_eq!(found(|_| 0.2), None);
        assert!(found(|size| 0.2 * (1.0 + size)).is_some());
    }

    #[test]
    fn a_row_says_nothing_about_its_own_weight() {
        let measured: Vec<f64> = (0..20).map(f64::from).collect();
        let mut other = measured.clone();
        other[7] = 1000.0;
        let (a, b): (Vec<f64>, Vec<f64>) = (sizes(&measured).collect(), sizes(&other).collect());
        // A running sum has as many digits as its largest term.
        assert!(
            (a[7] - b[7]).abs() < 1e-9 && (a[7] - 7.0).abs() < 1e-9 && (b[6] - a[6]).abs() > 1.0 && (a[0] - 2.5).abs() < 1e-9
        );
    }
}

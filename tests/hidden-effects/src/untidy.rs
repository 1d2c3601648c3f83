//! Irregular records: rows that a logger lost, channels that were not recorded, noise that is not normal or not constant.
//!
//! In: the requested irregularities, a record's rows, a separate stream of random numbers. Out: the lost rows, and the factor of the noise for each
//! row. A case has the same truth and the same normal numbers with and without irregularities.

use std::ops::Range;

use crate::random::Random;

/// The largest number of rows in a gap.
const LONGEST_GAP: u64 = 3;

/// The deviation of an outlier, relative to that of the others.
const OUTLIER: f64 = 20.0;

/// The requested irregularities; none by default.
#[derive(Debug, Clone, Default)]
pub struct Untidy {
    /// One of this number of rows is lost, in gaps of one to three rows.
    pub lost: Option<usize>,
    /// The noise's standard deviation increases by this multiple of itself from a reading of 0 to the largest one.
    pub growing: Option<f64>,
    /// The noise is Student's t with this number of degrees of freedom (more than 2), with the same standard deviation.
    pub tails: Option<f64>,
    /// This share of the readings has noise of `OUTLIER` times the usual deviation.
    pub outliers: Option<f64>,
    /// The factor of all noise; 0: readings are those of the simulation.
    pub noise: Option<f64>,
    /// The logger starts this number of rows late, so records begin in motion.
    pub late: usize,
    /// Outputs that are in no record.
    pub without: Vec<String>,
}

impl Untidy {
    /// The lost rows of a record. The first and the last are kept.
    pub fn lost_rows(&self, rows: usize, random: &mut Random) -> Vec<Range<usize>> {
        let mut lost = Vec::new();
        let Some(every) = self.lost else { return lost };
        // A gap of two rows on average after (2 every - 2) others.
        let mean = (2 * every).saturating_sub(2).max(2) as f64;
        let mut row = 1;
        loop {
            row += random.uniform(0.5 * mean, 1.5 * mean) as usize;
            let end = row + random.whole(1, LONGEST_GAP) as usize;
            if end + 1 >= rows {
                return lost;
            }
            lost.push(row..end);
            row = end;
        }
    }

    /// The factor of the noise for each row, from the exact readings and the largest one of all records: a sensor has one law for all records.
    pub fn factors(&self, exact: &[f64], largest: f64, random: &mut Random) -> Vec<f64> {
        let largest = largest.max(f64::MIN_POSITIVE);
        let factor = |value: &f64| {
            let grown = self.noise.unwrap_or(1.0) * (1.0 + self.growing.unwrap_or(0.0) * value.abs() / largest);
            let far = self.outliers.is_some_and(|share| random.uniform(0.0, 1.0) < share);
            let grown = if far { OUTLIER * grown } else { grown };
            let Some(freedom) = self.tails else { return grown };
            // A normal number divided by the root of chi squared/freedom; its variance is freedom/(freedom - 2).
            let chi: f64 = (0..freedom as usize).map(|_| random.normal().powi(2)).sum();
            grown * ((freedom - 2.0) / chi).sqrt()
        };
        exact.iter().map(factor).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_row_in_so_many_is_lost_in_short_gaps() {
        let untidy = Untidy { lost: Some(97), ..Untidy::default() };
        let lost = untidy.lost_rows(97_000, &mut Random::new(1, "lost"));
        let rows: usize = lost.iter().map(ExactSizeIterator::len).sum();
        // 500 gaps of 2 rows: three standard deviations of their sum, 0.82 for each gap, and of their distances.
        assert!((rows as f64 - 1000.0).abs() < 100.0, "{rows}");
        assert!(lost.iter().all(|it| (1..=3).contains(&it.len()) && it.start > 0 && it.end < 97_000));
    }

    #[test]
    fn noise_grows_and_has_tails_at_the_same_deviation() {
        let growing = Untidy { growing: Some(4.0), ..Untidy::default() };
        assert_eq!(growing.factors(&[0.0, -10.0, 5.0], 10.0, &mut Random::new(1, "g")), [1.0, 5.0, 3.0]);
        let outliers = Untidy { outliers: Some(0.01), ..Untidy::default() };
        let far =
            outliers.factors(&vec![1.0; 40_000], 1.0, &mut Random::new(3, "o")).iter().filter(|it| **it == OUTLIER).count();
        // The expected number is 400; the limit is four times its root.
        assert!((320..=480).contains(&far), "{far}");
        let tails = Untidy { tails: Some(5.0), ..Untidy::default() };
        let mut random = Random::new(2, "t");
        let factors = tails.factors(&vec![1.0; 40_000], 1.0, &mut random);
        let squares = factors.iter().map(|it| it * it * random.normal().powi(2));
        let (mut sum, mut far) = (0.0, 0);
        for square in squares {
            sum += square;
            far += usize::from(square > 25.0);
        }
        // Student's t with 5 degrees of freedom has a kurtosis of 9: the error of the mean square is sqrt(8/40000) = 0.014; the limit is four of it.
        assert!((sum / 40_000.0 - 1.0).abs() < 0.057, "{sum}");
        // Beyond 5 standard deviations, normal noise occurs once in two million.
        assert!(far > 20, "{far}");
    }
}

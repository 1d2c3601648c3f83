//! Resamples a column to other times.
//!
//! The rule: linear interpolation between the sample before and the sample after. A column with a zero-order hold (a command, a gear) has the value
//! of the sample before. There is no value before the first sample, after the last one, and between two samples that are more than three of the
//! column's usual steps apart. Nothing is filtered: interpolation reduces the variance of noise by up to a half, and signals above half the new
//! sampling rate are aliased.

/// There is no value between two samples that are more than this many usual steps apart: jitter is never larger (`clock.rs`).
const FARTHEST: f64 = 3.0;

/// A column with at most this many different values, all whole numbers, gets a zero-order hold: gears, flags, states.
const MOST_LEVELS: usize = 20;

/// The samples of a column.
pub(crate) struct Samples {
    times: Vec<f64>,
    values: Vec<f64>,
    usual: f64,
}

impl Samples {
    /// The rows that have a value. Times increase strictly.
    pub(crate) fn of(times: &[f64], values: &[f64]) -> Samples {
        let (times, values): (Vec<f64>, Vec<f64>) =
            times.iter().zip(values).filter(|(_, value)| !value.is_nan()).map(|(time, value)| (*time, *value)).unzip();
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        let usual = steps.get(steps.len().saturating_sub(1) / 2).copied().unwrap_or(0.0);
        Samples { times, values, usual }
    }

    /// Whether the column changes in steps between a few whole numbers.
    pub(crate) fn is_in_steps(&self) -> bool {
        let mut levels: Vec<f64> = Vec::new();
        for value in &self.values {
            if value.fract() != 0.0 {
                return false;
            }
            if !levels.contains(value) {
                levels.push(*value);
                if levels.len() > MOST_LEVELS {
                    return false;
                }
            }
        }
        // For a constant column both rules give the same values.
        levels.len() > 1
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.times.len()
    }

    /// First and last instant, in s; both are 0 if there are no samples.
    pub(crate) fn span(&self) -> (f64, f64) {
        (self.times.first().copied().unwrap_or(0.0), self.times.last().copied().unwrap_or(0.0))
    }

    /// Averages over cells of this width, from the time `start` on; NaN if a cell has no sample.
    pub(crate) fn averages(&self, start: f64, width: f64, count: usize) -> Vec<f64> {
        let mut cells = vec![(0.0, 0.0); count];
        for (time, value) in self.times.iter().zip(&self.values) {
            let place = (time - start) / width;
            let Some((number, sum)) = (place >= 0.0).then(|| cells.get_mut(place as usize)).flatten() else { continue };
            *number += 1.0;
            *sum += value;
        }
        cells.into_iter().map(|(number, sum)| if number > 0.0 { sum / number } else { f64::NAN }).collect()
    }

    /// The usual step between samples, in s.
    pub(crate) fn usual(&self) -> f64 {
        self.usual
    }

    /// The value at an instant; NaN if there is none.
    pub(crate) fn at(&self, instant: f64, holds: bool) -> f64 {
        let after = self.times.partition_point(|time| *time < instant);
        if self.times.get(after) == Some(&instant) {
            return self.values[after];
        }
        if after == 0 || after == self.times.len() {
            // Times of the new grid are rounded: a millionth of a step after the end counts as the end.
            let end = if after == 0 { 0 } else { after - 1 };
            let is_end = self.times.get(end).is_some_and(|time| (time - instant).abs() <= 1e-6 * self.usual);
            return if is_end { self.values[end] } else { f64::NAN };
        }
        let (before, next) = (self.times[after - 1], self.times[after]);
        if next - before > FARTHEST * self.usual {
            return f64::NAN;
        }
        if holds {
            return self.values[after - 1];
        }
        let share = (instant - before) / (next - before);
        self.values[after - 1] * (1.0 - share) + self.values[after] * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_steps_and_nothing_made_up() {
        let times = [0.0, 1.0, 2.1, 3.0, 9.0, 10.0];
        let samples = Samples::of(&times, &[0.0, 2.0, f64::NAN, 4.0, 5.0, 7.0]);
        for (instant, line, held) in [
            (0.0, 0.0, 0.0),
            (0.25, 0.5, 0.0),
            (2.0, 3.0, 2.0),
            (3.0, 4.0, 4.0),
            (6.0, f64::NAN, f64::NAN),
            (9.5, 6.0, 5.0),
            (-0.1, f64::NAN, f64::NAN),
            (10.1, f64::NAN, f64::NAN),
        ] {
            for (holds, expected) in [(false, line), (true, held)] {
                let found = samples.at(instant, holds);
                assert!(found == expected || (found.is_nan() && expected.is_nan()), "{instant} {holds}: {found}, {expected}");
            }
        }
        assert!(Samples::of(&times, &[1.0, 2.0, 1.0, 3.0, 3.0, 3.0]).is_in_steps());
        assert!(!Samples::of(&times, &[1.0, 2.0, 1.0, 3.0, 3.0, 3.5]).is_in_steps());
        assert!(!Samples::of(&times, &[1.0; 6]).is_in_steps());
    }
}

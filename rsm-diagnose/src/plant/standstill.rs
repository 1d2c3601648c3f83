//! Distinguishes a plant at rest from a stuck sensor: at rest, an encoder, a dead band or a coarse step also gives equal readings.
//!
//! In: the readings of a channel and the nominal plant along it. Out: whether equal readings mean rest. A stuck sensor has three signs. Its readings
//! end with a jump, because the plant has moved on. Its noise vanishes while the noise of neighbouring rows does not. It may stop at any value. Rest
//! begins and ends without a jump. The nominal plant is used last, because it may lack the friction that holds the true plant.

use rsm_core::order;
use std::ops::Range;

/// A channel is at rest after this many equal readings in a row.
const LEAST_REPEATS: usize = 3;

/// Readings of exactly 0 are rest if the changes before and after are below this share of the largest reading. A dead band is smaller than that.
const SMALL_CHANGE: f64 = 0.1;

/// They are also rest if the nominal plant, which may have no dry friction, is slower than this share of its largest reading.
const LOW_SPEED: f64 = 0.1;

/// A coarse sensor moves at most this many of its steps from row to row into a rest and out of it. Beside a rest, its change from row to row varies
/// by at most as much: rounding changes a second difference by up to two steps.
const STEPS: f64 = 2.5;

/// The number of rows on either side of a rest that show how the sensor reads there.
const BESIDE: usize = 20;

/// Changes of a coarse sensor are multiples of its step. The first number is the allowed error as a share of the step, the second is the share of
/// changes that must comply.
const WHOLE: (f64, f64) = (0.01, 0.98);

/// With fewer changes, no step is estimated.
const LEAST_STEPS: usize = 20;

/// Which rows move: they are not in a run of equal readings.
#[must_use]
pub fn moving(values: &[f64]) -> Vec<bool> {
    let mut moves = vec![true; values.len()];
    for run in values.chunk_by(|a, b| a == b).scan(0, |at, run| {
        *at += run.len();
        Some(*at - run.len()..*at)
    }) {
        if run.len() >= LEAST_REPEATS {
            moves[run].fill(false);
        }
    }
    moves
}

/// A channel that may rest.
pub struct StandstillTest<'a> {
    values: &'a [f64],
    nominal: Option<&'a [f64]>,
    /// The largest reading, and the largest value of the nominal plant.
    largest: [f64; 2],
    /// The step, if all changes are multiples of one.
    step: Option<f64>,
}

impl<'a> StandstillTest<'a> {
    /// A channel and the nominal plant's values of it.
    #[must_use]
    pub fn new(values: &'a [f64], nominal: Option<&'a [f64]>) -> Self {
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        StandstillTest { values, nominal, largest: [largest(values), nominal.map_or(0.0, largest)], step: step(values) }
    }

    /// Whether equal readings in these rows mean a plant at rest.
    #[must_use]
    pub fn rests(&self, rows: Range<usize>) -> bool {
        self.is_dead_band(&rows) || self.is_coarse(&rows)
    }

    /// Whether only the last digit of a coarse sensor changes in these rows.
    #[must_use]
    pub fn is_still(&self, rows: Range<usize>) -> bool {
        let part = &self.values[rows];
        let (low, high) = order::ends(part);
        // One step up or down.
        high == low || self.step.is_some_and(|step| high - low <= 2.0 * (1.0 + WHOLE.0) * step)
    }

    /// The changes of a channel into and out of a run of rows.
    fn ends(&self, rows: &Range<usize>) -> [f64; 2] {
        let value = self.values[rows.start];
        let off = |row: Option<usize>| row.and_then(|row| self.values.get(row)).map_or(0.0, |other| (other - value).abs());
        [off(rows.start.checked_sub(1)), off(Some(rows.end))]
    }

    fn is_dead_band(&self, rows: &Range<usize>) -> bool {
        if self.values[rows.start] != 0.0 {
            return false;
        }
        let slow =
            self.nominal.is_some_and(|it| it[rows.clone()].iter().all(|value| value.abs() < LOW_SPEED * self.largest[1]));
        slow || self.ends(rows).iter().all(|off| *off <= SMALL_CHANGE * self.largest[0])
    }

    /// Whether a coarse sensor repeats its value because the plant creeps or a smooth motion ends. A sensor with noise of some steps would not
    /// repeat; it is stuck.
    fn is_coarse(&self, rows: &Range<usize>) -> bool {
        let Some(step) = self.step else { return false };
        // The change is about the same as in the row before. Noise changes the slope from row to row; a motion that comes to rest does not.
        let change = |row: usize| self.values[row + 1] - self.values[row];
        let gently = |row: usize| (change(row) - if row == 0 { 0.0 } else { change(row - 1) }).abs() <= STEPS * step;
        let beside = |rows: Range<usize>| rows.is_empty() || 2 * rows.clone().filter(|row| gently(*row)).count() >= rows.len();
        let last = self.values.len() - 1;
        let after = (rows.end - 1).min(last)..(rows.end - 1 + BESIDE).min(last);
        let before = rows.start.saturating_sub(BESIDE)..rows.start;
        self.ends(rows).iter().all(|off| *off <= STEPS * step) && (beside(before) || beside(after))
    }
}

/// The step of which nearly all changes are multiples, if there is one.
fn step(values: &[f64]) -> Option<f64> {
    let changes: Vec<f64> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|change| *change > 0.0).collect();
    let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    // A change within the accuracy of a number is no step.
    let least = changes.iter().copied().filter(|change| *change > 1e-12 * largest).fold(f64::INFINITY, f64::min);
    if changes.len() < LEAST_STEPS || least.is_infinite() {
        return None;
    }
    let whole =
        changes.iter().filter(|it| (*it / least - (*it / least).round()).abs() < WHOLE.0.max(1e-9 * largest / least)).count();
    (whole as f64 > WHOLE.1 * changes.len() as f64).then_some(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    /// A speed that comes to rest for 100 rows and goes on, in steps, with noise of this many of them.
    fn readings(step: f64, noise: f64) -> Vec<f64> {
        let mut random = Random::new(2);
        let value = |k: usize| match k {
            0..200 => 200.0 - k as f64,
            200..300 => 0.0,
            _ => k as f64 - 300.0,
        };
        (0..500).map(|k| ((value(k) + noise * random.normal()) / step).round() * step).collect()
    }

    #[test]
    fn rest_of_a_coarse_sensor_and_of_a_dead_band_is_rest() {
        let coarse = readings(1.0, 0.0);
        assert!(StandstillTest::new(&coarse, None).rests(200..301));
        // The same sensor with an offset: its zero is no number in particular.
        let offset: Vec<f64> = coarse.iter().map(|value| value + 17.3).collect();
        assert!(StandstillTest::new(&offset, None).rests(200..301));
        let mut dead = readings(1e-9, 2.0);
        dead.iter_mut().filter(|value| value.abs() < 8.0).for_each(|value| *value = 0.0);
        let start = dead.iter().position(|value| *value == 0.0).unwrap();
        assert!(StandstillTest::new(&dead, None).rests(start..300));
    }

    #[test]
    fn a_sensor_that_hangs_does_not_rest() {
        for (step, noise) in [(1.0, 0.0), (1.0, 3.0), (1e-9, 2.0)] {
            let mut hangs = readings(step, noise);
            let value = hangs[60];
            hangs[60..120].fill(value);
            assert!(!StandstillTest::new(&hangs, None).rests(60..120), "{step} {noise}");
            // A wire that is off reads 0, at once.
            hangs[60..120].fill(0.0);
            assert!(!StandstillTest::new(&hangs, None).rests(60..120), "{step} {noise}");
        }
        // At rest its noise is gone.
        let mut hangs = readings(1.0, 6.0);
        let value = hangs[230];
        hangs[230..270].fill(value);
        assert!(value == 0.0 || !StandstillTest::new(&hangs, None).rests(230..270));
    }

    #[test]
    fn a_jump_beside_rest_is_still_a_jump_and_noise_beside_rest_is_none() {
        let mut values = readings(1e-9, 2.0);
        values[195..495].fill(0.0);
        assert_eq!(super::super::checks::jumps(&values), Vec::<usize>::new());
        values[100] += 60.0;
        assert_eq!(super::super::checks::jumps(&values), [100]);
    }
}

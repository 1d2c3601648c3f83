//! Waves of effort over a position: for every wave number, the columns that it adds to the prediction errors.
//!
//! In: a filter along a record; a plant with one slow wave. Out: two columns for each wave number, a quarter of a wave apart. The position is that
//! of the filter, so even a wave of 90 cycles per turn stays in phase; the position of a free run would be several cycles off. The effort of the
//! wave moves the states of the next row, and the linear model of the rows gives all that follows. Fits nothing.

use rsm_core::order;
use std::f64::consts::TAU;
use std::ops::Range;

use super::filter::Filter;
use crate::engine::angle::{Multiples, sin_cos};
use rsm_sim::plant_file::PlantFile;

/// Motion along a position, and what an effort along it does.
pub struct Turning<'f> {
    filter: &'f Filter,
    /// The phase of the slow wave at every row, in rad, continued over its periods.
    phase: Vec<f64>,
    /// The change of the predicted states of each row by a unit effort over the row before.
    response: Vec<Vec<f64>>,
    /// For each row: the change of the predicted states of the next row by a change of those of this row, with the correction between; by rows.
    passed: Vec<Vec<f64>>,
}

impl<'f> Turning<'f> {
    /// The motion along a position. `waves` are plants with a wave of the amplitude `amplitude`: the slow wave with the phases 0 and a quarter, and
    /// a wave with twice its number of periods and the phase 0. `None` if they have no effect.
    #[must_use]
    pub fn new(filter: &'f Filter, waves: &[PlantFile; 3], amplitude: f64) -> Option<Self> {
        let mut found = filter.row_responses(waves).into_iter();
        let (sin, cos, double) = (found.next()??, found.next()??, found.next()??);
        let count = filter.observer.is_kinematic.len();
        let rows = sin.len();
        // Both responses are one vector, times the sine and the cosine of the phase.
        let mut direction = vec![0.0; count];
        for it in sin.iter().chain(&cos) {
            let sign = if it.iter().zip(&direction).map(|(a, b)| a * b).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
            direction.iter_mut().zip(it).for_each(|(sum, value)| *sum += sign * value);
        }
        let largest = direction.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let state = direction.iter().position(|it| it.abs() == largest).filter(|_| largest > 0.0)?;
        // The response to a forward effort may have either sign. The sine of the double angle is twice the product of sine and cosine.
        let both: f64 = sin.iter().zip(&cos).zip(&double).map(|((s, c), d)| s[state] * c[state] * d[state]).sum();
        let sign = if both < 0.0 { -1.0 } else { 1.0 };
        let (mut phase, mut response, mut last) = (Vec::with_capacity(rows), Vec::with_capacity(rows), 0.0);
        for row in 0..rows {
            // What the wave does in a row shows at its end.
            let (sin, cos) = (&sin[(row + 1).min(rows - 1)], &cos[(row + 1).min(rows - 1)]);
            let size = sin[state].hypot(cos[state]);
            let now: f64 = if size > 0.0 { (sign * sin[state]).atan2(sign * cos[state]) } else { last };
            last += (now - last + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
            phase.push(last);
            let (s, c) = (last.sin(), last.cos());
            response.push(sin.iter().zip(cos).map(|(a, b)| (a * s + b * c) / amplitude).collect());
        }
        let mut passed = Vec::with_capacity(rows);
        for row in 0..rows {
            let it = &filter.linear[row];
            let next = &filter.linear[(row + 1).min(rows - 1)].transition;
            let kept = nalgebra::DMatrix::identity(count, count) - &filter.gains[row] * &it.slopes;
            passed.push((next * kept).transpose().as_slice().to_vec());
        }
        Some(Turning { filter, phase, response, passed })
    }

    /// The number of periods of the slow wave, with both directions added.
    #[must_use]
    pub fn turns(&self) -> f64 {
        self.phase.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / TAU
    }

    /// The distance between the ends of the motion, in periods of the slow wave.
    #[must_use]
    pub fn travel(&self) -> f64 {
        let ends = order::ends(&self.phase);
        (ends.1 - ends.0).max(0.0) / TAU
    }

    /// The columns that a unit wave and the same a quarter further add to the prediction errors, for each output of the record. `number` is the
    /// number of periods in a period of the slow wave.
    #[must_use]
    pub fn wave(&self, number: f64) -> [Vec<Vec<f64>>; 2] {
        let sines: Vec<(f64, f64)> = self.phase.iter().map(|phase| sin_cos(number * phase)).collect();
        self.wave_of(number, &sines)
    }

    /// The same for each of some multiples of a number.
    #[must_use]
    pub fn waves(&self, number: f64, multiples: Range<usize>) -> Vec<[Vec<Vec<f64>>; 2]> {
        let mut sines = Multiples::new(self.phase.iter().map(|phase| number * phase).collect(), multiples.start);
        let mut list = Vec::with_capacity(multiples.len());
        for multiple in multiples {
            list.push(self.wave_of(multiple as f64 * number, sines.now()));
            sines.advance();
        }
        list
    }

    /// The same with the sine and the cosine of `number` times the phase at every row.
    fn wave_of(&self, number: f64, sines: &[(f64, f64)]) -> [Vec<Vec<f64>>; 2] {
        let count = self.filter.observer.is_kinematic.len();
        let outputs = self.filter.sd.len();
        let rows = self.phase.len();
        let mut columns = [0, 1].map(|_| vec![Vec::with_capacity(rows); outputs]);
        let mut moved = [0, 1].map(|_| vec![0.0; count]);
        let mut next = vec![0.0; count];
        for row in 0..rows {
            let slopes = &self.filter.linear[row].slopes;
            let mean = if row + 1 < rows {
                mean(number * (self.phase[row + 1] - self.phase[row]), sines[row], sines[row + 1])
            } else {
                [0.0; 2]
            };
            for quarter in 0..2 {
                let moved = &mut moved[quarter];
                for (output, column) in columns[quarter].iter_mut().enumerate() {
                    let used = self.filter.prepared.used[output][row];
                    let seen: f64 = moved.iter().enumerate().map(|(k, value)| slopes[(output, k)] * value).sum();
                    column.push(if used { seen / self.filter.sd[output] } else { 0.0 });
                }
                for (k, next) in next.iter_mut().enumerate() {
                    let along = self.passed[row][k * count..(k + 1) * count].iter().zip(&*moved);
                    *next = along.map(|(a, b)| a * b).sum::<f64>() + mean[quarter] * self.response[row][k];
                }
                moved.copy_from_slice(&next);
            }
        }
        columns
    }
}

/// The means of the sine and the cosine between two phases that are `moved` apart, if the phase is linear in time: a wave of high order turns by
/// radians within a row. Each phase is given by its sine and cosine.
fn mean(moved: f64, (sin, cos): (f64, f64), (next_sin, next_cos): (f64, f64)) -> [f64; 2] {
    // For changes below 1e-4, the mean of both ends is accurate to 1e-9.
    if moved.abs() < 1e-4 {
        [0.5 * (sin + next_sin), 0.5 * (cos + next_cos)]
    } else {
        [(cos - next_cos) / moved, (next_sin - sin) / moved]
    }
}

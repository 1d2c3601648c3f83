//! Waves of effort over a position: for every wave number, the columns that it adds to the prediction errors.
//!
//! In: a filter along a record; a plant with one slow wave. Out: two columns for each wave number, a quarter of a wave apart. The position is that
//! of the filter, so even a wave of 90 cycles per turn stays in phase; the position of a free run would be several cycles off. The effort of the
//! wave moves the states of the next row, and the linear model of the rows gives all that follows. Fits nothing.

use rsm_core::order;
use rsm_core::vector::{Work, widest};
use std::f64::consts::TAU;
use std::ops::Range;

use super::filter::Filter;
use crate::engine::angle::{Multiples, Sines, TOGETHER, no_sines, sin_cos};
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
        let sines: Vec<Sines<1>> = self.phase.iter().map(|phase| sin_cos(number * phase)).map(|it| ([it.0], [it.1])).collect();
        let [wave] = self.waves_of([number], &sines);
        wave
    }

    /// The same for each of some multiples of a number.
    #[must_use]
    pub fn waves(&self, number: f64, multiples: Range<usize>) -> Vec<[Vec<Vec<f64>>; 2]> {
        let mut sines = Multiples::new(self.phase.iter().map(|phase| number * phase).collect(), multiples.start);
        let mut list = Vec::with_capacity(multiples.len());
        let mut together = no_sines(self.phase.len());
        for first in multiples.clone().step_by(TOGETHER) {
            sines.take(&mut together);
            let numbers: [f64; TOGETHER] = std::array::from_fn(|lane| (first + lane) as f64 * number);
            list.extend(self.waves_of(numbers, &together));
        }
        list.truncate(multiples.len());
        list
    }

    /// The same for some numbers, with the sines and the cosines of the numbers times the phase at every row.
    fn waves_of<const W: usize>(&self, numbers: [f64; W], sines: &[Sines<W>]) -> [[Vec<Vec<f64>>; 2]; W] {
        let (rows, outputs) = (self.phase.len(), self.filter.sd.len());
        let mut columns = std::array::from_fn(|_| [0, 1].map(|_| vec![vec![0.0; rows]; outputs]));
        widest(Along { turning: self, numbers, sines, columns: &mut columns });
        columns
    }
}

/// Waves along a motion.
struct Along<'a, const W: usize> {
    turning: &'a Turning<'a>,
    numbers: [f64; W],
    sines: &'a [Sines<W>],
    columns: &'a mut [[Vec<Vec<f64>>; 2]; W],
}

impl<const W: usize> Work for Along<'_, W> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Along { turning: Turning { filter, phase, response, passed }, numbers, sines, columns } = self;
        let count = filter.observer.is_kinematic.len();
        let rows = phase.len();
        let mut moved = [0, 1].map(|_| vec![[0.0; W]; count]);
        let mut next = vec![[0.0; W]; count];
        for row in 0..rows {
            // The derivatives of the outputs, state by state.
            let slopes = filter.linear[row].slopes.as_slice();
            let means = if row + 1 < rows {
                means(numbers.map(|it| it * (phase[row + 1] - phase[row])), &sines[row], &sines[row + 1])
            } else {
                [[0.0; W]; 2]
            };
            for quarter in 0..2 {
                let (moved, mean) = (&mut moved[quarter], &means[quarter]);
                for (output, sd) in filter.sd.iter().enumerate() {
                    if !filter.prepared.used[output][row] {
                        continue;
                    }
                    let mut seen = [0.0; W];
                    for (value, slope) in moved.iter().zip(slopes[output..].iter().step_by(filter.sd.len())) {
                        (0..W).for_each(|lane| seen[lane] += slope * value[lane]);
                    }
                    for (columns, seen) in columns.iter_mut().zip(seen) {
                        columns[quarter][output][row] = seen / sd;
                    }
                }
                for ((next, along), response) in next.iter_mut().zip(passed[row].chunks(count)).zip(&response[row]) {
                    let mut sum = [0.0; W];
                    for (by, value) in along.iter().zip(&*moved) {
                        (0..W).for_each(|lane| sum[lane] += by * value[lane]);
                    }
                    *next = std::array::from_fn(|lane| sum[lane] + mean[lane] * response);
                }
                moved.copy_from_slice(&next);
            }
        }
    }
}

/// The means of the sine and the cosine between two phases that are `moved` apart, if the phase is linear in time: a wave of high order turns by
/// radians within a row. Each phase is given by its sine and cosine.
#[inline(always)]
fn means<const W: usize>(moved: [f64; W], (sin, cos): &Sines<W>, (next_sin, next_cos): &Sines<W>) -> [[f64; W]; 2] {
    let mut means = [[0.0; W]; 2];
    for lane in 0..W {
        // For changes below 1e-4, the mean of both ends is accurate to 1e-9.
        let is_short = moved[lane].abs() < 1e-4;
        let ends = [0.5 * (sin[lane] + next_sin[lane]), 0.5 * (cos[lane] + next_cos[lane])];
        let between = [(cos[lane] - next_cos[lane]) / moved[lane], (next_sin[lane] - sin[lane]) / moved[lane]];
        for (mean, (ends, between)) in means.iter_mut().zip(ends.into_iter().zip(between)) {
            mean[lane] = if is_short { ends } else { between };
        }
    }
    means
}

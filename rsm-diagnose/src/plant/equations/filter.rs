//! The Kalman filter of a plant along a record: gains that keep the simulated states near the readings.
//!
//! ```text
//!   plant + readings --extended Kalman filter--> linear model of each row --energies--> process noise --Riccati--> gains
//! ```
//!
//! In: a prepared record, a plant file, the noise of its readings. Out: a gain for each row. The process noise of a state is chosen so that it is
//! just visible within the memory of the filter: an error of a rate then grows for about that many rows before the readings correct it, as the noise
//! of the readings is averaged over as many. States that no reading shows, and positions, whose derivative is another state, have no process noise.
//!
//! Source: B. D. O. Anderson, J. B. Moore, Optimal Filtering, 1979, sections 3.1 (the gains) and 8.2 (the extended filter).

use nalgebra::DMatrix;

use crate::plant::prepared::Prepared;
use rsm_sim::equation_plant::Observer;
use rsm_sim::equations::observed::{AtRow, PredictedRow};
use rsm_sim::plant_file::PlantFile;

/// The memory in rows. With a longer memory, a constant error of a rate is larger relative to the noise, but so is the plant's response to its own
/// errors.
pub const MEMORY: usize = 100;

/// The process noise of the first filter, which finds the states along the readings: this many times the mean change of a state in a row. With less,
/// an error of a rate holds the states back, and an angle that no sensor reads is soon off by a period of a wave.
const FIRST_NOISE: f64 = 3.0;

/// The standard deviation of a state at the start, in mean changes in a row.
const START: f64 = 10.0;

/// Readings that do not count have this many times the noise.
const DOES_NOT_COUNT: f64 = 1e6;

/// The energy of a state's response counts as none below this: the state then moves no output by more than 1e-4 of its noise per change in a row.
const NO_ENERGY: f64 = 1e-8;

/// Windows of rows, each as long as the memory, over which the energy of a response is averaged.
const WINDOWS: usize = 16;

/// A plant with its gains along a record.
pub struct Filter {
    /// The plant.
    pub observer: Observer,
    /// The record.
    pub prepared: Prepared,
    /// For each row: for each state of the plant, for each of the outputs that the record holds.
    pub gains: Vec<DMatrix<f64>>,
    /// For each row, the linear model from the row before.
    pub linear: Vec<LinearRow>,
    /// The standard deviation of each prediction error in the mean over the rows.
    pub sd: Vec<f64>,
}

/// The linear model of a row.
pub struct LinearRow {
    /// The predicted states.
    pub states: Vec<f64>,
    /// The states after the correction by the readings.
    pub corrected: Vec<f64>,
    /// The derivatives of the predicted states with respect to the corrected states of the row before.
    pub transition: DMatrix<f64>,
    /// The derivatives of the outputs that the record holds with respect to the states.
    pub slopes: DMatrix<f64>,
}

/// Covariance and noise of a filter in progress.
struct Riccati<'a> {
    covariance: DMatrix<f64>,
    process: Vec<f64>,
    noise: &'a [f64],
    prepared: &'a Prepared,
}

impl Riccati<'_> {
    /// The gain at a row, and the standard deviation of each prediction error.
    fn gain(&mut self, row: usize, transition: &DMatrix<f64>, slopes: &DMatrix<f64>) -> Option<(DMatrix<f64>, Vec<f64>)> {
        if row > 0 {
            self.covariance = transition * &self.covariance * transition.transpose();
            for (k, sd) in self.process.iter().enumerate() {
                self.covariance[(k, k)] += sd * sd;
            }
        }
        let across = &self.covariance * slopes.transpose();
        let mut errors = slopes * &across;
        for (k, noise) in self.noise.iter().enumerate() {
            let sd = if self.prepared.used[k][row] { *noise } else { DOES_NOT_COUNT * noise };
            errors[(k, k)] += sd * sd;
        }
        let sd = (0..self.noise.len()).map(|k| errors[(k, k)].sqrt()).collect();
        let gain = errors.cholesky()?.solve(&across.transpose()).transpose();
        let kept = DMatrix::identity(self.process.len(), self.process.len()) - &gain * slopes;
        self.covariance = &kept * &self.covariance;
        self.covariance = 0.5 * (&self.covariance + self.covariance.transpose());
        Some((gain, sd))
    }
}

impl Filter {
    /// The filter of a plant along a record. `noise` is the standard deviation of each output that the record holds. `None` if the plant cannot
    /// follow the record, or if a signal of it is delayed.
    #[must_use]
    pub fn new(prepared: &Prepared, file: &PlantFile, noise: &[f64]) -> Option<Filter> {
        let record = &prepared.record;
        let observer = Observer::new(file, record, prepared.tolerance(noise))?;
        let count = observer.is_kinematic.len();
        let start: Vec<f64> = observer.changes.iter().map(|it| START * it).collect();
        let covariance = || DMatrix::from_diagonal(&start.iter().map(|it| it * it).collect::<Vec<f64>>().into());
        let first = observer.changes.iter().zip(&observer.is_kinematic);
        let process = first.map(|(it, kinematic)| if *kinematic { 0.0 } else { FIRST_NOISE * it }).collect();
        let mut filter = Riccati { covariance: covariance(), process, noise, prepared };
        let mut linear: Vec<LinearRow> = Vec::with_capacity(record.rows());
        let mut correct = |at: &PredictedRow<'_>| -> Vec<f64> {
            let slopes = at.slopes.select_rows(&prepared.outputs);
            let gain = filter.gain(at.row, at.transition, &slopes);
            let Some((gain, _)) = gain else { return vec![f64::NAN; count] };
            let missed: Vec<f64> = (0..noise.len())
                .map(|k| prepared.measured(k)[at.row] - at.outputs[prepared.outputs[k]])
                .map(|it| if it.is_finite() { it } else { 0.0 })
                .collect();
            let change = (gain * DMatrix::from_vec(missed.len(), 1, missed)).as_slice().to_vec();
            let corrected = at.states.iter().zip(&change).map(|(state, change)| state + change).collect();
            let (states, transition) = (at.states.to_vec(), at.transition.clone());
            linear.push(LinearRow { states, corrected, transition, slopes });
            change
        };
        if count == 0 || !observer.rows(record, &mut correct) {
            return None;
        }
        let process =
            (0..count).map(|k| if observer.is_kinematic[k] { 0.0 } else { visible(&linear, k, noise, start[k]) }).collect();
        let mut filter = Riccati { covariance: covariance(), process, noise, prepared };
        let mut gains = Vec::with_capacity(linear.len());
        let mut squares = vec![0.0; noise.len()];
        for (row, it) in linear.iter().enumerate() {
            let (gain, sd) = filter.gain(row, &it.transition, &it.slopes)?;
            squares.iter_mut().zip(sd).enumerate().for_each(|(k, (sum, sd))| {
                *sum += if prepared.used[k][row] { sd * sd } else { 0.0 };
            });
            gains.push(gain);
        }
        let counted = |k: usize| prepared.used[k].iter().filter(|it| **it).count().max(1) as f64;
        let sd = squares.iter().enumerate().map(|(k, sum)| (sum / counted(k)).sqrt()).collect();
        Some(Filter { observer, prepared: prepared.clone(), gains, linear, sd })
    }

    /// The prediction errors of plants with the same effects at the same places: for each plant, for each output of the record, one value per row.
    /// Readings that do not count have the error 0.
    #[must_use]
    pub fn errors(&self, files: &[PlantFile]) -> Vec<Option<Vec<Vec<f64>>>> {
        let prepared = &self.prepared;
        let mut all = vec![vec![Vec::new(); prepared.outputs.len()]; files.len()];
        let mut correct = |at: &AtRow<'_>, states: &mut [f64]| {
            let gain = &self.gains[at.row];
            for (k, (output, missed)) in prepared.outputs.iter().zip(&mut all[at.lane]).enumerate() {
                if at.row == 0 {
                    missed.clear();
                }
                let off = prepared.measured(k)[at.row] - at.outputs[*output];
                let off = if prepared.used[k][at.row] && off.is_finite() { off } else { 0.0 };
                missed.push(off);
                states.iter_mut().enumerate().for_each(|(state, value)| *value += gain[(state, k)] * off);
            }
        };
        let done = self.observer.observed(files, &prepared.record, &mut correct);
        done.into_iter().zip(all).map(|(done, missed)| done.then_some(missed)).collect()
    }

    /// The change of the predicted states of each row by an effect that acts in the row before, for plants with the same effects at the same places.
    /// The states at the beginning of the row are those of the filter. The effects must have no states of their own.
    #[must_use]
    pub fn row_responses(&self, files: &[PlantFile]) -> Vec<Option<Vec<Vec<f64>>>> {
        let mut all = vec![Vec::new(); files.len()];
        let mut correct = |at: &AtRow<'_>, states: &mut [f64]| {
            if at.row == 0 {
                all[at.lane].clear();
            }
            let row = &self.linear[at.row];
            let moved: Vec<f64> = states.iter().zip(&row.states).map(|(with, without)| with - without).collect();
            all[at.lane].push(moved);
            states.copy_from_slice(&row.corrected);
        };
        let done = self.observer.observed(files, &self.prepared.record, &mut correct);
        done.into_iter().zip(all).map(|(done, moved)| done.then_some(moved)).collect()
    }
}

/// The process noise with which a state is just visible within the memory: the squared response of all outputs to it, in units of their noise,
/// summed over the memory and over that many rows of noise, is 1. At most the standard deviation of the start; 0 if no output shows the state.
fn visible(linear: &[LinearRow], state: usize, noise: &[f64], most: f64) -> f64 {
    let memory = MEMORY.min(linear.len());
    let windows = WINDOWS.min(linear.len() / memory.max(1)).max(1);
    let mut energy = 0.0;
    for window in 0..windows {
        let first = (linear.len() - memory) * window / windows;
        let count = linear[first].transition.nrows();
        let mut moved = DMatrix::from_fn(count, 1, |k, _| f64::from(u8::from(k == state)));
        for it in &linear[first..first + memory] {
            let seen = &it.slopes * &moved;
            energy += seen.iter().zip(noise).map(|(value, sd)| (value / sd).powi(2)).sum::<f64>();
            moved = &it.transition * moved;
        }
    }
    energy /= windows as f64;
    if energy * most * most <= NO_ENERGY { 0.0 } else { (1.0 / (energy * memory as f64).sqrt()).min(most) }
}

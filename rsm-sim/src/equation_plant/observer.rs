//! Plants that readings correct along a record.
//!
//! In: a plant file, a record, corrections of the states at every row. Out: the linear model of each row; predictions of plants with effects,
//! corrected in the same way. Chooses no gain.

use super::run::{Group, Model, ROWS, instants, open, setting};
use crate::equations::observed::{AtRow, PredictedRow, places_of_states};
use crate::equations::{Inputs, Lane, Setting, lanes};
use crate::plant_file::PlantFile;
use crate::record::Record;

/// A plant that readings correct along one record: its states, for gains.
pub struct Observer {
    model: &'static Model,
    /// For each state, whether its derivative is another state. Then no effect acts on it directly.
    pub is_kinematic: Vec<bool>,
    lane: Lane,
    steps: Vec<f64>,
    /// The mean magnitude of the change of each state in a row of the simulation.
    pub changes: Vec<f64>,
    /// The permitted error of a step, as in [`Setting`].
    tolerance: f64,
}

/// The step of a finite difference, as a share of the largest magnitude of a state. With a permitted error of a step of 1e-7 of that magnitude, a
/// derivative is accurate to 1e-4.
const DIFFERENCE: f64 = 1e-3;

/// The work per row at which a run that readings correct is stopped: 250 steps of the series, which are ten turns of the fastest motion between two
/// rows.
const OBSERVED_WORK_A_ROW: usize = 250 * Setting::SERIES as usize;

impl Observer {
    /// The plant of a file along a record, with the permitted error of a step as in [`Setting`]. `None` if its start has no solution.
    #[must_use]
    pub fn new(file: &PlantFile, record: &Record, tolerance: f64) -> Option<Observer> {
        let Group { model, slot, lanes, .. } = Group::of(std::slice::from_ref(file), record)?;
        let (lane, machine) = (lanes.into_iter().next()?, &slot.machine);
        let time = instants(record);
        let every = (record.rows() / ROWS).max(1);
        let points = lanes::points(
            machine,
            lane.start().clone(),
            Inputs { time: &time, values: &record.inputs },
            Setting { tolerance, ..Setting::default() },
            every,
        );
        let count = machine.states().len();
        let finite = |it: &f64| it.is_finite();
        let largest = |k: usize| points.iter().map(|it| it.states[k].abs()).filter(finite).fold(0.0, f64::max);
        let change = |k: usize| {
            let all: Vec<f64> =
                points.windows(2).map(|pair| (pair[1].states[k] - pair[0].states[k]).abs()).filter(finite).collect();
            all.iter().sum::<f64>() / (all.len().max(1) * every) as f64
        };
        let changes: Vec<f64> = (0..count).map(change).collect();
        // An angle grows without bound, but a row changes it little.
        let step = |k: usize| {
            let size = DIFFERENCE * largest(k);
            let limited = if changes[k] > 0.0 { size.min(changes[k]) } else { size };
            if limited > 0.0 { limited } else { DIFFERENCE * DIFFERENCE }
        };
        let is_kinematic = machine.kinematic_states();
        let steps = (0..count).map(step).collect();
        open(&model.slots).push(slot);
        Some(Observer { model, is_kinematic, lane, steps, changes, tolerance })
    }

    /// Runs the plant along its record with the linear model of each row. `correct` gets each row and returns the change of each state. Returns
    /// whether the last row was reached.
    #[must_use]
    pub fn rows(&self, record: &Record, correct: &mut dyn FnMut(&PredictedRow<'_>) -> Vec<f64>) -> bool {
        let mut slot = self.model.slot();
        let time = instants(record);
        let inputs = Inputs { time: &time, values: &record.inputs };
        let setting = setting(record, Setting::default().method, self.tolerance, OBSERVED_WORK_A_ROW);
        let done = slot.lanes.linearised_rows(&self.lane, inputs, setting, &self.steps, correct);
        open(&self.model.slots).push(slot);
        done.is_ok()
    }

    /// Runs plants of one kind side by side along the record. At each row `correct` gets the index of the plant, its predicted outputs and the
    /// states of this plant, which it may change. The plants have the same effects at the same places; these effects may be others than those of
    /// this plant, and their own states are not corrected. Returns for each plant whether it reached the last row.
    #[must_use]
    pub fn observed(&self, files: &[PlantFile], record: &Record, correct: &mut dyn FnMut(&AtRow<'_>, &mut [f64])) -> Vec<bool> {
        let mut done = vec![false; files.len()];
        let Some(Group { model, mut slot, places, lanes }) = Group::of(files, record) else { return done };
        if let Some(states) = places_of_states(&self.model.machine, &model.machine) {
            let time = instants(record);
            let inputs = Inputs { time: &time, values: &record.inputs };
            let setting = setting(record, Setting::default().method, self.tolerance, OBSERVED_WORK_A_ROW);
            let mut own = vec![0.0; states.len()];
            let mut of_all = |at: &AtRow<'_>, all: &mut [f64]| {
                own.iter_mut().zip(&states).for_each(|(to, place)| *to = all[*place]);
                correct(&AtRow { lane: places[at.lane], ..*at }, &mut own);
                own.iter().zip(&states).for_each(|(from, place)| all[*place] = *from);
            };
            let found = slot.lanes.observed(&lanes, inputs, setting, &mut of_all);
            for (place, found) in places.iter().zip(found) {
                done[*place] = found.is_ok();
            }
        }
        open(&model.slots).push(slot);
        done
    }
}

//! Runs that readings correct at every row: the observer form of a plant, and the linear model of each row.
//!
//! ```text
//!   states after row k --integrate--> predicted states at row k + 1 --outputs--> predicted readings
//!                                            + gain (reading - predicted reading) --> states after row k + 1
//! ```
//!
//! In: a machine; lanes; the inputs at every row; a correction of the states. Out: the predicted outputs at every row, and for one lane the matrices
//! of the linear model from row to row. Events of a row are executed at the predicted states for the predicted outputs, and again from the same
//! point at the corrected states. The bits of a lane do not depend on the other lanes.
//!
//! Source: B. D. O. Anderson, J. B. Moore, Optimal Filtering, 1979, section 8.2 (extended Kalman filter); the matrices are finite differences.

use nalgebra::DMatrix;

use super::engine::Setting;
use super::lanes::{Lanes, period};
use super::late::DelayedSignals;
use super::machine::Machine;
use super::rows::{Inputs, Stopped};
use super::walk::{Lane, Walk};
use crate::code::WIDE;

/// A plant at a row, with the linear model between this row and the row before.
pub struct PredictedRow<'a> {
    /// The row.
    pub row: usize,
    /// The predicted states.
    pub states: &'a [f64],
    /// The predicted outputs.
    pub outputs: &'a [f64],
    /// The derivatives of the predicted states with respect to the corrected states of the row before.
    pub transition: &'a DMatrix<f64>,
    /// The derivatives of the outputs with respect to the states.
    pub slopes: &'a DMatrix<f64>,
}

/// A lane at a row, before its states are corrected.
pub struct AtRow<'a> {
    /// The row.
    pub row: usize,
    /// The index of the lane.
    pub lane: usize,
    /// The predicted outputs.
    pub outputs: &'a [f64],
}

/// Corrects the states of a lane at a row. If lanes that run side by side cannot reach a row, each starts again alone: then row 0 of a lane comes a
/// second time.
pub type Correction<'a> = dyn FnMut(&AtRow<'_>, &mut [f64]) + 'a;

/// The events of a walk at an instant, to return to it.
struct Saved<const L: usize> {
    slots: Vec<[f64; L]>,
    conditions: Vec<[f64; L]>,
    past: Vec<u64>,
}

impl<const L: usize> Walk<'_, L> {
    /// Stores what events change; nothing if the plant has no events with a memory.
    fn saved(&self, to: &mut Option<Saved<L>>) {
        let counts = self.programs.counts;
        if counts.memories + counts.acts + counts.due == 0 {
            return;
        }
        match to {
            Some(saved) => {
                saved.slots.clone_from(&self.slots);
                saved.conditions.copy_from_slice(&self.events.conditions);
                saved.past.copy_from_slice(&self.events.past);
            }
            None => {
                let (slots, conditions, past) = (self.slots.clone(), self.events.conditions.clone(), self.events.past.clone());
                *to = Some(Saved { slots, conditions, past });
            }
        }
    }

    fn restore(&mut self, from: &Option<Saved<L>>) {
        if let Some(saved) = from {
            self.slots.copy_from_slice(&saved.slots);
            self.events.conditions.copy_from_slice(&saved.conditions);
            self.events.past.copy_from_slice(&saved.past);
        }
    }

    fn states(&mut self) -> &mut [[f64; L]] {
        let begin = self.layout().states as usize;
        &mut self.slots[begin..begin + self.programs.counts.states]
    }
}

impl Lanes<'_> {
    /// Runs lanes along inputs. `correct` gets the predicted outputs of each lane at each row and corrects its states. Returns for each lane whether
    /// it reached the last row.
    ///
    /// # Panics
    /// If an input has fewer rows than the time.
    pub fn observed(
        &mut self,
        lanes: &[Lane],
        inputs: Inputs<'_>,
        setting: Setting,
        correct: &mut Correction<'_>,
    ) -> Vec<Result<(), Stopped>> {
        let width = self.width(lanes);
        let mut all = Vec::with_capacity(lanes.len());
        for group in lanes.chunk_by(|a, b| a.has_samples_of(b)).flat_map(|it| it.chunks(width)) {
            let first = all.len();
            if group.len() > 1 && self.observed_together(group, first, inputs, setting, correct).is_ok() {
                all.extend(group.iter().map(|_| Ok(())));
                continue;
            }
            for lane in group {
                let place = all.len();
                all.push(self.observed_alone(lane, place, inputs, setting, correct));
            }
        }
        all
    }

    fn observed_together(
        &mut self,
        lanes: &[Lane],
        first: usize,
        inputs: Inputs<'_>,
        setting: Setting,
        correct: &mut Correction<'_>,
    ) -> Result<(), Stopped> {
        let machine = self.machine;
        let mut walk = self.group.take().unwrap_or_else(|| Walk::new(machine, self.way));
        walk.begin(lanes, setting, period(inputs));
        let mut saved = None;
        let (mut outputs, mut states) = (vec![0.0; machine.outputs().len()], vec![0.0; walk.states().len()]);
        let mut predicted: Vec<[f64; WIDE]> = Vec::new();
        let mut run = |lanes_of: &mut Self| -> Result<(), Stopped> {
            for row in 0..inputs.time.len() {
                lanes_of.reach_row(&mut walk, lanes, row, inputs, setting)?;
                walk.saved(&mut saved);
                walk.set_inputs(inputs.values, row);
                walk.execute_events(inputs.time[row])?;
                predicted.clear();
                predicted.extend_from_slice(walk.evaluate_outputs());
                walk.restore(&saved);
                for lane in 0..lanes.len() {
                    outputs.iter_mut().zip(&predicted).for_each(|(to, from)| *to = from[lane]);
                    states.iter_mut().zip(walk.states()).for_each(|(to, from)| *to = from[lane]);
                    is_finite(machine, row, &outputs)?;
                    correct(&AtRow { row, lane: first + lane, outputs: &outputs }, &mut states);
                    walk.states().iter_mut().zip(&states).for_each(|(to, from)| to[lane] = *from);
                }
                (lanes.len()..WIDE).for_each(|lane| walk.follow(lane, lanes.len() - 1));
                walk.set_inputs(inputs.values, row);
                walk.execute_events(inputs.time[row])?;
            }
            Ok(())
        };
        let done = run(self);
        self.group = Some(walk);
        done
    }

    fn observed_alone(
        &mut self,
        lane: &Lane,
        place: usize,
        inputs: Inputs<'_>,
        setting: Setting,
        correct: &mut Correction<'_>,
    ) -> Result<(), Stopped> {
        let machine = self.machine;
        let mut walk: Walk<'_, 1> = self.alone.take().unwrap_or_else(|| Walk::new(machine, self.way));
        walk.begin(std::slice::from_ref(lane), setting, period(inputs));
        let mut late = DelayedSignals::new(lane.numbers(), inputs.time, period(inputs));
        let mut saved = None;
        let (mut predicted, mut states): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut run = || -> Result<(), Stopped> {
            for (row, end) in inputs.time.iter().enumerate() {
                walk.row = row;
                if row > 0 {
                    walk.reach_row(inputs.time[row - 1], *end, &mut late)?;
                }
                walk.saved(&mut saved);
                walk.set_inputs(inputs.values, row);
                walk.exchange(&mut late);
                walk.execute_events_and_send(*end, &mut late)?;
                predicted.clear();
                predicted.extend(walk.evaluate_outputs().iter().map(|it| it[0]));
                late.replace(row, *end, &mut predicted);
                is_finite(machine, row, &predicted)?;
                walk.restore(&saved);
                states.clear();
                states.extend(walk.states().iter().map(|it| it[0]));
                correct(&AtRow { row, lane: place, outputs: &predicted }, &mut states);
                walk.states().iter_mut().zip(&states).for_each(|(to, from)| *to = [*from]);
                walk.set_inputs(inputs.values, row);
                walk.exchange(&mut late);
                walk.execute_events_and_send(*end, &mut late)?;
                late.read(*end, walk.evaluate_outputs());
            }
            Ok(())
        };
        let done = run();
        self.alone = Some(walk);
        done
    }

    /// Runs one lane along inputs with its linear model from row to row. `correct` gets each row and returns the change of each state. `steps` are
    /// the steps of the finite differences, one for each state.
    ///
    /// # Errors
    /// The reason why a row could not be reached; delayed signals.
    ///
    /// # Panics
    /// If an input has fewer rows than the time.
    pub fn linearised_rows(
        &mut self,
        lane: &Lane,
        inputs: Inputs<'_>,
        setting: Setting,
        steps: &[f64],
        correct: &mut dyn FnMut(&PredictedRow<'_>) -> Vec<f64>,
    ) -> Result<(), Stopped> {
        if self.width(std::slice::from_ref(lane)) == 1 {
            return Err(Stopped::Step("found delayed signals or a nonlinear block, expected a plant without them".to_string()));
        }
        let (machine, way) = (self.machine, self.way);
        let states = steps.len();
        // In each group, the first lane is the plant itself and the others have one changed state.
        let each = WIDE - 1;
        let lanes = vec![lane.clone(); WIDE];
        let mut groups: Vec<Walk<'_, WIDE>> = (0..states.div_ceil(each).max(1)).map(|_| Walk::new(machine, way)).collect();
        groups.iter_mut().for_each(|walk| walk.begin(&lanes, setting, period(inputs)));
        let mut saved: Vec<Option<Saved<WIDE>>> = groups.iter().map(|_| None).collect();
        let mut transition = DMatrix::identity(states, states);
        let mut slopes = DMatrix::zeros(machine.outputs().len(), states);
        for row in 0..inputs.time.len() {
            let mut predicted = Vec::new();
            let mut outputs = Vec::new();
            for (place, (walk, saved)) in groups.iter_mut().zip(&mut saved).enumerate() {
                let own = |lane: usize| place * each + lane - 1;
                self.reach_row(walk, &lanes, row, inputs, setting)?;
                let found: Vec<[f64; WIDE]> = walk.states().to_vec();
                let used = 1..WIDE.min(states + 1 - place * each);
                if row > 0 {
                    for lane in used.clone() {
                        for (k, values) in found.iter().enumerate() {
                            transition[(k, own(lane))] = (values[lane] - values[0]) / steps[own(lane)];
                        }
                    }
                }
                predicted = found.iter().map(|it| it[0]).collect();
                walk.saved(saved);
                spread(walk.states(), &predicted, steps, place * each);
                walk.set_inputs(inputs.values, row);
                walk.execute_events(inputs.time[row])?;
                let values = walk.evaluate_outputs();
                for lane in used {
                    for (k, values) in values.iter().enumerate() {
                        slopes[(k, own(lane))] = (values[lane] - values[0]) / steps[own(lane)];
                    }
                }
                outputs = values.iter().map(|it| it[0]).collect();
                walk.restore(saved);
            }
            let at = PredictedRow { row, states: &predicted, outputs: &outputs, transition: &transition, slopes: &slopes };
            let corrected: Vec<f64> = predicted.iter().zip(correct(&at)).map(|(state, change)| state + change).collect();
            if let Some(place) = corrected.iter().position(|it| !it.is_finite()) {
                return Err(Stopped::NotFinite { row, name: machine.states()[place].0.clone() });
            }
            for (place, walk) in groups.iter_mut().enumerate() {
                spread(walk.states(), &corrected, steps, place * each);
                walk.set_inputs(inputs.values, row);
                walk.execute_events(inputs.time[row])?;
            }
        }
        Ok(())
    }
}

fn is_finite(machine: &Machine, row: usize, outputs: &[f64]) -> Result<(), Stopped> {
    match outputs.iter().position(|it| !it.is_finite()) {
        Some(k) => Err(Stopped::NotFinite { row, name: machine.outputs()[k].0.clone() }),
        None => Ok(()),
    }
}

/// Sets all lanes to these states; in each lane after the first, one state from `first` on is changed by its step.
fn spread(lanes: &mut [[f64; WIDE]], states: &[f64], steps: &[f64], first: usize) {
    for (k, (slot, state)) in lanes.iter_mut().zip(states).enumerate() {
        *slot = [*state; WIDE];
        if k >= first && k - first + 1 < WIDE {
            slot[k - first + 1] += steps[k];
        }
    }
}

/// The index in `machine` of each state of `plain`, the same plant without effects, where it has this state or one that is equal to it.
#[must_use]
pub fn places_of_states(plain: &Machine, machine: &Machine) -> Option<Vec<usize>> {
    let all = machine.states();
    let of = |name: &str| {
        let same = all.iter().position(|it| it.0 == name);
        same.or_else(|| all.iter().position(|it| plain.is_same(name, &it.0) || machine.is_same(name, &it.0)))
    };
    plain.states().iter().map(|it| of(&it.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equations::EquationFile;
    use rsm_core::source::Source;

    const CART: &str = "model Cart\n  parameter Real mass = 2.0;\n  input Real force;\n  Real speed(start = 0.5, fixed = true);\n  \
        output Real position(start = 0.0, fixed = true);\nequation\n  mass*der(speed) = force;\n  der(position) = speed;\nend Cart;\n";

    /// A level with a drain that a controller sets at every row.
    const HELD: &str = "model Held\n  parameter Real gain = 3.0;\n  output Real level(start = 1.0, fixed = true);\n  \
        output discrete Real drain(start = 0.0, fixed = true);\nequation\n  der(level) = -drain;\n  when sample(0.0, 0.1) then\n    \
        drain = gain*level;\n  end when;\nend Held;\n";

    fn machine(text: &str) -> (EquationFile, Machine) {
        let file = EquationFile::of_text(&Source::new("plant.mo", text)).unwrap();
        let machine = Machine::new(&file).unwrap();
        (file, machine)
    }

    fn time(rows: usize) -> Vec<f64> {
        (0..rows).map(|k| 0.1 * k as f64).collect()
    }

    #[test]
    fn the_linear_model_of_a_row_is_that_of_a_free_cart() {
        let (file, mut machine) = machine(CART);
        let start = machine.start(&file, 0.0, &[4.0], &[]).unwrap();
        let states: Vec<String> = machine.states().into_iter().map(|it| it.0).collect();
        let [speed, position] = ["speed", "position"].map(|name| states.iter().position(|it| it == name).unwrap());
        let (time, values) = (time(5), [vec![4.0; 5]]);
        let mut seen = Vec::new();
        let mut correct = |at: &PredictedRow<'_>| {
            seen.push((at.states.to_vec(), at.transition.clone(), at.slopes.clone()));
            // The speed is set back by 0.1 at every row.
            let mut change = vec![0.0; 2];
            change[speed] = -0.1;
            change
        };
        let lane = Lane::new(&machine, start);
        let inputs = Inputs { time: &time, values: &values };
        Lanes::new(&machine).linearised_rows(&lane, inputs, Setting::default(), &[0.01, 0.01], &mut correct).unwrap();
        // From 0.4 m/s after the first row, with 2 m/s^2 for 0.1 s.
        assert!((seen[1].0[speed] - 0.6).abs() < 1e-12 && (seen[1].0[position] - 0.05).abs() < 1e-12, "{:?}", seen[1].0);
        for (_, transition, slopes) in &seen[1..] {
            // Differences of numbers near 1, with steps of 0.01.
            let is = |value: f64, expected: f64| (value - expected).abs() < 1e-12;
            assert!(is(transition[(speed, speed)], 1.0) && is(transition[(position, position)], 1.0), "{transition}");
            assert!(is(transition[(position, speed)], 0.1) && is(transition[(speed, position)], 0.0), "{transition}");
            assert!(is(slopes[(0, position)], 1.0) && is(slopes[(0, speed)], 0.0), "{slopes}");
        }
    }

    #[test]
    fn a_controller_at_the_rows_sees_the_corrected_state() {
        let (file, mut machine) = machine(HELD);
        let start = machine.start(&file, 0.0, &[], &[]).unwrap();
        let time = time(4);
        let mut seen = Vec::new();
        let mut correct = |at: &PredictedRow<'_>| {
            seen.push((at.outputs.to_vec(), at.transition[(0, 0)], at.slopes.clone()));
            vec![if at.row == 1 { 0.5 } else { 0.0 }]
        };
        let lane = Lane::new(&machine, start);
        let inputs = Inputs { time: &time, values: &[] };
        Lanes::new(&machine).linearised_rows(&lane, inputs, Setting::default(), &[0.01], &mut correct).unwrap();
        // 1 - 0.1*3 = 0.7 per row; the drain of a row is that at the predicted level, 3 times it. After the correction by 0.5 the level is 1.2.
        let level = [1.0, 0.7, 1.2 * 0.7, 1.2 * 0.7 * 0.7];
        for ((outputs, transition, slopes), level) in seen.iter().zip(level) {
            assert!((outputs[0] - level).abs() < 1e-9 && (outputs[1] - 3.0 * level).abs() < 1e-9, "{outputs:?} {level}");
            assert!((slopes[(0, 0)] - 1.0).abs() < 1e-9 && (slopes[(1, 0)] - 3.0).abs() < 1e-9, "{slopes}");
            assert!((transition - 0.7).abs() < 1e-9 || *transition == 1.0, "{transition}");
        }
    }

    #[test]
    fn lanes_follow_their_readings_with_the_same_bits_alone_and_side_by_side() {
        let (file, mut machine) = machine(CART);
        let start = machine.start(&file, 0.0, &[4.0], &[]).unwrap();
        let lanes: Vec<Lane> = [1.0, 2.0, 4.0]
            .map(|mass| {
                machine.set("mass", mass).unwrap();
                Lane::new(&machine, start.clone())
            })
            .into();
        let (time, values) = (time(40), [(0..40).map(|k| f64::from(k % 7) - 3.0).collect::<Vec<f64>>()]);
        let inputs = Inputs { time: &time, values: &values };
        let place = machine.states().iter().position(|it| it.0 == "position").unwrap();
        let run = |lanes: &[Lane]| -> Vec<Vec<f64>> {
            let mut all = vec![Vec::new(); lanes.len()];
            let mut correct = |at: &AtRow<'_>, states: &mut [f64]| {
                all[at.lane].push(at.outputs[0]);
                // A reading of 0 in every row.
                states[place] += 0.5 * (0.0 - at.outputs[0]);
            };
            let done = Lanes::new(&machine).observed(lanes, inputs, Setting::default(), &mut correct);
            assert!(done.iter().all(Result::is_ok));
            all
        };
        let together = run(&lanes);
        for (lane, found) in lanes.iter().zip(&together) {
            assert_eq!(&run(std::slice::from_ref(lane))[0], found);
        }
        // By hand: the mass of 2.
        let (mut position, mut speed) = (0.0, 0.5);
        for row in 0..40 {
            assert!((together[1][row] - position).abs() < 1e-9, "{row}");
            position *= 0.5;
            let change = 0.1 * values[0][row] / 2.0;
            position += 0.1 * (speed + 0.5 * change);
            speed += change;
        }
    }
}

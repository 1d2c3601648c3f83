//! Many runs of a machine along one record at the same time.
//!
//! In: a machine; lanes, each with its own parameters and start; the inputs at every row. Out: for each lane, the outputs at every row, or the reason
//! why it ended early. The bits of a lane do not depend on the other lanes.

use super::carried::Along;
use super::engine::{Method, Setting};
use super::fixed;
use super::late::DelayedSignals;
use super::machine::{Machine, Point};
use super::rows::{Inputs, Stopped};
use super::walk::{Lane, Walk};
use crate::code::{WIDE, Way, Work, over_lanes};

/// A machine as code: compiled once, for any number of runs.
pub struct Lanes<'m> {
    pub(super) machine: &'m Machine,
    pub(super) way: Way,
    pub(super) alone: Option<Walk<'m, 1>>,
    pub(super) group: Option<Walk<'m, WIDE>>,
    pub(super) sensitive: Option<Along<'m>>,
    /// The work of each lane in the last run.
    work: Vec<u64>,
}

/// For each output, in the order of the text: its value at every row.
pub type Outputs = Vec<Vec<f64>>;

/// From the row number and the outputs at this row to the first input from this row on.
pub type Controller<'a> = dyn FnMut(usize, &[f64]) -> f64 + 'a;

impl<'m> Lanes<'m> {
    /// The code of a machine.
    #[must_use]
    pub fn new(machine: &'m Machine) -> Self {
        Lanes { machine, way: Way::Fastest, alone: None, group: None, sensitive: None, work: Vec::new() }
    }

    /// The same with the interpreter of tapes, which gives the same bits. Machine code is compared with it.
    #[must_use]
    pub fn interpreted(machine: &'m Machine) -> Self {
        Lanes { way: Way::Interpreted, ..Lanes::new(machine) }
    }

    /// Runs lanes along inputs.
    ///
    /// # Panics
    /// If an input has fewer rows than the time.
    pub fn run(&mut self, lanes: &[Lane], inputs: Inputs<'_>, setting: Setting) -> Vec<Result<Outputs, Stopped>> {
        if let Method::Fixed { step } = setting.method {
            let one = |lane: &Lane| {
                if lane.numbers.parameters != self.machine.values_of_parameters() {
                    return Err(Stopped::Step(
                        "fixed steps have the parameters of the machine: make a machine of each lane".to_string(),
                    ));
                }
                fixed::run(self.machine, &lane.start, inputs, step)
            };
            return lanes.iter().map(one).collect();
        }
        let mut all = Vec::with_capacity(lanes.len());
        self.work.clear();
        let width = self.width(lanes);
        // Lanes in one group share the instants of samples.
        for group in lanes.chunk_by(|a, b| a.has_samples_of(b)).flat_map(|it| it.chunks(width)) {
            let together = (group.len() > 1).then(|| self.together(group, inputs, setting)).flatten();
            match together {
                Some(outputs) => {
                    let work = self.group.iter().flat_map(|it| &it.work).take(group.len());
                    self.work.extend(work);
                    all.extend(outputs.into_iter().map(Ok));
                }
                None => {
                    for lane in group {
                        all.push(self.alone(lane, inputs, setting, None));
                        self.work.extend(self.alone.iter().map(|it| it.work[0]));
                    }
                }
            }
        }
        all
    }

    /// The number of lanes that run side by side. A nonlinear block is iterated for each lane separately, and a delayed signal arrives in each lane
    /// separately.
    pub(super) fn width(&self, lanes: &[Lane]) -> usize {
        if self.machine.has_blocks() || lanes.iter().any(|lane| lane.numbers.has_delayed_signals()) { 1 } else { WIDE }
    }

    /// The work of each lane in the last run, in the unit of [`Setting::work`], also for a run that was stopped early. It is the same alone and in a
    /// group.
    #[must_use]
    pub fn work(&self) -> &[u64] {
        &self.work
    }

    /// Runs a lane with a controller in the loop. At every row the controller gets the row number and the outputs, computed with the inputs before
    /// this row. It returns the first input, which is constant until the next row. The returned value does not change the outputs that it got. The
    /// first input of `inputs` is used only before the first row.
    ///
    /// ```
    /// use rsm_core::source::{Faults, Source};
    /// use rsm_sim::equations::{EquationFile, Inputs, Lane, Lanes, Machine, Setting};
    ///
    /// let text = "model Tank\n  input Real rate;\n  output Real level(start = 1.0);\nequation\n  der(level) = rate;\nend Tank;\n";
    /// let file = EquationFile::of_text(&Source::new("tank.mo", text))?;
    /// let mut machine = Machine::new(&file)?;
    /// let start = machine.start(&file, 0.0, &[0.0], &[])?;
    /// let inputs = Inputs { time: &[0.0, 1.0, 2.0], values: &[vec![0.0; 3]] };
    /// let mut half = |_: usize, outputs: &[f64]| -0.5 * outputs[0];
    /// let found = Lanes::new(&machine).controlled(&Lane::new(&machine, start), inputs, Setting::default(), &mut half);
    /// assert_eq!(found.unwrap()[0], [1.0, 0.5, 0.25]);
    /// # Ok::<(), Faults>(())
    /// ```
    ///
    /// # Errors
    /// The reason why a row could not be reached.
    pub fn controlled(
        &mut self,
        lane: &Lane,
        inputs: Inputs<'_>,
        setting: Setting,
        controller: &mut Controller<'_>,
    ) -> Result<Outputs, Stopped> {
        let found = self.alone(lane, inputs, setting, Some(controller));
        self.work.clear();
        self.work.extend(self.alone.iter().map(|it| it.work[0]));
        found
    }

    fn alone(
        &mut self,
        lane: &Lane,
        inputs: Inputs<'_>,
        setting: Setting,
        mut controller: Option<&mut Controller<'_>>,
    ) -> Result<Outputs, Stopped> {
        let has_late = lane.numbers.has_delayed_signals();
        let walk = self.alone.get_or_insert_with(|| Walk::new(self.machine, self.way));
        walk.begin(std::slice::from_ref(lane), setting, period(inputs));
        let mut outputs = [allocate_outputs(self.machine, inputs)];
        let mut late = DelayedSignals::new(&lane.numbers, inputs.time, period(inputs));
        let mut said = 0.0;
        let is_quiet = walk.is_quiet();
        let mut block = Block::new(self.machine.outputs().len());
        for (row, end) in inputs.time.iter().enumerate() {
            walk.row = row;
            if row > 0 {
                walk.reach_row(inputs.time[row - 1], *end, &mut late)?;
            }
            walk.set_inputs(inputs.values, row);
            if let Some(controller) = &mut controller {
                if row > 0 {
                    walk.set_input(0, said);
                }
                let told: Vec<f64> = walk.evaluate_outputs().iter().map(|it| it[0]).collect();
                said = controller(row, &told);
                walk.set_input(0, said);
            }
            if has_late {
                walk.exchange(&mut late);
            }
            if has_late {
                walk.execute_events_and_send(*end, &mut late)?;
            } else if !is_quiet {
                walk.execute_events(*end)?;
            }
            block.read(walk, &mut outputs)?;
            if has_late {
                late.read(*end, walk.evaluate_outputs());
            }
        }
        block.write(&mut outputs);
        let [mut outputs] = outputs;
        late.finish(&mut outputs);
        Ok(outputs)
    }

    /// Runs lanes side by side. `None` if one of them ends early: then each is run alone to find the reason.
    fn together(&mut self, lanes: &[Lane], inputs: Inputs<'_>, setting: Setting) -> Option<Vec<Outputs>> {
        let machine = self.machine;
        let mut walk = self.group.take().unwrap_or_else(|| Walk::new(machine, self.way));
        walk.begin(lanes, setting, period(inputs));
        let mut outputs: [Outputs; WIDE] = std::array::from_fn(|_| allocate_outputs(machine, inputs));
        let done = self.along(&mut walk, lanes, inputs, setting, &mut outputs);
        self.group = Some(walk);
        done.ok()?;
        Some(outputs.into_iter().take(lanes.len()).collect())
    }

    fn along(
        &mut self,
        walk: &mut Walk<'m, WIDE>,
        lanes: &[Lane],
        inputs: Inputs<'_>,
        setting: Setting,
        outputs: &mut [Outputs; WIDE],
    ) -> Result<(), Stopped> {
        let mut block = Block::new(self.machine.outputs().len());
        let is_quiet = walk.is_quiet();
        for (row, end) in inputs.time.iter().enumerate() {
            self.reach_row(walk, lanes, row, inputs, setting)?;
            walk.set_inputs(inputs.values, row);
            if !is_quiet {
                walk.execute_events(*end)?;
            }
            block.read(walk, outputs)?;
        }
        block.write(outputs);
        Ok(())
    }

    /// Advances a group of lanes from one row to the next.
    #[inline]
    pub(super) fn reach_row(
        &mut self,
        walk: &mut Walk<'m, WIDE>,
        lanes: &[Lane],
        row: usize,
        inputs: Inputs<'_>,
        setting: Setting,
    ) -> Result<(), Stopped> {
        let (now, end) = (inputs.time[row.max(1) - 1], inputs.time[row]);
        walk.row = row;
        let is_free = walk.is_free(now, end);
        if row > 0 && !(walk.can_be_plain() && is_free && walk.plain(now, end)) {
            self.reach_with_events(walk, lanes, (now, end, is_free), inputs, setting)?;
        }
        walk.within_limit()
    }

    /// Advances each lane by its own steps. Apart from the usual way, which then needs little of the stack.
    #[inline(never)]
    fn reach_with_events(
        &mut self,
        walk: &mut Walk<'m, WIDE>,
        lanes: &[Lane],
        (now, end, is_free): (f64, f64, bool),
        inputs: Inputs<'_>,
        setting: Setting,
    ) -> Result<(), Stopped> {
        let count = lanes.len();
        let right = if is_free { walk.together(now, end)? } else { [false; WIDE] };
        for lane in (0..count).filter(|lane| !right[*lane]) {
            let alone = self.alone.get_or_insert_with(|| Walk::new(self.machine, self.way));
            alone.apply_setting(setting);
            alone.copy_from(walk, lane);
            alone.reach(end, &mut DelayedSignals::new(&lanes[lane].numbers, inputs.time, 0.0))?;
            alone.copy_to(walk, lane);
        }
        if let (false, Some(alone)) = (is_free, &self.alone) {
            // Every lane has passed the same instants of samples.
            walk.events.past.clone_from(&alone.events.past);
        }
        for lane in count..WIDE {
            walk.follow(lane, count - 1);
        }
        Ok(())
    }
}

/// Runs a machine from its start along inputs. Returns for each output its value at every row.
///
/// # Errors
/// The reason why a row could not be reached.
///
/// # Panics
/// If an input has fewer rows than the time.
pub fn run(machine: &Machine, start: Point, inputs: Inputs<'_>, setting: Setting) -> Result<Vec<Vec<f64>>, Stopped> {
    let lane = Lane::new(machine, start);
    Lanes::new(machine).run(&[lane], inputs, setting).remove(0)
}

/// The points of a machine along inputs, at every `every`-th row, from its start to the row where the run ends.
///
/// # Panics
/// If an input has fewer rows than the time.
#[must_use]
pub fn points(machine: &Machine, start: Point, inputs: Inputs<'_>, setting: Setting, every: usize) -> Vec<Point> {
    let mut walk: Walk<'_, 1> = Walk::new(machine, Way::Fastest);
    let lane = Lane::new(machine, start);
    walk.begin(std::slice::from_ref(&lane), setting, period(inputs));
    let mut late = DelayedSignals::new(&lane.numbers, inputs.time, period(inputs));
    let mut points = Vec::new();
    for (row, end) in inputs.time.iter().enumerate() {
        walk.row = row;
        if row > 0 && walk.reach_row(inputs.time[row - 1], *end, &mut late).is_err() {
            break;
        }
        walk.set_inputs(inputs.values, row);
        walk.exchange(&mut late);
        if walk.execute_events_and_send(*end, &mut late).is_err() {
            break;
        }
        walk.evaluate_outputs();
        late.read(*end, walk.evaluate_outputs());
        if row % every == 0 {
            points.push(walk.point(0));
        }
    }
    points
}

/// Allocates the outputs of a lane.
pub(super) fn allocate_outputs(machine: &Machine, inputs: Inputs<'_>) -> Outputs {
    vec![Vec::with_capacity(inputs.time.len()); machine.outputs().len()]
}

/// The time between the first two rows.
pub(super) fn period(inputs: Inputs<'_>) -> f64 {
    inputs.time.windows(2).next().map_or(1.0, |pair| pair[1] - pair[0])
}

/// The rows of a [`Block`]: with eight lanes and four outputs it has 16 kB, half of a first-level cache.
const BLOCK: usize = 64;

/// Outputs of the last rows, with the lanes side by side as they are computed. A block is written to the outputs of each lane when it is full: a row
/// alone would go to as many places as there are lanes and outputs.
pub(super) struct Block<const L: usize> {
    /// For each output, its rows.
    outputs: Vec<[[f64; L]; BLOCK]>,
    rows: usize,
}

impl<const L: usize> Block<L> {
    pub(super) fn new(outputs: usize) -> Self {
        Block { outputs: vec![[[0.0; L]; BLOCK]; outputs], rows: 0 }
    }

    /// Adds the outputs at a row. They must be finite.
    #[inline]
    pub(super) fn read(&mut self, walk: &mut Walk<'_, L>, outputs: &mut [Outputs; L]) -> Result<(), Stopped> {
        let found = walk.evaluate_outputs();
        if !over_lanes::<L, _>(Row { outputs: &mut self.outputs, found, row: self.rows }) {
            let place = found.iter().position(|it| it.iter().any(|it| !it.is_finite())).unwrap_or(0);
            return Err(Stopped::NotFinite { row: walk.row, name: walk.machine.outputs()[place].0.clone() });
        }
        self.rows += 1;
        if self.rows == BLOCK {
            self.write(outputs);
        }
        Ok(())
    }

    /// Writes the rows to the outputs of each lane.
    pub(super) fn write(&mut self, outputs: &mut [Outputs; L]) {
        let mut turned = [[0.0; BLOCK]; L];
        for (place, block) in self.outputs.iter().enumerate() {
            over_lanes::<L, _>(Turn { block, turned: &mut turned });
            for (turned, output) in turned.iter().zip(outputs.iter_mut()) {
                output[place].extend_from_slice(&turned[..self.rows]);
            }
        }
        self.rows = 0;
    }
}

/// A row that is added to a block.
struct Row<'a, const L: usize> {
    outputs: &'a mut [[[f64; L]; BLOCK]],
    found: &'a [[f64; L]],
    row: usize,
}

impl<const L: usize> Work for Row<'_, L> {
    type Found = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let row = self.row % BLOCK;
        let mut zero = [0.0; L];
        for (block, values) in self.outputs.iter_mut().zip(self.found) {
            block[row] = *values;
            // The product of a number that is not finite with zero is NaN.
            for lane in 0..L {
                zero[lane] += values[lane] * 0.0;
            }
        }
        zero == [0.0; L]
    }
}

/// The rows of an output become a list for each lane, four rows at a time.
struct Turn<'a, const L: usize> {
    block: &'a [[f64; L]; BLOCK],
    turned: &'a mut [[f64; BLOCK]; L],
}

impl<const L: usize> Work for Turn<'_, L> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        for (place, rows) in self.block.as_chunks::<4>().0.iter().enumerate() {
            for (lane, turned) in self.turned.iter_mut().enumerate() {
                turned.as_chunks_mut::<4>().0[place] = rows.map(|row| row[lane]);
            }
        }
    }
}

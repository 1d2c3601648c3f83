//! Lanes in progress along a record. A lane is one run with its own parameters; a group of lanes is computed together in vector registers.
//!
//! In: the programs of a machine, and for each lane its parameters and its start. Out: the states of every lane, row by row. Lanes share only the
//! instants of the rows: each has its own steps, switches and events, and its bits are the same as in a run alone. All lanes try a row together, in
//! one evaluation of the series. A lane that needs more than one step, or in which a comparison changes, is continued alone.

use super::branches::Events;
use super::engine::{Method, Setting};
use super::kept::{Anchor, Kept, Loaded, Segment};
use super::layout::Layout;
use super::machine::{Machine, Point};
use super::methods::Linear;
use super::numbers::Numbers;
use super::programs::Programs;
use super::rows::Stopped;
use super::speeds::Carried;
use super::thresholds::Thresholds;
use crate::code::{Way, lengthen};

/// The largest number of iterations of a nonlinear block.
const MOST_ITERATIONS: usize = 100;

/// A group of lanes.
pub(super) struct Walk<'m, const L: usize> {
    pub machine: &'m Machine,
    pub programs: Programs,
    pub slots: Vec<[f64; L]>,
    pub spare: Vec<[f64; L]>,
    pub setting: Setting,
    pub thresholds: Thresholds,
    /// The inputs of a row, without those that follow other signals.
    inputs: Vec<f64>,
    /// The states at the start and at the end of the step.
    pub before: Vec<[f64; L]>,
    /// Memory for the change of the states up to a share of a step, and for distances of comparisons from their borders.
    pub moved: Vec<[f64; L]>,
    pub distances: Vec<[f64; L]>,
    pub step_end: Vec<[f64; L]>,
    pub events: Events<L>,
    /// The step length that the last step suggests.
    pub suggestion: [f64; L],
    pub is_stiff: [bool; L],
    pub linear: Option<Linear>,
    /// For each lane: its linear parts, the part whose matrices are in its slots, and a point inside of its last step.
    pub kept: Vec<Kept>,
    pub loaded: [Option<Loaded>; L],
    /// The length of the steps of the matrices that are loaded, if it is the same in all lanes and a whole row; else NaN.
    pub loaded_length: f64,
    /// For each comparison: its held value in the linear part whose matrices are in the slots.
    pub patterns: Vec<[f64; L]>,
    pub anchors: Vec<Anchor>,
    pub segment: Option<Segment>,
    /// Whether an event is being located.
    pub is_locating: bool,
    pub row: usize,
    /// The work of the run so far ([`super::choice`]). A lane has the same work alone and in a group.
    pub work: [u64; L],
    /// The number of lanes in use. The others repeat the last one.
    pub used: usize,
    /// Sensitivities, in a walk of one lane that computes them.
    pub carried: Option<Box<Carried>>,
}

/// The parameters of one lane, with the values that depend on them, and its start.
#[derive(Debug, Clone)]
pub struct Lane {
    pub(super) numbers: Numbers,
    pub(super) start: Point,
}

impl Lane {
    /// A lane with the parameters of a machine.
    #[must_use]
    pub fn new(machine: &Machine, start: Point) -> Lane {
        Lane { numbers: machine.numbers().clone(), start }
    }

    /// The start.
    pub(crate) fn start(&self) -> &Point {
        &self.start
    }

    /// The parameters, with the values that depend on them.
    pub(super) fn numbers(&self) -> &Numbers {
        &self.numbers
    }

    /// Whether another lane has the same instants of samples.
    pub(super) fn has_samples_of(&self, other: &Lane) -> bool {
        self.numbers.samples == other.numbers.samples
    }
}

/// The larger of two numbers; the second if one is NaN. Unlike `f64::max` this is one instruction.
#[inline(always)]
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// What the error of a state in a step is compared with: its magnitude at the start, the largest one so far, or its change.
#[inline(always)]
pub(super) fn scale(begin: f64, largest: f64, moved: f64) -> f64 {
    larger(larger(begin.abs(), largest), moved)
}

impl<'m, const L: usize> Walk<'m, L> {
    pub(super) fn new(machine: &'m Machine, way: Way) -> Self {
        let programs = Programs::new(machine, L, way);
        let states = programs.counts.states;
        let mut slots = Vec::new();
        lengthen(&mut slots, programs.slots());
        Walk {
            slots,
            spare: Vec::new(),
            setting: Setting::default(),
            thresholds: Thresholds::new(Setting::default().tolerance, programs.counts.guesses > 0),
            inputs: vec![0.0; machine.inputs().len()],
            before: vec![[0.0; L]; states],
            moved: Vec::new(),
            distances: Vec::new(),
            step_end: vec![[0.0; L]; states],
            events: Events::new(machine, programs.has_sampled_conditions()),
            suggestion: [0.0; L],
            is_stiff: [false; L],
            linear: None,
            kept: vec![Kept::default(); L],
            loaded: [None; L],
            loaded_length: f64::NAN,
            patterns: vec![[0.0; L]; programs.counts.held],
            anchors: vec![Anchor::START; L],
            segment: None,
            is_locating: false,
            row: 0,
            work: [0; L],
            used: L,
            carried: None,
            machine,
            programs,
        }
    }

    pub(super) fn layout(&self) -> Layout {
        self.programs.layout
    }

    /// Before a run: sets the lanes to their starts. If there are fewer lanes than places, unused places repeat the last lane.
    pub(super) fn begin(&mut self, lanes: &[Lane], setting: Setting, period: f64) {
        self.apply_setting(setting);
        self.used = lanes.len();
        let lanes: [&Lane; L] = std::array::from_fn(|place| &lanes[place.min(lanes.len() - 1)]);
        let layout = self.layout();
        for (lane, from) in lanes.iter().enumerate() {
            let start = &from.start;
            let mut put = |begin: u32, values: &[f64]| {
                for (slot, value) in self.slots[begin as usize..].iter_mut().zip(values) {
                    slot[lane] = *value;
                }
            };
            put(layout.time, &[start.time]);
            put(layout.states, &start.states);
            put(layout.inputs, &start.inputs);
            put(layout.held, &start.held);
            put(layout.memories, &start.memories);
            put(layout.guesses, &start.guesses);
            put(layout.parameters, &from.numbers.parameters);
            let largest = &mut self.slots[layout.largest as usize..][..self.programs.counts.states];
            for (state, largest) in largest.iter_mut().enumerate() {
                largest[lane] = self.machine.nominal(state).unwrap_or(0.0);
            }
        }
        self.events.samples.clone_from(&lanes[0].numbers.samples);
        self.kept.iter_mut().for_each(Kept::clear);
        (self.loaded, self.loaded_length, self.segment) = ([None; L], f64::NAN, None);
        (self.suggestion, self.work) = ([period; L], [0; L]);
        self.is_stiff = [setting.method == Method::Stiff; L];
        for (code, _) in &self.programs.once {
            code.run(&mut self.slots, &mut self.spare);
        }
        self.refresh();
        self.first_conditions();
    }

    /// Recomputes the values that depend on inputs, held comparisons and memories, after these have changed.
    pub(super) fn refresh(&mut self) {
        for (code, _) in &self.programs.row {
            code.run(&mut self.slots, &mut self.spare);
        }
        self.carry_refresh();
    }

    pub(super) fn time(&self, lane: usize) -> f64 {
        self.slots[self.programs.layout.time as usize][lane]
    }

    /// The largest magnitude of a state so far, in each lane.
    #[inline]
    pub(super) fn largest(&self, state: usize) -> &[f64; L] {
        &self.slots[self.programs.layout.largest as usize + state]
    }

    /// The current point of a lane.
    pub(super) fn point(&self, lane: usize) -> Point {
        let (layout, counts) = (self.layout(), self.programs.counts);
        let list = |begin: u32, count: usize| self.slots[begin as usize..][..count].iter().map(|it| it[lane]).collect();
        Point {
            time: self.time(lane),
            states: list(layout.states, counts.states),
            inputs: list(layout.inputs, counts.inputs),
            held: list(layout.held, counts.held),
            memories: list(layout.memories, counts.memories),
            guesses: list(layout.guesses, counts.guesses),
        }
    }

    #[inline]
    pub(super) fn set_inputs(&mut self, values: &[Vec<f64>], row: usize) {
        debug_assert!(values.len() == self.inputs.len(), "one list an input that follows no other signal");
        self.inputs.iter_mut().zip(values).for_each(|(to, from)| *to = from[row]);
        self.programs.inputs.run_with(&self.inputs, &mut self.slots, &mut self.spare);
        self.carry_refresh();
    }

    /// Sets an input to a new value in all lanes.
    pub(super) fn set_input(&mut self, input: usize, value: f64) {
        let begin = self.layout().inputs as usize;
        self.slots[begin + input] = [value; L];
        self.refresh();
    }

    /// Computes the outputs at the current point, and returns their slots.
    #[inline]
    pub(super) fn evaluate_outputs(&mut self) -> &[[f64; L]] {
        let Some(output_program) = &self.programs.output_program else { return &[] };
        output_program.code.run(&mut self.slots, &mut self.spare);
        &self.slots[output_program.results as usize..output_program.results as usize + self.programs.counts.outputs]
    }

    /// Uses the solutions of nonlinear blocks as the next guesses until they converge. Returns `false` if one does not converge.
    #[inline]
    pub(super) fn settle(&mut self) -> bool {
        self.programs.counts.guesses == 0 || self.iterate_blocks()
    }

    fn iterate_blocks(&mut self) -> bool {
        let count = self.programs.counts.guesses;
        let guesses = self.layout().guesses as usize;
        let Some(solutions) =
            self.programs.output_program.as_ref().map(|it| it.results as usize + self.programs.counts.outputs)
        else {
            return true;
        };
        for _ in 0..MOST_ITERATIONS {
            self.evaluate_outputs();
            let mut moves = false;
            for k in 0..count {
                let (old, new) = (self.slots[guesses + k], self.slots[solutions + k]);
                moves |= (0..L).any(|lane| !super::machine::value_has_converged(old[lane], new[lane]));
                self.slots[guesses + k] = new;
            }
            if !moves {
                return true;
            }
        }
        false
    }

    /// The Jacobian of the first lane at its current point.
    pub(super) fn linear(&mut self) -> Linear {
        let states = self.programs.counts.states;
        let Some((code, range)) = self.programs.slopes() else { return Linear::new(0, &[]) };
        code.run(&mut self.slots, &mut self.spare);
        let slopes: Vec<f64> = self.slots[range].iter().map(|it| it[0]).collect();
        Linear::new(states, &slopes)
    }

    /// Takes another setting, before it continues a lane of a group.
    pub(super) fn apply_setting(&mut self, setting: Setting) {
        if setting.tolerance != self.setting.tolerance {
            self.thresholds = Thresholds::new(setting.tolerance, self.programs.counts.guesses > 0);
        }
        self.setting = setting;
    }

    /// An unused place of a group repeats another lane.
    pub(super) fn follow(&mut self, place: usize, lane: usize) {
        let common = self.programs.common;
        self.slots[..common].iter_mut().for_each(|it| it[place] = it[lane]);
        self.events.follow(place, lane);
        self.suggestion[place] = self.suggestion[lane];
        self.work[place] = self.work[lane];
        self.is_stiff[place] = self.is_stiff[lane];
        self.follow_linear(place, lane);
    }

    /// The same for the matrices in the slots.
    pub(super) fn follow_linear(&mut self, place: usize, lane: usize) {
        if self.loaded[place] != self.loaded[lane] {
            let loaded = self.programs.block.loaded();
            self.slots[loaded].iter_mut().chain(&mut self.patterns).for_each(|it| it[place] = it[lane]);
            (self.loaded[place], self.loaded_length) = (self.loaded[lane], f64::NAN);
        }
    }

    /// Takes over a lane of a wider group.
    pub(super) fn copy_from<const M: usize>(&mut self, other: &mut Walk<'m, M>, lane: usize) {
        for (to, from) in self.slots.iter_mut().zip(&other.slots[..other.programs.common]) {
            *to = [from[lane]; L];
        }
        self.events.copy_from(&other.events, lane);
        self.suggestion = [other.suggestion[lane]; L];
        self.work = [other.work[lane]; L];
        self.is_stiff = [other.is_stiff[lane]; L];
        (self.linear, self.segment) = (None, None);
        std::mem::swap(&mut self.kept[0], &mut other.kept[lane]);
        (self.loaded, self.loaded_length) = ([None; L], f64::NAN);
        self.row = other.row;
    }

    /// Returns the first lane to a wider group.
    pub(super) fn copy_to<const M: usize>(&mut self, other: &mut Walk<'m, M>, lane: usize) {
        let common = other.programs.common;
        for (from, to) in self.slots.iter().zip(&mut other.slots[..common]) {
            to[lane] = from[0];
        }
        self.events.copy_to(&mut other.events, lane);
        other.suggestion[lane] = self.suggestion[0];
        other.work[lane] = self.work[0];
        other.is_stiff[lane] = self.is_stiff[0];
        std::mem::swap(&mut self.kept[0], &mut other.kept[lane]);
        other.keep_loaded(lane);
    }

    /// Whether a state of a lane is no longer finite: the row and the name of the state.
    pub(super) fn not_finite(&self, lane: usize) -> Option<Stopped> {
        let begin = self.layout().states as usize;
        let place = (0..self.programs.counts.states).find(|k| !self.slots[begin + k][lane].is_finite())?;
        Some(Stopped::NotFinite { row: self.row, name: self.machine.states()[place].0.clone() })
    }
}

//! Programs of derivatives ("speeds"): how the results of the programs of a walk change with their arguments.
//!
//! In: tapes with the slots of their arguments and results, and the slots that have derivatives. Out: [`Carried`]: an array with values and
//! derivatives, four directions in a register, and the code for it. Values that do not depend on the direction are computed once for all. This file
//! handles no steps and no events.

use std::collections::HashSet;
use std::ops::Range;

use rsm_core::held::{Divided, divided};
use rsm_core::tangent;
use rsm_core::tape::{Op, Tape};

use super::derivatives::{DerivativeProgram, Mirror, Pieces, Store};
use super::entries::{Entries, Entry, Rest};
use super::frechet::Along;
use super::frechet_values::Shared;
use super::phi::Chain;
use super::placed::Placed;
use super::programs::Programs;
use super::series_speeds::{Checked, Derivatives, SeriesSpeeds, TOLERANCE};
use super::shortened::{composed, without};
use super::thresholds::Thresholds;
use crate::code::{Code, Piece, Slot, WIDE, Way};

/// The rows of derivatives of outputs that are collected before they are written: one at a time, they would go to as many places as there are
/// directions and outputs.
const BLOCK: usize = 64;

/// The derivatives of a run's start and parameters in one direction.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Direction {
    /// The parameter of the direction, by its index.
    pub parameter: Option<usize>,
    pub states: Vec<f64>,
    pub memories: Vec<f64>,
}

/// No slots.
const NONE: Range<usize> = 0..0;

/// The programs of derivatives. `None`: the program has no argument with a derivative.
#[derive(Debug)]
pub(super) struct Carried {
    pub way: Way,
    /// The number of groups of directions, without the group of the time.
    pub groups: usize,
    pub mirror: Mirror,
    pub store: Store,
    /// Slots of the walk that have derivatives.
    pub moving: HashSet<Slot>,
    /// For each group, and for the time: those of these slots whose derivatives are always 0.
    still: Vec<HashSet<Slot>>,
    pub once: Vec<Option<DerivativeProgram>>,
    pub row: Vec<Option<DerivativeProgram>>,
    /// For each part of the series: steps with all orders up to its last one. Compiled at the first such step.
    pub series: Vec<Option<SeriesSpeeds>>,
    /// The limits of their last terms.
    pub thresholds: Thresholds,
    pub checked: Checked,
    /// Slots of the walk that are constant during a run.
    fixed: HashSet<Slot>,
    pub output_program: Option<DerivativeProgram>,
    pub sides: Option<DerivativeProgram>,
    pub events: Option<DerivativeProgram>,
    /// For each group: the derivative of the instant of the current event.
    pub instant: Option<Vec<[f64; WIDE]>>,
    /// For each memory that has a derivative in a group: its place, and that of its next value.
    pub memories: Vec<(usize, Option<usize>)>,
    /// Copies the derivatives of the states at the end of a step by a linear part.
    end: Option<Code>,
    /// The places of the derivatives of the outputs, side by side: for each group, for each output; and the collected rows of them.
    outputs: Range<usize>,
    pub block: Vec<[f64; WIDE]>,
    /// The steps by a linear part. Compiled at the first one.
    pub linear: Option<Box<LinearSpeeds>>,
}

/// The derivatives of steps by a linear part.
#[derive(Debug)]
pub(super) struct LinearSpeeds {
    /// Of the Jacobian, and of the rates with respect to time; the first of these slots, and which of them have a derivative.
    pub slopes: Option<DerivativeProgram>,
    pub first: Slot,
    pub changing: Vec<usize>,
    /// The entries of the Jacobian among them, by row and column, column by column.
    pub entries_of_jacobian: Vec<(usize, usize)>,
    /// Of the step.
    pub step: Option<DerivativeProgram>,
    /// Copies the values of the step that only a new linear part changes.
    pub matrices: Code,
    /// The derivatives that only a new linear part changes; for each group, their places in the mirror.
    pub entries: Entries,
    pub places: Vec<Vec<usize>>,
    /// The columns in which phi_2 and phi_3 are needed; among them those of the rates that depend on time, each with its index in this list.
    pub columns: Vec<usize>,
    pub timed: Vec<(usize, usize)>,
    pub parts: Vec<PartSpeeds>,
    /// The linear part and the level whose derivatives are in the mirror.
    pub loaded: Option<(u64, usize)>,
    pub shared: Shared,
    pub along: Along<WIDE>,
    /// For two groups at once, on a machine whose registers have eight numbers.
    pub both: Along<{ 2 * WIDE }>,
    /// The functions over the time from the start of a step to an event.
    pub chain: Chain,
}

/// The derivatives of a linear part.
#[derive(Debug, Default)]
pub(super) struct PartSpeeds {
    /// The version of the part.
    pub version: u64,
    /// For each group: those of the Jacobian, row by row, then those of the derivatives with respect to time.
    pub slopes: Vec<[f64; WIDE]>,
    /// The level of the entries, if they are computed.
    pub level: Option<usize>,
    /// For each group, the derivative of each entry.
    pub entries: Vec<[f64; WIDE]>,
}

impl Carried {
    /// The programs of derivatives of a walk's programs in some directions. Those of the series are compiled at their first use.
    pub(super) fn new(programs: &Programs, directions: &[Direction], way: Way) -> Box<Carried> {
        let (layout, counts) = (programs.layout, programs.counts);

        let group = |begin: Slot, count: usize| begin..begin + count as Slot;
        let mut moving: HashSet<Slot> =
            directions.iter().filter_map(|it| it.parameter).map(|place| layout.parameters + place as Slot).collect();
        moving.extend(group(layout.states, counts.states).chain(group(layout.memories, counts.memories)));
        let fixed: HashSet<Slot> = group(layout.parameters, counts.parameters)
            .chain(programs.once.iter().flat_map(|it| it.1.results.iter().copied()))
            .collect();
        let groups = directions.len().div_ceil(WIDE);
        let parameters: Vec<Slot> = moving.iter().copied().filter(|slot| *slot >= layout.parameters).collect();
        let of_group = |group: usize| -> HashSet<Slot> {
            let of = |it: &Direction| it.parameter.map(|place| layout.parameters + place as Slot);
            let own: HashSet<Slot> = directions.iter().skip(group * WIDE).take(WIDE).filter_map(of).collect();
            parameters.iter().copied().filter(|slot| !own.contains(slot)).collect()
        };
        let mut it = Box::new(Carried {
            way,
            // After the directions comes the time, with which no parameter changes.
            still: (0..=groups).map(of_group).collect(),
            groups,
            mirror: Mirror::default(),
            store: Store::default(),
            moving,
            once: Vec::new(),
            row: Vec::new(),
            series: Vec::new(),
            checked: Checked::default(),
            thresholds: Thresholds::new(TOLERANCE, counts.guesses > 0),
            fixed,
            output_program: None,
            sides: None,
            events: None,
            instant: None,
            memories: Vec::new(),
            end: None,
            outputs: 0..0,
            block: Vec::new(),
            linear: None,
        });
        // Places for the derivatives of states, memories and the time, whether a program reads them or not.
        for group_of in 1..=it.groups + 1 {
            let all = group(layout.states, counts.states).chain(group(layout.memories, counts.memories));
            for slot in all.chain([layout.time]) {
                it.mirror.place(group_of, slot);
            }
        }
        for (_, placed) in &programs.once {
            let found = it.speeds(placed, false, &NONE);
            it.once.push(found);
        }
        for (_, placed) in &programs.row {
            let found = it.speeds(placed, false, &NONE);
            it.row.push(found);
        }
        let first = it.mirror.next as usize;
        let begin = programs.output_program.as_ref().map_or(0, |program| program.results);
        for group_of in 1..=it.groups {
            for k in 0..counts.outputs as Slot {
                it.mirror.place(group_of, begin + k);
            }
        }
        it.outputs = first..it.mirror.next as usize;
        it.output_program = programs.output_program.as_ref().and_then(|program| it.speeds(&program.placed, false, &NONE));
        // The instant of an event changes with the parameters, so the events also need derivatives with respect to time.
        it.moving.insert(layout.time);
        it.sides = programs.sides.as_ref().and_then(|program| it.speeds(&program.placed, true, &NONE));
        it.events = programs.events.as_ref().and_then(|program| it.speeds(&program.placed, false, &NONE));
        it.moving.remove(&layout.time);
        for group in 0..it.groups {
            let first = programs.events.as_ref().map_or(0, |program| program.results);
            for k in 0..counts.memories as Slot {
                if let Some(to) = it.speed(group, layout.memories + k) {
                    it.memories.push((to, it.speed(group, first + k)));
                }
            }
        }
        it.block = Vec::with_capacity(BLOCK * it.outputs.len());
        it
    }

    /// Compiles the derivatives of a program, and marks which of its results have derivatives.
    /// `loaded`: the slots of the walk that only a new linear part changes.
    pub(super) fn speeds(&mut self, placed: &Placed, by_time: bool, loaded: &Range<usize>) -> Option<DerivativeProgram> {
        self.pieces(placed, by_time, loaded).map(|pieces| pieces.compiled(self.way))
    }

    /// The pieces of [`Carried::speeds`].
    pub(super) fn pieces(&mut self, placed: &Placed, by_time: bool, loaded: &Range<usize>) -> Option<Pieces> {
        let ports: Vec<usize> =
            (0..placed.arguments.len()).filter(|port| self.moving.contains(&placed.arguments[*port])).collect();
        if ports.is_empty() {
            return None;
        }
        let mut tape = tangent::along(&placed.tape, &ports);
        let moves = |tape: &Tape, k: usize| !matches!(tape.op(tape.outputs[k].reg), Op::Constant(it) if it.value == 0.0);
        let results: Vec<Slot> =
            placed.results.iter().enumerate().filter(|(k, _)| moves(&tape, *k)).map(|(_, slot)| *slot).collect();
        if results.is_empty() {
            return None;
        }
        let kept: Vec<bool> = (0..tape.outputs.len()).map(|k| moves(&tape, k)).collect();
        let mut keep = kept.iter();
        tape.outputs.retain(|_| *keep.next().unwrap_or(&false));
        self.moving.extend(&results);
        let count = placed.arguments.len();
        let is_held: Vec<bool> = (0..tape.inputs.len()).map(|port| port < count).collect();
        let Divided { held, rest } = divided(&tape, &is_held);
        let values: Vec<Slot> = placed.arguments.iter().map(|slot| self.mirror.place(0, *slot)).collect();
        let reads = |port: usize| {
            [held.as_ref(), Some(&rest)]
                .into_iter()
                .flatten()
                .any(|tape| tape.ops.iter().any(|op| matches!(op, Op::Input(it) if it.0 as usize == port)))
        };
        let all = (0..count).filter(|port| reads(*port)).map(|port| (placed.arguments[port] as usize, values[port] as usize));
        let (fixed, changing): (Vec<_>, Vec<_>) = all.partition(|it| self.fixed.contains(&(it.0 as Slot)));
        let (loaded, read) = changing.into_iter().partition(|it| loaded.contains(&it.0));
        let mut pieces = vec![Piece::Spread(read)];
        let mut found: Vec<Slot> = Vec::new();
        if let Some(held) = held {
            found.extend(held.outputs.iter().map(|_| self.mirror.fresh()));
            let all = values.iter().copied().chain(vec![0; held.inputs.len() - count]).collect::<Vec<_>>();
            pieces.push(Piece::tape(&held, &all, &found));
        }
        for group in 1..=self.groups + usize::from(by_time) {
            let speeds: Vec<Slot> = ports.iter().map(|port| self.mirror.place(group, placed.arguments[*port])).collect();
            let all: Vec<Slot> = values.iter().copied().chain(speeds).chain(found.iter().copied()).collect();
            // What no direction of this group changes keeps its derivative of 0, which is in its place.
            let still = &self.still[group - 1];
            let mut is_zero = vec![false; rest.inputs.len()];
            ports.iter().enumerate().for_each(|(k, port)| is_zero[count + k] = still.contains(&placed.arguments[*port]));
            let (own, moves) = without(&rest, &is_zero);
            let results: Vec<(Slot, Slot)> = results.iter().map(|slot| (*slot, self.mirror.place(group, *slot))).collect();
            let still: Vec<Slot> = results.iter().zip(&moves).filter(|it| !it.1).map(|it| it.0.0).collect();
            self.still[group - 1].extend(still);
            let results: Vec<Slot> = results.iter().zip(&moves).filter(|it| *it.1).map(|it| it.0.1).collect();
            pieces.extend(own.map(|own| Piece::tape(&own, &all, &results)));
        }
        Some(Pieces { pieces, fixed, loaded })
    }

    /// The derivatives of what is computed when inputs, held comparisons or memories change.
    pub(super) fn refresh<const L: usize>(&mut self, values: &[[f64; L]]) {
        self.row.iter().flatten().for_each(|speeds| speeds.run(&mut self.store, values));
    }

    /// Compiles the derivatives of steps by a linear part.
    pub(super) fn write_linear(&mut self, programs: &Programs) {
        let Some((slopes, (step, shape))) = programs.placed_slopes().zip(programs.without_estimate()) else { return };
        let (n, block, first) = (programs.counts.states, programs.block, slopes.results[0]);
        let of_slopes = self.speeds(&slopes, false, &NONE);
        let changing: Vec<usize> = (0..slopes.results.len()).filter(|k| self.moving.contains(&(first + *k as Slot))).collect();
        let mut entries_of_jacobian: Vec<(usize, usize)> =
            changing.iter().filter(|k| **k < n * n).map(|k| (k / n, k % n)).collect();
        entries_of_jacobian.sort_by_key(|it| it.1);
        let columns = shape.columns();
        let timed = columns.iter().copied().enumerate().filter(|it| shape.timed.contains(&it.1)).collect();
        let mut entries: Vec<Entry> = Vec::new();
        let square =
            |columns: &[usize]| -> Vec<(usize, usize)> { (0..n).flat_map(|i| columns.iter().map(move |j| (i, *j))).collect() };
        if changing.iter().any(|k| *k < n * n) {
            for (i, j) in square(&(0..n).collect::<Vec<usize>>()) {
                entries.extend([Entry::Half(i, j), Entry::Whole(i, j)]);
            }
            for (i, column) in square(&(0..columns.len()).collect::<Vec<usize>>()) {
                entries.extend([Entry::Bent(i, column), Entry::Off(i, column)]);
            }
        }
        if !shape.timed.is_empty() && !changing.is_empty() {
            entries.extend((0..n).flat_map(|i| [Rest::HalfTime(i), Rest::WholeTime(i)].map(Entry::Rest)));
        }
        for k in &changing {
            match k.checked_sub(n * n) {
                Some(i) => entries.extend([Rest::HalfSlope(i), Rest::WholeSlope(i)].map(Entry::Rest)),
                None => entries.push(Entry::Rest(Rest::Slope(k / n, k % n))),
            }
        }
        let slots: Vec<Slot> = entries
            .iter()
            .map(|entry| match *entry {
                Entry::Half(i, j) => block.matrix(0, i, j),
                Entry::Whole(i, j) => block.matrix(1, i, j),
                Entry::Bent(i, column) => block.matrix(2, i, columns[column]),
                Entry::Off(i, column) => block.matrix(3, i, columns[column]),
                Entry::Rest(Rest::Slope(i, j)) => block.matrix(4, i, j),
                Entry::Rest(Rest::HalfTime(i)) => block.time(0, i),
                Entry::Rest(Rest::WholeTime(i)) => block.time(1, i),
                Entry::Rest(Rest::HalfSlope(i)) => block.time(2, i),
                Entry::Rest(Rest::WholeSlope(i)) => block.time(3, i),
            })
            .map(|slot| slot as Slot)
            .collect();
        self.moving.extend(&slots);
        let mut of_step = self.speeds(&step, false, &block.loaded());
        self.store.grow(self.mirror.next);
        let loaded = of_step.as_mut().map_or_else(Vec::new, |program| std::mem::take(&mut program.loaded));
        let matrices = Code::of(vec![Piece::Spread(loaded)], WIDE, self.way);
        // The step does not read every entry.
        let (entries, slots): (Vec<Entry>, Vec<Slot>) =
            entries.into_iter().zip(slots).filter(|it| self.speed(0, it.1).is_some()).unzip();
        let places = (0..self.groups).map(|group| slots.iter().filter_map(|slot| self.speed(group, *slot)).collect()).collect();
        self.linear = Some(Box::new(LinearSpeeds {
            slopes: of_slopes,
            first,
            changing,
            entries_of_jacobian,
            step: of_step,
            matrices,
            entries: Entries::new(n, &entries),
            places,
            columns,
            timed,
            parts: Vec::new(),
            loaded: None,
            shared: Shared::default(),
            along: Along::default(),
            both: Along::default(),
            chain: Chain::default(),
        }));
    }

    /// Compiles the derivatives of a step of the series. `end`, `last`: the first of the states at its end, and of its last terms.
    pub(super) fn write_series(&mut self, programs: &Programs, parts: &[&Placed], end: Slot, last: Slot) -> SeriesSpeeds {
        let (begin, states) = (programs.layout.states, 0..programs.counts.states as Slot);
        let pairs: Vec<(usize, Slot)> = (0..self.groups).flat_map(|group| states.clone().map(move |k| (group, k))).collect();
        if self.checked.largest.is_empty() {
            let largest = pairs.iter().map(|_| self.mirror.fresh()).collect();
            let too_long = (0..self.groups).map(|_| self.mirror.fresh()).collect();
            self.checked = Checked { limit: self.mirror.fresh(), too_long, largest };
        }
        let results: Vec<Slot> = states.clone().map(|k| end + k).chain(states.map(|k| last + k)).collect();
        let pieces = self.pieces(&composed(parts, &results), false, &NONE);
        let mut all = Vec::new();
        for ((group, k), largest) in pairs.iter().zip(&self.checked.largest) {
            let [begin, end, last] = [begin, end, last].map(|slot| self.speed(*group, slot + k).map(|it| it as Slot));
            if let Some((begin, end)) = begin.zip(end) {
                let next = self.mirror.fresh();
                all.push(Derivatives { group: *group, begin, end, last, largest: *largest, next });
            }
        }
        self.store.grow(self.mirror.next);
        SeriesSpeeds::new(pieces, &self.checked, all, self.way)
    }

    /// The place of the derivative of a slot of the walk; `None` if the derivative is 0.
    pub(super) fn speed(&self, group: usize, slot: Slot) -> Option<usize> {
        self.mirror.known(group + 1, slot)
    }

    /// The derivatives of a slot of the walk in the directions of a group.
    pub(super) fn speeds_of(&self, group: usize, slot: Slot) -> [f64; WIDE] {
        self.speed(group, slot).map_or([0.0; WIDE], |place| self.store.slots[place])
    }

    /// Takes the derivatives of the states from those at the end of a step by a linear part.
    pub(super) fn take_end(&mut self, states: Slot, end: Slot, count: usize) {
        let Carried { end: code, mirror, groups, store, way, .. } = self;
        let code = code.get_or_insert_with(|| {
            let both = |(group, k): (usize, Slot)| mirror.known(group, end + k).zip(mirror.known(group, states + k));
            let all = (1..=*groups).flat_map(|group| (0..count as Slot).map(move |k| (group, k)));
            Code::of(vec![Piece::Copy(all.filter_map(both).collect())], WIDE, *way)
        });
        store.run(code, &[]);
    }

    /// Collects a row of the derivatives of outputs, and writes the collected rows if there are enough.
    pub(super) fn collect_outputs(&mut self, to: &mut [Vec<Vec<f64>>]) {
        self.block.extend_from_slice(&self.store.slots[self.outputs.clone()]);
        if self.block.len() >= BLOCK * self.outputs.len() {
            self.write_outputs(to);
        }
    }

    /// Writes the collected rows of the derivatives of outputs: for each direction, for each output.
    pub(super) fn write_outputs(&mut self, to: &mut [Vec<Vec<f64>>]) {
        let all = self.outputs.len();
        let count = all / self.groups.max(1);
        for (k, to) in to.iter_mut().enumerate() {
            for (output, to) in to.iter_mut().enumerate() {
                let rows = self.block.chunks_exact(all);
                to.extend(rows.map(|row| row[k / WIDE * count + output][k % WIDE]));
            }
        }
        self.block.clear();
    }
}

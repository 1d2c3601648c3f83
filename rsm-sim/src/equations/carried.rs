//! Sensitivities, computed along with a walk.
//!
//! ```text
//! d x = S d q:  a step       S after = derivative of the step along S          (tangents of the tape of the series)
//!               an event     dT = -(dg)/(g' f before),  S += f before dT;  the event is differentiated;  S -= f after dT
//! ```
//!
//! In: a walk of one lane, and the derivatives of its parameters and of its start in some directions. Out: the derivatives of every output. Each
//! direction is a lane: four directions are computed together by the same machine code, and values that do not depend on the direction are computed
//! once for all. The walk itself is unchanged. The sensitivity is the exact derivative of the computed solution with the step lengths held constant
//! (H. G. Bock, "Numerical treatment of inverse problems in chemical reaction kinetics", 1981, calls it internal differentiation), if the terms of
//! the sensitivities permit this step. Else they have steps of their own along the same solution. The instant of an event depends on the parameters;
//! the second line above contains this contribution (M. A. Aizerman, F. R. Gantmacher, "Determination of stability by linear approximation of a
//! periodic solution of a system of differential equations with discontinuous right-hand sides", 1958).

use super::rows::Stopped;
use super::series::Tried;
use super::series_speeds::{Open, TOLERANCE};
use super::speeds::{Carried, Direction};
use super::thresholds::Thresholds;
use super::walk::Walk;
use crate::code::{Slot, WIDE, Way, lengthen};

/// The shortest share of a step of the states for a step of the sensitivities. With three orders and a tolerance of 1e-13, a share of 1/4096 of a
/// step that is 100 times as long as the fastest time constant still has terms that decrease.
const SHORTEST: f64 = 1.0 / 4096.0;

/// A step in which some directions go separately.
struct Separate {
    begin: f64,
    length: f64,
    /// For each order from 0: the terms of all states.
    polynomial: Vec<Vec<f64>>,
    /// The last solution of the iterated blocks.
    guesses: Vec<f64>,
}

/// The data that one set of directions keeps from run to run.
pub(super) struct Along<'m> {
    pub parameters: Vec<Option<usize>>,
    pub walk: Walk<'m, 1>,
    pub carried: Option<Box<Carried>>,
}

impl<const L: usize> Walk<'_, L> {
    /// Starts to compute sensitivities, after the start of a run. `known` contains the programs of an earlier run with the same directions.
    pub(super) fn carry(&mut self, directions: &[Direction], known: Option<Box<Carried>>, way: Way) {
        let layout = self.programs.layout;
        let mut boxed = known.unwrap_or_else(|| Carried::new(&self.programs, directions, way));
        let it = &mut *boxed;
        it.store.begin(it.mirror.next);
        it.instant = None;
        it.block.clear();
        if let Some(linear) = &mut it.linear {
            linear.parts.clear();
            linear.loaded = None;
        }
        it.checked.begin(&mut it.store);
        let tolerance = self.setting.tolerance.max(TOLERANCE);
        if it.thresholds.tolerance() != tolerance {
            it.thresholds = Thresholds::new(tolerance, self.programs.counts.guesses > 0);
        }
        for (k, moving) in directions.iter().enumerate() {
            let (group, lane) = (k / WIDE, k % WIDE);
            let mut put = |slot: Slot, value: f64| {
                if let Some(place) = it.mirror.known(group + 1, slot) {
                    it.store.slots[place][lane] = value;
                }
            };
            moving.parameter.into_iter().for_each(|place| put(layout.parameters + place as Slot, 1.0));
            moving.states.iter().zip(layout.states..).for_each(|(value, slot)| put(slot, *value));
            moving.memories.iter().zip(layout.memories..).for_each(|(value, slot)| put(slot, *value));
        }
        it.once.iter().flatten().for_each(|speeds| speeds.run(&mut it.store, &self.slots));
        self.carried = Some(boxed);
        self.carry_refresh();
    }

    /// After [`Walk::refresh`].
    #[inline]
    pub(super) fn carry_refresh(&mut self) {
        if let Some(it) = &mut self.carried {
            it.refresh(&self.slots);
        }
    }

    /// Carries the sensitivities over a step of the series that began at an instant, up to a share of its length. `before` contains the states at the
    /// start of the step.
    pub(super) fn carry_step(&mut self, tried: Tried, share: f64, begin: f64) {
        let count = self.programs.counts.states;
        let Some(mut it) = self.carried.take_if(|_| count > 0) else { return };
        let layout = self.programs.layout;
        let mut last = 0;
        while self.programs.part(last).order < tried.order {
            last += 1;
        }
        let mut time = [begin; L];
        self.swap_with_step_start(&mut time);
        let step = self.slots[layout.step as usize];
        self.slots[layout.step as usize] = step.map(|it| it * share);
        if let Some(open) = self.series_step(&mut it, last, None, false) {
            self.carry_separately(&mut it, last, (begin, share * step[0]), &open);
        }
        self.slots[layout.step as usize] = step;
        self.swap_with_step_start(&mut time);
        self.carried = Some(it);
    }

    /// Carries the sensitivities in some directions over a step, whose start is in the slots, with orders and lengths of their own. The states inside
    /// of the step are those of its series up to the last order of a part. The walk stays where it is.
    fn carry_separately(&mut self, it: &mut Carried, last: usize, (begin, length): (f64, f64), open: &Open) {
        let (states, count) = (self.programs.layout.states as usize, self.programs.counts.states);
        let mut highest = last;
        while self.programs.part(highest).order + 2 <= it.thresholds.most() {
            highest += 1;
        }
        lengthen(&mut self.slots, self.programs.slots());
        let kept = self.slots.clone();
        for place in 0..=last {
            self.programs.part(place).code.run(&mut self.slots, &mut self.spare);
        }
        let order = self.programs.part(last).order;
        let terms = &self.programs.terms[..order];
        let list = |begin: usize| self.slots[begin..begin + count].iter().map(|it| it[0]).collect::<Vec<f64>>();
        let polynomial: Vec<Vec<f64>> = [states].into_iter().chain(terms.iter().map(|it| *it as usize)).map(list).collect();
        let guesses =
            self.slots[self.programs.layout.guesses as usize..][..self.programs.counts.guesses].iter().map(|it| it[0]);
        let of = Separate { begin, length, polynomial, guesses: guesses.collect() };
        self.carry_divided(it, highest, &of, (0.0, 1.0), open);
        self.slots = kept;
    }

    /// Carries the sensitivities in some directions over a share of a step, between two shares. If it is too long for a direction, it is divided into
    /// halves.
    fn carry_divided(&mut self, it: &mut Carried, last: usize, of: &Separate, (from, to): (f64, f64), open: &Open) {
        let layout = self.programs.layout;
        self.slots[layout.step as usize] = [(to - from) * of.length; L];
        self.slots[layout.time as usize] = [of.begin + from * of.length; L];
        for (k, slot) in self.slots[layout.states as usize..][..self.programs.counts.states].iter_mut().enumerate() {
            *slot = [of.polynomial.iter().rev().fold(0.0, |sum, terms| sum * from + terms[k]); L];
        }
        let guesses = &mut self.slots[layout.guesses as usize..];
        guesses.iter_mut().zip(&of.guesses).for_each(|(slot, value)| *slot = [*value; L]);
        self.settle();
        if let Some(open) = self.series_step(it, last, Some(open), to - from <= SHORTEST) {
            let middle = 0.5 * (from + to);
            self.carry_divided(it, last, of, (from, middle), &open);
            self.carry_divided(it, last, of, (middle, to), &open);
        }
    }

    /// Swaps the time and the states with those at the start of the step: programs of derivatives read their arguments from the walk.
    pub(super) fn swap_with_step_start(&mut self, time: &mut [f64; L]) {
        let layout = self.programs.layout;
        let states = layout.states as usize..layout.states as usize + self.programs.counts.states;
        std::mem::swap(&mut self.slots[layout.time as usize], time);
        self.slots[states].swap_with_slice(&mut self.before);
    }

    /// Takes the derivatives at the end of a step of the series, from all orders up to the last order of a part, in some directions or all. Returns
    /// the directions for which the step is too long, and keeps their derivatives.
    fn series_step(&mut self, it: &mut Carried, last: usize, of: Option<&Open>, is_shortest: bool) -> Option<Open> {
        it.series.resize_with(it.series.len().max(last + 1), || None);
        let order = self.programs.written(last)[last].order;
        if it.series[last].is_none() {
            let parts: Vec<_> = self.programs.written(last).iter().map(|it| &it.placed).collect();
            let (end, terms) = (self.programs.end(), self.programs.terms[order - 1]);
            it.series[last] = Some(it.write_series(&self.programs, &parts, end, terms));
        }
        let Carried { series, store, checked, thresholds, groups, .. } = it;
        let Some(series) = &series[last] else { return None };
        let fits = series.run(store, checked, &self.slots, thresholds.of(order).0) || is_shortest;
        let all = match of {
            None if fits => {
                series.take(store);
                return None;
            }
            None => &vec![[true; WIDE]; *groups],
            Some(of) => of,
        };
        let open = if fits { vec![[false; WIDE]; *groups] } else { checked.too_long(store, all) };
        let valid: Open =
            all.iter().zip(&open).map(|(all, open)| std::array::from_fn(|lane| all[lane] && !open[lane])).collect();
        series.take_in(store, &valid);
        open.as_flattened().contains(&true).then_some(open)
    }

    /// At an instant at which a comparison has just changed: the instant depends on the parameters, and so do the states at this instant.
    pub(super) fn carry_event(&mut self) -> Result<(), Stopped> {
        let Some(mut it) = self.carried.take() else { return Ok(()) };
        let layout = self.programs.layout;
        let count = self.programs.counts.states;
        self.sides_differ();
        let changed = self.programs.sides.as_ref().and_then(|sides| {
            let (begin, held) = (sides.results as usize, layout.held as usize);
            let differs = |k: &usize| {
                (self.slots[begin + 2 * k][0] < self.slots[begin + 2 * k + 1][0]) != (self.slots[held + k][0] != 0.0)
            };
            (0..self.programs.counts.held).find(differs).map(|k| sides.results + 2 * k as Slot)
        });
        self.programs.rates.code.run(&mut self.slots, &mut self.spare);
        let rates = self.programs.rates.results as usize;
        let time = it.groups;
        for k in 0..count {
            if let Some(place) = it.speed(time, layout.states + k as Slot) {
                it.store.slots[place] = [self.slots[rates + k][0]; WIDE];
            }
        }
        let clock = |it: &Carried, group: usize| it.mirror.places[group + 1][layout.time as usize] as usize;
        let at = clock(&it, time);
        it.store.slots[at] = [1.0; WIDE];
        it.sides.iter().for_each(|speeds| speeds.run(&mut it.store, &self.slots));
        let mut instant = Vec::with_capacity(it.groups);
        if let Some(slot) = changed {
            let distance = |it: &Carried, group: usize| -> [f64; WIDE] {
                let (left, right) = (it.speeds_of(group, slot), it.speeds_of(group, slot + 1));
                std::array::from_fn(|lane| left[lane] - right[lane])
            };
            let by_time = distance(&it, time)[0];
            for group in 0..it.groups {
                let moved = distance(&it, group);
                let moves: [f64; WIDE] =
                    std::array::from_fn(|lane| if moved[lane] == 0.0 { 0.0 } else { -moved[lane] / by_time });
                if moves.iter().any(|it| !it.is_finite()) {
                    let what = "a comparison is touched and not crossed: the instant has no derivative";
                    self.carried = Some(it);
                    return Err(Stopped::Step(format!("row {}: {what}", self.row + 1)));
                }
                instant.push(moves);
            }
        }
        self.carried = Some(it);
        if !instant.is_empty() {
            self.shift(&instant, 1.0);
            let Some(it) = &mut self.carried else { return Ok(()) };
            for (group, moves) in instant.iter().enumerate() {
                let at = clock(it, group);
                it.store.slots[at] = *moves;
            }
            it.instant = Some(instant);
        }
        Ok(())
    }

    /// Adds the effect of the moved instant to the states, with the rates in their slots. After the event the sign is negative.
    fn shift(&mut self, instant: &[[f64; WIDE]], sign: f64) {
        let Some(it) = &mut self.carried else { return };
        let (states, rates) = (self.programs.layout.states, self.programs.rates.results as usize);
        for (group, moves) in instant.iter().enumerate() {
            for k in 0..self.programs.counts.states {
                let rate = sign * self.slots[rates + k][0];
                if let Some(place) = it.speed(group, states + k as Slot) {
                    (0..WIDE).for_each(|lane| it.store.slots[place][lane] += rate * moves[lane]);
                }
            }
        }
    }

    /// After all events of an instant.
    pub(super) fn carry_after_events(&mut self) {
        let Some(instant) = self.carried.as_mut().and_then(|it| it.instant.take()) else { return };
        self.programs.rates.code.run(&mut self.slots, &mut self.spare);
        self.shift(&instant, -1.0);
        let time = self.programs.layout.time;
        if let Some(it) = &mut self.carried {
            for group in 0..it.groups {
                let at = it.mirror.places[group + 1][time as usize] as usize;
                it.store.slots[at] = [0.0; WIDE];
            }
        }
    }

    /// Where branches act: after the program of events, before its results are used.
    pub(super) fn carry_branches(&mut self) {
        let Some(it) = self.carried.as_deref_mut() else { return };
        let Some(program) = &self.programs.events else { return };
        it.events.iter().for_each(|speeds| speeds.run(&mut it.store, &self.slots));
        let (layout, results) = (self.programs.layout, program.results);
        for (place, branch) in self.events.branches.iter().enumerate() {
            if branch.restarted.is_empty() || self.slots[layout.acts as usize + place][0] == 0.0 {
                continue;
            }
            for group in 0..it.groups {
                for (state, place) in &branch.restarted {
                    let value = it.speeds_of(group, results + *place as Slot);
                    if let Some(place) = it.speed(group, layout.states + *state as Slot) {
                        it.store.slots[place] = value;
                    }
                }
            }
        }
        for (to, from) in &it.memories {
            it.store.slots[*to] = from.map_or([0.0; WIDE], |from| it.store.slots[from]);
        }
    }

    /// The derivatives of every output at the current point, in each direction. Rows are collected and written in blocks.
    pub(super) fn carry_outputs(&mut self, to: &mut [Vec<Vec<f64>>]) {
        let Some(it) = self.carried.as_deref_mut() else { return };
        it.output_program.iter().for_each(|speeds| speeds.run(&mut it.store, &self.slots));
        it.collect_outputs(to);
    }

    /// Writes the rows that are collected.
    pub(super) fn finish_outputs(&mut self, to: &mut [Vec<Vec<f64>>]) {
        self.carried.iter_mut().for_each(|it| it.write_outputs(to));
    }
}

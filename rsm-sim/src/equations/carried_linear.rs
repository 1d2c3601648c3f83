//! Sensitivities over steps by a linear part.
//!
//! ```text
//! dJ = (dJ/dx) S + dJ/dp at the instant of the linear part --frechet--> d phi(h J);  S after = derivative of the step along S and d phi(h J)
//! ```
//!
//! In: a walk that computes sensitivities, a linear part that was just computed, or a step that was just made with one. Out: the sensitivities at the
//! end of the step, or at a share of it. They are the exact derivative of the computed step, in which also the matrices change with the directions;
//! held constant are the length of the step, and the instant at which its linear part was computed. For a linear plant this is the derivative of
//! the exact solution, however long the step is.

use super::entries::{Entries, Rest};
use super::frechet::Along;
use super::frechet_values::place as place_of;
use super::part::Part;
use super::rows::Stopped;
use super::speeds::{Carried, LinearSpeeds, PartSpeeds};
use super::walk::Walk;
use crate::code::{Slot, WIDE, has_eight};

impl<const L: usize> Walk<'_, L> {
    /// At a point where a linear part has just been computed: how it changes with the directions.
    pub(super) fn carry_part(&mut self, place: usize) {
        let Some(mut it) = self.carried.take() else { return };
        if it.linear.is_none() {
            it.write_linear(&self.programs);
        }
        let n = self.programs.counts.states;
        let Carried { linear, store, mirror, groups, .. } = &mut *it;
        if let Some(linear) = linear {
            if let Some(slopes) = &linear.slopes {
                slopes.run(store, &self.slots);
            }
            linear.parts.resize_with(linear.parts.len().max(place + 1), PartSpeeds::default);
            let part = &mut linear.parts[place];
            (part.version, part.level) = (self.kept[0].parts[place].version, None);
            part.slopes.resize(*groups * n * (n + 1), [0.0; WIDE]);
            for group in 0..*groups {
                for k in &linear.changing {
                    if let Some(from) = mirror.known(group + 1, linear.first + *k as Slot) {
                        part.slopes[group * n * (n + 1) + k] = store.slots[from];
                    }
                }
            }
        }
        self.carried = Some(it);
    }

    /// Carries the sensitivities over the last step, which began at an instant, or over a share of it.
    pub(super) fn carry_linear_step(&mut self, share: f64, begin: f64) -> Result<(), Stopped> {
        let Some(mut it) = self.carried.take() else { return Ok(()) };
        let found = self.carry_linear(&mut it, share, begin);
        self.carried = Some(it);
        found.ok_or_else(|| Stopped::Step(format!("row {}: the linear part of a step has no finite derivative", self.row + 1)))
    }

    /// `None` if the functions of the linear part are not finite.
    fn carry_linear(&mut self, it: &mut Carried, share: f64, begin: f64) -> Option<()> {
        let (layout, block, n) = (self.programs.layout, self.programs.block, self.programs.counts.states);
        let loaded = self.loaded[0]?;
        let place = it.linear.as_ref()?.parts.iter().position(|part| part.version == loaded.version)?;
        let mut linear = it.linear.take()?;
        let part = &self.kept[0].parts[place];
        if linear.loaded != Some((loaded.version, loaded.level)) {
            compute(&mut linear, part, place, loaded.level);
            let entries = &linear.parts[place].entries;
            for (places, entries) in linear.places.iter().zip(entries.chunks(linear.entries.count.max(1))) {
                places.iter().zip(entries).for_each(|(to, value)| it.store.slots[*to] = *value);
            }
            it.store.run(&linear.matrices, self.slots.as_flattened());
            linear.loaded = Some((loaded.version, loaded.level));
        }
        let mut time = [begin; L];
        self.swap_with_step_start(&mut time);
        if let Some(step) = &linear.step {
            step.run(&mut it.store, &self.slots);
        }
        self.swap_with_step_start(&mut time);
        let found = if share == 1.0 {
            it.take_end(layout.states, block.end() as Slot, n);
            Some(())
        } else {
            self.carry_inside(it, &mut linear, (place, loaded.level), share)
        };
        it.linear = Some(linear);
        found
    }

    /// Carries the sensitivities to a share of the last step. The states there are those of [`Part::within`], written for this share at once: with
    /// phi of the time up to there, H phi_1 f0 + H share phi_2 (a + h f') + 2 H share^2 phi_3 (D(1) - a).
    fn carry_inside(
        &self,
        it: &mut Carried,
        linear: &mut LinearSpeeds,
        (place, level): (usize, usize),
        share: f64,
    ) -> Option<()> {
        let n = self.programs.counts.states;
        let part = &self.kept[0].parts[place];
        let whole = part.length_of(level);
        let length = share * whole;
        let LinearSpeeds { chain, shared, along, columns, parts, entries_of_jacobian, .. } = linear;
        if !chain.set_matrix(n, part.jacobian(), length, columns) || !chain.make(0) {
            return None;
        }
        shared.prepare((n, part.jacobian(), length), chain, (0, 0), columns);
        let inside = self.programs.block.inside();
        for group in 0..it.groups {
            let slopes = &parts[place].slopes[group * n * (n + 1)..(group + 1) * n * (n + 1)];
            along.compute(shared, entries_of_jacobian, |i, j| slopes[i * n + j]);
            let [one, two, three, ..] = along.lists();
            // Rates at the start, a, D(1): values and derivatives.
            let value = |list: usize, k: usize| self.slots[inside[list] + k][0];
            let moved = |list: usize, k: usize| it.speeds_of(group, (inside[list] + k) as Slot);
            let mut change = vec![[0.0; WIDE]; n];
            for (i, change) in change.iter_mut().enumerate() {
                for j in 0..n {
                    let (by_matrix, rate, moved) = (one[place_of(n, i, j)], value(0, j), moved(0, j));
                    let entry = chain.entry(0, 0, i, j);
                    (0..WIDE).for_each(|lane| change[lane] += length * (by_matrix[lane] * rate + entry * moved[lane]));
                }
                for (column, j) in columns.iter().copied().enumerate() {
                    let [two, three] = [two, three].map(|list| list[place_of(n, i, column)]);
                    let (phi_2, phi_3) = (chain.entry(0, 1, i, j), chain.entry(0, 2, i, j));
                    let (a, end, by_time) = (value(1, j), value(2, j), part.by_time[j]);
                    let (moved_a, moved_end, moved_by_time) = (moved(1, j), moved(2, j), slopes[n * n + j]);
                    let (factor, of_bend) = (length * share, 2.0 * length * share * share);
                    for lane in 0..WIDE {
                        let slope = a + whole * by_time;
                        let moved_slope = moved_a[lane] + whole * moved_by_time[lane];
                        change[lane] += factor * (two[lane] * slope + phi_2 * moved_slope)
                            + of_bend * (three[lane] * (end - a) + phi_3 * (moved_end[lane] - moved_a[lane]));
                    }
                }
            }
            for (k, change) in change.iter().enumerate() {
                if let Some(to) = it.speed(group, self.programs.layout.states + k as Slot) {
                    (0..WIDE).for_each(|lane| it.store.slots[to][lane] += change[lane]);
                }
            }
        }
        Some(())
    }
}

/// Computes the derivatives of a linear part for steps of a level, if the part has none for this level.
fn compute(linear: &mut LinearSpeeds, part: &Part, place: usize, level: usize) {
    let LinearSpeeds { shared, along, both, columns, timed, parts, entries, places, entries_of_jacobian, .. } = linear;
    let of_part = &mut parts[place];
    if of_part.level == Some(level) || entries.count == 0 {
        return;
    }
    let n = part.chain.rows();
    shared.prepare((n, part.jacobian(), part.length), &part.chain, (level + 1, level), columns);
    of_part.entries.resize(places.len() * entries.count, [0.0; WIDE]);
    let (size, count) = (n * (n + 1), entries.count);
    let step = Step { part, level, entries, timed };
    for group in (0..places.len()).step_by(2) {
        let slopes = &of_part.slopes[group * size..];
        let to = &mut of_part.entries[group * count..];
        if has_eight() && group + 1 < places.len() {
            let eight = |k: usize| -> [f64; 2 * WIDE] {
                std::array::from_fn(|lane| slopes[if lane < WIDE { k } else { size + k }][lane % WIDE])
            };
            both.compute(shared, entries_of_jacobian, |i, j| eight(i * n + j));
            step.entries(both, eight, &mut |k, value| {
                let (values, others) = value.split_at(WIDE);
                to[k].copy_from_slice(values);
                to[count + k].copy_from_slice(others);
            });
            continue;
        }
        for other in 0..2.min(places.len() - group) {
            let four = |k: usize| slopes[other * size + k];
            along.compute(shared, entries_of_jacobian, |i, j| four(i * n + j));
            step.entries(along, four, &mut |k, value| to[other * count + k] = value);
        }
    }
    of_part.level = Some(level);
}

/// A step of a level, and what its entries are computed from.
struct Step<'a> {
    part: &'a Part,
    level: usize,
    entries: &'a Entries,
    timed: &'a [(usize, usize)],
}

impl Step<'_> {
    /// The derivatives of all entries in some directions, from those of the functions and of the Jacobian.
    fn entries<const W: usize>(
        &self,
        along: &Along<W>,
        slopes: impl Fn(usize) -> [f64; W],
        to: &mut impl FnMut(usize, [f64; W]),
    ) {
        let Step { part, level, entries, .. } = *self;
        let (n, h) = (part.chain.rows(), part.length_of(level));
        let [one, two, three, half, half_two] = along.lists();
        entries.half.iter().for_each(|(from, k)| to(*k, half[*from].map(|it| 0.5 * h * it)));
        entries.whole.iter().for_each(|(from, k)| to(*k, one[*from].map(|it| h * it)));
        entries.bent.iter().for_each(|(from, k)| to(*k, three[*from].map(|it| 2.0 * h * it)));
        for (from, k) in &entries.off {
            let (two, three) = (two[*from], three[*from]);
            to(*k, std::array::from_fn(|lane| h * (two[lane] - 2.0 * three[lane])));
        }
        for (rest, k) in &entries.rest {
            let value = match *rest {
                Rest::HalfTime(i) => {
                    let moved = |column: usize| half_two[place_of(n, i, column)];
                    self.by_time(i, level + 1, &moved, &slopes).map(|it| 0.25 * h * h * it)
                }
                Rest::WholeTime(i) => {
                    let moved = |column: usize| two[place_of(n, i, column)];
                    self.by_time(i, level, &moved, &slopes).map(|it| h * h * it)
                }
                Rest::HalfSlope(i) => slopes(n * n + i).map(|it| 0.5 * h * it),
                Rest::WholeSlope(i) => slopes(n * n + i).map(|it| h * it),
                Rest::Slope(i, j) => slopes(i * n + j),
            };
            to(*k, value);
        }
    }

    /// The derivatives of a row of phi_2 of a level times the derivative of the rates with respect to time. `moved`: those of an entry of phi_2, by
    /// the index of its column.
    fn by_time<const W: usize>(
        &self,
        i: usize,
        level: usize,
        moved: &impl Fn(usize) -> [f64; W],
        slopes: &impl Fn(usize) -> [f64; W],
    ) -> [f64; W] {
        let (part, n) = (self.part, self.part.chain.rows());
        let mut sum = [0.0; W];
        for (column, j) in self.timed.iter().copied() {
            let (moved, moved_by_time) = (moved(column), slopes(n * n + j));
            let (entry, by_time) = (part.chain.entry(level, 1, i, j), part.by_time[j]);
            (0..W).for_each(|lane| sum[lane] += moved[lane] * by_time + entry * moved_by_time[lane]);
        }
        sum
    }
}

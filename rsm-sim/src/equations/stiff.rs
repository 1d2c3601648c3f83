//! Steps in which the linear part is solved exactly.
//!
//! In: a walk at an instant, the time to the next row. Out: the states after a step whose error is permitted. Step lengths are the time to the row,
//! its half, its quarter and so on, so the matrices of a linear part can be used for many rows. A linear part is computed if none fits at the
//! beginning of a row. It is computed again if the error of a step is too large, or is expected to be ([`super::kept::Kept::must_recompute`]), and
//! the current linear part belongs to an earlier point. All these decisions depend on the lane alone.

use super::choice::{PART, STEP};
use super::kept::{Anchor, Loaded, SAME, Segment};
use super::part::MOST_STATES;
use super::rows::Stopped;
use super::walk::{Walk, larger, scale};
use crate::code::{Work, over_lanes};

/// If the error of a step is below this share of the permitted error, the next step may be twice as long: an error of order 4 becomes 16 times as
/// large. The better estimate ([`super::exponential`]) must also be below this share. With a linear part from an earlier point it has the size of the
/// error, and the errors of a hundred steps have one sign; the first estimate is far larger than the error.
pub(super) const SMALL: f64 = 1.0 / 32.0;

/// The largest number of halvings.
const MOST_LEVELS: usize = 40;

/// A ratio just above 1, for an error above the limit whose ratio rounds to 1.
const ABOVE: f64 = 1.0 + f64::EPSILON;

/// A change of a state, as a share of its magnitude, that may be the rounding error of a dozen operations.
const ROUNDED: f64 = 16.0 * f64::EPSILON;

/// The number of equal shares of a step at which the comparisons of every lane are evaluated.
const GRID: f64 = 8.0;

/// The result of an attempted step.
pub(super) enum Attempt {
    /// The length of the step, its level, and the suggested length of the next step.
    Taken(f64, usize, f64),
    /// The step was too long, or the linear part was out of date: try again.
    Again,
    /// No linear part exists here.
    None,
}

/// The length of the next step after one with an error that is a multiple of the permitted one. An error of order 4 becomes 256 times smaller in a
/// quarter of the step.
pub(super) fn shorter(length: f64, excess: f64) -> f64 {
    if excess > 256.0 { 0.25 * length } else { 0.5 * length }
}

/// Whether a step of a length can take matrices for steps of another length.
#[inline]
fn is_same(whole: f64, length: f64, tolerance: f64) -> bool {
    (whole - length).abs() <= SAME * tolerance * length
}

impl<const L: usize> Walk<'_, L> {
    /// Whether the matrices for a whole row of this length are in the slots of a lane, or can be copied there.
    pub(super) fn select(&mut self, lane: usize, length: f64) -> bool {
        let (held, count) = (self.layout().held as usize, self.programs.counts.held);
        let tolerance = self.setting.tolerance;
        if let Some(loaded) = self.loaded[lane]
            && loaded.level == 0
            && is_same(loaded.whole, length, tolerance)
            && (0..count).all(|k| self.slots[held + k][lane] == self.patterns[k][lane])
        {
            return true;
        }
        let slots = &self.slots;
        let is_held = |list: &[f64]| list.iter().enumerate().all(|(k, it)| slots[held + k][lane] == *it);
        let Some(place) = self.kept[lane].find(is_held, length, tolerance) else { return false };
        self.load(lane, place, 0)
    }

    /// Copies the matrices of a part into the slots of a lane. Returns `false` if there are none for a step of this level.
    pub(super) fn load(&mut self, lane: usize, place: usize, level: usize) -> bool {
        let part = &mut self.kept[lane].parts[place];
        let wanted = Loaded { version: part.version, level, whole: part.length };
        if self.loaded[lane] != Some(wanted) {
            if !part.make(level) {
                return false;
            }
            self.programs.block.load(&mut self.slots, lane, part, level);
            self.patterns.iter_mut().zip(&part.held).for_each(|(to, from)| to[lane] = *from);
            (self.loaded[lane], self.loaded_length) = (Some(wanted), f64::NAN);
        }
        true
    }

    /// Keeps the matrices in the slots of a lane only if they belong to its current part: another walk may have changed it.
    pub(super) fn keep_loaded(&mut self, lane: usize) {
        let kept = &self.kept[lane];
        let version = kept.current.map(|place| kept.parts[place].version);
        self.loaded[lane] = self.loaded[lane].filter(|it| Some(it.version) == version);
        self.loaded_length = f64::NAN;
    }

    /// Selects matrices for steps of a length in all lanes of a plant without comparisons. Returns `false` if there are none.
    #[inline]
    pub(super) fn select_all(&mut self, length: f64) -> bool {
        if is_same(self.loaded_length, length, self.setting.tolerance) {
            return true;
        }
        if !(0..self.used).all(|lane| self.select(lane, length)) {
            return false;
        }
        (self.used..L).for_each(|lane| self.follow_linear(lane, self.used - 1));
        let whole = self.loaded[0].map_or(f64::NAN, |it| it.whole);
        let all = self.loaded.iter().all(|it| it.is_some_and(|it| it.level == 0 && it.whole == whole));
        self.loaded_length = if all { whole } else { f64::NAN };
        true
    }

    /// One step of all lanes with the matrices in their slots. The slot of the step length must be set.
    pub(super) fn exponential_step(&mut self) -> bool {
        let Some(code) = self.programs.exponential() else { return false };
        code.run(&mut self.slots, &mut self.spare);
        true
    }

    /// Replaces the estimate of the error of the last step, in all lanes, by the better one. The states must still be those of its start.
    fn refine(&mut self) {
        if let Some(code) = self.programs.refined() {
            code.run(&mut self.slots, &mut self.spare);
        }
    }

    /// The error of the last step of a lane as a multiple of a share of the permitted one, for the worst state. `longer`: the time to the row divided
    /// by the step length.
    pub(super) fn excess(&self, lane: usize, longer: f64, share: f64) -> f64 {
        let tolerance = share * self.setting.tolerance;
        let block = self.programs.block;
        let (ends, errors) = (block.end(), block.error());
        let (mut worst, mut is_finite) = (0.0_f64, true);
        for k in 0..self.programs.counts.states {
            let (end, error) = (self.slots[ends + k][lane], self.slots[errors + k][lane]);
            is_finite &= end.is_finite() && error.is_finite();
            let scale = self.scale_of(lane, k, longer);
            // A state that is 0, stays 0 and has an error of 0 is correct.
            if error.abs() > tolerance * scale {
                worst = worst.max(error.abs() / (tolerance * scale)).max(ABOVE);
            } else if error != 0.0 {
                worst = worst.max((error.abs() / (tolerance * scale)).min(1.0));
            }
        }
        if is_finite { worst } else { f64::INFINITY }
    }

    /// Whether the error of the last step, a whole row, is permitted in each lane. The answer is that of [`Walk::excess`] and
    /// [`Walk::unresolved`] for the lane alone.
    #[inline]
    pub(super) fn allowed(&mut self) -> [bool; L] {
        let first = self.is_below(1.0);
        let fits = if first == [true; L] { first } else { self.allowed_by_better(first) };
        let sure = self.are_below(self.programs.block.hidden(), SMALL * self.setting.tolerance);
        let doubtful = std::array::from_fn(|lane| fits[lane] && !sure[lane]);
        if doubtful == [false; L] { fits } else { self.confirmed(fits, doubtful) }
    }

    /// The same by the better estimate, in lanes in which the first one is too large.
    fn allowed_by_better(&mut self, first: [bool; L]) -> [bool; L] {
        self.refine();
        let second = self.is_below(SMALL);
        std::array::from_fn(|lane| first[lane] || second[lane])
    }

    /// Whether the functions phi hide so much of the remainder that the end of the last step must be confirmed. If the linear part is wrong where
    /// they hide it, the end is wrong by that much, and the estimate of the error does not show it.
    fn is_doubtful(&self, lane: usize, longer: f64) -> bool {
        let (hidden, limit) = (self.programs.block.hidden(), SMALL * self.setting.tolerance);
        (0..self.programs.counts.states)
            .any(|k| self.slots[hidden + k][lane].abs() - limit * self.scale_of(lane, k, longer) > 0.0)
    }

    /// Confirms the ends of doubtful lanes.
    fn confirmed(&mut self, fits: [bool; L], doubtful: [bool; L]) -> [bool; L] {
        self.confirm();
        let unresolved = self.unresolved([1.0; L]);
        std::array::from_fn(|lane| fits[lane] && !(doubtful[lane] && unresolved[lane] > 1.0))
    }

    /// Computes the next and the last change of the ends of the last step, in all lanes. The states must still be those of its start.
    fn confirm(&mut self) {
        if let Some(code) = self.programs.confirmed() {
            code.run(&mut self.slots, &mut self.spare);
        }
    }

    /// The further changes of the end of the last step as a multiple of the permitted error: a geometric series, if each change is the same multiple
    /// of the change before (E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", IV.8). Infinite if they do not become smaller.
    fn unresolved(&self, longer: [f64; L]) -> [f64; L] {
        let count = self.programs.counts.states;
        let list = |begin: usize| &self.slots[begin..begin + count];
        let block = self.programs.block;
        let lists = [self.layout().states as usize, self.layout().largest as usize, block.end()].map(list);
        let changes = block.changes().map(list);
        let [next, last] = over_lanes::<L, _>(LargestChanges { lists, changes, longer });
        let permitted = SMALL * self.setting.tolerance;
        std::array::from_fn(|lane| {
            if next[lane] <= ROUNDED {
                0.0
            } else if next[lane] < last[lane] {
                next[lane] / (1.0 - next[lane] / last[lane]) / permitted
            } else {
                // Also if a change is not finite.
                f64::INFINITY
            }
        })
    }

    /// The magnitude of a state to which the permitted error of the last step refers. `longer`: the time to the row divided by the step length.
    fn scale_of(&self, lane: usize, state: usize, longer: f64) -> f64 {
        let (begin, end) =
            (self.slots[self.layout().states as usize + state][lane], self.slots[self.programs.block.end() + state][lane]);
        scale(begin, self.largest(state)[lane], ((end - begin) * longer).abs())
    }

    /// Whether the estimate is at most a share of the permitted error, in each lane.
    #[inline]
    fn is_below(&self, share: f64) -> [bool; L] {
        self.are_below(self.programs.block.error(), share * self.setting.tolerance)
    }

    /// Whether the results of a group are at most this share of the magnitudes of their states, in each lane.
    #[inline]
    fn are_below(&self, group: usize, limit: f64) -> [bool; L] {
        let block = self.programs.block;
        over_lanes::<L, _>(Allowed {
            slots: &self.slots,
            largest: &self.slots[self.layout().largest as usize..][..self.programs.counts.states],
            states: self.layout().states as usize,
            ends: block.end(),
            errors: group,
            tolerance: limit,
        })
    }

    /// Moves a lane to a share of its last step, which had this level.
    pub(super) fn put_inside(&mut self, lane: usize, level: usize, share: f64, time: f64) {
        if share == 0.0 {
            self.anchors[lane] = Anchor::START;
            self.move_to_step_start(lane, time);
            return;
        }
        let n = self.programs.counts.states;
        let kept = &self.kept[lane];
        let Some(part) = kept.current.map(|place| &kept.parts[place]) else { return };
        let forcing = self.programs.block.inside().map(|begin| &self.slots[begin..begin + n]);
        let mut anchor = if self.anchors[lane].share <= share { self.anchors[lane] } else { Anchor::START };
        part.within(level, (anchor.share, share), forcing, lane, &mut anchor.moved);
        anchor.share = share;
        // The stored point must not depend on where the comparisons of other lanes are evaluated.
        if self.is_locating || (share * GRID).fract() == 0.0 {
            self.anchors[lane] = anchor;
        }
        let layout = self.programs.layout;
        for k in 0..n {
            self.slots[layout.states as usize + k][lane] = self.before[k][lane] + anchor.moved[k];
        }
        self.slots[layout.time as usize][lane] = time;
    }
}

/// The largest changes of the end of a step, next and last, each relative to the magnitude of its state. `lists`: the states at the start, their
/// largest magnitudes, the states at the end. NaN if a change is not finite.
struct LargestChanges<'a, const L: usize> {
    lists: [&'a [[f64; L]]; 3],
    changes: [&'a [[f64; L]]; 2],
    longer: [f64; L],
}

impl<const L: usize> Work for LargestChanges<'_, L> {
    type Found = [[f64; L]; 2];

    #[inline(always)]
    fn run(self) -> [[f64; L]; 2] {
        let LargestChanges { lists: [begins, largest, ends], changes, longer } = self;
        let mut found = [[0.0; L]; 2];
        let mut zero = [0.0; L];
        for k in 0..begins.len() {
            for lane in 0..L {
                let moved = (ends[k][lane] - begins[k][lane]).abs() * longer[lane];
                // A state that is 0 and stays 0 has no change.
                let scale = larger(scale(begins[k][lane], largest[k][lane], moved), f64::MIN_POSITIVE);
                for (found, change) in found.iter_mut().zip(changes) {
                    found[lane] = larger(change[k][lane].abs() / scale, found[lane]);
                    // A number that is not finite has a product with zero that is NaN.
                    zero[lane] += change[k][lane] * 0.0;
                }
            }
        }
        found.map(|it| std::array::from_fn(|lane| it[lane] + zero[lane]))
    }
}

/// Whether the errors of a step over a whole row are permitted.
struct Allowed<'a, const L: usize> {
    slots: &'a [[f64; L]],
    largest: &'a [[f64; L]],
    states: usize,
    ends: usize,
    errors: usize,
    tolerance: f64,
}

impl<const L: usize> Work for Allowed<'_, L> {
    type Found = [bool; L];

    #[inline(always)]
    fn run(self) -> [bool; L] {
        let Allowed { slots, largest, states, ends, errors, tolerance } = self;
        let count = largest.len();
        let list = |begin: usize| &slots[begin..begin + count];
        let (states, ends, errors) = (list(states), list(ends), list(errors));
        // A number that is not finite has a product with zero that is NaN.
        let (mut excess, mut zero) = ([0.0; L], [0.0; L]);
        for k in 0..count {
            let (begin, end, error, largest) = (&states[k], &ends[k], &errors[k], &largest[k]);
            for lane in 0..L {
                let moved = (end[lane] - begin[lane]).abs();
                let scale = scale(begin[lane], largest[lane], moved);
                excess[lane] = larger(error[lane].abs() - tolerance * scale, excess[lane]);
                zero[lane] += end[lane] * 0.0 + error[lane] * 0.0;
            }
        }
        std::array::from_fn(|lane| excess[lane] == 0.0 && zero[lane] == 0.0)
    }
}

impl<const L: usize> Walk<'_, L> {
    /// Whether the method can be used for this plant.
    pub(super) fn has_exponential(&self) -> bool {
        (1..=MOST_STATES).contains(&self.programs.counts.states)
    }

    /// Computes linear parts over a length in some lanes, at their current points. Returns the lanes that have one. It replaces the current part, if
    /// that is a part for this length and these values of comparisons.
    pub(super) fn take(&mut self, lanes: [bool; L], length: f64) -> [bool; L] {
        let Some((code, range)) = self.programs.slopes() else { return [false; L] };
        code.run(&mut self.slots, &mut self.spare);
        std::array::from_fn(|lane| lanes[lane] && self.take_in_lane(lane, length, range.clone()))
    }

    fn take_in_lane(&mut self, lane: usize, length: f64, slopes: std::ops::Range<usize>) -> bool {
        if !self.slots[slopes.clone()].iter().all(|it| it[lane].is_finite()) {
            return false;
        }
        let (held, count) = (self.layout().held as usize, self.programs.counts.held);
        let slots = &self.slots;
        let is_held = |list: &[f64]| list.iter().enumerate().all(|(k, it)| slots[held + k][lane] == *it);
        let kept = &mut self.kept[lane];
        let replaces = kept.find(is_held, length, self.setting.tolerance).is_some();
        let place = kept.place_for_part(replaces);
        let part = &mut kept.parts[place];
        part.held.clear();
        part.held.extend(slots[held..held + count].iter().map(|it| it[lane]));
        part.length = length;
        let is_part = part.take(self.programs.counts.states, &self.programs.curved, slots[slopes].iter().map(|it| it[lane]));
        if !is_part {
            // NaN marks the part as unusable.
            part.length = f64::NAN;
            (kept.current, self.loaded[lane]) = (None, None);
        }
        kept.renewed();
        self.work[lane] += PART;
        if is_part {
            self.carry_part(place);
        }
        is_part
    }
}

impl Walk<'_, 1> {
    /// One step towards a row that is `rest` away.
    pub(super) fn exponential(&mut self, rest: f64) -> Result<Attempt, Stopped> {
        let mut segment = self.segment.unwrap_or(Segment { length: rest, level: 0, index: 0 });
        let suggestion = 1.001 * self.suggestion[0];
        let length_of = |level: usize| segment.length * 0.5_f64.powi(level as i32);
        let (mut level, mut index) = (segment.level, segment.index);
        while level > 0 && index.is_multiple_of(2) && length_of(level - 1) <= suggestion {
            (level, index) = (level - 1, index / 2);
        }
        while length_of(level) > suggestion {
            (level, index) = (level + 1, index * 2);
            if level > MOST_LEVELS {
                return Err(Stopped::TooManySteps { row: self.row });
            }
        }
        (segment.level, segment.index) = (level, index);
        self.segment = Some(segment);
        let held = self.layout().held as usize;
        let slots = &self.slots;
        let is_held = |list: &[f64]| list.iter().enumerate().all(|(k, it)| slots[held + k][0] == *it);
        let found = self.kept[0].find(is_held, segment.length, self.setting.tolerance);
        if found.is_none() || self.kept[0].must_recompute(level) {
            if self.leaves_linear(0) {
                self.segment = None;
                return Ok(Attempt::Again);
            }
            if self.take([true], segment.length) == [false] {
                return Ok(Attempt::None);
            }
        }
        let n = self.programs.counts.states;
        self.work[0] += STEP;
        let place = self.kept[0].current.unwrap_or(0);
        if !self.load(0, place, level) {
            return Ok(Attempt::None);
        }
        let h = self.kept[0].parts[place].length_of(level);
        let is_last = index + 1 == 1 << level;
        let taken = if is_last { rest } else { h };
        self.slots[self.programs.layout.step as usize] = [taken];
        self.anchors[0] = Anchor::START;
        if !self.exponential_step() {
            return Ok(Attempt::None);
        }
        let mut size = self.excess(0, rest / taken, 1.0);
        if size > 1.0 {
            self.refine();
            size = self.excess(0, rest / taken, SMALL);
        }
        if size <= 1.0 && self.is_doubtful(0, rest / taken) {
            self.confirm();
            size = size.max(self.unresolved([rest / taken])[0]);
        }
        if size <= 1.0 {
            let end = self.programs.block.end();
            self.step_end.copy_from_slice(&self.slots[end..end + n]);
            self.kept[0].step_accepted();
            self.segment = Some(Segment { index: index + 1, ..segment });
            let grows = level > 0 && size < SMALL;
            let suggestion = if grows { 2.0 * h } else { h };
            return Ok(Attempt::Taken(taken, level, if level == 0 { taken } else { suggestion }));
        }
        if self.kept[0].is_fresh {
            self.suggestion = [shorter(h, size)];
        } else {
            self.kept[0].failed(level);
            if self.take([true], segment.length) == [false] {
                return Ok(Attempt::None);
            }
        }
        Ok(Attempt::Again)
    }
}

#[cfg(test)]
mod tests {
    use crate::equations::lanes::{Lanes, Outputs};
    use crate::equations::{EquationFile, Inputs, Lane, Machine, Method, Setting};
    use rsm_core::source::Source;

    /// A car with drag on a stiff shaft: the Jacobian changes with the speed, in every row by some thousandths.
    const CAR: &str = "model Car\n  parameter Real stiffness = 4000;\n  parameter Real drag = 0.1;\n  input Real torque;\n  Real speed(start = 2.0, fixed = true);\n  \
        output Real twist(start = 0.0, fixed = true);\n  output Real car(start = 2.0, fixed = true);\nequation\n  \
        der(speed) = torque - stiffness*twist - 4*(speed - car);\n  der(twist) = speed - car;\n  \
        der(car) = 0.1*stiffness*twist + 0.4*(speed - car) - drag*car*abs(car);\nend Car;\n";

    #[test]
    fn a_linear_part_serves_for_many_rows_although_the_jacobian_changes() {
        const ROWS: usize = 1000;
        let file = EquationFile::of_text(&Source::new("car.mo", CAR)).unwrap();
        let mut machine = Machine::new(&file).unwrap();
        let start = machine.start(&file, 0.0, &[0.0], &[]).unwrap();
        let time: Vec<f64> = (0..ROWS).map(|k| 0.01 * k as f64).collect();
        let values = [(0..ROWS).map(|k| if k % 200 < 100 { 2.0 } else { -1.0 }).collect()];
        let (lane, inputs) = (Lane::new(&machine, start), Inputs { time: &time, values: &values });
        let mut lanes = Lanes::new(&machine);
        let mut run = |tolerance: f64| -> (Outputs, usize) {
            let found =
                lanes.run(std::slice::from_ref(&lane), inputs, Setting::new(Method::Stiff, tolerance)).remove(0).unwrap();
            (found, lanes.alone.as_ref().map_or(0, |walk| walk.kept[0].computed()))
        };
        let (exact, _) = run(1e-13);
        let (found, parts) = run(1e-8);
        let off = found.iter().flatten().zip(exact.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Numbers of up to 4. The permitted errors of some hundred rows add up.
        assert!(off < 1e-6, "{off:e}");
        // There are 253. With the first estimate alone there are 351, because the slope of the remainder counts as an error.
        assert!(parts < 300, "{parts}");
    }
}

//! A whole row in one step.
//!
//! In: lanes at a row, and the instant of the next row. Out: the lanes at the next row for which one step is valid, and in which no comparison
//! changes; the others are unchanged, and continue alone ([`super::reach`]). A lane tries at most one step by each of: the series, the linear part
//! that it has, a new linear part. A lane in a group goes the same way as a lane alone, so its bits are the same.

use super::choice::{ROW_BY_SERIES, STEP};
use super::engine::Method;
use super::kept::Anchor;
use super::rows::Stopped;
use super::series::Tried;
use super::stiff::{SMALL, shorter};
use super::walk::Walk;

/// What a lane tries next.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Try {
    /// A step of the series.
    Series,
    /// A step by the linear part whose matrices are in its slots.
    Linear,
    /// A new linear part, then a step by it.
    New,
    /// The lane is at the end of the row, or it continues alone.
    Nothing,
}

/// What the steps of an attempt are.
struct Steps<const L: usize> {
    /// For lanes with a step of the series: its order and share.
    series: [Option<Tried>; L],
    is_linear: [bool; L],
    /// Whether the error of a step over the whole row is permitted.
    whole: [bool; L],
}

impl<const L: usize> Walk<'_, L> {
    /// Tries one step to the end of a row in all lanes. Returns the lanes that are there.
    pub(super) fn together(&mut self, now: f64, end: f64) -> Result<[bool; L], Stopped> {
        let rest = end - now;
        let mut right = [false; L];
        let mut tries: [Try; L] = std::array::from_fn(|lane| {
            if lane >= self.used || self.suggestion[lane] < 0.999 * rest {
                Try::Nothing
            } else if self.is_stiff[lane] {
                self.linear_try(lane, rest)
            } else {
                Try::Series
            }
        });
        if tries == [Try::Nothing; L] {
            return Ok(right);
        }
        self.store_step_start();
        while tries != [Try::Nothing; L] {
            self.take_new(&mut tries, rest);
            let steps = self.steps(&tries, rest);
            let there = self.without_events(&steps, now, end);
            if there[0] {
                self.carry_row(steps.series[0], now)?;
            }
            self.update_largest(there);
            for lane in 0..L {
                right[lane] |= there[lane];
                tries[lane] = match tries[lane] {
                    Try::Nothing => Try::Nothing,
                    _ if there[lane] => {
                        self.accept_row(lane, steps.is_linear[lane], rest);
                        Try::Nothing
                    }
                    // A comparison changes in the row, or the rates are not smooth.
                    _ if steps.whole[lane] => Try::Nothing,
                    Try::Series => self.after_series(lane, steps.series[lane], rest),
                    Try::Linear | Try::New => self.after_linear(lane, rest),
                };
            }
        }
        Ok(right)
    }

    /// How a lane with linear parts tries a row: by the part that it has; if that is useless, sometimes by the series, and else by a new part.
    fn linear_try(&mut self, lane: usize, rest: f64) -> Try {
        if !self.has_exponential() {
            Try::Nothing
        } else if self.select(lane, rest) && !self.kept[lane].must_recompute(0) {
            Try::Linear
        } else if self.leaves_linear(lane) {
            Try::Series
        } else {
            Try::New
        }
    }

    /// Computes new linear parts, and loads their matrices.
    fn take_new(&mut self, tries: &mut [Try; L], rest: f64) {
        let is_new = tries.map(|it| it == Try::New);
        if !is_new.contains(&true) {
            return;
        }
        let found = self.take(is_new, rest);
        for lane in (0..L).filter(|lane| is_new[*lane]) {
            let place = self.kept[lane].current.filter(|_| found[lane]);
            let is_loaded = place.is_some_and(|place| self.load(lane, place, 0));
            tries[lane] = if is_loaded { Try::Linear } else { Try::Nothing };
        }
    }

    /// Computes the steps. The states at their ends are in `step_end`.
    fn steps(&mut self, tries: &[Try; L], rest: f64) -> Steps<L> {
        let is_series = tries.map(|it| it == Try::Series);
        let is_linear = tries.map(|it| it == Try::Linear);
        let series = if is_series.contains(&true) { self.series([rest; L], is_series) } else { [None; L] };
        let mut whole: [bool; L] = std::array::from_fn(|lane| series[lane].is_some_and(|it| it.share == 1.0));
        (0..L).filter(|lane| is_series[*lane]).for_each(|lane| self.work[lane] += ROW_BY_SERIES);
        if is_linear.contains(&true) {
            self.slots[self.programs.layout.step as usize] = [rest; L];
            self.exponential_step();
            let (end, fits) = (self.programs.block.end(), self.allowed());
            for lane in (0..L).filter(|lane| is_linear[*lane]) {
                self.anchors[lane] = Anchor::START;
                whole[lane] = fits[lane];
                for k in 0..self.programs.counts.states {
                    self.step_end[k][lane] = self.slots[end + k][lane];
                }
            }
        }
        Steps { series, is_linear, whole }
    }

    /// Moves lanes to the ends of their steps if no comparison changes there or before. Returns these lanes; the others are at the start.
    fn without_events(&mut self, steps: &Steps<L>, now: f64, end: f64) -> [bool; L] {
        let Steps { series, is_linear, whole } = steps;
        if !whole.contains(&true) {
            return [false; L];
        }
        let rest = end - now;
        self.move_to_step_end([end; L], *whole);
        let agree = self.slopes_agree([rest; L], series);
        let differ = self.sides_differ();
        let mut right: [bool; L] = std::array::from_fn(|lane| whole[lane] && agree[lane] && !differ[lane]);
        if self.programs.counts.held > 0 && right.contains(&true) {
            let order = series[0].map(|it| it.order).filter(|_| right == [true; L]);
            let order = order.filter(|order| series.iter().all(|it| it.is_some_and(|it| it.order == *order)));
            let found = self.changes_inside(right, &mut |walk, share| {
                if let Some(order) = order {
                    walk.put_on_series(order, share, now + share * rest);
                    return;
                }
                for lane in (0..L).filter(|lane| right[*lane]) {
                    if is_linear[lane] {
                        walk.put_inside(lane, 0, share, now + share * rest);
                    } else {
                        walk.put_lane_on_series(lane, series[lane], share, now + share * rest);
                    }
                }
            });
            (0..L).for_each(|lane| right[lane] &= found[lane].is_none());
            self.move_to_step_end([end; L], right);
        }
        for lane in (0..L).filter(|lane| whole[*lane] && !right[*lane]) {
            self.move_to_step_start(lane, now);
        }
        right
    }

    /// A lane is at the end of the row.
    fn accept_row(&mut self, lane: usize, is_linear: bool, rest: f64) {
        self.kept[lane].moved();
        // A step by a linear part that failed is not counted: it shares its time with the other lanes. One of the series is.
        self.work[lane] += if is_linear { STEP } else { 0 };
        let next = if is_linear { rest } else { 2.0 * rest };
        self.suggestion[lane] = self.suggestion[lane].max(next);
    }

    /// After a step of the series that was too long.
    fn after_series(&mut self, lane: usize, tried: Option<Tried>, rest: f64) -> Try {
        let enters = tried.is_some_and(|it| self.enters_linear(lane, 1.0 / it.share));
        if enters { self.linear_try(lane, rest) } else { Try::Nothing }
    }

    /// After a step by a linear part whose error was too large.
    fn after_linear(&mut self, lane: usize, rest: f64) -> Try {
        if self.kept[lane].is_fresh {
            self.suggestion[lane] = shorter(rest, self.excess(lane, 1.0, SMALL));
            return Try::Nothing;
        }
        self.kept[lane].failed(0);
        self.linear_try(lane, rest)
    }

    /// Whether a lane uses linear parts from now on: they are expected to need less work than this number of steps of the series for a row.
    pub(super) fn enters_linear(&mut self, lane: usize, steps: f64) -> bool {
        let is_open = self.setting.method == Method::Automatic && !self.is_stiff[lane] && self.has_exponential();
        let choice = &mut self.kept[lane].choice;
        if !is_open || !choice.prefers_linear(steps, self.row) {
            return false;
        }
        choice.enter_linear(steps, self.row, self.work[lane]);
        self.is_stiff[lane] = true;
        true
    }

    /// Whether a lane tries the series in place of a new linear part.
    pub(super) fn leaves_linear(&mut self, lane: usize) -> bool {
        if self.setting.method != Method::Automatic || !self.kept[lane].choice.leaves_linear(self.row, self.work[lane]) {
            return false;
        }
        self.is_stiff[lane] = false;
        true
    }

    /// Carries the sensitivities over a whole row: by a step of the series, or by a linear part.
    pub(super) fn carry_row(&mut self, series: Option<Tried>, begin: f64) -> Result<(), Stopped> {
        match series {
            _ if self.carried.is_none() => Ok(()),
            Some(tried) => {
                self.carry_step(tried, 1.0, begin);
                Ok(())
            }
            None => self.carry_linear_step(1.0, begin),
        }
    }

    /// Stops a run that has used up its work.
    #[inline]
    pub(super) fn within_limit(&self) -> Result<(), Stopped> {
        if self.work[..self.used].iter().all(|it| *it <= self.setting.work) {
            return Ok(());
        }
        Err(Stopped::TooManySteps { row: self.row })
    }
}

#[cfg(test)]
mod tests {
    use crate::equations::lanes::Lanes;
    use crate::equations::{EquationFile, Inputs, Lane, Machine, Setting};
    use rsm_core::source::Source;

    /// Stiff for a fifth of a second, and slow for the rest; its Jacobian changes from row to row.
    const EARLY: &str = "model Early\n  parameter Real w = 3;\n  output Real x(start = 0.0, fixed = true);\nequation\n  \
        der(x) = (if time < 0.2 then 2e4 else 5)*(2*cos(w*time) - x - x*x*x);\nend Early;\n";

    #[test]
    fn a_plant_that_is_stiff_for_a_part_of_a_record_costs_little_in_the_rest() {
        let file = EquationFile::of_text(&Source::new("early.mo", EARLY)).unwrap();
        let mut machine = Machine::new(&file).unwrap();
        let start = machine.start(&file, 0.0, &[], &[]).unwrap();
        let time: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        let lane = Lane::new(&machine, start);
        let mut lanes = Lanes::new(&machine);
        let mut run = |rows: usize| {
            let inputs = Inputs { time: &time[..rows], values: &[] };
            lanes.run(std::slice::from_ref(&lane), inputs, Setting::default()).remove(0).unwrap();
            let walk = lanes.alone.as_ref().unwrap();
            (walk.work[0], walk.is_stiff[0])
        };
        let (stiff, all) = (run(20), run(1000));

        assert!(stiff.1 && !all.1, "the series was not tried again");
        // A row by one step of the series is a work of 4, a new linear part and a step with it are 9. Some rows try the other method: 5.2 on average.
        assert!(all.0 - stiff.0 < 6 * 980, "{stiff:?} {all:?}");
    }
}

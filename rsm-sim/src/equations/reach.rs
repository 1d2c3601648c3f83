//! The way of a single lane from one row to the next.
//!
//! In: a walk at an instant, and the next instant. Out: the walk at the next instant. The lane handles everything that happens before it: the step
//! length follows from the error, a step ends where a comparison changes, and then the event is executed. Before that, one step over the whole row is
//! tried ([`super::whole_row`]), as in a group of lanes.

use super::choice::SERIES;
use super::engine::Method;
use super::late::DelayedSignals;
use super::methods::{self, Linear, Stepped};
use super::rows::{MOST_EVENTS, MOST_STEPS, Stopped};
use super::series::Tried;
use super::stiff::Attempt;
use super::walk::Walk;

/// A plant is stiff if one row needs more steps of the series than this.
const STIFF: usize = 24;

/// Bisections that locate an event. They stop earlier when the bracket cannot be divided any more.
const HALVINGS: usize = 60;

/// The limits of the change of a step length from one step to the next, and the safety factor (E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary
/// Differential Equations I", II.4).
const SHORTEST: f64 = 0.2;
const LONGEST: f64 = 5.0;
const SAFETY: f64 = 0.9;

/// After a step of the series with the largest permitted length, the next step is tried with this factor. The attempt costs no additional terms, and
/// the terms show whether the longer step is permitted.
const TRY: f64 = 1.5;

/// The method of the last step: with it, the states at the end or inside of the step can be computed again.
#[derive(Clone, Copy)]
enum Way {
    Series(Tried),
    Pair,
    Stiff,
    /// By a linear part, with this number of halvings.
    Exponential(usize),
}

impl<const L: usize> Walk<'_, L> {
    pub(super) fn move_to_step_end(&mut self, time: [f64; L], lanes: [bool; L]) {
        let layout = self.programs.layout;
        let states = layout.states as usize;
        if lanes == [true; L] {
            self.slots[states..states + self.programs.counts.states].copy_from_slice(&self.step_end);
            self.slots[layout.time as usize] = time;
            return;
        }
        for lane in (0..L).filter(|lane| lanes[*lane]) {
            for k in 0..self.programs.counts.states {
                self.slots[states + k][lane] = self.step_end[k][lane];
            }
            self.slots[layout.time as usize][lane] = time[lane];
        }
    }

    pub(super) fn move_to_step_start(&mut self, lane: usize, time: f64) {
        let layout = self.programs.layout;
        for k in 0..self.programs.counts.states {
            self.slots[layout.states as usize + k][lane] = self.before[k][lane];
        }
        self.slots[layout.time as usize][lane] = time;
    }

    /// Updates the largest magnitudes with the current states.
    pub(super) fn update_largest(&mut self, lanes: [bool; L]) {
        let states = self.programs.layout.states as usize;
        let largest = self.programs.layout.largest as usize;
        for k in 0..self.programs.counts.states {
            let state = self.slots[states + k];
            let largest = &mut self.slots[largest + k];
            for lane in 0..L {
                if lanes[lane] {
                    largest[lane] = largest[lane].max(state[lane].abs());
                }
            }
        }
    }
}

impl Walk<'_, 1> {
    /// Advances from one row to the next, in one step if that is possible.
    pub(super) fn reach_row(&mut self, now: f64, end: f64, late: &mut DelayedSignals<'_>) -> Result<(), Stopped> {
        if self.programs.counts.guesses == 0 && !late.has_signals() && self.is_free(now, end) {
            if self.can_be_plain() {
                if self.carried.is_some() {
                    self.store_step_start();
                }
                if self.plain(now, end) {
                    let series =
                        (!self.is_stiff[0]).then(|| Tried { order: self.programs.first_order().unwrap_or(0), share: 1.0 });
                    self.carry_row(series, now)?;
                    return self.within_limit();
                }
            }
            if self.together(now, end)? == [true] {
                return self.within_limit();
            }
        }
        self.reach(end, late)
    }

    /// Advances to an instant, and handles everything that happens before it.
    pub(super) fn reach(&mut self, end: f64, late: &mut DelayedSignals<'_>) -> Result<(), Stopped> {
        let (mut steps, mut events) = (0, 0);
        while self.time(0) < end {
            let (due, next) = self.next_sample(self.time(0), end);
            let arrival = late.next(self.time(0), next);
            let is_event = self.advance(arrival.unwrap_or(next), &mut steps)?;
            let now = self.time(0);
            if arrival.is_some_and(|it| now >= it) {
                let changed = self.exchange(late);
                if late.is_read(now) {
                    late.read(now, self.evaluate_outputs());
                }
                if changed {
                    self.execute_events_and_send(now, late)?;
                }
                continue;
            }
            let is_due = due && now >= next;
            if is_event || is_due {
                events += 1;
                if events > MOST_EVENTS {
                    return Err(Stopped::TooManyEvents { row: self.row });
                }
                if now < end || is_event {
                    self.execute_events_and_send(now, late)?;
                }
            }
        }
        Ok(())
    }

    /// Sends the current values of signals, and stores the values that have arrived. Returns whether an input changed.
    pub(super) fn exchange(&mut self, late: &mut DelayedSignals<'_>) -> bool {
        let (time, layout) = (self.time(0), self.programs.layout);
        let (before, memories) = self.slots.split_at_mut(layout.memories as usize);
        let changed = late.exchange(time, &mut before[layout.inputs as usize..], memories);
        if changed {
            self.refresh();
        }
        changed
    }

    /// Executes the events that are due, and sends the signals that they changed.
    pub(super) fn execute_events_and_send(&mut self, now: f64, late: &mut DelayedSignals<'_>) -> Result<(), Stopped> {
        self.execute_events(now)?;
        if self.exchange(late) { self.execute_events(now) } else { Ok(()) }
    }

    /// Advances to an instant, or to the first event before it. Returns whether an event occurred.
    fn advance(&mut self, next: f64, steps: &mut usize) -> Result<bool, Stopped> {
        let (begin, work) = (*steps, self.work[0]);
        (self.linear, self.segment) = (None, None);
        while self.time(0) < next {
            *steps += 1;
            if *steps > MOST_STEPS {
                return Err(Stopped::TooManySteps { row: self.row });
            }
            self.within_limit()?;
            self.choose(*steps - begin, work);
            let now = self.time(0);
            let rest = next - now;
            // If the suggested step nearly reaches the end, it is extended to the end. This avoids a very short last step.
            let h = if self.suggestion[0] >= 0.999 * rest { rest } else { self.suggestion[0] };
            self.store_step_start();
            let (taken, way, suggestion) = match self.step(h, rest)? {
                Some(found) => found,
                None => {
                    if now + self.suggestion[0] <= now {
                        return Err(Stopped::TooManySteps { row: self.row });
                    }
                    continue;
                }
            };
            if !matches!(way, Way::Exponential(_)) {
                self.kept[0].moved();
            }
            let reached = if taken == rest { next } else { now + taken };
            self.move_to_step_end([reached], [true]);
            if !self.settle() {
                return Err(Stopped::NoSolution { row: self.row });
            }
            if let Way::Series(tried) = way
                && self.slopes_agree([h], &[Some(tried)]) == [false]
            {
                self.move_to_step_start(0, now);
                self.settle();
                self.suggestion = [0.5 * taken];
                if now + self.suggestion[0] <= now {
                    return Err(Stopped::TooManySteps { row: self.row });
                }
                continue;
            }
            if self.programs.counts.held > 0 {
                let [found] = self.changes_inside([true], &mut |walk, share| {
                    walk.inside(&way, (now, h), taken, share);
                });
                if let Some(bracket) = found {
                    // A step that ends at an event does not change the suggested length.
                    let share = self.locate(&way, (now, h), taken, bracket)?;
                    self.carry_over(&way, share, now)?;
                    self.carry_event()?;
                    self.update_largest([true]);
                    return self.not_finite(0).map_or(Ok(true), Err);
                }
                self.move_to_step_end([reached], [true]);
                if !self.settle() {
                    return Err(Stopped::NoSolution { row: self.row });
                }
            }
            if let Some(stopped) = self.not_finite(0) {
                return Err(stopped);
            }
            self.carry_over(&way, 1.0, now)?;
            self.update_largest([true]);
            // A step that was shortened to end at a row keeps the suggestion or increases it.
            self.suggestion = [if taken == rest { self.suggestion[0].max(suggestion) } else { suggestion }];
            self.linear = None;
        }
        self.enters_linear(0, (*steps - begin) as f64);
        Ok(false)
    }

    /// Chooses between the series and the stiff method before the next step in a row, which began with this work.
    fn choose(&mut self, steps: usize, work: u64) {
        if self.setting.method != Method::Automatic {
            return;
        }
        if !self.is_stiff[0] {
            if steps > STIFF {
                self.is_stiff = [true];
                self.kept[0].choice.enter_linear(f64::INFINITY, self.row, self.work[0]);
            }
        } else if self.kept[0].choice.exceeds_budget(self.row, self.work[0] - work) {
            (self.is_stiff, self.segment) = ([false], None);
        }
    }

    /// Tries one step. Returns its length, its method and the suggested next length, or `None` if the step failed; then the suggested length is
    /// shorter.
    fn step(&mut self, h: f64, rest: f64) -> Result<Option<(f64, Way, f64)>, Stopped> {
        if self.is_stiff[0] && self.has_exponential() {
            match self.exponential(rest)? {
                Attempt::Taken(taken, level, suggestion) => return Ok(Some((taken, Way::Exponential(level), suggestion))),
                Attempt::Again => return Ok(None),
                Attempt::None => self.segment = None,
            }
        } else if self.is_stiff[0] && self.has_linear() {
            self.work[0] += SERIES;
            let stepped = self.stiff(h);
            let Some(stepped) = stepped else {
                self.suggestion = [SHORTEST * h];
                return Ok(None);
            };
            return Ok(self.judged(&stepped, h, rest, Way::Stiff, cube_root_of_inverse));
        }
        self.work[0] += SERIES;
        let [tried] = self.series([h], [true]);
        let Some(tried) = tried else {
            // The square root of 0 has no series. The explicit pair can step over it.
            let stepped = self.pair(h);
            return Ok(self.judged(&stepped, h, rest, Way::Pair, fifth_root_of_inverse));
        };
        if self.enters_linear(0, rest / (tried.share * h)) {
            return Ok(None);
        }
        if tried.share < 1.0 {
            let taken = tried.share * h;
            return Ok(Some((taken, Way::Series(tried), TRY * taken)));
        }
        Ok(Some((h, Way::Series(tried), 2.0 * h)))
    }

    /// Accepts a step of an embedded pair if its error is permitted. `change`: the factor of the step length for an error that is the given multiple
    /// of the permitted one.
    fn judged(&mut self, stepped: &Stepped, h: f64, rest: f64, way: Way, change: fn(f64) -> f64) -> Option<(f64, Way, f64)> {
        let size = self.error(stepped, h, rest);
        let change = if size == 0.0 {
            LONGEST
        } else if size.is_finite() {
            SAFETY * change(size)
        } else {
            SHORTEST
        };
        if size.is_nan() || size > 1.0 {
            self.suggestion = [h * change.max(SHORTEST)];
            return None;
        }
        self.step_end.iter_mut().zip(&stepped.states).for_each(|(to, from)| *to = [*from]);
        Some((h, way, h * change.clamp(SHORTEST, LONGEST)))
    }

    fn pair(&mut self, h: f64) -> Stepped {
        let time = self.time(0);
        let from: Vec<f64> = self.before.iter().map(|it| it[0]).collect();
        let stepped = methods::explicit(&mut |share, states| self.rates_at(time + share * h, states), &from, h);
        self.move_to_step_start(0, time);
        stepped
    }

    /// The rates at an instant and at given states.
    fn rates_at(&mut self, time: f64, states: &[f64]) -> Vec<f64> {
        let layout = self.programs.layout;
        let (begin, count) = (layout.states as usize, states.len());
        self.slots[begin..begin + count].iter_mut().zip(states).for_each(|(slot, state)| *slot = [*state]);
        self.slots[layout.time as usize] = [time];
        self.programs.rates.code.run(&mut self.slots, &mut self.spare);
        let results = self.programs.rates.results as usize;
        self.slots[results..results + count].iter().map(|it| it[0]).collect()
    }

    /// Whether the Jacobian at this point is finite: at a square root of 0 it is not. Then the series is used.
    fn has_linear(&mut self) -> bool {
        if self.linear.is_none() {
            self.linear = Some(self.linear());
        }
        self.setting.method == Method::Stiff || self.linear.as_ref().is_some_and(Linear::is_finite)
    }

    fn stiff(&mut self, h: f64) -> Option<Stepped> {
        let linear = self.linear.take().unwrap_or_else(|| self.linear());
        let time = self.time(0);
        let from: Vec<f64> = self.before.iter().map(|it| it[0]).collect();
        let stepped = methods::stiff(&mut |share, states| self.rates_at(time + share * h, states), &from, h, &linear);
        self.linear = Some(linear);
        self.move_to_step_start(0, time);
        stepped
    }

    /// The largest error of the states in a step, as a multiple of the permitted error.
    fn error(&self, stepped: &Stepped, h: f64, rest: f64) -> f64 {
        let mut worst = 0.0_f64;
        for (k, (end, error)) in stepped.states.iter().zip(&stepped.error).enumerate() {
            if !end.is_finite() || !error.is_finite() {
                return f64::INFINITY;
            }
            let (begin, largest) = (self.before[k][0], self.largest(k)[0]);
            let scale = largest.max(begin.abs()).max(((end - begin) / h * rest).abs());
            // A state that is 0, stays 0 and has an error of 0 is correct.
            if *error != 0.0 {
                worst = worst.max(error.abs() / (self.setting.tolerance * scale));
            }
        }
        worst
    }

    /// Moves the walk to a share of the last step, and returns whether a comparison has changed there. `None` if the step has no solution.
    fn inside(&mut self, way: &Way, (now, h): (f64, f64), taken: f64, share: f64) -> Option<bool> {
        let time = now + share * taken;
        match way {
            Way::Series(tried) => self.put_on_series(tried.order, tried.share * share, time),
            Way::Exponential(level) => self.put_inside(0, *level, share, time),
            // A step of length 0 has no matrix.
            Way::Stiff | Way::Pair if share == 0.0 => self.move_to_step_start(0, now),
            Way::Stiff | Way::Pair => {
                self.move_to_step_start(0, now);
                let length = share * taken.min(h);
                let stepped = if matches!(way, Way::Pair) { self.pair(length) } else { self.stiff(length)? };
                let (states, count) = (self.programs.layout.states as usize, self.programs.counts.states);
                self.slots[states..states + count].iter_mut().zip(&stepped.states).for_each(|(to, from)| *to = [*from]);
                self.slots[self.programs.layout.time as usize] = [time];
            }
        }
        self.settle();
        Some(self.sides_differ() == [true])
    }

    /// Carries the sensitivities over a share of the last step.
    fn carry_over(&mut self, way: &Way, share: f64, begin: f64) -> Result<(), Stopped> {
        match way {
            _ if self.carried.is_none() => Ok(()),
            Way::Series(tried) => {
                self.carry_step(*tried, tried.share * share, begin);
                Ok(())
            }
            Way::Exponential(_) => self.carry_linear_step(share, begin),
            _ => Err(Stopped::Step(format!("row {}: the solution has no series here, so it has no derivative", self.row + 1))),
        }
    }

    /// Ends a step where its first comparison changes, between two shares of the step. Returns the share.
    fn locate(&mut self, way: &Way, (now, h): (f64, f64), taken: f64, bracket: (f64, f64)) -> Result<f64, Stopped> {
        let (mut before, mut after) = bracket;
        self.is_locating = true;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (before + after);
            let instant = now + middle * taken;
            if middle <= before || middle >= after || instant <= now + before * taken || instant >= now + after * taken {
                break;
            }
            match self.inside(way, (now, h), taken, middle) {
                Some(true) => after = middle,
                Some(false) => before = middle,
                None => break,
            }
        }
        let placed = self.inside(way, (now, h), taken, after);
        self.is_locating = false;
        placed.map(|_| after).ok_or(Stopped::TooManySteps { row: self.row })
    }
}

/// 1 over a root, limited to the largest growth of a step, with the same bits on every machine.
fn root_of_inverse(size: f64, degree: usize) -> f64 {
    let wanted = 1.0 / size;
    let (mut low, mut high) = (0.0_f64, LONGEST / SAFETY);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if (0..degree).fold(1.0, |product, _| product * middle) < wanted { low = middle } else { high = middle }
    }
    high
}

/// For the stiff pair, whose lower order is 2.
fn cube_root_of_inverse(size: f64) -> f64 {
    root_of_inverse(size, 3)
}

/// For the explicit pair, whose lower order is 4.
fn fifth_root_of_inverse(size: f64) -> f64 {
    root_of_inverse(size, 5)
}

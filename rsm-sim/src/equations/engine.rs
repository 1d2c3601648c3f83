//! Runs a plant of equations along its inputs.
//!
//! In: a machine at its start, the inputs at every row. Out: the outputs at every row. Inputs hold from row to row. A step is as long as its estimated error allows; where a comparison changes inside a step, the instant
//! is located and the step ends there, and what the text wants to happen then happens. The same machine and inputs give the same bits.

use super::fixed;
use super::late::Late;
use super::machine::{Happening, Machine, Point};
use super::methods::{self, Linear, Stepped};
use super::rows::{Inputs, MOST_EVENTS, MOST_STEPS, Stopped};

/// How time moves on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// Explicit, orders 5 and 4, until it needs many steps a row; stiff from there on.
    Automatic,
    /// Explicit, orders 5 and 4.
    Explicit,
    /// Stiff, orders 3 and 2, with the exact Jacobian.
    Stiff,
    /// The classical Runge-Kutta method with steps of one length, a whole share of the time between two rows. Its error is not estimated, and nothing is located in time.
    Fixed {
        /// The length of a step in s.
        step: f64,
    },
}

/// How a plant runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// How time moves on.
    pub method: Method,
    /// The error of a step, relative to the largest value that a state has had, or changes by in one row.
    pub tolerance: f64,
}

impl Default for Setting {
    fn default() -> Self {
        Setting { method: Method::Automatic, tolerance: 1e-8 }
    }
}

/// An explicit method that takes more steps a row than this for its stability or its error is dearer than a stiff one, whose steps cost some five explicit ones.
const STIFF: usize = 100;

/// An event is located to this share of the time that its step takes. A double has 53 bits; so many halvings reach the last of them.
const HALVINGS: usize = 60;

/// Turns of what happens at one instant until it stands still.
const TURNS: usize = 100;

/// A step grows or shrinks by these at most, and is a little shorter than its error suggests (E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", II.4).
const SHORTEST: f64 = 0.2;
const LONGEST: f64 = 5.0;
const SAFETY: f64 = 0.9;

/// A run.
struct Run<'m> {
    machine: &'m Machine,
    setting: Setting,
    point: Point,
    /// Conditions of branches, as they were last.
    conditions: Vec<Vec<f64>>,
    /// Of each `sample` how many instants are past.
    past: Vec<u64>,
    /// The largest value of each state so far.
    largest: Vec<f64>,
    /// The step that the error suggests.
    step: f64,
    is_stiff: bool,
    row: usize,
    late: Late<'m>,
}

/// Runs a machine from its start along inputs. By output: its value at every row.
///
/// # Errors
/// Why a row could not be reached.
///
/// # Panics
/// When an input has fewer rows than the time.
pub fn run(machine: &Machine, start: Point, inputs: Inputs<'_>, setting: Setting) -> Result<Vec<Vec<f64>>, Stopped> {
    if let Method::Fixed { step } = setting.method {
        return fixed::run(machine, &start, inputs, step);
    }
    let n = start.states.len();
    let period = inputs.time.windows(2).next().map_or(1.0, |pair| pair[1] - pair[0]);
    let mut run = Run {
        machine,
        setting,
        conditions: Vec::new(),
        past: vec![0; machine.samples().len()],
        largest: (0..n).map(|k| machine.nominal(k).unwrap_or(0.0)).collect(),
        step: period,
        is_stiff: setting.method == Method::Stiff,
        row: 0,
        point: start,
        late: Late::new(machine, inputs.time, period),
    };
    run.conditions = run.happening(&[], &[]).branches.into_iter().map(|it| it.conditions).collect();
    let names = machine.outputs();
    let mut outputs = vec![Vec::with_capacity(inputs.time.len()); names.len()];
    for row in 0..inputs.time.len() {
        run.row = row;
        if row > 0 {
            run.reach(inputs.time[row])?;
        }
        let values = inputs.at(row);
        run.point.inputs[..values.len()].copy_from_slice(&values);
        run.late.exchange(&mut run.point);
        run.happen_and_send()?;
        let found = machine.look(&run.point).outputs;
        run.late.read(run.point.time, &found);
        for ((list, value), (name, _)) in outputs.iter_mut().zip(found).zip(&names) {
            if !value.is_finite() {
                return Err(Stopped::NotFinite { row, name: name.clone() });
            }
            list.push(value);
        }
    }
    run.late.finish(&mut outputs);
    Ok(outputs)
}

impl Run<'_> {
    /// Goes on to an instant, over everything that happens before it.
    fn reach(&mut self, end: f64) -> Result<(), Stopped> {
        let (mut steps, mut events) = (0, 0);
        while self.point.time < end {
            let (due, next) = self.next_sample(end);
            let coming = self.late.next(self.point.time, next);
            let is_event = self.advance(coming.unwrap_or(next), &mut steps)?;
            if coming.is_some_and(|it| self.point.time >= it) {
                let changed = self.late.exchange(&mut self.point);
                if self.late.is_read(self.point.time) {
                    let found = self.machine.look(&self.point).outputs;
                    self.late.read(self.point.time, &found);
                }
                if changed {
                    self.happen_and_send()?;
                }
                continue;
            }
            let is_due = due && self.point.time >= next;
            if is_event || is_due {
                events += 1;
                if events > MOST_EVENTS {
                    return Err(Stopped::TooManyEvents { row: self.row });
                }
                if self.point.time < end || is_event {
                    self.happen_and_send()?;
                }
            }
        }
        Ok(())
    }

    /// Lets happen what is due, and sends on what it changed.
    fn happen_and_send(&mut self) -> Result<(), Stopped> {
        self.happen()?;
        if self.late.exchange(&mut self.point) { self.happen() } else { Ok(()) }
    }

    /// The next instant of a `sample` up to an end, or the end.
    fn next_sample(&self, end: f64) -> (bool, f64) {
        let instants =
            self.machine.samples().iter().zip(&self.past).map(|((first, period), past)| first + *past as f64 * period);
        let next = instants.filter(|it| *it > self.point.time).fold(f64::INFINITY, f64::min);
        if next <= end { (true, next) } else { (false, end) }
    }

    /// Goes on to an instant, or to the first event before it, which it tells.
    fn advance(&mut self, next: f64, steps: &mut usize) -> Result<bool, Stopped> {
        let begin = *steps;
        let mut linear: Option<Linear> = None;
        let (mut first, _) = self.machine.rates_and_truths(&self.point);
        while self.point.time < next {
            *steps += 1;
            if *steps > MOST_STEPS {
                return Err(Stopped::TooManySteps { row: self.row });
            }
            if self.setting.method == Method::Automatic && *steps - begin > STIFF {
                self.is_stiff = true;
            }
            let rest = next - self.point.time;
            // What is left is taken in one step where a step nearly reaches: no crumbs.
            let h = if self.step >= 0.999 * rest { rest } else { self.step };
            let stepped = self.stepped(h, &first, &mut linear);
            let scale = |it: &Stepped| self.scale(&first, rest, it, h);
            let size = stepped.as_ref().map_or(f64::INFINITY, |it| error(it, &scale(it), self.setting.tolerance));
            if size.is_nan() || size > 1.0 {
                let shrunk = if size.is_finite() { (SAFETY * size.powf(-self.order())).max(SHORTEST) } else { SHORTEST };
                self.step = h * shrunk;
                if self.point.time + self.step <= self.point.time {
                    return Err(Stopped::TooManySteps { row: self.row });
                }
                continue;
            }
            let Some(stepped) = stepped else { continue };
            let grown = if size == 0.0 { LONGEST } else { (SAFETY * size.powf(-self.order())).clamp(SHORTEST, LONGEST) };
            let reached = if h == rest { next } else { self.point.time + h };
            let mut behind = Point { time: reached, states: stepped.states, ..self.point.clone() };
            if !self.machine.settle(&mut behind) {
                return Err(Stopped::NoSolution { row: self.row });
            }
            let (rates, truths) = self.machine.rates_and_truths(&behind);
            if truths != self.point.held || self.changes_inside(&first, &behind, &rates) {
                // A step that ends at an event says nothing of the next one's length.
                self.locate(h, &first, &mut linear)?;
                return Ok(true);
            }
            self.take(behind)?;
            // A step that was cut to end at a row leaves the suggestion as it was, or raises it.
            self.step = if h < self.step { self.step.max(h * grown) } else { h * grown };
            (first, linear) = (rates, None);
        }
        Ok(false)
    }

    /// One over one more than the lower order of the pair.
    fn order(&self) -> f64 {
        if self.is_stiff { 1.0 / 3.0 } else { 1.0 / 5.0 }
    }

    fn stepped(&self, h: f64, first: &[f64], linear: &mut Option<Linear>) -> Option<Stepped> {
        if !self.is_stiff {
            return Some(methods::explicit(self.machine, &self.point, h, first));
        }
        let linear = linear.get_or_insert_with(|| Linear::at(self.machine, &self.point));
        if self.setting.method == Method::Automatic && !linear.is_finite() {
            return Some(methods::explicit(self.machine, &self.point, h, first));
        }
        methods::stiff(self.machine, &self.point, h, linear)
    }

    /// What an error of each state is compared with: the largest value so far, or what it changes by up to the next row, at its first rate or at the mean
    /// rate of the step. A plant at rest that is pushed has positions of 0 with rates of 0: the mean rate alone is a measure of them.
    fn scale(&self, rates: &[f64], rest: f64, stepped: &Stepped, h: f64) -> Vec<f64> {
        let each = self.largest.iter().zip(rates).zip(self.point.states.iter().zip(&stepped.states));
        each.map(|((largest, rate), (state, end))| {
            let changes = (rate * rest).abs().max(((end - state) / h * rest).abs());
            largest.max(state.abs()).max(changes)
        })
        .collect()
    }

    fn take(&mut self, point: Point) -> Result<(), Stopped> {
        if let Some(k) = point.states.iter().position(|it| !it.is_finite()) {
            return Err(Stopped::NotFinite { row: self.row, name: self.machine.states()[k].0.clone() });
        }
        self.largest.iter_mut().zip(&point.states).for_each(|(largest, it)| *largest = largest.max(it.abs()));
        self.point = point;
        Ok(())
    }

    /// Whether a comparison changes inside a step and back again: looked at on the cubic through both ends and their rates.
    fn changes_inside(&self, first: &[f64], behind: &Point, last: &[f64]) -> bool {
        if self.point.held.is_empty() {
            return false;
        }
        let h = behind.time - self.point.time;
        [0.25, 0.5, 0.75].into_iter().any(|share: f64| {
            let (s, r) = (share, 1.0 - share);
            let mut between = behind.clone();
            between.time = self.point.time + s * h;
            for (k, state) in between.states.iter_mut().enumerate() {
                let (a, b) = (self.point.states[k], behind.states[k]);
                *state = r * a + s * b + s * r * (r * (h * first[k] - (b - a)) - s * (h * last[k] - (b - a)));
            }
            self.machine.rates_and_truths(&between).1 != self.point.held
        })
    }

    /// Ends a step where the first comparison changes in it.
    fn locate(&mut self, h: f64, first: &[f64], linear: &mut Option<Linear>) -> Result<(), Stopped> {
        let (mut before, mut after) = (0.0, h);
        let mut found: Option<Point> = None;
        let at = |run: &Self, share: f64, linear: &mut Option<Linear>| {
            let stepped = run.stepped(share, first, linear)?;
            let mut behind = Point { time: run.point.time + share, states: stepped.states, ..run.point.clone() };
            run.machine.settle(&mut behind);
            let changed = run.machine.rates_and_truths(&behind).1 != run.point.held;
            Some((behind, changed))
        };
        // A change that is taken back inside the step is looked for at quarters of it first.
        for quarter in 1..=4 {
            let share = h * f64::from(quarter) / 4.0;
            if let Some((point, true)) = at(self, share, linear) {
                (before, after, found) = (h * f64::from(quarter - 1) / 4.0, share, Some(point));
                break;
            }
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (before + after);
            if middle <= before || middle >= after {
                break;
            }
            match at(self, middle, linear) {
                Some((point, true)) => (after, found) = (middle, Some(point)),
                Some((_, false)) => before = middle,
                None => break,
            }
        }
        match found {
            Some(point) => self.take(point),
            // On the cubic it changed, along the method itself it does not.
            None => match at(self, h, linear) {
                Some((point, _)) => self.take(point),
                None => Err(Stopped::TooManySteps { row: self.row }),
            },
        }
    }

    fn happening(&self, acts: &[f64], due: &[f64]) -> Happening {
        let none = |given: &[f64], count: usize| if given.is_empty() { vec![0.0; count] } else { given.to_vec() };
        let acts = none(acts, self.machine.system().events().len());
        self.machine.happening(&self.point, &acts, &none(due, self.past.len()))
    }

    /// What happens at this instant, turn by turn, until nothing changes any more.
    fn happen(&mut self) -> Result<(), Stopped> {
        let now = self.point.time;
        let mut due: Vec<f64> = Vec::new();
        for (past, (first, period)) in self.past.iter_mut().zip(self.machine.samples()) {
            // Instants of rows and of samples are sums and products of decimals, and meet to a few units in the last place.
            let is_due = first + *past as f64 * period <= now + 8.0 * f64::EPSILON * now.abs();
            *past += u64::from(is_due);
            due.push(f64::from(u8::from(is_due)));
        }
        if !self.machine.settle(&mut self.point) {
            return Err(Stopped::NoSolution { row: self.row });
        }
        for _ in 0..TURNS {
            let (_, truths) = self.machine.rates_and_truths(&self.point);
            let mut changed = truths != self.point.held;
            self.point.held = truths;
            let conditions: Vec<Vec<f64>> = self.happening(&[], &due).branches.into_iter().map(|it| it.conditions).collect();
            let mut acts: Vec<f64> = Vec::new();
            for (event, (now, before)) in self.machine.system().events().iter().zip(conditions.iter().zip(&self.conditions)) {
                let rises = now.iter().zip(before).any(|(now, before)| *now != 0.0 && *before == 0.0);
                let is_free = event.unless.iter().all(|other| acts[*other] == 0.0);
                acts.push(f64::from(u8::from(rises && is_free)));
            }
            self.conditions = conditions;
            let found = self.happening(&acts, &due);
            for (branch, acts) in found.branches.into_iter().zip(&acts) {
                if *acts != 0.0 {
                    branch.restarted.into_iter().for_each(|(state, value)| self.point.states[state] = value);
                    changed = true;
                }
            }
            changed |= found.memories != self.point.memories;
            self.point.memories = found.memories;
            due.fill(0.0);
            if !self.machine.settle(&mut self.point) {
                return Err(Stopped::NoSolution { row: self.row });
            }
            if !changed {
                return Ok(());
            }
        }
        Err(Stopped::TooManyEvents { row: self.row })
    }
}

/// The error of a step as a multiple of what is allowed, the worst state's.
fn error(stepped: &Stepped, scale: &[f64], tolerance: f64) -> f64 {
    if stepped.states.iter().any(|it| !it.is_finite()) {
        return f64::INFINITY;
    }
    let each = stepped.error.iter().zip(scale);
    // A state that is 0, stays 0 and has an error of 0 is right.
    each.map(|(error, scale)| if *error == 0.0 { 0.0 } else { error.abs() / (tolerance * scale) }).fold(0.0, f64::max)
}

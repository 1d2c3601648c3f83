//! Events at an instant: comparisons that change, samples that are due, branches of `when` that act.
//!
//! In: a walk at an instant. Out: the walk after all events of this instant, which are executed in rounds until nothing changes. All lanes of a group
//! execute the same rounds. In a lane in which nothing changes, a further round has no effect.

use super::branches::Events;
use super::rows::Stopped;
use super::sampling;
use super::walk::Walk;

/// The largest number of rounds at one instant.
const MOST_ROUNDS: usize = 100;

impl<const L: usize> Walk<'_, L> {
    /// Whether nothing ever happens at an instant: there are no events, and no nonlinear block has to be solved.
    #[inline]
    pub(super) fn is_quiet(&self) -> bool {
        self.programs.counts.guesses == 0 && !self.has_events()
    }

    /// Whether any event can occur at an instant.
    pub(super) fn has_events(&self) -> bool {
        let counts = self.programs.counts;
        counts.held + counts.memories + counts.acts + counts.due > 0
    }

    /// Computes the conditions before the first event.
    pub(super) fn first_conditions(&mut self) {
        let time = self.time(0);
        for (past, sample) in self.events.past.iter_mut().zip(&self.events.samples) {
            *past = sampling::instants_before(*sample, time) as u64;
        }
        let layout = self.layout();
        for (begin, count) in
            [(layout.acts as usize, self.events.branches.len()), (layout.due as usize, self.events.past.len())]
        {
            self.slots[begin..begin + count].fill([0.0; L]);
        }
        if let Some(results) = self.conditions() {
            let count = self.events.conditions.len();
            self.events.conditions.copy_from_slice(&self.slots[results..results + count]);
        }
    }

    /// Computes the conditions of all branches for the due samples; no branch acts. Returns the slot of the first condition.
    fn conditions(&mut self) -> Option<usize> {
        let conditions = self.programs.conditions.as_ref()?;
        conditions.code.run(&mut self.slots, &mut self.spare);
        Some(conditions.results as usize)
    }

    /// Runs the program of events for the acting branches and due samples. Returns the slot of its first result.
    fn run_event_program(&mut self) -> Option<usize> {
        let events = self.programs.events.as_ref()?;
        events.code.run(&mut self.slots, &mut self.spare);
        Some(events.results as usize)
    }

    /// The next instant of a `sample` up to an end, or the end; and whether it is an instant of a `sample`.
    pub(super) fn next_sample(&self, now: f64, end: f64) -> (bool, f64) {
        let instants =
            self.events.samples.iter().zip(&self.events.past).map(|((first, period), past)| first + *past as f64 * period);
        let next = instants.filter(|it| *it > now).fold(f64::INFINITY, f64::min);
        // Instants of rows and samples are sums and products of decimals. A sample at the instant of a row uses the inputs of that row.
        if next < end - sampling::SAME * end.abs() { (true, next) } else { (next <= end, end) }
    }

    /// Whether no `sample` is due between two rows. A sample that is due at the later row is executed there.
    #[inline]
    pub(super) fn is_free(&self, now: f64, end: f64) -> bool {
        self.events.past.is_empty() || self.next_sample(now, end).1 == end
    }

    /// Computes the sides of each comparison at the current point, and whether in a lane one of them differs from its held value.
    pub(super) fn sides_differ(&mut self) -> [bool; L] {
        let Some(sides) = &self.programs.sides else { return [false; L] };
        sides.code.run(&mut self.slots, &mut self.spare);
        let (begin, held) = (sides.results as usize, self.layout().held as usize);
        // As whole words, comparisons of lanes are vector instructions.
        let mut differ = [0_u64; L];
        for k in 0..self.programs.counts.held {
            let (left, right, held) = (self.slots[begin + 2 * k], self.slots[begin + 2 * k + 1], self.slots[held + k]);
            for lane in 0..L {
                differ[lane] |= u64::from(left[lane] < right[lane]) ^ u64::from(held[lane] != 0.0);
            }
        }
        differ.map(|it| it != 0)
    }

    /// Sets every held value to the current value of its comparison. Returns the lanes in which this is a change.
    fn hold(&mut self) -> [bool; L] {
        let differ = self.sides_differ();
        if let (Some(sides), true) = (&self.programs.sides, differ.contains(&true)) {
            let (begin, held) = (sides.results as usize, self.layout().held as usize);
            for k in 0..self.programs.counts.held {
                let (left, right) = (self.slots[begin + 2 * k], self.slots[begin + 2 * k + 1]);
                self.slots[held + k] = std::array::from_fn(|lane| f64::from(u8::from(left[lane] < right[lane])));
            }
            self.refresh();
        }
        differ
    }

    /// Executes the events of this instant in all lanes. All lanes must be at the same instant.
    pub(super) fn execute_events(&mut self, now: f64) -> Result<(), Stopped> {
        if !self.settle() {
            return Err(Stopped::NoSolution { row: self.row });
        }
        if !self.has_events() {
            return Ok(());
        }
        let due_slots = self.layout().due as usize;
        let mut is_due = false;
        for (k, (first, period)) in self.events.samples.iter().enumerate() {
            let due = first + self.events.past[k] as f64 * period <= now + sampling::SAME * now.abs();
            self.events.past[k] += u64::from(due);
            self.slots[due_slots + k] = [f64::from(u8::from(due)); L];
            is_due |= due;
        }
        if self.events.only_samples {
            if is_due {
                self.run_branches();
                for k in 0..self.events.past.len() {
                    self.slots[due_slots + k] = [0.0; L];
                }
            }
            self.carry_after_events();
            return Ok(());
        }
        for _ in 0..MOST_ROUNDS {
            let mut changed = self.hold().contains(&true);
            changed |= self.run_branches();
            if is_due {
                for k in 0..self.events.past.len() {
                    self.slots[due_slots + k] = [0.0; L];
                }
            }
            if !self.settle() {
                return Err(Stopped::NoSolution { row: self.row });
            }
            // After an instant of a sample, the conditions are evaluated once more without it, so that they can become true again at the next
            // instant.
            if !changed && !is_due {
                self.carry_after_events();
                return Ok(());
            }
            is_due = false;
        }
        Err(Stopped::TooManyEvents { row: self.row })
    }

    /// One round of the branches. Returns whether a state or a memory has changed.
    fn run_branches(&mut self) -> bool {
        let found = self.conditions();
        // Between two rounds, no branch acts.
        let acts = self.layout().acts as usize;
        let Events { conditions, branches, only_samples, .. } = &mut self.events;
        let mut any = false;
        for (place, branch) in branches.iter().enumerate() {
            // Numbers in place of booleans, and sums in place of comparisons of lists: they stay in registers.
            let mut rises = [0.0; L];
            for k in 0..branch.conditions.len() {
                let (now, before) = (self.slots[found.unwrap_or(0) + branch.first + k], conditions[branch.first + k]);
                for lane in 0..L {
                    rises[lane] = if (now[lane] != 0.0) & (before[lane] == 0.0) { 1.0 } else { rises[lane] };
                }
                if !*only_samples {
                    conditions[branch.first + k] = now;
                }
            }
            if rises.iter().sum::<f64>() == 0.0 {
                continue;
            }
            // A branch acts unless one before it in its clause does.
            let mut act = rises;
            for other in &branch.unless {
                let before = self.slots[acts + *other];
                (0..L).for_each(|lane| act[lane] = if before[lane] == 0.0 { act[lane] } else { 0.0 });
            }
            let slot = &mut self.slots[acts + place];
            for lane in 0..L {
                slot[lane] = if rises[lane] != 0.0 { act[lane] } else { slot[lane] };
            }
            any |= act.iter().sum::<f64>() != 0.0;
        }
        if !any && self.events.only_acts_change {
            return false;
        }
        let Some(results) = self.run_event_program() else { return false };
        self.carry_branches();
        let (states, memories) = (self.layout().states as usize, self.layout().memories as usize);
        let mut changed = false;
        for (k, branch) in self.events.branches.iter().enumerate() {
            let acts = std::mem::replace(&mut self.slots[acts + k], [0.0; L]);
            for (state, place) in &branch.restarted {
                for lane in (0..L).filter(|lane| acts[*lane] != 0.0) {
                    self.slots[states + state][lane] = self.slots[results + place][lane];
                    changed = true;
                }
            }
        }
        let mut differ = [0_u64; L];
        for k in 0..self.events.memories {
            let (next, now) = (self.slots[results + k], self.slots[memories + k]);
            (0..L).for_each(|lane| differ[lane] |= next[lane].to_bits() ^ now[lane].to_bits());
            self.slots[memories + k] = next;
        }
        let remembered = differ.iter().fold(0, |all, lane| all | lane) != 0;
        if remembered {
            self.refresh();
        }
        changed | remembered
    }
}

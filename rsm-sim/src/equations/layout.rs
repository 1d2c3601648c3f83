//! The places of the values of a walk in its array of slots.
//!
//! In: the numbers of states, inputs, parameters and further values of a machine. Out: [`Layout`]. The results of programs come after it.

use super::machine::Counts;
use crate::code::Slot;

/// The layout of the slots: the first slot of each group.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    pub step: Slot,
    pub time: Slot,
    pub states: Slot,
    pub inputs: Slot,
    pub held: Slot,
    pub memories: Slot,
    pub guesses: Slot,
    pub acts: Slot,
    pub due: Slot,
    pub parameters: Slot,
    /// For each state, its largest magnitude so far, and after a step that is not accepted yet.
    pub largest: Slot,
    pub next: Slot,
    /// The limits of the errors of a step, and by how much the errors exceed them ([`super::checked`]).
    pub limits: Slot,
    pub excess: Slot,
    pub end: Slot,
}

impl Layout {
    pub(super) fn new(count: Counts) -> Layout {
        let mut next = 0;
        let mut take = |count: usize| {
            let begin = next;
            next += count as Slot;
            begin
        };
        let (step, time) = (take(1), take(1));
        let (states, inputs, held, memories) = (take(count.states), take(count.inputs), take(count.held), take(count.memories));
        let (guesses, acts, due) = (take(count.guesses), take(count.acts), take(count.due));
        let parameters = take(count.parameters);
        let (largest, next, limits, excess) = (take(count.states), take(count.states), take(2), take(1));
        Layout {
            step,
            time,
            states,
            inputs,
            held,
            memories,
            guesses,
            acts,
            due,
            parameters,
            largest,
            next,
            limits,
            excess,
            end: take(0),
        }
    }

    /// The slots of the arguments of a program. Programs of events have some additional arguments.
    pub(super) fn arguments(&self, count: Counts, at_events: bool) -> Vec<Slot> {
        let mut list = Vec::new();
        let mut group = |begin: Slot, count: usize| list.extend(begin..begin + count as Slot);
        group(self.time, count.time);
        group(self.states, count.states);
        group(self.inputs, count.inputs);
        group(self.parameters, count.parameters);
        group(self.held, count.held);
        group(self.memories, count.memories);
        group(self.guesses, count.guesses);
        if at_events {
            group(self.acts, count.acts);
            group(self.due, count.due);
        }
        list
    }
}

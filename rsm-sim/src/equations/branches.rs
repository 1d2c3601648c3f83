//! The branches of `when`, and what is remembered of them from event to event.

use super::machine::Machine;

/// The state of events of each lane.
pub(super) struct Events<const L: usize> {
    /// Conditions of all branches, as they were last.
    pub conditions: Vec<[f64; L]>,
    /// The first instant and the period of each `sample`, in s: those of all lanes.
    pub samples: Vec<(f64, f64)>,
    /// Of each `sample` how many instants are past.
    pub past: Vec<u64>,
    pub branches: Vec<Branch>,
    pub memories: usize,
    /// Memories change only where a branch acts.
    pub only_acts_change: bool,
    pub acts: Vec<[f64; L]>,
    pub due: Vec<f64>,
}

/// A branch of a `when`, and where its results stand behind the first result of the program.
pub(super) struct Branch {
    /// States that it restarts, each with the place of its value.
    pub restarted: Vec<(usize, usize)>,
    /// Its conditions.
    pub conditions: std::ops::Range<usize>,
    /// The first of its conditions among all.
    pub first: usize,
    /// It does not act together with these.
    pub unless: Vec<usize>,
}

impl<const L: usize> Events<L> {
    pub(super) fn new(machine: &Machine) -> Self {
        let system = machine.system();
        let memories = system.memories().len();
        let only_acts_change = system.memories().iter().all(|it| it.held == it.variable);
        let (mut next, mut first) = (memories, 0);
        let mut branches = Vec::new();
        for (event, places) in system.events().iter().zip(machine.restarted()) {
            let restarted = places.iter().enumerate().map(|(k, state)| (*state, next + k)).collect();
            next += places.len();
            let conditions = next..next + event.conditions.len();
            next = conditions.end;
            branches.push(Branch { restarted, first, unless: event.unless.clone(), conditions: conditions.clone() });
            first += conditions.len();
        }
        let samples = machine.samples().to_vec();
        let past = vec![0; samples.len()];
        let due = vec![0.0; past.len()];
        Events {
            conditions: vec![[0.0; L]; first],
            samples,
            past,
            memories,
            only_acts_change,
            acts: vec![[0.0; L]; branches.len()],
            due,
            branches,
        }
    }

    pub(super) fn copy_from<const M: usize>(&mut self, other: &Events<M>, lane: usize) {
        for (to, from) in self.conditions.iter_mut().zip(&other.conditions) {
            *to = [from[lane]; L];
        }
        self.samples.clone_from(&other.samples);
        self.past.clone_from(&other.past);
    }

    pub(super) fn follow(&mut self, place: usize, lane: usize) {
        self.conditions.iter_mut().for_each(|it| it[place] = it[lane]);
    }

    pub(super) fn copy_to<const M: usize>(&self, other: &mut Events<M>, lane: usize) {
        for (from, to) in self.conditions.iter().zip(&mut other.conditions) {
            to[lane] = from[0];
        }
    }
}

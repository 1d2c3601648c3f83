//! The branches of `when`, and their data that is kept from event to event.

use super::machine::Machine;

/// The state of the events of each lane.
pub(super) struct Events<const L: usize> {
    /// The last values of the conditions of all branches.
    pub conditions: Vec<[f64; L]>,
    /// The first instant and the period of each `sample`, in s. They are the same for all lanes.
    pub samples: Vec<(f64, f64)>,
    /// For each `sample`, the number of past instants.
    pub past: Vec<u64>,
    pub branches: Vec<Branch>,
    pub memories: usize,
    /// Whether memories change only if a branch acts.
    pub only_acts_change: bool,
    /// Whether nothing can happen at an instant without a due `sample`, and nothing more after its branches have acted: there are no comparisons, and
    /// conditions depend on due samples and on parameters alone. Then the conditions keep the values that they have between samples.
    pub only_samples: bool,
}

/// A branch of a `when`. The places of its results are counted from the first result of the program.
pub(super) struct Branch {
    /// States that it restarts, each with the place of its new value.
    pub restarted: Vec<(usize, usize)>,
    /// The places of its conditions.
    pub conditions: std::ops::Range<usize>,
    /// The index of its first condition among the conditions of all branches.
    pub first: usize,
    /// Branches that take precedence: if one of them acts, this one does not.
    pub unless: Vec<usize>,
}

impl<const L: usize> Events<L> {
    /// `by_samples`: whether the conditions depend on due samples and on parameters alone, in a plant without comparisons.
    pub(super) fn new(machine: &Machine, by_samples: bool) -> Self {
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
        let only_samples = only_acts_change && by_samples;
        Events { conditions: vec![[0.0; L]; first], samples, past, memories, only_acts_change, only_samples, branches }
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

//! Programs of derivatives, and the array of values and derivatives that they read and write.
//!
//! In: pieces of code for places of the array. Out: [`DerivativeProgram`], which runs them from the values in a walk of one lane. Four directions are
//! computed in a register.

use std::cell::Cell;

use crate::code::{Code, Piece, Slot, WIDE, Way, lengthen};

/// The places of values and their derivatives in an array: group 0 contains values, group k + 1 the derivatives in four directions, the last group
/// the derivatives with respect to time.
#[derive(Debug, Default)]
pub(super) struct Mirror {
    /// For each group, for each slot of the walk.
    pub places: Vec<Vec<Slot>>,
    pub next: Slot,
}

/// No place.
const NO_SLOT: Slot = Slot::MAX;

impl Mirror {
    pub(super) fn place(&mut self, group: usize, slot: Slot) -> Slot {
        let (group, slot) = (group, slot as usize);
        self.places.resize_with(self.places.len().max(group + 1), Vec::new);
        let list = &mut self.places[group];
        list.resize(list.len().max(slot + 1), NO_SLOT);
        if list[slot] == NO_SLOT {
            list[slot] = self.next;
            self.next += 1;
        }
        list[slot]
    }

    pub(super) fn known(&self, group: usize, slot: Slot) -> Option<usize> {
        self.places.get(group)?.get(slot as usize).filter(|it| **it != NO_SLOT).map(|it| *it as usize)
    }

    pub(super) fn fresh(&mut self) -> Slot {
        self.next += 1;
        self.next - 1
    }
}

/// The derivatives of a program's results.
#[derive(Debug)]
pub(super) struct DerivativeProgram {
    /// Copies the values that it reads, then computes first what does not depend on the direction, then group by group.
    code: Code,
    /// Values that are constant during a run: their places in the walk, and in the mirror. They are copied once, in the run with this number.
    fixed: Vec<(usize, usize)>,
    run: Cell<u64>,
    /// Values that only a new linear part changes, and which are copied then.
    pub loaded: Vec<(usize, usize)>,
}

/// The same before it is compiled.
pub(super) struct Pieces {
    pub pieces: Vec<Piece>,
    pub fixed: Vec<(usize, usize)>,
    pub loaded: Vec<(usize, usize)>,
}

impl Pieces {
    pub(super) fn compiled(self, way: Way) -> DerivativeProgram {
        let Pieces { pieces, fixed, loaded } = self;
        DerivativeProgram { code: Code::of(pieces, WIDE, way), fixed, run: Cell::new(0), loaded }
    }
}

/// Values and derivatives, at the places of the mirror.
#[derive(Debug, Default)]
pub(super) struct Store {
    pub slots: Vec<[f64; WIDE]>,
    spare: Vec<[f64; WIDE]>,
    /// The number of the run.
    run: u64,
}

impl Store {
    /// Starts a new run: all derivatives are 0, and there is memory for this number of places.
    pub(super) fn begin(&mut self, places: Slot) {
        self.run += 1;
        self.slots.fill([0.0; WIDE]);
        self.grow(places);
    }

    pub(super) fn grow(&mut self, places: Slot) {
        lengthen(&mut self.slots, places as usize);
    }

    /// Runs code that reads values of a walk.
    #[inline]
    pub(super) fn run(&mut self, code: &Code, values: &[f64]) {
        code.run_with(values, &mut self.slots, &mut self.spare);
    }
}

impl DerivativeProgram {
    /// Computes the derivatives of a program's results from the values in a walk of one lane.
    pub(super) fn run<const L: usize>(&self, store: &mut Store, values: &[[f64; L]]) {
        assert!(L == 1, "derivatives are computed along with one lane");
        let values = values.as_flattened();
        if self.run.replace(store.run) != store.run {
            self.fixed.iter().for_each(|(from, to)| store.slots[*to] = [values[*from]; WIDE]);
        }
        store.run(&self.code, values);
    }
}

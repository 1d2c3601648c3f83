//! Sensitivities over a step of the series, with a check of their own terms.
//!
//! ```text
//! scale = max(largest |S| so far, |S_end - S|);  the step is valid for a direction if |last term| < limit scale for all states
//! ```
//!
//! In: the parts of a series up to its last order. Out: code for the derivatives at the end of the step, and the directions for which the step is too
//! long. The states alone decide how long a step is. A motion that is faster than the step, and that the states do not show, is in the derivatives:
//! beyond the region of stability of the series it grows from step to step there, before the states show it (E. Hairer, G. Wanner, "Solving Ordinary
//! Differential Equations II", IV.2). Each direction is checked alone, so its bits do not depend on the others.

use rsm_core::number::{Precision, exact, integer};
use rsm_core::tape::{Reg, TapeBuilder};

use super::checked::larger;
use super::derivatives::{DerivativeProgram, Pieces, Store};
use crate::code::{Code, Piece, Slot, WIDE, Way};

/// Directions, for each group.
pub(super) type Open = Vec<[bool; WIDE]>;

/// The smallest tolerance of the terms of the derivatives. Where the states rest, the derivatives may move: at the tolerance of the states they would
/// need steps of their own in most rows, to digits that no fit and no standard error needs.
pub(super) const TOLERANCE: f64 = 1e-4;

/// What the steps of all orders share: the place of the limit; for each group that of the number of terms above it; and for each derivative that of
/// its largest magnitude so far.
#[derive(Debug, Default)]
pub(super) struct Checked {
    pub limit: Slot,
    pub too_long: Vec<Slot>,
    pub largest: Vec<Slot>,
}

impl Checked {
    /// Those of some directions for which the last step is too long.
    pub(super) fn too_long(&self, store: &Store, of: &Open) -> Open {
        let places = self.too_long.iter().map(|place| store.slots[*place as usize]);
        places.zip(of).map(|(sums, of)| std::array::from_fn(|lane| of[lane] && sums[lane] != 0.0)).collect()
    }

    /// Before a run.
    pub(super) fn begin(&self, store: &mut Store) {
        self.largest.iter().for_each(|place| store.slots[*place as usize] = [0.0; WIDE]);
    }
}

/// The derivatives of one state in the directions of a group: the places at the start and at the end of the step, of the last term, of the largest
/// magnitude so far, and of the next one.
#[derive(Debug)]
pub(super) struct Derivatives {
    pub group: usize,
    pub begin: Slot,
    pub end: Slot,
    pub last: Option<Slot>,
    pub largest: Slot,
    pub next: Slot,
}

/// The steps of one order.
#[derive(Debug)]
pub(super) struct SeriesSpeeds {
    program: Option<DerivativeProgram>,
    /// Takes the derivatives at the end of the step, and the largest magnitudes.
    accept: Code,
    all: Vec<Derivatives>,
}

impl SeriesSpeeds {
    /// `pieces`: the derivatives of the series; `None` if it has none.
    pub(super) fn new(pieces: Option<Pieces>, checked: &Checked, all: Vec<Derivatives>, way: Way) -> SeriesSpeeds {
        let program = pieces.map(|mut pieces| {
            pieces.pieces.push(check(checked, &all));
            pieces.compiled(way)
        });
        let copies = all.iter().flat_map(|it| [(it.end, it.begin), (it.next, it.largest)]);
        let copies = copies.map(|(from, to)| (from as usize, to as usize)).collect();
        SeriesSpeeds { program, accept: Code::of(vec![Piece::Copy(copies)], WIDE, way), all }
    }

    /// Computes the derivatives at the end of a step from the values in a walk of one lane. `limit`: of the last terms, as a share of the scale.
    /// Returns whether the step is valid for all directions.
    #[inline]
    pub(super) fn run<const L: usize>(&self, store: &mut Store, checked: &Checked, values: &[[f64; L]], limit: f64) -> bool {
        let Some(program) = &self.program else { return true };
        store.slots[checked.limit as usize] = [limit; WIDE];
        program.run(store, values);
        checked.too_long.iter().all(|place| store.slots[*place as usize] == [0.0; WIDE])
    }

    /// Takes the derivatives at the end of the step in all directions.
    #[inline]
    pub(super) fn take(&self, store: &mut Store) {
        store.run(&self.accept, &[]);
    }

    /// Takes the derivatives at the end of the step in some directions.
    pub(super) fn take_in(&self, store: &mut Store, of: &Open) {
        for it in &self.all {
            for lane in (0..WIDE).filter(|lane| of[it.group][*lane]) {
                for (from, to) in [(it.end, it.begin), (it.next, it.largest)] {
                    store.slots[to as usize][lane] = store.slots[from as usize][lane];
                }
            }
        }
    }
}

/// The check of the derivatives of a step.
fn check(checked: &Checked, all: &[Derivatives]) -> Piece {
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let (mut arguments, mut outputs, mut results) = (Vec::new(), Vec::new(), Vec::new());
    let mut given = |tape: &mut TapeBuilder, slot: Slot| {
        arguments.push(slot);
        tape.input(arguments.len() as u32 - 1)
    };
    let limit = given(&mut tape, checked.limit);
    let (zero, one, smallest) = (tape.constant(integer(0)), tape.constant(integer(1)), tape.constant(exact(f64::MIN_POSITIVE)));
    let mut too_long = vec![zero; checked.too_long.len()];
    for it in all {
        let [begin, end, largest] = [it.begin, it.end, it.largest].map(|slot| given(&mut tape, slot));
        let size = tape.absolute(begin);
        let next = larger(&mut tape, size, largest);
        outputs.push((format!("slot {}", it.next), next));
        results.push(it.next);
        let Some(last) = it.last else { continue };
        let last = given(&mut tape, last);
        let (moved, size) = (tape.subtract(end, begin), tape.absolute(last));
        let moved = tape.absolute(moved);
        let scale = larger(&mut tape, moved, next);
        let allowed = tape.multiply(limit, scale);
        let allowed = tape.add(allowed, smallest);
        // A term that is not finite is not less.
        let is_too_long = tape.select_less(size, allowed, zero, one);
        too_long[it.group] = tape.add(too_long[it.group], is_too_long);
    }
    outputs.extend(checked.too_long.iter().zip(too_long).map(|(place, sum)| (format!("slot {place}"), sum)));
    results.extend(&checked.too_long);
    let names = arguments.iter().map(|slot| format!("slot {slot}")).collect();
    Piece::tape(&tape.finish_with_results("check", names, outputs, [] as [(String, Reg); 0]), &arguments, &results)
}

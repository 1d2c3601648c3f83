//! A step over a whole row and its check as one tape, so that a row without events costs one call.
//!
//! ```text
//! scale = max(|x|, largest |x| so far, |x_end - x|, |first term|)
//! excess = max(0, |error| - limit scale) over all states and errors;  NaN if an end is not finite
//! ```
//!
//! In: the tape of a step. Out: [`Checked`]: a tape with the states at the end, the excess and the next largest magnitudes, and the copies that
//! accept the step. A step is valid in a lane in which the excess is 0.

use std::collections::HashMap;

use rsm_core::number::integer;
use rsm_core::tape::{Reg, TapeBuilder};

use super::layout::Layout;
use super::placed::Placed;
use crate::code::{Code, Piece, Slot, Way};

/// What is checked.
pub(super) struct Check<'a> {
    pub layout: Layout,
    pub states: usize,
    /// The first of the slots of the states at the end of the step.
    pub ends: Slot,
    /// The first slots of errors, each with the slot of its limit.
    pub errors: &'a [(Slot, Slot)],
    /// The first slot of the first terms of the series; `None` for a step by a linear part.
    pub first: Option<Slot>,
    /// Further results of the step that are kept.
    pub kept: &'a [Slot],
}

/// The code of a step with its check.
#[derive(Debug)]
pub(super) struct Checked {
    /// Reads the step length and two limits. They are written to whole registers by this code: a load of a register after two half stores waits.
    pub step: Code,
    /// Reads the instant at the end. Takes the states and the largest magnitudes.
    pub accept: Code,
}

impl Checked {
    pub(super) fn new(step: &Placed, check: &Check<'_>, lanes: usize, way: Way) -> Checked {
        let states = 0..check.states as Slot;
        let taken = |from: Slot, to: Slot| states.clone().map(move |k| ((from + k) as usize, (to + k) as usize));
        let copies = taken(check.ends, check.layout.states).chain(taken(check.layout.next, check.layout.largest)).collect();
        let Layout { step: length, time, limits, .. } = check.layout;
        let given = [length, limits, limits + 1].into_iter().enumerate().map(|(k, slot)| (k, slot as usize)).collect();
        let step = vec![Piece::Spread(given), tape(step, check).piece()];
        let accept = vec![Piece::Spread(vec![(0, time as usize)]), Piece::Copy(copies)];
        Checked { step: Code::of(step, lanes, way), accept: Code::of(accept, lanes, way) }
    }
}

/// The larger of two numbers; the second if one is NaN.
pub(super) fn larger(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Reg {
    tape.select_less(b, a, a, b)
}

fn tape(step: &Placed, check: &Check<'_>) -> Placed {
    let Check { layout, ends, errors, first, kept, .. } = *check;
    let mut tape = TapeBuilder::sharing(step.tape.precision);
    let mut arguments = step.arguments.clone();
    let inputs: Vec<Reg> = (0..arguments.len() as u32).map(|port| tape.input(port)).collect();
    let found: HashMap<Slot, Reg> = step.results.iter().copied().zip(tape.inline(&step.tape, &inputs)).collect();
    let mut given = |tape: &mut TapeBuilder, slot: Slot| {
        let port = arguments.iter().position(|it| *it == slot).unwrap_or_else(|| {
            arguments.push(slot);
            arguments.len() - 1
        });
        tape.input(port as u32)
    };
    let nothing = tape.constant(integer(0));
    let (mut excess, mut not_finite, mut next) = (nothing, nothing, Vec::new());
    for k in 0..check.states as Slot {
        let (begin, largest) = (given(&mut tape, layout.states + k), given(&mut tape, layout.largest + k));
        let end = found[&(ends + k)];
        let (difference, size) = (tape.subtract(end, begin), tape.absolute(begin));
        let mut scale = tape.absolute(difference);
        if let Some(first) = first {
            let first = tape.absolute(found[&(first + k)]);
            scale = larger(&mut tape, scale, first);
        }
        let so_far = larger(&mut tape, size, largest);
        scale = larger(&mut tape, so_far, scale);
        for (slot, limit) in errors {
            let (error, limit) = (found[&(slot + k)], given(&mut tape, *limit));
            let (size, allowed) = (tape.absolute(error), tape.multiply(limit, scale));
            let over = tape.subtract(size, allowed);
            excess = larger(&mut tape, over, excess);
            // A term of the series that is not finite makes the end not finite.
            if first.is_none() {
                let zero = tape.subtract(error, error);
                not_finite = tape.add(not_finite, zero);
            }
        }
        // The difference of a number and itself is NaN if the number is not finite.
        let zero = tape.subtract(end, end);
        not_finite = tape.add(not_finite, zero);
        let size = tape.absolute(end);
        next.push(larger(&mut tape, size, largest));
    }
    let excess = tape.add(excess, not_finite);
    let all = (0..check.states as Slot).map(|k| (ends + k, found[&(ends + k)]));
    let all = all.chain(kept.iter().map(|slot| (*slot, found[slot]))).chain([(layout.excess, excess)]);
    let all: Vec<(Slot, Reg)> = all.chain((layout.next..).zip(next)).collect();
    let named = all.iter().map(|(slot, reg)| (format!("slot {slot}"), *reg)).collect::<Vec<_>>();
    let names = arguments.iter().map(|slot| format!("slot {slot}")).collect();
    let results = all.iter().map(|it| it.0).collect();
    Placed { tape: tape.finish_with_results("checked", names, named, [] as [(String, Reg); 0]), arguments, results }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equations::machine::Counts;
    use rsm_core::number::Precision;
    use rsm_core::run::Interpreter;

    /// A step of one state whose end, error and first term are its arguments: slots 20 to 22 become slots 30 to 32.
    fn given() -> Placed {
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let results: Vec<(String, Reg)> = (0..3).map(|port| (format!("r{port}"), tape.input(port))).collect();
        let names = (0..3).map(|port| format!("a{port}")).collect();
        let tape = tape.finish_with_results("step", names, results, [] as [(String, Reg); 0]);
        Placed { tape, arguments: vec![20, 21, 22], results: vec![30, 31, 32] }
    }

    /// The excess and the next largest magnitude, for a state x, its end, its error and its first term, the largest magnitude so far, the limit.
    fn found(x: f64, end: f64, error: f64, first: f64, largest: f64, limit: f64) -> [f64; 2] {
        let layout = Layout::new(Counts { states: 1, ..Counts::default() });
        let check = Check { layout, states: 1, ends: 30, errors: &[(31, layout.limits)], first: Some(32), kept: &[] };
        let placed = tape(&given(), &check);
        let value = |slot: &Slot| match *slot {
            20 => end,
            21 => error,
            22 => first,
            it if it == layout.states => x,
            it if it == layout.largest => largest,
            it if it == layout.limits => limit,
            other => panic!("slot {other}"),
        };
        let arguments: Vec<f64> = placed.arguments.iter().map(value).collect();
        let mut results = vec![0.0; placed.results.len()];
        Interpreter::<f64>::new(&placed.tape).eval_all(&arguments, &mut results);
        [layout.excess, layout.next].map(|slot| results[placed.results.iter().position(|it| *it == slot).unwrap()])
    }

    #[test]
    fn the_excess_is_0_up_to_the_limit_and_the_scale_is_the_largest_of_four() {
        // In each case another number is the scale, 8; the limit is 1/4, so an error of 2 is permitted.
        for (x, end, first, largest) in
            [(-8.0, -7.0, 1.0, 0.0), (1.0, -7.0, 1.0, 0.0), (1.0, 2.0, -8.0, 0.0), (1.0, 2.0, 1.0, 8.0)]
        {
            let next = f64::max(largest, f64::abs(end));
            assert_eq!(found(x, end, -2.0, first, largest, 0.25), [0.0, next]);
            assert_eq!(found(x, end, 2.5, first, largest, 0.25), [0.5, next]);
        }
    }

    #[test]
    fn an_end_that_is_not_finite_has_an_excess_that_is_not_0() {
        for end in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(found(1.0, end, 0.0, 1.0, 1.0, 1.0)[0].is_nan());
        }
    }
}

//! Tapes of derivatives made shorter: without what is 0 in some directions, and parts of a series as one tape for the end of a step.
//!
//! In: tapes of the programs of a walk or of their derivatives. Out: tapes with the same results. This file compiles nothing.

use std::collections::HashMap;

use rsm_core::number::integer;
use rsm_core::tape::{Op, Reg, Tape, TapeBuilder};

use super::placed::Placed;
use crate::code::Slot;

/// A tape in which some inputs are 0, without the operations that are 0 then; and which of its results are not. The others are left out; `None` if
/// all are.
pub(super) fn without(tape: &Tape, zero_inputs: &[bool]) -> (Option<Tape>, Vec<bool>) {
    // Marks of elementary functions would have to be moved. The derivatives of programs have none.
    if !tape.computed.is_empty() || !zero_inputs.contains(&true) {
        return (Some(tape.clone()), vec![true; tape.outputs.len()]);
    }
    let mut zero = vec![false; tape.ops.len()];
    for (reg, op) in tape.iter() {
        let is = |a: &Reg| zero[a.0 as usize];
        zero[reg.0 as usize] = match op {
            Op::Input(port) => zero_inputs[port.0 as usize],
            Op::Negate(a) | Op::Absolute(a) | Op::Divide(a, _) => is(a),
            Op::Add(a, b) | Op::Subtract(a, b) => is(a) && is(b),
            Op::Multiply(a, b) => is(a) || is(b),
            Op::Select { then, otherwise, .. } => is(then) && is(otherwise),
            _ => false,
        };
    }
    let mut needed = vec![false; tape.ops.len()];
    tape.outputs.iter().for_each(|output| needed[output.reg.0 as usize] = !zero[output.reg.0 as usize]);
    for k in (0..tape.ops.len()).rev().filter(|k| !zero[*k]) {
        if needed[k] {
            tape.ops[k].operands().iter().for_each(|reg| needed[reg.0 as usize] = true);
        }
    }
    let mut builder = TapeBuilder::sharing(tape.precision);
    let nothing = builder.constant(integer(0));
    let mut places = vec![nothing; tape.ops.len()];
    for (reg, op) in tape.iter().filter(|(reg, _)| needed[reg.0 as usize] && !zero[reg.0 as usize]) {
        let is = |a: &Reg| zero[a.0 as usize];
        let place = |a: &Reg| places[a.0 as usize];
        places[reg.0 as usize] = match op {
            Op::Add(a, b) if is(a) => place(b),
            Op::Add(a, b) | Op::Subtract(a, b) if is(b) => place(a),
            Op::Subtract(a, b) if is(a) => builder.push(Op::Negate(place(b))),
            other => builder.push(other.with_operands(|operand| places[operand.0 as usize])),
        };
    }
    let moves: Vec<bool> = tape.outputs.iter().map(|output| !zero[output.reg.0 as usize]).collect();
    let outputs = tape.outputs.iter().zip(&moves).filter(|it| *it.1);
    let outputs: Vec<(String, Reg)> = outputs.map(|(it, _)| (it.name.clone(), places[it.reg.0 as usize])).collect();
    let own = (!outputs.is_empty())
        .then(|| builder.finish_with_results(tape.name.clone(), tape.inputs.clone(), outputs, [] as [(String, Reg); 0]));
    (own, moves)
}

/// Combines parts of a series to one program for some of their results.
pub(super) fn composed(parts: &[&Placed], results: &[Slot]) -> Placed {
    let mut builder = TapeBuilder::sharing(rsm_core::number::Precision::F64);
    let mut found: HashMap<Slot, Reg> = HashMap::new();
    let mut arguments: Vec<Slot> = Vec::new();
    for part in parts {
        let mut inputs = Vec::with_capacity(part.arguments.len());
        for slot in &part.arguments {
            inputs.push(*found.entry(*slot).or_insert_with(|| {
                arguments.push(*slot);
                builder.input(arguments.len() as u32 - 1)
            }));
        }
        let results = builder.inline(&part.tape, &inputs);
        found.extend(part.results.iter().copied().zip(results));
    }
    let outputs: Vec<(String, Reg)> = results.iter().map(|slot| (format!("slot {slot}"), found[slot])).collect();
    let names = arguments.iter().map(|slot| format!("slot {slot}")).collect();
    Placed {
        tape: builder.finish_with_results("step", names, outputs, [] as [(String, Reg); 0]),
        arguments,
        results: results.to_vec(),
    }
}

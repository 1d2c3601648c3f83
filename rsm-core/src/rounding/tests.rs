//! Tests each rule of the bound with an adversary: no error that a search finds is above the bound, and each rule is tight somewhere.
//!
//! Where a test is about errors of operands, constants of its tape represent numbers far from their values. Such an error is much larger than the
//! rounding error of the operation, so a bound without it fails immediately.

mod boxes;
mod choices;
mod exact;
mod limits;
mod operations;
mod tapes;

use super::*;
use crate::adversary::{Random, seen_error, worst_ratio};
use crate::number::{Rational, integer};
use crate::tape::{Constant, Port, State, TapeBuilder};

/// A tape of some inputs.
fn write_tape(precision: Precision, arity: usize, write: impl FnOnce(&mut TapeBuilder, &[Reg]) -> Reg) -> Tape {
    let mut builder = TapeBuilder::new(precision);
    let inputs: Vec<Reg> = (0..arity).map(|k| builder.push(Op::Input(Port(k as u32)))).collect();
    let output = write(&mut builder, &inputs);
    builder.finish("t", (0..arity).map(|k| format!("x{k}")).collect(), output)
}

/// A constant that represents another number.
fn off(builder: &mut TapeBuilder, value: f64, by: f64) -> Reg {
    builder.rounded_constant(value, exact(value) + exact(by))
}

/// The bound if the whole box is one cell.
fn bound_of_one_cell(tape: &Tape, ranges: &[[f64; 2]]) -> f64 {
    let sides: Vec<Side> = ranges.iter().map(|range| side(tape.precision, *range, 0, 1).unwrap()).collect();
    let mut analysis = Analysis::new(tape);
    analysis.run(&sides);
    analysis.of(tape.output()).error
}

/// The worst ratio over a box; asserts that no error is above the bound.
fn tightness(tape: &Tape, ranges: &[[f64; 2]], effort: usize) -> f64 {
    worst_ratio(&mut Random(1), tape, ranges, error_bound(tape, ranges), effort)
}

/// One unit in the last place of 1.
fn ulp_of_one(precision: Precision) -> f64 {
    2.0 * precision.unit_roundoff()
}

type Unary = fn(&mut TapeBuilder, Reg) -> Reg;
type Binary = fn(Reg, Reg) -> Op;
const BINARIES: [(&str, Binary); 4] =
    [("sum", Op::Add), ("difference", Op::Subtract), ("product", Op::Multiply), ("quotient", Op::Divide)];

//! Proves a bound of the error of each function, in units in the last place, over its whole stated range.
//!
//! An error has three parts: the error of the polynomials and split constants in exact arithmetic (`derive.rs` has it in rationals; each proof here
//! adds it up by a formula), the errors of the roundings (`engine.rs`, cell by cell over all arguments), and the last rounding, at most half a unit
//! at every argument. The first two parts in a cell are in units of the smallest true value in the cell. That the operations, computed exactly, equal
//! the formulas of the first part is checked by reading them; the comparison with an arbitrary-precision library (`tests/all/elementary.rs`) would
//! show a difference.
//!
//! Cells of odd functions end at 2^-300. Below, every term after the leading one is less than 2^-590 of it: each sum gives its leading term, and
//! products that underflow are 0.

mod circular;
mod engine;
mod exponential;
mod inverse;
mod logarithm;
mod span;

use std::collections::HashMap;

use num_traits::Signed;

use super::{Function, derive};
use crate::number::{Precision, Rational, exact};
use crate::tape::{Op, Reg, Tape};
use engine::Found;
use span::{Span, span, unit};

/// No known registers.
type Pins = HashMap<Reg, engine::Pin>;

/// The error in units in the last place, from the error in exact arithmetic, the earlier roundings, and the last rounding.
fn in_units(found: &Found, missed: f64) -> f64 {
    let least = found.ideal.least() - missed;
    assert!(least > 0.0, "{found:?} {missed}");
    // Three roundings to nearest, moved upward by more than that.
    let others = (found.besides + missed) / unit(least * (1.0 - 1e-15)) * (1.0 + 1e-15);
    others + if found.rounds { 0.5 } else { 0.0 }
}

/// The difference between a sum of constants and its exact value.
fn lacks(parts: &[f64], of: &Rational) -> f64 {
    let sum = parts.iter().map(|part| exact(*part)).fold(-of, |sum, part| sum + part);
    Precision::F64.round_up(&sum.abs())
}

/// Cells for all numbers from 2^low to below 2^high, `each` of them in each power of two.
fn powers(low: i32, high: i32, each: u32) -> impl Iterator<Item = Span> {
    (low..high).flat_map(move |power| (0..each).map(move |k| part(2f64.powi(power), 2f64.powi(power + 1), k, each)))
}

/// `count` cells for all numbers from `low` to below `high`.
fn parts(low: f64, high: f64, count: u32) -> impl Iterator<Item = Span> {
    (0..count).map(move |k| part(low, high, k, count))
}

fn part(low: f64, high: f64, k: u32, count: u32) -> Span {
    let border = |k: u32| if k == count { high } else { low + (high - low) * (f64::from(k) / f64::from(count)) };
    // The border belongs to the next cell.
    span(border(k), border(k + 1).next_down().max(border(k)))
}

/// The register before selections: the value for a true, or a false, condition.
fn otherwise(tape: &Tape, reg: Reg) -> Reg {
    let Op::Select { otherwise, .. } = *tape.op(reg) else { panic!("{reg} is no choice") };
    otherwise
}

fn then(tape: &Tape, reg: Reg) -> Reg {
    let Op::Select { then, .. } = *tape.op(reg) else { panic!("{reg} is no choice") };
    then
}

fn sum_of(tape: &Tape, reg: Reg) -> (Reg, Reg) {
    let Op::Add(a, b) = *tape.op(reg) else { panic!("{reg} is no sum") };
    (a, b)
}

fn product_of(tape: &Tape, reg: Reg) -> (Reg, Reg) {
    let Op::Multiply(a, b) = *tape.op(reg) else { panic!("{reg} is no product") };
    (a, b)
}

/// A proof: the worst error over all cells.
fn worst(function: Function) -> f64 {
    match function {
        Function::Sqrt => logarithm::sqrt(),
        Function::Exp => exponential::exp(),
        Function::Log => logarithm::log(),
        Function::Log10 => logarithm::log10(),
        Function::Sin => circular::sin(),
        Function::Cos => circular::cos(),
        Function::Tan => circular::tan(),
        Function::Asin => inverse::asin(),
        Function::Acos => inverse::acos(),
        Function::Atan => inverse::atan(),
        Function::Atan2 => inverse::atan2(),
        Function::Sinh => exponential::sinh(),
        Function::Cosh => exponential::cosh(),
        Function::Tanh => exponential::tanh(),
        // Below 2^52 a magnitude plus 2^52 is rounded to the nearest integer, which the difference gives exactly. If that is above the argument, 1 is
        // subtracted, which is exact below 2^52. From 2^52 on the argument is the result.
        Function::Floor => 0.0,
    }
}

#[test]
fn every_function_errs_by_at_most_what_it_states() {
    let each: Vec<_> = Function::ALL.map(|function| std::thread::spawn(move || worst(function))).into_iter().collect();
    let mut wrong = Vec::new();
    for (function, proved) in Function::ALL.into_iter().zip(each) {
        let (name, stated) = (function.name(), function.error_in_units());
        match proved.join() {
            Ok(proved) => {
                println!("{name}: {proved:.4}");
                // The stated error is the proved one, with two digits.
                if proved > stated || proved < stated - 0.01 {
                    wrong.push(format!("{name}: {proved}, stated {stated}"));
                }
            }
            Err(_) => wrong.push(format!("{name} has no proof")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

//! exp, sinh, cosh, tanh.

use super::derive::{log_of_two, polynomial_bound};
use super::engine::{Pin, outcomes};
use super::span::{Span, span};
use super::{Pins, in_units, lacks, otherwise, powers, product_of, sum_of};
use crate::elementary::{Function, coefficients, range};
use crate::tape::{Op, Reg, Tape};

const LOG_2: f64 = std::f64::consts::LN_2;

/// More than the rounding errors of x - k log 2, here and in the choice of k: about 1100 units of 2^-53.
const SLACK: f64 = 1e-12;

/// k is the whole number nearest to x/log 2.
const HALF: f64 = LOG_2 / 2.0 + SLACK;

/// The first integer that a tape computes.
fn first_whole(tape: &Tape) -> Reg {
    let is_lift = |reg: Reg| matches!(tape.op(reg), Op::Constant(constant) if constant.value == 1.5 * 2f64.powi(52));
    let found = tape.iter().find(|(_, op)| matches!(op, Op::Subtract(_, lift) if is_lift(*lift)));
    found.expect("the tape has a whole number").0
}

/// Cells of the remainder r for a nonzero k: the range of x, and the largest |r|.
fn around(k: i32, count: i32) -> impl Iterator<Item = (Span, f64)> {
    let share = move |j: i32| HALF * (2.0 * f64::from(j) / f64::from(count) - 1.0);
    (0..count).map(move |j| {
        let middle = f64::from(k) * LOG_2;
        let r = share(j).abs().max(share(j + 1).abs()) + SLACK;
        // The polynomials are valid for this and for r^2 <= 0.1202.
        assert!(r <= 0.3466 && r * r <= 0.1202);
        (span(middle + share(j) - SLACK, middle + share(j + 1) + SLACK), r)
    })
}

/// y is exp r, before the multiplication by two powers of two.
pub(super) fn exp() -> f64 {
    let tape = range::alone(Function::Exp);
    let whole = first_whole(&tape);
    let (scaled, _) = product_of(&tape, tape.output());
    let (y, _) = product_of(&tape, scaled);
    let (lacks, misses) = (lacks(&coefficients::LOG_OF_TWO, &log_of_two()), polynomial_bound("EXP"));
    let mut worst = 0.0_f64;
    for k in -1076..=1024 {
        let pins = Pins::from([(whole, Pin::Constant(f64::from(k)))]);
        // The range ends at 709.79.
        for (x, r) in around(k, 12).filter(|(x, _)| x.low < 709.79) {
            for found in outcomes(&tape, &[x], &pins, y) {
                // e^0.35 < 1.5
                worst = worst.max(in_units(&found, r * r * misses + 1.5 * f64::from(k.abs()) * lacks));
            }
        }
    }
    // A subnormal result is rounded once more, by half a unit, and the error of y is then at most half of its value here.
    worst.max(0.5 + worst / 2.0)
}

/// The errors of 2^(1-k) sinh and 2^(1-k) cosh in exact arithmetic.
fn missed(k: i32, r: f64, of_log: f64) -> (f64, f64) {
    let lacks = 2.2 * f64::from(k) * of_log;
    let m = 4f64.powi(-k.min(60));
    // 4^-60 is used in place of smaller values of 4^-k, times 1.5.
    let cut = if k > 60 { 1.5 * m } else { 0.0 };
    let (odd, even) = (r * r * r * polynomial_bound("SINH"), r * r * r * r * polynomial_bound("COSH"));
    let up = 1.0 + 1e-9;
    (((1.0 + m) * odd + (1.0 - m) * even + lacks + cut) * up, ((1.0 + m) * even + (1.0 - m) * odd + lacks + cut) * up)
}

/// All k up to a largest one: k, the cell of x, the errors.
fn cells(largest: i32, each: u32) -> Vec<(i32, Span, (f64, f64))> {
    let (odd, even) = (polynomial_bound("SINH"), polynomial_bound("COSH"));
    let of_log = lacks(&coefficients::LOG_OF_TWO, &log_of_two());
    let near = powers(-300, -4, each).chain(super::parts(0.0625, HALF, 8 * each));
    // At k = 0 the factor of the other function is 0, and x is r.
    let near = near.map(|x| (0, x, (2.0 * x.high.powi(3) * odd, 2.0 * x.high.powi(4) * even)));
    let far = (1..=largest).flat_map(|k| {
        let (sinh, cosh) = missed(k, 0.3466, of_log);
        // From k = 60 on m is 4^-60, so only the exponent changes.
        around(k, if k > 60 { 12 } else { 4 * each as i32 }).map(move |(x, _)| (k, x, (sinh, cosh)))
    });
    near.chain(far).collect()
}

/// The largest error of a sum that is followed by the selection of a sign and a product with a power of two.
fn of_a_sum(function: Function) -> f64 {
    let tape = range::alone(function);
    let result = if function == Function::Sinh { otherwise(&tape, tape.output()) } else { tape.output() };
    let (twice, _) = product_of(&tape, result);
    let (sum, _) = sum_of(&tape, twice);
    let whole = first_whole(&tape);
    let mut worst = 0.0_f64;
    for (k, x, (sinh, cosh)) in cells(1025, 8) {
        let pins = Pins::from([(whole, Pin::Constant(f64::from(k)))]);
        for found in outcomes(&tape, &[x], &pins, sum) {
            worst = worst.max(in_units(&found, if function == Function::Sinh { sinh } else { cosh }));
        }
    }
    worst
}

pub(super) fn sinh() -> f64 {
    of_a_sum(Function::Sinh)
}

/// Below 2^-300 the result is 1.
pub(super) fn cosh() -> f64 {
    of_a_sum(Function::Cosh)
}

pub(super) fn tanh() -> f64 {
    let tape = range::alone(Function::Tanh);
    let result = otherwise(&tape, tape.output());
    let whole = first_whole(&tape);
    let mut worst = 0.0_f64;
    for (k, x, (sinh, cosh)) in cells(32, 64) {
        if x.low > 22.0 {
            continue;
        }
        let pins = Pins::from([(whole, Pin::Constant(f64::from(k)))]);
        for found in outcomes(&tape, &[x], &pins, result) {
            // 2^(1-k) cosh x is 2 or more at k = 0, and e^r or more at others. From 22 on the result is that at 22, and 1 - tanh 22 < 2e-19.
            let least = if k == 0 { 2.0 } else { 0.7 };
            let missed = (sinh + found.ideal.high * cosh) / least * (1.0 + 1e-9) + if x.high >= 22.0 { 2e-19 } else { 0.0 };
            worst = worst.max(in_units(&found, missed));
        }
    }
    worst
}

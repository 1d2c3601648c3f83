//! log, log10, sqrt.

use super::derive::{log_of_ten, log_of_two, polynomial_bound};
use super::engine::{Pin, outcomes};
use super::span::{Span, span};
use super::{Pins, in_units, lacks, otherwise, powers, then};
use crate::elementary::{Function, coefficients, range};
use crate::number::integer;
use crate::tape::{Op, Reg, Tape};

/// The registers of the argument's exponent, of its significand m, and of the power of two between them.
fn taken_apart(tape: &Tape) -> [Reg; 3] {
    let of = |wanted: &dyn Fn(&Op) -> bool| tape.iter().find(|(_, op)| wanted(op)).expect("the tape has it").0;
    let exponent = of(&|op| matches!(op, Op::Exponent(_)));
    let factor = of(&|op| matches!(op, Op::PowerOfTwo(_)));
    [exponent, of(&|op| matches!(op, Op::Multiply(_, by) if *by == factor)), factor]
}

/// The limits of m: slightly beyond sqrt(1/2) and sqrt 2, because of the rounding in the choice of k.
const LEAST: f64 = std::f64::consts::FRAC_1_SQRT_2 - 1e-8;
const MOST: f64 = std::f64::consts::SQRT_2 + 1e-8;

/// x = 2^k m, with m from sqrt(1/2) to sqrt 2 except for the rounding of x sqrt 2 that selects k.
fn of_parts(function: Function, parts: [f64; 2], of_two: &crate::number::Rational, factor_lacks: f64) -> f64 {
    let tape = range::alone(function);
    let result = then(&tape, otherwise(&tape, tape.output()));
    let [exponent, m, factor] = taken_apart(&tape);
    let (lacks, misses) = (lacks(&parts, of_two), polynomial_bound("LOG"));
    let mut worst = 0.0_f64;
    let mut cell = |k: i32, cell: Span| {
        // The argument does not matter: any number from 1 on, from whose exponent the tape subtracts 54.
        let pins =
            Pins::from([(exponent, Pin::Constant(f64::from(k - 54))), (m, Pin::Any(cell)), (factor, Pin::Constant(1.0))]);
        let f = (cell.low - 1.0).abs().max((cell.high - 1.0).abs());
        // s grows with m.
        let s = [cell.low, cell.high].map(|m| ((m - 1.0) / (m + 1.0)).abs()).into_iter().fold(0.0, f64::max) * (1.0 + 1e-9);
        assert!(s * s <= 0.02945);
        // |log m| <= 1.21 |m - 1| from 0.7 on.
        let missed = f64::from(k.abs()) * lacks + s * s * s * misses + 1.21 * f * factor_lacks;
        for found in outcomes(&tape, &[Span::point(3.0)], &pins, result) {
            worst = worst.max(in_units(&found, missed * (1.0 + 1e-9)));
        }
    };
    for k in (-1074_i32..=1023).filter(|k| *k != 0) {
        // Near k = 0 the result and its units are smallest.
        super::parts(LEAST, MOST, if k.abs() < 4 { 512 } else { 8 }).for_each(|m| cell(k, m));
    }
    // Near 1 the logarithm is small.
    for f in powers(-52, -4, 16).chain(powers(-4, -1, 128)).filter(|f| f.low < 0.414_214) {
        cell(0, span(1.0 + f.low, (1.0 + f.high).min(MOST)));
    }
    for f in powers(-53, -4, 16).chain(powers(-4, -1, 128)).filter(|f| f.low < 0.292_893) {
        cell(0, span((1.0 - f.high).max(LEAST), 1.0 - f.low));
    }
    worst
}

pub(super) fn log() -> f64 {
    of_parts(Function::Log, coefficients::LOG_OF_TWO, &log_of_two(), 0.0)
}

pub(super) fn log10() -> f64 {
    let of_ten = log_of_ten();
    let factor = lacks(&coefficients::INVERSE_LOG_OF_TEN, &(integer(1) / &of_ten));
    of_parts(Function::Log10, coefficients::LOG10_OF_TWO, &(log_of_two() / &of_ten), factor)
}

/// A unit of rounding.
const U: f64 = f64::EPSILON / 2.0;

/// The relative errors of the first number and of the sum, for the pair of the square root of m in [1, 4].
pub(super) fn root() -> (f64, f64) {
    // The cubic for 1/sqrt m is 1 + d: d over cells, from the value in the middle and a slope of d below 1 there. Its own roundings are below 1e-15.
    let count = 20_000;
    let width = 3.0 / f64::from(count);
    let off = |m: f64| (1.5372 + m * (-0.7116 + m * (0.1832 - m * 0.0176))) * m.sqrt() - 1.0;
    let mut d = (0..count).map(|k| off(1.0 + width * (f64::from(k) + 0.5)).abs()).fold(0.0_f64, f64::max) + 0.5 * width + 1e-12;
    assert!(d < 0.01, "{d}");
    for _ in 0..3 {
        // The exact error of y (3 - m y^2)/2 is -3 d^2/2 - d^3/2. m y^2 is rounded twice, the difference from 1 at most once, then the product and
        // the sum.
        let square = (1.0 + d) * (1.0 + d);
        let rest = square * (2.0 * U + U * U);
        let error = (square - 1.0 + rest) * (1.0 + U);
        let step = 0.5 * (1.0 + d) * (rest + U * error + U * error);
        d = (1.5 * d * d + 0.5 * d * d * d + step + U * (1.0 + 2.0 * d)) * (1.0 + 1e-9);
    }
    // high = sqrt m (1 + e). In exact arithmetic, low = (m - high^2) y/2 leaves e^2/2 and e d. The rest is rounded twice, and its product once.
    let e = d + U + d * U;
    let rest = 2.0 * e + e * e;
    let sum = e * e / 2.0 + 0.5 * rest * d + 0.5 * rest * (1.0 + d) * (4.0 * U);
    (e, sum * (1.0 + 1e-9))
}

/// One sum is rounded. Powers of two are exact, and no result is subnormal.
pub(super) fn sqrt() -> f64 {
    let (_, sum) = root();
    // A share is at most 2^53 units.
    0.5 + sum / U
}

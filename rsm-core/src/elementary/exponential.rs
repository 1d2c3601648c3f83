//! exp, sinh, cosh, tanh.
//!
//! x = k log 2 + r with a whole k and |r| <= log 2/2, in a pair of numbers (W. J. Cody, W. Waite, "Software Manual for the Elementary Functions",
//! 1980): exp x = 2^k exp r. For the hyperbolic functions, with m = 4^-k:
//!
//! ```text
//! sinh x = 2^(k-1) ((1 + m) sinh r + (1 - m) cosh r)
//! cosh x = 2^(k-1) ((1 + m) cosh r + (1 - m) sinh r)
//! ```
//!
//! These formulas lose nothing to cancellation; at k = 0 they are sinh r and cosh r themselves.

use super::coefficients::{COSH, EXP, INVERSE_LOG_OF_TWO, LOG_OF_TWO, SINH};
use super::pair::{Pair, constant, nearest_whole, polynomial, quick_sum, quotient, split};
use crate::tape::{Op, Reg, TapeBuilder};

/// k and r, the latter as a pair.
fn reduced(tape: &mut TapeBuilder, x: Reg) -> (Reg, Pair) {
    let inverse = constant(tape, INVERSE_LOG_OF_TWO);
    let quotient = tape.multiply(x, inverse);
    let k = nearest_whole(tape, quotient);
    let [of_high, of_low] = LOG_OF_TWO.map(|part| {
        let part = constant(tape, part);
        tape.multiply(k, part)
    });
    // Exact: k has 11 bits and the first part of log 2 has 40.
    let rest = tape.subtract(x, of_high);
    let high = tape.subtract(rest, of_low);
    let lost = tape.subtract(rest, high);
    (k, Pair { high, low: tape.subtract(lost, of_low) })
}

pub(super) fn exp(tape: &mut TapeBuilder, x: Reg) -> Reg {
    // Beyond these limits the result is 0 or infinite.
    let (low, high) = (constant(tape, -746.0), constant(tape, 710.0));
    let x = tape.at_least(x, low);
    let x = tape.at_most(x, high);
    let (k, r) = reduced(tape, x);
    let one = constant(tape, 1.0);
    let begin = quick_sum(tape, one, r.high);
    let square = tape.multiply(r.high, r.high);
    let series = polynomial(tape, r.high, EXP);
    let rest = tape.multiply(square, series);
    let of_low = tape.multiply(r.low, begin.high);
    let rest = tape.add(rest, of_low);
    let rest = tape.add(begin.low, rest);
    let y = tape.add(begin.high, rest);
    // In two steps, because one factor cannot reach subnormal results or the largest ones.
    let half = constant(tape, 0.5);
    let half = tape.multiply(k, half);
    let first = nearest_whole(tape, half);
    let second = tape.subtract(k, first);
    let (first, second) = (tape.push(Op::PowerOfTwo(first)), tape.push(Op::PowerOfTwo(second)));
    let scaled = tape.multiply(y, first);
    tape.multiply(scaled, second)
}

/// The common part of sinh and cosh of |x|.
struct Hyperbolic {
    k: Reg,
    sinh: Pair,
    cosh: Pair,
}

/// 2^(1-k) sinh and 2^(1-k) cosh of a number that is not negative.
fn hyperbolic(tape: &mut TapeBuilder, magnitude: Reg) -> Hyperbolic {
    let (k, r) = reduced(tape, magnitude);
    let z = tape.multiply(r.high, r.high);
    // sinh r = r + odd, cosh r = 1 + even
    let series = polynomial(tape, z, SINH);
    let cube = tape.multiply(z, r.high);
    let odd = tape.multiply(cube, series);
    let odd = tape.add(odd, r.low);
    let series = polynomial(tape, z, COSH);
    let square = tape.multiply(z, z);
    let even = tape.multiply(square, series);
    let half = constant(tape, 0.5);
    let half = tape.multiply(z, half);
    let even = tape.add(half, even);
    let of_low = tape.multiply(r.high, r.low);
    let even = tape.add(even, of_low);
    // 4^-k; below 2^-120 it has no effect.
    let most = constant(tape, 60.0);
    let bounded = tape.at_most(k, most);
    let minus_two = constant(tape, -2.0);
    let exponent = tape.multiply(bounded, minus_two);
    let m = tape.push(Op::PowerOfTwo(exponent));
    let one = constant(tape, 1.0);
    let opposite = tape.negate(m);
    let (plus, minus) = (quick_sum(tape, one, m), quick_sum(tape, one, opposite));
    let r = split(tape, r.high);
    let odd = tape.add(r.low, odd);
    // with c the factor of cosh r and s that of sinh r: c + s r + (s odd + c even); s r.high is exact while 1 + m has 27 bits.
    let mut combined = |c: Pair, s: Pair| {
        let leading = tape.multiply(s.high, r.high);
        let begin = quick_sum(tape, c.high, leading);
        let (of_odd, of_even) = (tape.multiply(s.high, odd), tape.multiply(c.high, even));
        let rest = tape.add(of_odd, of_even);
        // From k = 27 on 1 + m is rounded.
        let of_low = tape.multiply(s.low, r.high);
        let lost = tape.add(c.low, of_low);
        let rest = tape.add(lost, rest);
        Pair { high: begin.high, low: tape.add(begin.low, rest) }
    };
    Hyperbolic { sinh: combined(minus, plus), cosh: combined(plus, minus), k }
}

/// 2^(k-1) times a pair.
fn scaled(tape: &mut TapeBuilder, value: Pair, k: Reg) -> Reg {
    let sum = tape.add(value.high, value.low);
    let twice = tape.add(sum, sum);
    let two = constant(tape, 2.0);
    let exponent = tape.subtract(k, two);
    let factor = tape.push(Op::PowerOfTwo(exponent));
    tape.multiply(twice, factor)
}

/// |x|, at most the bound.
fn bounded_magnitude(tape: &mut TapeBuilder, x: Reg, bound: f64) -> Reg {
    let magnitude = tape.absolute(x);
    let bound = constant(tape, bound);
    tape.at_most(magnitude, bound)
}

/// The result with the sign of x.
pub(super) fn with_sign_of(tape: &mut TapeBuilder, x: Reg, result: Reg) -> Reg {
    let zero = constant(tape, 0.0);
    let negated = tape.negate(result);
    tape.select_less(x, zero, negated, result)
}

pub(super) fn sinh(tape: &mut TapeBuilder, x: Reg) -> Reg {
    // The result is infinite from 710.48 on; k stays below 1026.
    let magnitude = bounded_magnitude(tape, x, 710.5);
    let all = hyperbolic(tape, magnitude);
    let result = scaled(tape, all.sinh, all.k);
    with_sign_of(tape, x, result)
}

pub(super) fn cosh(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let magnitude = bounded_magnitude(tape, x, 710.5);
    let all = hyperbolic(tape, magnitude);
    scaled(tape, all.cosh, all.k)
}

pub(super) fn tanh(tape: &mut TapeBuilder, x: Reg) -> Reg {
    // 1 - tanh 22 is 2^-62.
    let magnitude = bounded_magnitude(tape, x, 22.0);
    let all = hyperbolic(tape, magnitude);
    let result = quotient(tape, all.sinh, all.cosh);
    let result = tape.add(result.high, result.low);
    with_sign_of(tape, x, result)
}

//! log, log10, sqrt.
//!
//! x = 2^k m with m in [sqrt(1/2), sqrt 2), f = m - 1, s = f/(2 + f): log m = 2 atanh s, whose leading part f is exact. The square root of m in
//! [1, 4) begins with a cubic for 1/sqrt m, doubles the number of digits three times (Newton), and ends with the exact remainder m - s^2.

use super::coefficients::{INVERSE_LOG_OF_TEN, LOG, LOG_OF_TWO, LOG10_OF_TWO};
use super::pair::{Pair, constant, polynomial, product, quick_sum, split};
use crate::tape::{Op, Reg, TapeBuilder};

/// A number times 2^54 if it is below 1, times 2^-54 otherwise, so that it is normal and cannot overflow. Also the opposite exponent of that factor.
fn within_the_normal_numbers(tape: &mut TapeBuilder, x: Reg) -> (Reg, Reg) {
    let one = constant(tape, 1.0);
    let (up, down) = (constant(tape, 2f64.powi(54)), constant(tape, 2f64.powi(-54)));
    let factor = tape.select_less(x, one, up, down);
    let (below, above) = (constant(tape, -54.0), constant(tape, 54.0));
    (tape.multiply(x, factor), tape.select_less(x, one, below, above))
}

/// k, f, and log m - f.
fn reduced(tape: &mut TapeBuilder, x: Reg) -> (Reg, Reg, Reg) {
    let (scaled, offset) = within_the_normal_numbers(tape, x);
    let root = constant(tape, std::f64::consts::SQRT_2);
    let raised = tape.multiply(scaled, root);
    let exponent = tape.push(Op::Exponent(raised));
    let k = tape.add(exponent, offset);
    let opposite = tape.negate(exponent);
    let factor = tape.push(Op::PowerOfTwo(opposite));
    let m = tape.multiply(scaled, factor);
    let (one, two) = (constant(tape, 1.0), constant(tape, 2.0));
    let f = tape.subtract(m, one);
    let denominator = tape.add(two, f);
    let s = tape.divide(f, denominator);
    let z = tape.multiply(s, s);
    let series = polynomial(tape, z, LOG);
    let series = tape.multiply(z, series);
    // 2 s + s series = f - (f^2/2 - s (f^2/2 + series))
    let half = constant(tape, 0.5);
    let half = tape.multiply(f, half);
    let half_square = tape.multiply(half, f);
    let inner = tape.add(half_square, series);
    let inner = tape.multiply(s, inner);
    (k, f, tape.subtract(inner, half_square))
}

/// The logarithm if it is defined; -inf at 0, infinity at infinity, NaN below 0.
fn completed(tape: &mut TapeBuilder, x: Reg, result: Reg) -> Reg {
    let zero = constant(tape, 0.0);
    let minus_one = constant(tape, -1.0);
    // 0/0 below 0, -1/0 at 0, NaN at NaN
    let numerator = tape.select_less(x, zero, zero, minus_one);
    let nothing = tape.subtract(x, x);
    let numerator = tape.add(numerator, nothing);
    let outside = tape.divide(numerator, zero);
    let inside = tape.select_less(zero, x, result, outside);
    let largest = constant(tape, f64::MAX);
    tape.select_less(largest, x, x, inside)
}

pub(super) fn log(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (k, f, rest) = reduced(tape, x);
    let [high, low] = LOG_OF_TWO.map(|part| {
        let part = constant(tape, part);
        tape.multiply(k, part)
    });
    // |k log 2| is 0 or larger than |f|.
    let begin = quick_sum(tape, high, f);
    let rest = tape.add(low, rest);
    let rest = tape.add(begin.low, rest);
    let result = tape.add(begin.high, rest);
    completed(tape, x, result)
}

pub(super) fn log10(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (k, f, rest) = reduced(tape, x);
    let of_m = quick_sum(tape, f, rest);
    let parts = split(tape, of_m.high);
    let [inverse_high, inverse_low] = INVERSE_LOG_OF_TEN.map(|part| constant(tape, part));
    // Exact: 26 bits each.
    let leading = tape.multiply(parts.high, inverse_high);
    let small = tape.add(parts.low, of_m.low);
    let of_small = tape.multiply(small, inverse_high);
    let of_rest = tape.multiply(of_m.high, inverse_low);
    let rest = tape.add(of_small, of_rest);
    let [high, low] = LOG10_OF_TWO.map(|part| {
        let part = constant(tape, part);
        tape.multiply(k, part)
    });
    let begin = quick_sum(tape, high, leading);
    let rest = tape.add(low, rest);
    let rest = tape.add(begin.low, rest);
    let result = tape.add(begin.high, rest);
    completed(tape, x, result)
}

/// The square root of a number that is not negative, as a pair whose sum must be rounded, and the factor by which both must still be multiplied: a
/// power of two.
fn root(tape: &mut TapeBuilder, x: Reg) -> (Pair, Reg) {
    let (scaled, offset) = within_the_normal_numbers(tape, x);
    let exponent = tape.push(Op::Exponent(scaled));
    // It is less only for zero, whose square root is zero for any factor.
    let least = constant(tape, -1020.0);
    let exponent = tape.at_least(exponent, least);
    // floor(exponent/2): the exponent/2 - 1/4 is nearer to it than to any other integer.
    let (half, quarter) = (constant(tape, 0.5), constant(tape, 0.25));
    let halved = tape.multiply(exponent, half);
    let lowered = tape.subtract(halved, quarter);
    let h = super::pair::nearest_whole(tape, lowered);
    let minus_two = constant(tape, -2.0);
    let opposite = tape.multiply(h, minus_two);
    let factor = tape.push(Op::PowerOfTwo(opposite));
    let m = tape.multiply(scaled, factor);
    // 1/sqrt m to 0.9 % on [1, 4]; the cubic interpolates it at four points.
    let mut inverse = polynomial(tape, m, &[1.5372, -0.7116, 0.1832, -0.0176]);
    let one = constant(tape, 1.0);
    for _ in 0..3 {
        // y + y (1 - m y^2)/2
        let product = tape.multiply(m, inverse);
        let square = tape.multiply(product, inverse);
        let error = tape.subtract(one, square);
        let half_inverse = tape.multiply(inverse, half);
        let step = tape.multiply(half_inverse, error);
        inverse = tape.add(inverse, step);
    }
    let high = tape.multiply(m, inverse);
    let square = product(tape, high, high);
    let rest = tape.subtract(m, square.high);
    let rest = tape.subtract(rest, square.low);
    let half_inverse = tape.multiply(inverse, half);
    let low = tape.multiply(rest, half_inverse);
    let half_offset = tape.multiply(offset, half);
    let exponent = tape.add(h, half_offset);
    (Pair { high, low }, tape.push(Op::PowerOfTwo(exponent)))
}

pub(super) fn sqrt(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (pair, factor) = root(tape, x);
    let sum = tape.add(pair.high, pair.low);
    let result = tape.multiply(sum, factor);
    let (zero, largest) = (constant(tape, 0.0), constant(tape, f64::MAX));
    let nan = tape.divide(zero, zero);
    let result = tape.select_less(x, zero, nan, result);
    tape.select_less(largest, x, x, result)
}

/// The square root as a pair, NaN below 0.
pub(super) fn sqrt_pair(tape: &mut TapeBuilder, x: Reg) -> Pair {
    let (pair, factor) = root(tape, x);
    let high = tape.multiply(pair.high, factor);
    let zero = constant(tape, 0.0);
    let nan = tape.divide(zero, zero);
    Pair { high: tape.select_less(x, zero, nan, high), low: tape.multiply(pair.low, factor) }
}

//! sin, cos, tan.
//!
//! x = k pi/2 + r with an integer k and |r| <= pi/4, r as a pair of numbers. The first three parts of pi/2 have 33 bits each, so that their products
//! with k are exact for |k| < 2^20. The rounding errors of the differences are kept (Cody and Waite; K. C. Ng, "Argument reduction for huge
//! arguments", 1992). The remainder of k by 4 selects sin r or cos r, and the sign.

use super::coefficients::{COS, HALF_PI, INVERSE_HALF_PI, SIN};
use super::pair::{Pair, constant, difference, nearest_whole, polynomial, product, quotient};
use crate::tape::{Reg, TapeBuilder};

/// Beyond this argument the result is NaN, because k would have more than 20 bits.
pub(super) const LIMIT: f64 = 800_000.0;

/// The remainder of k by 4, in -2, -1, 0, 1, 2, and r.
fn reduced(tape: &mut TapeBuilder, x: Reg) -> (Reg, Pair) {
    let inverse = constant(tape, INVERSE_HALF_PI);
    let quotient = tape.multiply(x, inverse);
    let k = nearest_whole(tape, quotient);
    let [first, second, third, fourth] = HALF_PI.map(|part| {
        let part = constant(tape, part);
        tape.multiply(k, part)
    });
    let rest = tape.subtract(x, first);
    let a = difference(tape, rest, second);
    let b = difference(tape, a.high, third);
    let low = tape.add(a.low, b.low);
    let low = tape.subtract(low, fourth);
    let high = tape.add(b.high, low);
    let taken = tape.subtract(high, b.high);
    let low = tape.subtract(low, taken);
    let (quarter, four) = (constant(tape, 0.25), constant(tape, 4.0));
    let turns = tape.multiply(k, quarter);
    let turns = nearest_whole(tape, turns);
    let whole_turns = tape.multiply(turns, four);
    (tape.subtract(k, whole_turns), Pair { high, low })
}

/// sin r = r + tail.
fn sine(tape: &mut TapeBuilder, r: Pair, z: Reg, half_z: Reg) -> Pair {
    let cube = tape.multiply(z, r.high);
    let series = polynomial(tape, z, SIN);
    let tail = tape.multiply(cube, series);
    let one = constant(tape, 1.0);
    let slope = tape.subtract(one, half_z);
    let of_low = tape.multiply(r.low, slope);
    Pair { high: r.high, low: tape.add(tail, of_low) }
}

/// cos r = (1 - z/2) + tail.
fn cosine(tape: &mut TapeBuilder, r: Pair, z: Reg, half_z: Reg) -> Pair {
    let one = constant(tape, 1.0);
    let high = tape.subtract(one, half_z);
    let taken = tape.subtract(one, high);
    let lost = tape.subtract(taken, half_z);
    let square = tape.multiply(z, z);
    let series = polynomial(tape, z, COS);
    let tail = tape.multiply(square, series);
    let of_low = tape.multiply(r.high, r.low);
    let tail = tape.subtract(tail, of_low);
    Pair { high, low: tape.add(lost, tail) }
}

fn half(tape: &mut TapeBuilder, z: Reg) -> Reg {
    let half = constant(tape, 0.5);
    tape.multiply(z, half)
}

/// sin r and cos r.
pub(super) fn of_remainder(tape: &mut TapeBuilder, r: Pair) -> (Reg, Reg) {
    let z = tape.multiply(r.high, r.high);
    let half_z = half(tape, z);
    let (sine, cosine) = (sine(tape, r, z, half_z), cosine(tape, r, z, half_z));
    (tape.add(sine.high, sine.low), tape.add(cosine.high, cosine.low))
}

/// The remainder of k by 4, sin r and cos r.
fn both(tape: &mut TapeBuilder, x: Reg) -> (Reg, Reg, Reg) {
    let (quadrant, r) = reduced(tape, x);
    let (sine, cosine) = of_remainder(tape, r);
    (quadrant, sine, cosine)
}

/// `odd` if the remainder is 1 or -1, otherwise `even`.
fn by_parity(tape: &mut TapeBuilder, quadrant: Reg, odd: Reg, even: Reg) -> Reg {
    let (half, one) = (constant(tape, 0.5), constant(tape, 1.0));
    let magnitude = tape.absolute(quadrant);
    let from_one = tape.subtract(magnitude, one);
    let distance = tape.absolute(from_one);
    tape.select_less(distance, half, odd, even)
}

/// NaN if the argument is beyond the limit or NaN.
fn within_the_limit(tape: &mut TapeBuilder, x: Reg, result: Reg) -> Reg {
    let zero = constant(tape, 0.0);
    let nan = tape.divide(zero, zero);
    let magnitude = tape.absolute(x);
    let limit = constant(tape, LIMIT);
    tape.select_less(limit, magnitude, nan, result)
}

pub(super) fn sin(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (quadrant, sine, cosine) = both(tape, x);
    let value = by_parity(tape, quadrant, cosine, sine);
    // Negative at -2, -1 and 2: these are more than 1 away from 1/2.
    let (half, one) = (constant(tape, 0.5), constant(tape, 1.0));
    let from_half = tape.subtract(quadrant, half);
    let distance = tape.absolute(from_half);
    let negated = tape.negate(value);
    let result = tape.select_less(one, distance, negated, value);
    within_the_limit(tape, x, result)
}

pub(super) fn cos(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (quadrant, sine, cosine) = both(tape, x);
    let value = by_parity(tape, quadrant, sine, cosine);
    // Negative at -2, 1 and 2: these are more than 1 away from -1/2.
    let (half, one) = (constant(tape, 0.5), constant(tape, 1.0));
    let from_half = tape.add(quadrant, half);
    let distance = tape.absolute(from_half);
    let negated = tape.negate(value);
    let result = tape.select_less(one, distance, negated, value);
    within_the_limit(tape, x, result)
}

/// tan r, or -1/tan r where k is odd.
pub(super) fn tangent(tape: &mut TapeBuilder, quadrant: Reg, r: Pair) -> Reg {
    let square = product(tape, r.high, r.high);
    let half_z = half(tape, square.high);
    let sine = sine(tape, r, square.high, half_z);
    let cosine = cosine(tape, r, square.high, half_z);
    // A quotient of two rounded results would have an error above one unit, so the rounding error of the square is included in the cosine.
    let half_rest = half(tape, square.low);
    let cosine = Pair { high: cosine.high, low: tape.subtract(cosine.low, half_rest) };
    // sin/cos, or cos/-sin
    let negated = [tape.negate(sine.high), tape.negate(sine.low)];
    let mut choose = |odd: Reg, even: Reg| by_parity(tape, quadrant, odd, even);
    let numerator = Pair { high: choose(cosine.high, sine.high), low: choose(cosine.low, sine.low) };
    let denominator = Pair { high: choose(negated[0], cosine.high), low: choose(negated[1], cosine.low) };
    let result = quotient(tape, numerator, denominator);
    tape.add(result.high, result.low)
}

pub(super) fn tan(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (quadrant, r) = reduced(tape, x);
    let result = tangent(tape, quadrant, r);
    within_the_limit(tape, x, result)
}

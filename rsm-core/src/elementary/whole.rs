//! Functions without a series: floor, the remainder of a division, the sign, minimum and maximum, integer powers.

use super::exponential::with_sign_of;
use super::pair::constant;
use crate::tape::{Reg, TapeBuilder};

/// The largest integer that is not above x, exactly.
pub(super) fn floor(tape: &mut TapeBuilder, x: Reg) -> Reg {
    // From 2^52 on every number is an integer. Below, adding 2^52 removes the fractional digits.
    let border = constant(tape, 2f64.powi(52));
    let magnitude = tape.absolute(x);
    let lifted = tape.add(magnitude, border);
    let nearest = tape.subtract(lifted, border);
    let nearest = with_sign_of(tape, x, nearest);
    let one = constant(tape, 1.0);
    let below = tape.subtract(nearest, one);
    let floor = tape.select_less(x, nearest, below, nearest);
    tape.select_less(magnitude, border, floor, x)
}

/// x - floor(x/y) y, as Modelica defines `mod`: the sign of the result is that of y.
pub fn modulo(tape: &mut TapeBuilder, x: Reg, y: Reg) -> Reg {
    let quotient = tape.divide(x, y);
    let whole = super::write(tape, super::Function::Floor, &[quotient]);
    let taken = tape.multiply(whole, y);
    tape.subtract(x, taken)
}

/// -1, 0 or 1; NaN for NaN.
pub fn sign(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let (zero, one, minus_one) = (constant(tape, 0.0), constant(tape, 1.0), constant(tape, -1.0));
    // Zero and NaN are unchanged.
    let positive = tape.select_less(zero, x, one, x);
    tape.select_less(x, zero, minus_one, positive)
}

/// The smaller of two; NaN if either is NaN.
pub fn minimum(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Reg {
    let smaller = tape.at_most(a, b);
    with_nan_of(tape, b, smaller)
}

/// The larger of two; NaN if either is NaN.
pub fn maximum(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Reg {
    let larger = tape.at_least(a, b);
    with_nan_of(tape, b, larger)
}

/// The result, or b if b is NaN: every other number is below the largest one or above the smallest one.
fn with_nan_of(tape: &mut TapeBuilder, b: Reg, result: Reg) -> Reg {
    let (largest, smallest) = (constant(tape, f64::MAX), constant(tape, f64::MIN));
    let from_above = tape.select_less(smallest, b, result, b);
    tape.select_less(b, largest, result, from_above)
}

/// x to an integer power, by squaring: about 2 log2 n products, each rounded. A negative power is 1 over the positive one.
pub fn power(tape: &mut TapeBuilder, x: Reg, exponent: i32) -> Reg {
    let mut rest = exponent.unsigned_abs();
    let mut square = x;
    let mut result: Option<Reg> = None;
    while rest > 0 {
        if rest % 2 == 1 {
            result = Some(result.map_or(square, |result| tape.multiply(result, square)));
        }
        rest /= 2;
        if rest > 0 {
            square = tape.multiply(square, square);
        }
    }
    let one = constant(tape, 1.0);
    match result {
        None => one,
        Some(result) if exponent < 0 => tape.divide(one, result),
        Some(result) => result,
    }
}

//! Sine and cosine of one angle, computed without a tape: the same operations as `circular.rs`, and so the same bits.
//!
//! For loops over many angles. It is as fast as a system's library, whose last bits differ between systems.

use super::circular::LIMIT;
use super::coefficients::{COS, HALF_PI, INVERSE_HALF_PI, SIN};

/// a - b with its rounding error, for any a and b (Knuth).
#[inline(always)]
fn difference(a: f64, b: f64) -> (f64, f64) {
    let high = a - b;
    let part = high - a;
    (high, (a - (high - part)) - (b + part))
}

/// The integer nearest to a value below 2^51: a number plus 3 * 2^51 has no fractional digits.
#[inline(always)]
fn nearest_whole(value: f64) -> f64 {
    const LIFT: f64 = 6_755_399_441_055_744.0;
    (value + LIFT) - LIFT
}

#[inline(always)]
fn polynomial(z: f64, coefficients: &[f64]) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, a| sum * z + a)
}

/// The sine and the cosine of an angle in rad, with errors below 0.85 units in the last place: the bits of [`Function::Sin`](super::Function::Sin)
/// and [`Function::Cos`](super::Function::Cos) in a tape. NaN for magnitudes above 800,000 rad, as there.
///
/// ```
/// let (sin, cos) = rsm_core::elementary::sin_cos(0.5);
/// assert_eq!((sin, cos), (0.479425538604203, 0.8775825618903728));
/// ```
#[inline]
#[must_use]
pub fn sin_cos(x: f64) -> (f64, f64) {
    let k = nearest_whole(x * INVERSE_HALF_PI);
    let a = difference(x - k * HALF_PI[0], k * HALF_PI[1]);
    let b = difference(a.0, k * HALF_PI[2]);
    let low = (a.1 + b.1) - k * HALF_PI[3];
    let r = b.0 + low;
    let low = low - (r - b.0);
    let quadrant = k - nearest_whole(k * 0.25) * 4.0;
    let z = r * r;
    let half_z = z * 0.5;
    let slope = 1.0 - half_z;
    let sine = r + ((z * r) * polynomial(z, SIN) + low * slope);
    let lost = (1.0 - slope) - half_z;
    let cosine = slope + (lost + ((z * z) * polynomial(z, COS) - r * low));
    let is_odd = (quadrant.abs() - 1.0).abs() < 0.5;
    let (sin, cos) = if is_odd { (cosine, sine) } else { (sine, cosine) };
    // The sine is negative at the quadrants -2, -1 and 2, the cosine at -2, 1 and 2.
    let sin = if 1.0 < (quadrant - 0.5).abs() { -sin } else { sin };
    let cos = if 1.0 < (quadrant + 0.5).abs() { -cos } else { cos };
    if LIMIT < x.abs() { (f64::NAN, f64::NAN) } else { (sin, cos) }
}

#[cfg(test)]
mod tests {
    use super::super::{Function, write};
    use super::*;
    use crate::number::Precision;
    use crate::run::Interpreter;
    use crate::tape::TapeBuilder;

    #[test]
    fn the_bits_are_those_of_a_tape() {
        let of_tape = [Function::Sin, Function::Cos].map(|function| {
            let mut tape = TapeBuilder::sharing(Precision::F64);
            let angle = tape.input(0);
            let result = write(&mut tape, function, &[angle]);
            tape.finish("wave", vec!["angle".to_string()], result)
        });
        let [mut sin, mut cos] = of_tape.each_ref().map(Interpreter::<f64>::new);
        // Angles of every magnitude and both signs: a Weyl sequence in the exponent and in the fraction.
        let drawn = (1..200_000_u32).map(|k| {
            let share = |step: f64| (f64::from(k) * step).fract();
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sign * 2f64.powf(60.0 * share(0.618_033_988_749_894_9) - 40.0) * (1.0 + share(0.414_213_562_373_095_1))
        });
        let multiples = (-4000..4000).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_4);
        let edges = [0.0, -0.0, LIMIT, -LIMIT, LIMIT.next_up(), f64::INFINITY, f64::NAN, 5e-324];
        for angle in drawn.chain(multiples).chain(edges) {
            let (own_sin, own_cos) = sin_cos(angle);
            for (own, tape) in [(own_sin, sin.eval(&[angle])), (own_cos, cos.eval(&[angle]))] {
                assert!(own.to_bits() == tape.to_bits() || own.is_nan() && tape.is_nan(), "{angle}: {own} and {tape}");
            }
        }
    }
}

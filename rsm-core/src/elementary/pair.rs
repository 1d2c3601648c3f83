//! Numbers as a sum of two: a result together with its rounding error.
//!
//! In: a builder and registers. Out: registers. Sums after Moller and Knuth (T. J. Dekker, "A floating-point technique for extending the available
//! precision", 1971; D. Knuth, "The Art of Computer Programming", volume 2, 4.2.2), products after Dekker with Veltkamp's split: all exact
//! unless something overflows or underflows.

use crate::number::exact;
use crate::tape::{Reg, TapeBuilder};

/// high + low.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub high: Reg,
    pub low: Reg,
}

pub(super) fn constant(tape: &mut TapeBuilder, value: f64) -> Reg {
    tape.constant(exact(value))
}

/// a(0) + a(1) z + ..., by Horner's rule.
pub(super) fn polynomial(tape: &mut TapeBuilder, z: Reg, coefficients: &[f64]) -> Reg {
    let (last, others) = coefficients.split_last().expect("a polynomial has a term");
    let mut sum = constant(tape, *last);
    for a in others.iter().rev() {
        let product = tape.multiply(sum, z);
        let a = constant(tape, *a);
        sum = tape.add(product, a);
    }
    sum
}

/// The integer nearest to a value below 2^51: a number plus 3 * 2^51 has no fractional digits.
pub(super) fn nearest_whole(tape: &mut TapeBuilder, value: Reg) -> Reg {
    let lift = constant(tape, 1.5 * 2f64.powi(52));
    let lifted = tape.add(value, lift);
    tape.subtract(lifted, lift)
}

/// a + b with its rounding error, for |a| >= |b| or a = 0.
pub(super) fn quick_sum(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Pair {
    let high = tape.add(a, b);
    let taken = tape.subtract(high, a);
    Pair { high, low: tape.subtract(b, taken) }
}

/// a - b with its rounding error, for any a and b.
pub(super) fn difference(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Pair {
    let high = tape.subtract(a, b);
    let part = tape.subtract(high, a);
    let rest = tape.subtract(high, part);
    let of_a = tape.subtract(a, rest);
    let of_b = tape.add(b, part);
    Pair { high, low: tape.subtract(of_a, of_b) }
}

/// a + b with its rounding error, for any a and b.
pub(super) fn sum(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Pair {
    let high = tape.add(a, b);
    let part = tape.subtract(high, a);
    let rest = tape.subtract(high, part);
    let of_a = tape.subtract(a, rest);
    let of_b = tape.subtract(b, part);
    Pair { high, low: tape.add(of_a, of_b) }
}

/// A number as a sum of two with 26 bits each.
pub(super) fn split(tape: &mut TapeBuilder, a: Reg) -> Pair {
    let factor = constant(tape, 134_217_729.0);
    let large = tape.multiply(a, factor);
    let rest = tape.subtract(large, a);
    let high = tape.subtract(large, rest);
    Pair { high, low: tape.subtract(a, high) }
}

/// a b with its rounding error.
pub(super) fn product(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Pair {
    let high = tape.multiply(a, b);
    let (of_a, of_b) = (split(tape, a), split(tape, b));
    let largest = tape.multiply(of_a.high, of_b.high);
    let cross = [tape.multiply(of_a.high, of_b.low), tape.multiply(of_a.low, of_b.high)];
    let smallest = tape.multiply(of_a.low, of_b.low);
    let mut low = tape.subtract(largest, high);
    for part in [cross[0], cross[1], smallest] {
        low = tape.add(low, part);
    }
    Pair { high, low }
}

/// (n.high + n.low)/(d.high + d.low) with a relative error of about 2^-100, before rounding to a pair whose parts are to be added.
pub(super) fn quotient(tape: &mut TapeBuilder, numerator: Pair, denominator: Pair) -> Pair {
    let n = quick_sum(tape, numerator.high, numerator.low);
    let d = quick_sum(tape, denominator.high, denominator.low);
    let high = tape.divide(n.high, d.high);
    // n - high d; the first difference is exact.
    let taken = product(tape, high, d.high);
    let rest = tape.subtract(n.high, taken.high);
    let rest = tape.subtract(rest, taken.low);
    let rest = tape.add(rest, n.low);
    let of_low = tape.multiply(high, d.low);
    let rest = tape.subtract(rest, of_low);
    Pair { high, low: tape.divide(rest, d.high) }
}

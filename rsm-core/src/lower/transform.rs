//! Lowers the transform of a response: value of the terms -> response.
//!
//! In: the register of the terms' value P. Out: that of the response. P is first limited to its proved range over the box, or to the limits of the
//! transform if an input extrapolates. This changes no true value. It limits a rounding error at the edge of the range, so that a root is not below 0
//! and a reciprocal has no pole and thus a bound of its rounding error.

use crate::elementary;
use crate::model::{Input, Surface, Transform};
use crate::number::exact;
use crate::range;
use crate::tape::{Op, Reg, TapeBuilder};
use crate::transform::exponential_steps;

use super::is_clamped;

pub(super) fn lower(tape: &mut TapeBuilder, transform: Transform, surface: &Surface, inputs: &[Input], terms: Reg) -> Reg {
    let limits = transform.limits();
    let (low, high) = if inputs.iter().all(is_clamped) {
        let proved = range::of_terms(surface, inputs);
        (proved.low.clamp(limits.low, limits.high), proved.high.clamp(limits.low, limits.high))
    } else {
        (limits.low, limits.high)
    };
    let mut limited = terms;
    let precision = tape.precision();
    if low.is_finite() {
        let bound = tape.rounded_constant(precision.round_down(&exact(low)), exact(low));
        limited = tape.at_least(limited, bound);
    }
    if high.is_finite() {
        let bound = tape.rounded_constant(precision.round_up(&exact(high)), exact(high));
        limited = tape.at_most(limited, bound);
    }
    match transform.exponent() {
        Some(exponent) => elementary::power(tape, limited, exponent),
        None => exponential(tape, limited),
    }
}

/// The formula of [`crate::transform::exponential`].
fn exponential(tape: &mut TapeBuilder, p: Reg) -> Reg {
    let (mut coefficients, squarings) = exponential_steps();
    let mut sum = tape.constant(coefficients.next().expect("there are twelve"));
    for coefficient in coefficients {
        let product = tape.push(Op::Multiply(sum, p));
        let coefficient = tape.constant(coefficient);
        sum = tape.push(Op::Add(product, coefficient));
    }
    for _ in 0..squarings {
        sum = tape.push(Op::Multiply(sum, sum));
    }
    sum
}

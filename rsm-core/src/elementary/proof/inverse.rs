//! asin, acos, atan, atan2.

use super::derive::{atan_of_half, half_pi, polynomial_bound};
use super::engine::{Pin, outcomes};
use super::logarithm::root;
use super::span::{Span, span};
use super::{Pins, in_units, lacks, otherwise, parts, powers, sum_of, then};
use crate::elementary::coefficients::{ATAN_OF_HALF, HALF_PI_PAIR, PI_PAIR, QUARTER_PI};
use crate::elementary::{Function, range};
use crate::number::integer;
use crate::tape::{Op, Reg, Tape};

fn difference_of(tape: &Tape, reg: Reg) -> (Reg, Reg) {
    let Op::Subtract(a, b) = *tape.op(reg) else { panic!("{reg} is no difference") };
    (a, b)
}

/// Arguments beyond 1/2 with the pair for the root of (1 - x)/2: the known registers of both numbers, and the largest root.
fn beyond_a_half(high: Reg, low: Reg) -> impl Iterator<Item = (Span, Pins, f64)> {
    let (share, sum) = root();
    // 1 - x from 2^-53 to 1/2.
    powers(-53, -4, 16).chain(powers(-4, -1, 256)).map(move |rest| {
        let x = span(1.0 - rest.high, 1.0 - rest.low);
        // Square roots to nearest, moved outward.
        let ends = [(1.0 - x.high) / 2.0, (1.0 - x.low) / 2.0].map(f64::sqrt);
        let ideal = span(ends[0].next_down(), ends[1].next_up());
        let pins = Pins::from([
            (high, Pin::High { ideal, error: share * ideal.high * 1.000_001 }),
            (low, Pin::Low { of: high, off: sum * ideal.high * 1.000_001 }),
        ]);
        (x, pins, ideal.high)
    })
}

/// Arguments up to 1/2.
fn up_to_a_half() -> impl Iterator<Item = Span> {
    powers(-300, -2, 8).chain(parts(0.25, 0.5, 64)).chain(std::iter::once(span(0.5, 0.5)))
}

/// The largest error of the polynomial for asin s - s, and of a constant as a sum of two numbers.
fn arc(s: f64) -> f64 {
    s * s * s * polynomial_bound("ASIN") * (1.0 + 1e-9)
}

pub(super) fn asin() -> f64 {
    let tape = range::alone(Function::Asin);
    let result = otherwise(&tape, tape.output());
    let (small, large) = (otherwise(&tape, result), then(&tape, result));
    let (high, tail) = sum_of(&tape, small);
    // begin.high + (begin.low + (low - 2 (s.low + tail)))
    let (_, inner) = sum_of(&tape, sum_of(&tape, large).1);
    let (low, same) = sum_of(&tape, sum_of(&tape, difference_of(&tape, inner).1).0);
    assert_eq!(tail, same);
    let mut worst = 0.0_f64;
    for x in up_to_a_half() {
        for found in outcomes(&tape, &[x], &Pins::new(), small) {
            worst = worst.max(in_units(&found, arc(x.high)));
        }
    }
    let constant = lacks(&HALF_PI_PAIR, &half_pi());
    for (x, pins, s) in beyond_a_half(high, low) {
        for found in outcomes(&tape, &[x], &pins, large) {
            worst = worst.max(in_units(&found, 2.0 * arc(s) + constant));
        }
    }
    worst
}

pub(super) fn acos() -> f64 {
    let tape = range::alone(Function::Acos);
    let (large, middle) = (then(&tape, tape.output()), otherwise(&tape, tape.output()));
    let (below, above) = (then(&tape, large), otherwise(&tape, large));
    let (high, rest) = sum_of(&tape, sum_of(&tape, above).0);
    let (low, _) = sum_of(&tape, rest);
    let mut worst = 0.0_f64;
    let constant = lacks(&HALF_PI_PAIR, &half_pi());
    let half_turn = lacks(&PI_PAIR, &(integer(2) * half_pi()));
    let near = std::iter::once(span(-2f64.powi(-60), 2f64.powi(-60)));
    let positive = || powers(-60, -2, 8).chain(parts(0.25, 0.5, 64)).chain(std::iter::once(span(0.5, 0.5)));
    for x in near.chain(positive()).chain(positive().map(Span::negated)) {
        for found in outcomes(&tape, &[x], &Pins::new(), middle) {
            worst = worst.max(in_units(&found, arc(x.largest()) + constant));
        }
    }
    for (x, pins, s) in beyond_a_half(high, low) {
        for found in outcomes(&tape, &[x], &pins, above) {
            worst = worst.max(in_units(&found, 2.0 * arc(s)));
        }
        for found in outcomes(&tape, &[x.negated()], &pins, below) {
            worst = worst.max(in_units(&found, 2.0 * arc(s) + half_turn));
        }
    }
    worst
}

/// The errors of the constants of the pieces and of a rotation.
fn constants() -> [f64; 2] {
    let pieces = lacks(&ATAN_OF_HALF, &atan_of_half()).max(lacks(&QUARTER_PI, &(half_pi() / integer(2))));
    [pieces, lacks(&PI_PAIR, &(integer(2) * half_pi()))]
}

/// The error of the angle of a quotient: that of its polynomial, and of the constants of pieces and rotations.
fn angle(quotient: Span, is_turned: bool, [pieces, turn]: [f64; 2]) -> f64 {
    // Here t is the quotient itself in the first piece. In the others it is (q - c)/(1 + c q): at most 2/11, for q = 3/4, plus its rounding.
    let third = 1.0 / 3.0;
    let (t, constants) = if quotient.high < third {
        (quotient.high, 0.0)
    } else if quotient.low >= third {
        (0.1825, pieces)
    } else {
        (0.3334, pieces)
    };
    assert!(t * t <= 0.1112);
    let turn = if is_turned { turn } else { 0.0 };
    t * t * t * polynomial_bound("ATAN") * (1.0 + 1e-9) + constants + turn
}

pub(super) fn atan() -> f64 {
    let (tape, constants) = (range::alone(Function::Atan), constants());
    let mut worst = 0.0_f64;
    // The first limit of the pieces is the number next to 1/3.
    let pieces = parts(0.25, 1.0 / 3.0, 128).chain(parts(1.0 / 3.0, 0.75, 1024)).chain(parts(0.75, 1.0, 128));
    let cells = powers(-300, -2, 8).chain(pieces).chain(parts(1.0, 4.0, 512)).chain(powers(2, 900, 4));
    // From 2^900 on the result is that of 2^900, and the angle changes by less than 2^-900.
    for x in cells.chain(std::iter::once(span(2f64.powi(900), 2f64.powi(901)))) {
        let quotient = if x.high <= 1.0 { x } else { span((1.0 / x.high).next_down(), (1.0 / x.low).next_up()) };
        for found in outcomes(&tape, &[x], &Pins::new(), tape.output()) {
            let far = if x.high > 2f64.powi(900) { 1e-250 } else { 0.0 };
            worst = worst.max(in_units(&found, angle(quotient, x.high > 1.0, constants) + far));
        }
    }
    worst
}

/// Powers of two scale both arguments: the larger one is from 1 to 2, the other is any smaller number.
pub(super) fn atan2() -> f64 {
    let (tape, constants) = (range::alone(Function::Atan2), constants());
    let mut worst = 0.0_f64;
    for large in parts(1.0, 2.0, 16) {
        for small in powers(-300, -3, 4).chain(parts(0.125, 2.0, 120)).filter(|small| small.low <= large.high) {
            let quotient = span((small.low / large.high).next_down(), (small.high / large.low).next_up());
            // Near the positive x axis there is no rotation, unless y may be the larger one.
            let is_turned = small.high >= large.low;
            let ways = [
                (small, large, is_turned),
                (small, large.negated(), true),
                (large, small, true),
                (large, small.negated(), true),
            ];
            for (y, x, is_turned) in ways {
                for found in outcomes(&tape, &[y, x], &Pins::new(), tape.output()) {
                    worst = worst.max(in_units(&found, angle(quotient, is_turned, constants)));
                }
            }
        }
    }
    worst
}

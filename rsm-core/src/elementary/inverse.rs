//! asin, acos, atan, atan2.
//!
//! asin s is a polynomial for s up to 1/2; beyond, it is pi/2 - 2 asin sqrt((1 - s)/2). The angle of a quotient n/d in [0, 1] is that of c plus the
//! angle of t = (n - c d)/(d + c n), with c = 0, 1/2 or 1, so that |t| <= 1/3. For a quotient above 1, n and d are exchanged.

use super::coefficients::{ASIN, ATAN, ATAN_OF_HALF, HALF_PI_PAIR, PI_PAIR, QUARTER_PI};
use super::exponential::with_sign_of;
use super::logarithm::sqrt_pair;
use super::pair::{Pair, constant, polynomial, quick_sum, quotient, sum};
use crate::tape::{Reg, TapeBuilder};

/// |x|, s, the rounding error of s, and asin s - s. s is |x| up to 1/2, and the root beyond.
struct Arc {
    magnitude: Reg,
    s: Pair,
    tail: Reg,
}

fn arc(tape: &mut TapeBuilder, x: Reg) -> Arc {
    let magnitude = tape.absolute(x);
    let (half, one, zero) = (constant(tape, 0.5), constant(tape, 1.0), constant(tape, 0.0));
    let from_one = tape.subtract(one, magnitude);
    let large = tape.multiply(from_one, half);
    let small = tape.multiply(magnitude, magnitude);
    let z = tape.select_less(half, magnitude, large, small);
    let root = sqrt_pair(tape, large);
    let high = tape.select_less(half, magnitude, root.high, magnitude);
    let low = tape.select_less(half, magnitude, root.low, zero);
    let series = polynomial(tape, z, ASIN);
    let cube = tape.multiply(high, z);
    Arc { magnitude, s: Pair { high, low }, tail: tape.multiply(cube, series) }
}

/// from - 2 asin s, for |x| beyond 1/2.
fn turned(tape: &mut TapeBuilder, arc: &Arc, from: [f64; 2]) -> Reg {
    let [high, low] = from.map(|part| constant(tape, part));
    let twice = tape.add(arc.s.high, arc.s.high);
    let opposite = tape.negate(twice);
    let begin = quick_sum(tape, high, opposite);
    let rest = tape.add(arc.s.low, arc.tail);
    let rest = tape.add(rest, rest);
    let rest = tape.subtract(low, rest);
    let rest = tape.add(begin.low, rest);
    tape.add(begin.high, rest)
}

pub(super) fn asin(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let arc = arc(tape, x);
    let small = tape.add(arc.s.high, arc.tail);
    let large = turned(tape, &arc, HALF_PI_PAIR);
    let half = constant(tape, 0.5);
    let result = tape.select_less(half, arc.magnitude, large, small);
    with_sign_of(tape, x, result)
}

pub(super) fn acos(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let arc = arc(tape, x);
    let [high, low] = HALF_PI_PAIR.map(|part| constant(tape, part));
    // pi/2 - (x - (the rest of pi/2 - tail)), the tail with the sign of x
    let tail = with_sign_of(tape, x, arc.tail);
    let rest = tape.subtract(low, tail);
    let taken = tape.subtract(x, rest);
    let middle = tape.subtract(high, taken);
    let below = turned(tape, &arc, PI_PAIR);
    let rest = tape.add(arc.s.low, arc.tail);
    let root = tape.add(arc.s.high, rest);
    let above = tape.add(root, root);
    let zero = constant(tape, 0.0);
    let large = tape.select_less(x, zero, below, above);
    let half = constant(tape, 0.5);
    tape.select_less(half, arc.magnitude, large, middle)
}

/// The angle of c, n - c d and c n, by the size of n/d in [0, 1].
fn piece(tape: &mut TapeBuilder, n: Reg, d: Reg) -> (Pair, Reg, Reg) {
    let (third, three_quarters) = (constant(tape, 1.0 / 3.0), constant(tape, 0.75));
    let (low, high) = (tape.multiply(d, third), tape.multiply(d, three_quarters));
    let (half, zero) = (constant(tape, 0.5), constant(tape, 0.0));
    let (half_d, half_n) = (tape.multiply(d, half), tape.multiply(n, half));
    let mut choose = |first: Reg, second: Reg, last: Reg| {
        let others = tape.select_less(n, high, second, last);
        tape.select_less(n, low, first, others)
    };
    let c_d = choose(zero, half_d, d);
    let c_n = choose(zero, half_n, n);
    let [of_half, of_half_low] = ATAN_OF_HALF.map(|part| constant(tape, part));
    let [of_one, of_one_low] = QUARTER_PI.map(|part| constant(tape, part));
    let mut choose = |second: Reg, last: Reg| {
        let others = tape.select_less(n, high, second, last);
        tape.select_less(n, low, zero, others)
    };
    let angle = Pair { high: choose(of_half, of_one), low: choose(of_half_low, of_one_low) };
    (angle, tape.subtract(n, c_d), c_n)
}

/// base + sign (angle + t + rest), the parts largest first.
fn collected(tape: &mut TapeBuilder, base: Pair, sign: Reg, angle: Pair, t: Reg, rest: Reg) -> Reg {
    let mut signed = |value: Reg| tape.multiply(value, sign);
    let (high, low, t, rest) = (signed(angle.high), signed(angle.low), signed(t), signed(rest));
    let first = sum(tape, base.high, high);
    let second = sum(tape, first.high, t);
    let lost = tape.add(first.low, second.low);
    let constants = tape.add(base.low, low);
    let small = tape.add(lost, constants);
    let small = tape.add(small, rest);
    tape.add(second.high, small)
}

/// atan t - t.
fn tail(tape: &mut TapeBuilder, t: Reg) -> Reg {
    let z = tape.multiply(t, t);
    let series = polynomial(tape, z, ATAN);
    let cube = tape.multiply(z, t);
    tape.multiply(cube, series)
}

pub(super) fn atan(tape: &mut TapeBuilder, x: Reg) -> Reg {
    let magnitude = tape.absolute(x);
    let (one, minus_one, zero) = (constant(tape, 1.0), constant(tape, -1.0), constant(tape, 0.0));
    // The angle of 2^900 is already pi/2.
    let largest = constant(tape, 2f64.powi(900));
    let magnitude = tape.at_most(magnitude, largest);
    let n = tape.select_less(one, magnitude, one, magnitude);
    let d = tape.select_less(one, magnitude, magnitude, one);
    let (angle, numerator, c_n) = piece(tape, n, d);
    let denominator = tape.add(d, c_n);
    let t = tape.divide(numerator, denominator);
    let rest = tail(tape, t);
    let [high, low] = HALF_PI_PAIR.map(|part| constant(tape, part));
    let mut choose = |turned: Reg, straight: Reg| tape.select_less(one, magnitude, turned, straight);
    let base = Pair { high: choose(high, zero), low: choose(low, zero) };
    let sign = choose(minus_one, one);
    let result = collected(tape, base, sign, angle, t, rest);
    with_sign_of(tape, x, result)
}

pub(super) fn atan2(tape: &mut TapeBuilder, y: Reg, x: Reg) -> Reg {
    let (a, b) = (tape.absolute(y), tape.absolute(x));
    let (one, minus_one, zero) = (constant(tape, 1.0), constant(tape, -1.0), constant(tape, 0.0));
    let n = tape.select_less(b, a, b, a);
    let d = tape.select_less(b, a, a, b);
    // Scaled to the middle of the exponent range, so that no product of parts underflows or overflows. A quotient of two zeros is 0.
    let border = constant(tape, 2f64.powi(300));
    let (up, down) = (constant(tape, 2f64.powi(600)), constant(tape, 2f64.powi(-200)));
    let factor = tape.select_less(d, border, up, down);
    let (n, d) = (tape.multiply(n, factor), tape.multiply(d, factor));
    let least = constant(tape, 2f64.powi(-1000));
    let d = tape.at_least(d, least);
    let (angle, numerator, c_n) = piece(tape, n, d);
    let t = quotient(tape, Pair { high: numerator, low: zero }, Pair { high: d, low: c_n });
    let rest = tail(tape, t.high);
    let rest = tape.add(t.low, rest);
    let [half_turn, half_turn_low] = PI_PAIR.map(|part| constant(tape, part));
    let [quarter_turn, quarter_turn_low] = HALF_PI_PAIR.map(|part| constant(tape, part));
    // If steep: pi/2 -+ the angle; if to the left: pi - the angle.
    let mut choose = |steep_left: Reg, steep_right: Reg, flat_left: Reg, flat_right: Reg| {
        let flat = tape.select_less(x, zero, flat_left, flat_right);
        let steep = tape.select_less(x, zero, steep_left, steep_right);
        tape.select_less(b, a, steep, flat)
    };
    let high = choose(quarter_turn, quarter_turn, half_turn, zero);
    let low = choose(quarter_turn_low, quarter_turn_low, half_turn_low, zero);
    let sign = choose(one, minus_one, minus_one, one);
    let result = collected(tape, Pair { high, low }, sign, angle, t.high, rest);
    with_sign_of(tape, y, result)
}

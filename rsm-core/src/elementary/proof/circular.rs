//! sin, cos, tan.
//!
//! The reduction is proved separately: r.high + r.low is x - k pi/2 with a relative error computed below, and |r.low| is at most half a unit of
//! r.high. After that, r.high is any number, and r.low any number of that size.

use super::derive::{half_pi, polynomial_bound};
use super::engine::outcomes;
use super::span::{Span, span};
use super::{Pins, in_units, parts, powers};
use crate::elementary::circular::{LIMIT, of_remainder, tangent};
use crate::elementary::coefficients::HALF_PI;
use crate::elementary::pair::Pair;
use crate::number::{Precision, exact, integer};
use crate::tape::{Tape, TapeBuilder};

/// A unit of rounding.
const U: f64 = f64::EPSILON / 2.0;

/// The largest k. Its products with each of the first three parts of pi/2 are exact.
const MOST: i64 = 509_297;

/// The smallest |x - k pi/2| of all numbers x and all nonzero k: for each k the distance of k pi/2 from the nearest numbers, in units of 2^-100.
fn least_remainder() -> f64 {
    let scale = integer(2).pow(100);
    let half_pi: i128 = (half_pi() * scale).round().to_integer().try_into().expect("101 bits");
    let mut least = i128::MAX;
    for k in 1..=MOST {
        let product = half_pi * i128::from(k);
        // Numbers of the size of the product are 2^(exponent - 52) apart.
        let exponent = 127 - product.leading_zeros() as i32 - 100;
        let apart = 1_i128 << (exponent - 52 + 100);
        let above = product % apart;
        least = least.min(above.min(apart - above));
    }
    // pi/2 was rounded to 2^-101, so the error is k times that.
    (least as f64 - MOST as f64) * 2f64.powi(-100)
}

/// The relative difference between r.high + r.low and x - k pi/2.
fn reduction() -> f64 {
    assert!(MOST as f64 > LIMIT * std::f64::consts::FRAC_2_PI + 1.0);
    let least = least_remainder();
    let k = MOST as f64;
    // 33 bits and 19 bits.
    for part in &HALF_PI[..3] {
        assert!(part.to_bits().trailing_zeros() >= 20 && k < 2f64.powi(20));
    }
    let sum = HALF_PI.iter().map(|part| exact(*part)).fold(integer(0), |sum, part| sum + part);
    let distance = if sum > half_pi() { &sum - half_pi() } else { half_pi() - &sum };
    let lacks = k * Precision::F64.round_up(&distance);
    // x - k (first part) is exact: up to 0.8, on the grid of x, which is 2^-53 or coarser from 0.78 on. The two differences keep their rounding
    // errors. The fourth product is rounded. a.low and b.low are half units of numbers that differ from r by k times the remaining parts; their sum
    // and the next are rounded.
    let fourth = k * HALF_PI[3] * (1.0 + U);
    let behind = k * (HALF_PI[2] + HALF_PI[3]);
    let of = |r: f64| {
        let low = 2.0 * U * (r + behind);
        lacks + fourth * U + U * low + U * (low * (1.0 + U) + fourth)
    };
    // The relative error decreases with r.
    assert!(of(least) < 1e-3 * least);
    let share = of(least) / least * 1.01;
    // high = b.high + low is larger than low, as quick sums require.
    assert!(least * (1.0 - 1e-3) > 2.0 * (2.0 * U * (least + behind) + fourth));
    share
}

/// The cells of r.high: all numbers up to pi/4, plus the rounding of x 2/pi.
fn cells(each: u32) -> impl Iterator<Item = Span> {
    powers(-300, -4, 16).chain(parts(0.0625, 0.785_399, each))
}

fn of_tape(
    quadrants: usize,
    write: impl FnOnce(&mut TapeBuilder, Pair, Option<crate::tape::Reg>) -> Vec<crate::tape::Reg>,
) -> Tape {
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let r = Pair { high: tape.input(0), low: tape.input(1) };
    let quadrant = (quadrants > 0).then(|| tape.input(2));
    let results = write(&mut tape, r, quadrant);
    let names = ["high", "low", "quadrant"][..2 + quadrants].iter().map(|name| (*name).to_string()).collect();
    let results = results.into_iter().enumerate().map(|(k, reg)| (format!("result {k}"), reg));
    tape.finish_with_results("remainder", names, results, [] as [(&str, _); 0])
}

/// The errors of sine and cosine in exact arithmetic: sin(high + low) and cos(high + low) by Taylor's formula in low.
fn missed(r: f64) -> (f64, f64) {
    let low = U * r;
    let sine = r.powi(3) * polynomial_bound("SIN") + low * r.powi(4) / 24.0 + low * low * r;
    let cosine = r.powi(4) * polynomial_bound("COS") + low * r.powi(3) / 6.0 + low * low;
    (sine * (1.0 + 1e-9), cosine * (1.0 + 1e-9))
}

fn of_sums(result: usize) -> f64 {
    let tape = of_tape(0, |tape, r, _| {
        let (sine, cosine) = of_remainder(tape, r);
        vec![sine, cosine]
    });
    let share = reduction();
    let mut worst = 0.0_f64;
    for r in cells(128) {
        let (sine, cosine) = missed(r.high);
        let low = U * r.high;
        let missed = if result == 0 { sine + share * r.high } else { cosine + share * r.high * r.high };
        for found in outcomes(&tape, &[r, span(-low, low)], &Pins::new(), tape.outputs[result].reg) {
            worst = worst.max(in_units(&found, missed));
        }
    }
    worst
}

/// Each of the two functions is a sine or a cosine of the remainder.
pub(super) fn sin() -> f64 {
    of_sums(0).max(of_sums(1))
}

pub(super) fn cos() -> f64 {
    sin()
}

pub(super) fn tan() -> f64 {
    let tape = of_tape(1, |tape, r, quadrant| vec![tangent(tape, quadrant.expect("asked for"), r)]);
    let share = reduction();
    let mut worst = 0.0_f64;
    for r in cells(1024) {
        let (sine, cosine) = missed(r.high);
        let low = U * r.high;
        for is_odd in [false, true] {
            let arguments = [r, span(-low, low), Span::point(f64::from(u8::from(is_odd)))];
            for found in outcomes(&tape, &arguments, &Pins::new(), tape.output()) {
                // sin r >= 0.9 r and cos r >= 0.7 up to pi/4; the slopes are 1/cos^2 and 1/sin^2.
                let most = found.ideal.largest();
                let missed = if is_odd {
                    (cosine + most * sine) / (0.9 * r.low) + share * r.high / (0.9 * r.low).powi(2)
                } else {
                    (sine + most * cosine) / 0.7 + share * r.high * 2.05
                };
                worst = worst.max(in_units(&found, missed * (1.0 + 1e-9)));
            }
        }
    }
    worst
}

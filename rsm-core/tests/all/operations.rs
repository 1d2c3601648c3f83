//! The operations `Exponent` and `PowerOfTwo`: their results in rationals, in ranges and in bounds.

use rsm_core::exact::ideal;
use rsm_core::interval::Interval;
use rsm_core::number::{Precision, exact};
use rsm_core::rounding::error_bound;
use rsm_core::run::{Interpreter, Scalar};
use rsm_core::tape::{Op, Tape, TapeBuilder};
use rsm_core::values::Values;

fn unary(precision: Precision, op: impl Fn(&mut TapeBuilder, rsm_core::tape::Reg) -> rsm_core::tape::Reg) -> Tape {
    let mut tape = TapeBuilder::new(precision);
    let x = tape.input(0);
    let y = op(&mut tape, x);
    tape.finish("t", vec!["x".to_string()], y)
}

fn exponent(precision: Precision) -> Tape {
    unary(precision, |tape, x| tape.push(Op::Exponent(x)))
}

fn power(precision: Precision) -> Tape {
    unary(precision, |tape, x| tape.push(Op::PowerOfTwo(x)))
}

fn run<T: Scalar>(tape: &Tape, x: T) -> T {
    Interpreter::<T>::new(tape).eval(&[x])
}

#[test]
fn an_exponent_is_the_floor_of_the_binary_logarithm() {
    let of_f64 = exponent(Precision::F64);
    for (x, wanted) in [(1.0, 0.0), (1.9999, 0.0), (-2.0, 1.0), (0.75, -1.0), (-1e10, 33.0), (f64::MAX, 1023.0)] {
        assert_eq!(run(&of_f64, x), wanted, "{x}");
        assert_eq!(ideal(&of_f64, &[exact(x)]), Some(exact(wanted)), "{x}");
    }
    assert_eq!(run(&of_f64, f64::MIN_POSITIVE), -1022.0);
    assert_eq!(ideal(&of_f64, &[exact(f64::MIN_POSITIVE)]), Some(exact(-1022.0)));
    for x in [0.0, -0.0, 5e-324, f64::MIN_POSITIVE.next_down()] {
        assert_eq!(run(&of_f64, x), -1023.0, "{x}");
        assert_eq!(ideal(&of_f64, &[exact(x)]), Some(exact(-1023.0)), "{x}");
    }
    for x in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        assert_eq!(run(&of_f64, x), 1024.0);
    }
    let of_f32 = exponent(Precision::F32);
    for (x, wanted) in
        [(1.0f32, 0.0), (-0.75, -1.0), (f32::MAX, 127.0), (f32::MIN_POSITIVE, -126.0), (1e-45, -127.0), (0.0, -127.0)]
    {
        assert_eq!(run(&of_f32, x), wanted, "{x}");
        assert_eq!(ideal(&of_f32, &[exact(f64::from(x))]), Some(exact(f64::from(wanted))), "{x}");
    }
    assert_eq!(run(&of_f32, f32::NAN), 128.0);
}

#[test]
fn a_power_of_two_is_exact_for_every_whole_number_that_has_one() {
    let of_f64 = power(Precision::F64);
    for k in -1022..=1023 {
        assert_eq!(run(&of_f64, f64::from(k)), 2f64.powi(k), "{k}");
    }
    let of_f32 = power(Precision::F32);
    for k in -126..=127 {
        assert_eq!(run(&of_f32, k as f32), 2f32.powi(k), "{k}");
        assert_eq!(ideal(&of_f32, &[exact(f64::from(k))]), Some(exact(2f64.powi(k))), "{k}");
    }
    assert_eq!(ideal(&of_f64, &[exact(-1022.0)]), Some(exact(f64::MIN_POSITIVE)));
    for x in [-1023.0, 1024.0, 0.5] {
        assert_eq!(ideal(&of_f64, &[exact(x)]), None, "{x}");
    }
    assert_eq!(ideal(&of_f32, &[exact(128.0)]), None);
    assert_eq!(ideal(&of_f32, &[exact(-127.0)]), None);
}

#[test]
fn their_ranges_hold_what_they_give_and_no_more() {
    let range = |tape: &Tape, low: f64, high: f64| Values::new(tape).over(&[Interval::new(low, high)]);
    let of_f64 = exponent(Precision::F64);
    assert_eq!(range(&of_f64, 0.75, 5.0), Interval::new(-1.0, 2.0));
    assert_eq!(range(&of_f64, -5.0, -0.75), Interval::new(-1.0, 2.0));
    assert_eq!(range(&of_f64, -0.5, 5.0), Interval::new(-1023.0, 2.0));
    assert_eq!(range(&exponent(Precision::F32), 0.0, 5.0), Interval::new(-127.0, 2.0));
    assert_eq!(range(&power(Precision::F64), -2.0, 3.0), Interval::new(0.25, 8.0));
    assert_eq!(range(&power(Precision::F64), -1022.0, 1023.0), Interval::new(f64::MIN_POSITIVE, 2f64.powi(1023)));
    let anything = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
    for (precision, low, high) in [
        (Precision::F64, -1023.0, 0.0),
        (Precision::F64, 0.0, 1024.0),
        (Precision::F32, -127.0, 0.0),
        (Precision::F32, 0.0, 128.0),
    ] {
        assert_eq!(range(&power(precision), low, high), anything);
    }
}

#[test]
fn they_are_exact_of_what_is_exact_and_unknown_of_what_is_not() {
    assert_eq!(error_bound(&exponent(Precision::F64), &[[0.1, 50.0]]), 0.0);
    assert_eq!(error_bound(&power(Precision::F32), &[[-20.0, 20.0]]), 0.0);
    assert_eq!(error_bound(&power(Precision::F32), &[[-20.0, 128.0]]), f64::INFINITY);
    let rounded = |op: fn(rsm_core::tape::Reg) -> Op| {
        unary(Precision::F64, move |tape, x| {
            let sum = tape.add(x, x);
            let product = tape.multiply(sum, x);
            tape.push(op(product))
        })
    };
    assert_eq!(error_bound(&rounded(Op::Exponent), &[[1.0, 2.0]]), f64::INFINITY);
    assert_eq!(error_bound(&rounded(Op::PowerOfTwo), &[[1.0, 2.0]]), f64::INFINITY);
}

#[test]
fn they_stand_in_the_listing_by_their_names() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let x = tape.input(0);
    let exponent = tape.push(Op::Exponent(x));
    let power = tape.push(Op::PowerOfTwo(exponent));
    let text = tape.finish("t", vec!["x".to_string()], power).to_string();
    assert!(text.contains("r1   = exponent r0\n  r2   = power-of-two r1\n"), "{text}");
}

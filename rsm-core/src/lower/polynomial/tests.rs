//! Tests of the limits within which scales are folded and powers are written.

use super::*;
use crate::check::Checked;
use crate::model::{Coding, Input, Knot, Model, Outside};
use crate::run::{Interpreter, Scalar};
use crate::tape::Tape;

fn two_to(exponent: i32) -> Rational {
    if exponent < 0 {
        integer(1) / power(&integer(2), exponent.unsigned_abs())
    } else {
        power(&integer(2), exponent.unsigned_abs())
    }
}

#[test]
fn magnitude_bits_hold_the_logarithm_and_hardly_more() {
    for numerator in 1..40 {
        for denominator in 1..40 {
            let value = integer(numerator) / integer(denominator);
            for value in [-&value, value] {
                let bits = magnitude_bits(&value) as i32;
                let size = if value < integer(0) { -value } else { value };
                assert!(two_to(-bits) < size && size < two_to(bits), "{size}: {bits}");
                // At most two more than needed, because numerator and denominator are measured separately.
                assert!(size <= two_to(2 - bits) || two_to(bits - 2) <= size, "{size}: {bits}");
            }
        }
    }
    // The additional bit is needed: 3 is between 2^1 and 2^2, 1 is 2^0.
    assert_eq!([3, 1].map(|value| magnitude_bits(&integer(value))), [2, 1]);
}

/// Limits of 90 bits for f32 and 900 for f64: 2^k has |k| + 1 bits.
#[test]
fn scales_fold_and_weights_are_ordinary_up_to_the_limit() {
    for (precision, third) in [(Precision::F32, 30), (Precision::F64, 300)] {
        for sign in [1, -1] {
            let folds = |coefficient: i32, scale: i32| {
                let coefficient = precision.round(&two_to(coefficient));
                let near = Term { powers: vec![0], coefficient: 1.0 };
                let term = Term { powers: vec![2], coefficient };
                scales_fold(precision, &[&near, &term], &[(0, two_to(scale))])
            };
            // The scale counts twice and the coefficient once: three thirds.
            let end = third - 1;
            assert!(folds(sign * end, -end) && folds(sign * end, end));
            assert!(!folds(sign * (end + 1), -end) && !folds(sign * (end + 1), end));
            assert!(!folds(sign * end, -end - 1) && !folds(sign * end, end + 1));
            let limit = 3 * third - 1;
            assert!(is_ordinary(precision, &two_to(sign * limit)) && !is_ordinary(precision, &two_to(sign * (limit + 1))));
        }
    }
}

/// A surface of one clamped input: 0.5 times a power of its last factor, and a constant. In the form of powers it has fewer operations than in Horner
/// form.
fn lowered(precision: Precision, range: [f64; 2], kind: &Surface, degree: u32) -> Tape {
    let input = Input { name: "x".to_owned(), unit: "1".to_owned(), range, outside: Outside::Clamp };
    let factors = 1 + kind.knots.len();
    let mut powers = vec![0; factors];
    let constant = Term { powers: powers.clone(), coefficient: 3.0 };
    powers[factors - 1] = degree;
    let surface = Surface {
        name: "s".to_owned(),
        unit: "1".to_owned(),
        inputs: vec!["x".to_owned()],
        terms: vec![constant, Term { powers, coefficient: 0.5 }],
        ..kind.clone()
    };
    let model = Model { name: "m".to_owned(), inputs: vec![input], surfaces: vec![surface], compensators: vec![] };
    let checked = Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}"));
    crate::lower::surface(&checked, 0, precision)
}

fn has_powers(tape: &Tape) -> bool {
    tape.ops.iter().any(|op| matches!(op, Op::Multiply(a, b) if a == b))
}

fn at<T: Scalar>(tape: &Tape, x: f64) -> T {
    Interpreter::<T>::new(tape).eval(&[T::from_constant(x)])
}

#[test]
fn powers_stand_up_to_the_limit_of_the_exponents() {
    let natural = Surface { coding: Coding::None, ..Surface::default() };
    // x^5 of an x with 18 bits has 90 bits.
    for (precision, last) in [(Precision::F32, 17), (Precision::F64, 179)] {
        let to = |exponent: i32| [1.0, crate::number::power_of_two(i64::from(exponent))];
        assert!(has_powers(&lowered(precision, to(last), &natural, 5)));
        assert!(!has_powers(&lowered(precision, to(last + 1), &natural, 5)));
        // The largest magnitude is at the other end.
        let mirrored = |exponent: i32| to(exponent).map(|end| -end);
        let [near, far] = mirrored(last);
        assert!(has_powers(&lowered(precision, [far, near], &natural, 5)));
        let [near, far] = mirrored(last + 1);
        assert!(!has_powers(&lowered(precision, [far, near], &natural, 5)));
    }
}

/// A hinge of a reciprocal: x = 1/xi - 1/k is below 2^20, but its variable on the tape, (k - xi)/xi, is nearly 2^39. The fourth power of that
/// variable overflows in f32; the nested products do not.
#[test]
fn it_is_the_variable_of_the_tape_whose_powers_must_be_numbers() {
    let [low, knot, high] = [-20, 19, 20].map(crate::number::power_of_two);
    let bent = Surface {
        coding: Coding::None,
        reciprocal: vec!["x".to_owned()],
        knots: vec![Knot { input: "x".to_owned(), at: knot }],
        ..Surface::default()
    };
    let tape = lowered(Precision::F32, [low, high], &bent, 4);
    assert!(!has_powers(&tape), "{tape}");
    let found = f64::from(at::<f32>(&tape, low));
    let expected = 0.5 * 2f64.powi(80);
    assert!((found / expected - 1.0).abs() < 1e-5, "{found:e} {expected:e}");
    // In f64 it does not overflow.
    let tape = lowered(Precision::F64, [low, high], &bent, 4);
    assert!(has_powers(&tape) && (at::<f64>(&tape, low) / expected - 1.0).abs() < 1e-5, "{tape}");
}

/// Natural variables have scale 1. If the scale is not folded, no division by 1 is written.
#[test]
fn a_scale_of_one_is_no_operation() {
    let natural = Surface { coding: Coding::None, ..Surface::default() };
    let wide = Surface { terms: vec![Term { powers: vec![1], coefficient: 1e30 }], ..natural };
    let input = Input { name: "x".to_owned(), unit: "1".to_owned(), range: [-1.0, 2.0], outside: Outside::Extrapolate };
    let surface = Surface { name: "s".to_owned(), unit: "1".to_owned(), inputs: vec!["x".to_owned()], ..wide };
    let model = Model { name: "m".to_owned(), inputs: vec![input], surfaces: vec![surface], compensators: vec![] };
    let checked = Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}"));
    let tape = crate::lower::surface(&checked, 0, Precision::F32);
    assert_eq!(tape.operation_count(), 1, "{tape}");
}

//! Against batch least squares with weights forgetting^age, in exact rational arithmetic.

use rsm_core::number::{exact, power};

use super::*;
use crate::random::Random;
use crate::reference::{Problem, agree, whole};

#[test]
fn a_constant_is_followed_and_the_old_one_forgotten() {
    // Weighted mean with weights 0.5^age: after 2, 2, 6 it is (6 + 0.5 2 + 0.25 2)/(1 + 0.5 + 0.25) = 7.5/1.75.
    let mut state = RecursiveLeastSquares::new(1, 0.5);
    assert_eq!(state.coefficients(), None);
    for y in [2.0, 2.0, 6.0] {
        assert!(state.update(&[Dd::ONE], y));
    }
    assert_eq!(state.coefficients(), Some(vec![7.5 / 1.75]));
}

#[test]
fn what_is_forgotten_counts_for_nothing() {
    // The weighted square about the weighted mean of 2, 2, 6: (1/4 + 1/2) (2 - m)^2 + (6 - m)^2 with m = 7.5/1.75.
    let mut state = RecursiveLeastSquares::new(1, 0.5);
    for y in [2.0, 2.0, 6.0] {
        state.update(&[Dd::ONE], y);
    }
    let mean: f64 = 7.5 / 1.75;
    let expected = 0.75 * (2.0 - mean).powi(2) + (6.0 - mean).powi(2);
    assert!((state.residual_square() / expected - 1.0).abs() < 1e-14, "{}", state.residual_square());
    // A line through two points, then one point for a thousand rows: the other has a weight of 0.9^1000 and tells nothing.
    let row = |x: f64| [Dd::ONE, Dd::from(x)];
    let mut state = RecursiveLeastSquares::new(2, 0.9);
    state.update(&row(1.0), 1.0);
    state.update(&row(3.0), 2.0);
    assert!(state.coefficients().is_some());
    for _ in 0..1000 {
        state.update(&row(3.0), 2.0);
    }
    assert_eq!(state.coefficients(), None);
    // And a row that was 10^16 times larger does not hide what the new ones tell.
    let mut state = RecursiveLeastSquares::new(2, 0.5);
    state.update(&row(1e16), 1.0);
    for k in 0..400 {
        let x = f64::from(k % 2);
        state.update(&row(x), 5.0 - 2.0 * x);
    }
    let found = state.coefficients().expect("the large row is forgotten");
    assert!((found[0] - 5.0).abs() < 1e-12 && (found[1] + 2.0).abs() < 1e-12, "{found:?}");
}

#[test]
fn there_is_no_answer_before_the_rows_determine_it_and_none_is_lost_to_a_bad_row() {
    let mut state = RecursiveLeastSquares::new(2, 1.0);
    let row = |x: f64| [Dd::ONE, Dd::from(x)];
    state.update(&row(3.0), 7.0);
    state.update(&row(3.0), 7.0);
    assert_eq!(state.coefficients(), None);
    assert!(!state.update(&row(f64::NAN), 1.0) && !state.update(&row(1.0), f64::INFINITY));
    state.update(&row(5.0), 11.0);
    assert_eq!(state.coefficients(), Some(vec![1.0, 2.0]));
    assert_eq!((state.rows(), state.residual_square()), (3, 0.0));
}

#[test]
fn every_row_gives_what_batch_gives_with_fading_weights() {
    // A forgetting factor of 1/4, whose root is exact, and of 1.
    for (seed, forgetting) in [(1, 0.25), (2, 1.0), (3, 0.25)] {
        let mut random = Random::new(seed);
        let width = 3;
        let rows: Vec<Vec<f64>> = (0..9).map(|_| (0..width).map(|_| whole(&mut random, 4)).collect()).collect();
        let response: Vec<f64> = rows.iter().map(|_| whole(&mut random, 9)).collect();
        let mut state = RecursiveLeastSquares::new(width, forgetting);
        for seen in 1..=rows.len() {
            let row: Vec<Dd> = rows[seen - 1].iter().map(|x| Dd::from(*x)).collect();
            assert!(state.update(&row, response[seen - 1]));
            assert_eq!(state.rows(), seen);
            let weights = (0..seen).map(|k| power(&exact(forgetting), (seen - 1 - k) as u32)).collect();
            let batch = Problem { weights, ..Problem::of(&rows[..seen], &response[..seen]) };
            match (batch.solve(), state.coefficients()) {
                (None, None) => {}
                (Some(answer), Some(found)) => {
                    for (found, expected) in found.iter().zip(&answer.coefficients) {
                        // Double-double, rounded once to f64.
                        assert!(agree(&exact(*found), expected, 2e-16), "{found} {expected}");
                    }
                    // What is left of the square: as small as the rounding of what went in, where it is 0.
                    assert!(
                        agree(&exact(state.residual_square()), &answer.residual_square, 2e-16),
                        "{}",
                        state.residual_square()
                    );
                }
                (answer, found) => panic!("row {seen}: {answer:?} {found:?}"),
            }
        }
    }
    assert_eq!(RecursiveLeastSquares::new(1, 0.5).residual_square(), 0.0);
}

#[test]
fn a_column_is_judged_by_its_own_part() {
    // The second column is (2, own): its part beside the first is `own`, its length 2 to the last bit.
    let of = |own: f64| {
        let mut state = RecursiveLeastSquares::new(2, 1.0);
        state.update(&[Dd::ONE, Dd::from(2.0)], 1.0);
        state.update(&[Dd::ZERO, Dd::from(own)], 2.0);
        state.coefficients()
    };
    assert_eq!(of(2.0 * DEPENDENT), None);
    assert!(of(3.0 * DEPENDENT).is_some() && of(-3.0 * DEPENDENT).is_some());
}

//! Tests of maxima, minima and selections by comparison.

use super::*;

#[test]
fn a_maximum_moves_by_no_more_than_what_it_compares() {
    for precision in Precision::ALL {
        // Where the value is selected its error counts, where the bound is selected the error of the bound; the same for a minimum.
        for (of_value, of_bound) in [(0.25, 0.0), (0.0, 0.25), (0.25, 0.125), (0.125, 0.25), (-0.25, -0.125)] {
            for is_minimum in [false, true] {
                let tape = write_tape(precision, 1, |builder, x| {
                    let shift = off(builder, 2.0, of_value);
                    let value = builder.push(Op::Add(x[0], shift));
                    let bound = off(builder, 2.0, of_bound);
                    if is_minimum { builder.at_most(value, bound) } else { builder.at_least(value, bound) }
                });
                let found = tightness(&tape, &[[-1.0, 1.0]], 100);
                assert!(found > 0.999, "{found} {of_value} {of_bound}\n{tape}");
            }
        }
        // A bound that the computed value never exceeds, but the exact value might. If the bound was rounded towards the exact value, there is no
        // error. Otherwise the error is that of the bound.
        for (by, is_minimum, range) in
            [(-0.125, false, [1.0, 2.0]), (0.125, false, [1.0, 2.0]), (0.125, true, [0.0, 1.0]), (-0.125, true, [0.0, 1.0])]
        {
            let tape = write_tape(precision, 1, |builder, x| {
                let bound = off(builder, 1.0, by);
                if is_minimum { builder.at_most(x[0], bound) } else { builder.at_least(x[0], bound) }
            });
            let bound = error_bound(&tape, &[range]);
            let is_free = (by < 0.0) != is_minimum;
            assert_eq!(bound, if is_free { 0.0 } else { 0.125 }, "{by} {is_minimum}");
            worst_ratio(&mut Random(5), &tape, &[range], bound, 50);
            // If the value may exceed the bound, the error of the bound always counts.
            let wider = [0.0, 2.0];
            assert_eq!(error_bound(&tape, &[wider]), 0.125);
            assert!(tightness(&tape, &[wider], 50) > 0.999);
            // An exact bound causes no error.
            let exactly = write_tape(precision, 1, |builder, x| {
                let bound = builder.constant(integer(1));
                if is_minimum { builder.at_most(x[0], bound) } else { builder.at_least(x[0], bound) }
            });
            assert_eq!(error_bound(&exactly, &[range]), 0.0);
        }
        // The rounding direction of a computed bound is unknown: here 0.9 represents 1.4.
        for is_minimum in [false, true] {
            let sign = if is_minimum { -1.0 } else { 1.0 };
            let computed = write_tape(precision, 2, |builder, x| {
                let shift = off(builder, 0.0, sign * 0.5);
                let bound = builder.push(Op::Add(x[1], shift));
                if is_minimum { builder.at_most(x[0], bound) } else { builder.at_least(x[0], bound) }
            });
            let point = [1.0 * sign, 0.75 * sign];
            let ranges = point.map(|x| [x, x]);
            assert_eq!(seen_error(&computed, &point), Some(exact(0.25)));
            worst_ratio(&mut Random(6), &computed, &ranges, error_bound(&computed, &ranges), 1);
        }
    }
}

#[test]
fn a_choice_by_exact_numbers_is_charged_what_it_may_choose() {
    let choice = |precision, of_then: f64, of_otherwise: f64, of_left: f64| {
        write_tape(precision, 2, |builder, x| {
            let (then, otherwise) = (off(builder, 1.0, of_then), off(builder, 2.0, of_otherwise));
            let shift = off(builder, 0.0, of_left);
            let left = builder.push(Op::Add(x[0], shift));
            // Without an error the argument is used directly, because a sum with zero has a rounding error in the bound.
            let left = if of_left == 0.0 { x[0] } else { left };
            let condition = builder.push(Op::Less(left, x[1]));
            builder.push(Op::Select { condition, then, otherwise })
        })
    };
    for precision in Precision::ALL {
        let (small, large) = (0.125, 0.5);
        let charged = |of_then, of_otherwise, ranges: [[f64; 2]; 2]| {
            let tape = choice(precision, of_then, of_otherwise, 0.0);
            let bound = error_bound(&tape, &ranges);
            worst_ratio(&mut Random(7), &tape, &ranges, bound, 60);
            bound
        };
        // The comparison is always true, never true (for equal numbers it is false), or both.
        assert_eq!(charged(small, large, [[0.0, 0.5], [1.0, 2.0]]), small);
        assert_eq!(charged(small, large, [[0.0, 1.0], [1.0, 2.0]]), large);
        assert_eq!(charged(large, small, [[2.0, 3.0], [1.0, 2.0]]), small);
        assert_eq!(charged(large, small, [[2.5, 3.0], [1.0, 2.0]]), small);
        assert_eq!(charged(large, small, [[1.0, 3.0], [1.0, 2.0]]), large);
        assert_eq!(charged(small, large, [[1.0, 3.0], [1.0, 2.0]]), large);
        // An inexact comparison may select the other value, so there is no bound.
        let inexact = choice(precision, 0.0, 0.0, 0.25);
        assert_eq!(error_bound(&inexact, &[[0.0, 2.0], [1.0, 1.0]]), f64::INFINITY);
        let other_side = write_tape(precision, 1, |builder, x| {
            let (one, two) = (builder.constant(integer(1)), builder.constant(integer(2)));
            let limit = off(builder, 1.0, 0.25);
            let condition = builder.push(Op::Less(x[0], limit));
            builder.push(Op::Select { condition, then: one, otherwise: two })
        });
        assert_eq!(error_bound(&other_side, &[[0.0, 2.0]]), f64::INFINITY);
        // The sign of an odd input.
        let odd = write_tape(precision, 1, |builder, x| {
            let (zero, factor) = (builder.constant(integer(0)), off(builder, 3.0, 0.25));
            let magnitude = builder.push(Op::Absolute(x[0]));
            let value = builder.push(Op::Multiply(magnitude, factor));
            let condition = builder.push(Op::Less(x[0], zero));
            let opposite = builder.push(Op::Negate(value));
            builder.push(Op::Select { condition, then: opposite, otherwise: value })
        });
        assert!(tightness(&odd, &[[-2.0, 2.0]], 50) > 0.999);
    }
}

/// Selects 0 or x by a comparison, as the derivative of a clamp does.
fn choice(precision: Precision, arity: usize, compared: impl Fn(&mut TapeBuilder, &[Reg]) -> (Reg, Reg)) -> Tape {
    write_tape(precision, arity, |builder, x| {
        let (left, right) = compared(builder, x);
        let zero = builder.constant(integer(0));
        builder.select_less(left, right, zero, x[0])
    })
}

#[test]
fn a_choice_is_known_where_tape_and_ideal_compare_alike() {
    let tenth = || integer(1) / integer(10);
    for precision in Precision::ALL {
        let (below, above) = (precision.round_down(&tenth()), precision.round_up(&tenth()));
        // (Value of the bound, whether it is on the right, whether tape and ideal agree): no number of the type is between 1/10 and its neighbours.
        for (value, is_right, agrees) in
            [(above, true, true), (below, true, false), (below, false, true), (above, false, false)]
        {
            let tape = choice(precision, 1, |builder, x| {
                let bound = builder.rounded_constant(value, tenth());
                if is_right { (x[0], bound) } else { (bound, x[0]) }
            });
            let bound = error_bound(&tape, &[[0.0, 1.0]]);
            assert_eq!(bound, if agrees { 0.0 } else { f64::INFINITY }, "{value} {is_right}");
            // At the neighbour itself they differ if and only if they do not agree.
            let differs = seen_error(&tape, &[value]) != Some(integer(0));
            assert_eq!(differs, !agrees, "{value} {is_right}");
        }
        // A bound farther away than the next number is a different bound.
        let far = choice(precision, 1, |builder, x| (x[0], off(builder, 0.5, -0.25)));
        assert_eq!(error_bound(&far, &[[0.0, 1.0]]), f64::INFINITY);
    }
}

#[test]
fn the_sign_of_a_difference_of_exact_numbers_is_certain() {
    for precision in Precision::ALL {
        let difference = |is_left: bool| {
            choice(precision, 2, move |builder, x| {
                let difference = builder.subtract(x[0], x[1]);
                let zero = builder.constant(integer(0));
                if is_left { (difference, zero) } else { (zero, difference) }
            })
        };
        for is_left in [true, false] {
            assert_eq!(error_bound(&difference(is_left), &[[0.1, 1.0], [0.1, 3.0]]), 0.0);
        }
        // The comparison is not certain if an operand of the difference is not exact, or if the other side is not 0.
        let of_rounded = choice(precision, 2, |builder, x| {
            let product = builder.multiply(x[0], x[1]);
            let difference = builder.subtract(product, x[1]);
            let zero = builder.constant(integer(0));
            (difference, zero)
        });
        assert_eq!(error_bound(&of_rounded, &[[0.1, 1.0], [0.1, 3.0]]), f64::INFINITY);
        let beside_one = choice(precision, 2, |builder, x| {
            let difference = builder.subtract(x[0], x[1]);
            let one = builder.constant(integer(-1));
            (difference, one)
        });
        assert_eq!(error_bound(&beside_one, &[[0.1, 1.0], [0.1, 3.0]]), f64::INFINITY);
        // The sign of a product is not certain here either: only a difference of exact numbers is.
        let of_sum = choice(precision, 2, |builder, x| {
            let square = builder.multiply(x[0], x[1]);
            let zero = builder.constant(integer(0));
            (square, zero)
        });
        assert_eq!(error_bound(&of_sum, &[[-0.1, 1.0], [0.1, 3.0]]), f64::INFINITY);
    }
}

//! Tests that exact operations have a bound of 0, and that operations that are almost exact have not.

use super::*;

#[test]
fn a_difference_is_exact_up_to_a_ratio_of_two_and_no_further() {
    for precision in Precision::ALL {
        let u = ulp_of_one(precision);
        let difference = write_tape(precision, 2, |builder, x| builder.push(Op::Subtract(x[0], x[1])));
        let sum = write_tape(precision, 2, |builder, x| builder.push(Op::Add(x[0], x[1])));
        // Both ends of both ranges have a ratio of exactly 2.
        for ranges in
            [[[2.0, 4.0], [2.0, 4.0]], [[-4.0, -2.0], [-4.0, -2.0]], [[1.5, 1.5], [3.0, 3.0]], [[3.0, 3.0], [1.5, 1.5]]]
        {
            // For numbers of any size.
            for scale in [-60, 0, 60] {
                let ranges = ranges.map(|range| range.map(|end| end * power_of_two(scale)));
                assert_eq!(error_bound(&difference, &ranges), 0.0, "{ranges:?}");
                let [a, [low, high]] = ranges;
                assert_eq!(error_bound(&sum, &[a, [-high, -low]]), 0.0, "{ranges:?}");
                // Numbers of the same sign have no exact sum.
                assert!(error_bound(&sum, &ranges) > 0.0);
                worst_ratio(&mut Random(4), &difference, &ranges, 0.0, 100);
            }
        }
        // One number beyond: 4 - (2 - u) = 2 + u needs one bit more, and is rounded by half a unit of its last place.
        let below_two = precision.next_down(2.0);
        for (a, b) in [(4.0, below_two), (below_two, 4.0), (-4.0, -below_two), (-below_two, -4.0)] {
            let ranges = [[a, a], [b, b]];
            assert_eq!(seen_error(&difference, &[a, b]), Some(exact(u / 1.0)), "{a} {b}");
            assert_eq!(error_bound(&difference, &ranges), u, "{a} {b}");
            assert_eq!(error_bound(&sum, &[[a, a], [-b, -b]]), u, "{a} {b}");
        }
        // The difference is not exact if the second number may have another sign or be 0.
        for b in [[-1.0, 1.0], [0.0, 1.0], [-1.0, 0.0]] {
            assert!(error_bound(&difference, &[[1.0, 1.5], b]) > 0.0);
        }
        // Over a whole box: a ratio of up to 4 in either direction.
        for sign in [1.0, -1.0] {
            let range = if sign > 0.0 { [1.0, 4.0] } else { [-4.0, -1.0] };
            let found = tightness(&difference, &[range, range], 2000);
            assert!(found > 0.4, "{found}");
        }
        // With exact operands and an exact difference the maximum after it has no error either.
        let hinge = write_tape(precision, 1, |builder, x| {
            let (three, zero) = (builder.constant(integer(3)), builder.constant(integer(0)));
            let above = builder.push(Op::Subtract(x[0], three));
            builder.at_least(above, zero)
        });
        assert_eq!(error_bound(&hinge, &[[2.0, 5.0]]), 0.0);
    }
}

#[test]
fn a_difference_with_itself_is_zero_unless_it_is_no_number() {
    for precision in Precision::ALL {
        let square_less_itself = write_tape(precision, 1, |builder, x| {
            let square = builder.push(Op::Multiply(x[0], x[0]));
            builder.push(Op::Subtract(square, square))
        });
        let largest = precision.largest();
        assert_eq!(error_bound(&square_less_itself, &[[0.1, 0.7]]), 0.0);
        // The square overflows: infinity minus infinity is NaN, so there is no bound.
        assert_eq!(error_bound(&square_less_itself, &[[1.0, largest]]), f64::INFINITY);
        // A sum of a number with itself is not a difference.
        let twice = write_tape(precision, 1, |builder, x| builder.push(Op::Add(x[0], x[0])));
        let with_error = write_tape(precision, 1, |builder, x| {
            let c = off(builder, 1.0, 0.5);
            let product = builder.push(Op::Multiply(x[0], c));
            builder.push(Op::Add(product, product))
        });
        assert!(error_bound(&twice, &[[1.0, 2.0]]) > 0.0 || tightness(&twice, &[[1.0, 2.0]], 50) == 0.0);
        assert!(tightness(&with_error, &[[1.0, 2.0]], 50) > 0.99);
    }
}

#[test]
fn what_is_known_of_a_square_and_of_nothing_goes_into_what_follows() {
    for precision in Precision::ALL {
        // A square is not negative, so the divisor that contains it is not zero.
        let bell = write_tape(precision, 1, |builder, x| {
            let (one, width) = (builder.constant(integer(1)), off(builder, 1e-6f32.into(), 1e-8));
            let square = builder.push(Op::Multiply(x[0], x[0]));
            let divisor = builder.push(Op::Add(square, width));
            builder.push(Op::Divide(one, divisor))
        });
        assert!(error_bound(&bell, &[[-1.0, 1.3]]).is_finite());
        let at_its_top = bound_of_one_cell(&bell, &[[-1e-6, 1.3e-6]]);
        assert!(worst_ratio(&mut Random(15), &bell, &[[-1e-6, 1.3e-6]], at_its_top, 50) > 0.9);
        // x - x is exactly zero: adding it changes no range.
        for range in [[2.0, 3.0], [-3.0, -2.0]] {
            let moved = write_tape(precision, 2, |builder, x| {
                let factor = off(builder, 1.0, 1.0 / 64.0);
                let nothing = builder.push(Op::Subtract(x[0], x[0]));
                let sum = builder.push(Op::Add(x[1], nothing));
                builder.push(Op::Multiply(sum, factor))
            });
            assert!(tightness(&moved, &[[1.0, 5.0], range], 20) > 0.99);
        }
    }
}

#[test]
fn a_power_of_two_moves_the_exponent_alone() {
    for precision in Precision::ALL {
        let smallest = power_of_two(precision.smallest_exponent());
        let normal = smallest * power_of_two(precision.significand_bits() - 1);
        for factor in [2.0, -2.0, 0.5, -0.25, 1024.0, 2f64.powi(-30), 1.0] {
            let times = write_tape(precision, 1, |builder, x| {
                let factor = builder.constant(exact(factor));
                builder.push(Op::Multiply(x[0], factor))
            });
            let of_factor = write_tape(precision, 1, |builder, x| {
                let factor = builder.constant(exact(factor));
                builder.push(Op::Multiply(factor, x[0]))
            });
            let over = write_tape(precision, 1, |builder, x| {
                let divisor = builder.constant(exact(1.0 / factor));
                builder.push(Op::Divide(x[0], divisor))
            });
            for tape in [times, of_factor, over] {
                for range in [[0.1, 0.9], [-70.0, -60.0]] {
                    assert_eq!(error_bound(&tape, &[range]), 0.0, "{tape}");
                    worst_ratio(&mut Random(16), &tape, &[range], 0.0, 40);
                }
                // A result loses bits if it is subnormal, or if it is rounded up to the smallest normal number.
                let (low, high) = (normal / factor.abs(), 4.0 * normal / factor.abs());
                let above = [precision.next_up(low), high];
                assert_eq!(error_bound(&tape, &[above]), 0.0, "{tape}");
                assert_eq!(error_bound(&tape, &[[-above[1], -above[0]]]), 0.0, "{tape}");
                for range in [[low / 8.0, low], [-low, -low / 8.0], [-low, low]] {
                    let found = tightness(&tape, &[range], 200);
                    let is_exact = factor.abs() >= 1.0;
                    assert_eq!(error_bound(&tape, &[range]) == 0.0, is_exact, "{tape}");
                    // Half of the smallest f64 is no f64, so the bound has the smallest f64 itself.
                    assert!(is_exact || found > if precision == Precision::F64 { 0.45 } else { 0.9 }, "{found}\n{tape}");
                }
                // A quarter of a number just below four times the smallest normal number is rounded up to the smallest normal number.
                let edge = precision.next_down(low);
                assert!(factor.abs() >= 1.0 || tightness(&tape, &[[edge, edge]], 1) > 0.1, "{tape}");
            }
        }
        // Other factors, and ranges that contain more than a power of two, cause a rounding error.
        for factor in [3.0, 1.5, -0.75] {
            let times = write_tape(precision, 1, |builder, x| {
                let factor = builder.constant(exact(factor));
                builder.push(Op::Multiply(x[0], factor))
            });
            assert!(tightness(&times, &[[1.0, 1.3]], 200) > 0.4);
        }
        let product = write_tape(precision, 2, |builder, x| builder.push(Op::Multiply(x[0], x[1])));
        let quotient = write_tape(precision, 2, |builder, x| builder.push(Op::Divide(x[0], x[1])));
        for tape in [product, quotient] {
            let above_two = precision.next_up(2.0);
            assert!(tightness(&tape, &[[1.0, 1.9], [2.0, above_two]], 200) > 0.4);
            assert!(tightness(&tape, &[[1.0, 1.9], [1.0, 2.0]], 200) > 0.4);
        }
        // A factor that represents another number has an error of its own.
        let off_two = write_tape(precision, 1, |builder, x| {
            let factor = off(builder, 2.0, 1.0 / 64.0);
            builder.push(Op::Multiply(x[0], factor))
        });
        assert!(tightness(&off_two, &[[0.5, 3.0]], 20) > 0.9999);
    }
}

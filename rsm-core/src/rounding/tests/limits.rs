//! Tests of values beyond the largest number, of a divisor of zero, and of values below the smallest normal number.

use super::*;

#[test]
fn nothing_is_promised_where_the_tape_may_leave_its_numbers() {
    for precision in Precision::ALL {
        let largest = precision.largest();
        let half = largest / 2.0;
        let twice = write_tape(precision, 2, |builder, x| builder.push(Op::Add(x[0], x[1])));
        assert!(error_bound(&twice, &[[1.0, half], [1.0, half]]).is_finite());
        assert_eq!(error_bound(&twice, &[[1.0, largest], [1.0, half]]), f64::INFINITY);
        assert_eq!(error_bound(&twice, &[[-largest, -1.0], [-half, -1.0]]), f64::INFINITY);
        // At the edge only the rounding error remains: half a unit of the largest number.
        let tiny = [0.0, half * precision.unit_roundoff() * 0.5];
        let found = tightness(&twice, &[[half, largest], tiny], 300);
        assert!(found > 0.2, "{found}");
        let product = write_tape(precision, 2, |builder, x| builder.push(Op::Multiply(x[0], x[1])));
        assert!(error_bound(&product, &[[1.0, half], [-2.0, 2.0]]).is_finite());
        assert_eq!(error_bound(&product, &[[1.0, half], [-2.0, 2.0 + 1e-6]]), f64::INFINITY);
        assert_eq!(error_bound(&product, &[[1.0, half], [-2.0 - 1e-6, 2.0]]), f64::INFINITY);
        // An infinity affects all later operations, also a product with zero.
        let lost = write_tape(precision, 2, |builder, x| {
            let zero = builder.constant(integer(0));
            let square = builder.push(Op::Multiply(x[0], x[1]));
            builder.push(Op::Multiply(square, zero))
        });
        assert_eq!(error_bound(&lost, &[[1.0, largest], [1.0, 2.0]]), f64::INFINITY);
        // The numbers are finite, but their error exceeds f64: 1 + 10^200, squared.
        let lost = write_tape(precision, 0, |builder, _| {
            let (zero, a) = (builder.constant(integer(0)), off(builder, 1.0, 1e200));
            let square = builder.push(Op::Multiply(a, a));
            builder.push(Op::Multiply(square, zero))
        });
        assert_eq!(error_bound(&lost, &[]), f64::INFINITY);
        let quotient = write_tape(precision, 2, |builder, x| builder.push(Op::Divide(x[0], x[1])));
        for divisor in [[-1.0, 1.0], [0.0, 1.0], [-1.0, 0.0], [0.0, 0.0]] {
            assert_eq!(error_bound(&quotient, &[[1.0, 2.0], divisor]), f64::INFINITY, "{divisor:?}");
        }
        for divisor in [[0.5, 1.0], [-1.0, -0.5]] {
            assert!(error_bound(&quotient, &[[1.0, 2.0], divisor]).is_finite(), "{divisor:?}");
        }
        // A divisor whose error is as large as the divisor, or larger.
        for (by, is_finite) in [(-0.5, true), (-1.0, false), (-1.5, false), (1.0, false), (0.5, true)] {
            let off_by = write_tape(precision, 1, |builder, x| {
                let divisor = off(builder, 1.0, by);
                builder.push(Op::Divide(x[0], divisor))
            });
            assert_eq!(error_bound(&off_by, &[[1.0, 2.0]]).is_finite(), is_finite, "{by}");
            worst_ratio(&mut Random(9), &off_by, &[[1.0, 2.0]], error_bound(&off_by, &[[1.0, 2.0]]), 30);
        }
    }
    // A state may have any value.
    let mut builder = TapeBuilder::new(Precision::F64);
    let state = builder.push(Op::State(State(0)));
    let held = builder.finish_with_states("t", vec![], state, vec![state]);
    assert_eq!(error_bound(&held, &[]), f64::INFINITY);
}

#[test]
fn results_below_the_smallest_normal_number_lose_more() {
    // Products and quotients of which only a few bits or none remain.
    for (precision, small) in [(Precision::F32, 1e-30), (Precision::F64, 1e-300)] {
        let smallest = power_of_two(precision.smallest_exponent());
        let product = write_tape(precision, 2, |builder, x| builder.push(Op::Multiply(x[0], x[1])));
        let quotient = write_tape(precision, 2, |builder, x| builder.push(Op::Divide(x[0], x[1])));
        let factor = smallest / small;
        for scale in [0.1, 1.0, 16.0, 4096.0] {
            let ranges = [[small, 2.0 * small], [scale * factor, 2.0 * scale * factor]];
            let inverse = [ranges[0], [0.5 / (scale * factor), 1.0 / (scale * factor)]];
            for (tape, ranges) in [(&product, ranges), (&quotient, inverse)] {
                let found = tightness(tape, &ranges, 400);
                // Half of the smallest f64 is no f64, so the bound has the smallest f64 itself. A result below half of the smallest f64 is its own
                // error.
                let expected = if precision == Precision::F64 { 0.45 } else { 0.9 };
                assert!(found > expected || scale < 0.2 && found > 0.35 * expected, "{found} at {scale}\n{tape}");
            }
        }
        // Sums of subnormal numbers are exact; the bound may contain at most the smallest number.
        let sum = write_tape(precision, 2, |builder, x| builder.push(Op::Add(x[0], x[1])));
        let ranges = [[smallest, 100.0 * smallest]; 2];
        assert!(error_bound(&sum, &ranges) <= smallest);
        tightness(&sum, &ranges, 50);
    }
}

/// An ideal index is an integer. If the index of the tape is nearer than 1/2, both are the same; if it is not, the ideal may read another entry.
#[test]
fn an_index_that_may_be_another_integer_reads_any_entry() {
    for precision in Precision::ALL {
        for (by, is_finite) in [(0.0, true), (0.25, true), (-0.25, true), (0.5, false), (-0.5, false), (1.0, false)] {
            let read = write_tape(precision, 0, |builder, _| {
                let index = off(builder, 1.0, by);
                let entries =
                    (0..4).map(|k: i32| Constant { value: f64::from(10 * k), exact: integer(i64::from(10 * k)) }).collect();
                builder.push(Op::Load { table: Arc::new(Table::new(entries, 3, 0)), index, offset: 0 })
            });
            let bound = error_bound(&read, &[]);
            assert_eq!(bound, if is_finite { 0.0 } else { f64::INFINITY }, "{by}");
        }
        // Outside of the table the mask makes another index of it.
        let outside = write_tape(precision, 1, |builder, x| {
            let entries = (0..4).map(|k: i32| Constant { value: f64::from(k), exact: integer(i64::from(k)) }).collect();
            builder.push(Op::Load { table: Arc::new(Table::new(entries, 3, 0)), index: x[0], offset: 0 })
        });
        assert_eq!(error_bound(&outside, &[[0.0, 3.0]]), 0.0);
        assert_eq!(error_bound(&outside, &[[0.0, 4.0]]), f64::INFINITY);
    }
}

/// The ideal's exponent is another one if the operand has an error. Without one, it is that of the operand.
#[test]
fn only_an_exact_operand_has_an_exponent() {
    for precision in Precision::ALL {
        for (by, is_finite) in [(0.0, true), (0.25, false), (-0.25, false)] {
            let exponent = write_tape(precision, 0, |builder, _| {
                let operand = off(builder, 3.0, by);
                builder.push(Op::Exponent(operand))
            });
            assert_eq!(error_bound(&exponent, &[]), if is_finite { 0.0 } else { f64::INFINITY }, "{by}");
        }
    }
}

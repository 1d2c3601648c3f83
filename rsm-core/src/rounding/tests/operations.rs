//! Tests of the bound of each operation: its own rounding, the errors of its operands, and the rounding of the bound itself. Each part is tight
//! somewhere.

use super::*;

#[test]
fn every_operation_is_charged_its_rounding_and_little_more() {
    // Results stay inside one power of two, so half a unit in the last place is the same everywhere.
    let cases: [(Binary, [[f64; 2]; 2]); 10] = [
        (Op::Add, [[1.0, 1.9], [0.01, 0.02]]),
        (Op::Add, [[-1.9, -1.0], [-0.02, -0.01]]),
        (Op::Add, [[4.6, 4.9], [3.5, 7.9]]),
        (Op::Subtract, [[1.1, 1.9], [0.01, 0.02]]),
        (Op::Subtract, [[-0.02, -0.01], [1.1, 1.9]]),
        (Op::Multiply, [[1.2, 1.39], [1.2, 1.4]]),
        (Op::Multiply, [[-1.4, -1.2], [100.0, 110.0]]),
        (Op::Divide, [[1.5, 1.9], [1.0, 1.2]]),
        (Op::Divide, [[-1.9, -1.5], [3.0, 3.4]]),
        (Op::Divide, [[7.0, 7.9], [-1.5, -1.1]]),
    ];
    for precision in Precision::ALL {
        for (op, ranges) in cases {
            let tape = write_tape(precision, 2, |builder, x| builder.push(op(x[0], x[1])));
            let found = tightness(&tape, &ranges, 600);
            assert!(found > 0.97, "{found}\n{tape}");
        }
        let square = write_tape(precision, 1, |builder, x| builder.push(Op::Multiply(x[0], x[0])));
        for range in [[1.1, 1.41], [-1.41, -1.1]] {
            assert!(tightness(&square, &[range], 600) > 0.97, "{square}");
        }
        for value in [0.1f64, -0.7, 1.0 / 3.0] {
            // A constant may represent any number: here the exact fraction, not its f64.
            let tenths = integer((value * 30.0).round() as i64) / integer(30);
            let constant = write_tape(precision, 0, |builder, _| builder.constant(tenths.clone()));
            assert!(tightness(&constant, &[], 1) > 0.999, "{constant}");
        }
    }
}

#[test]
fn an_error_that_an_operand_brings_along_is_charged() {
    let mut random = Random(2);
    for precision in Precision::ALL {
        for (name, op) in BINARIES {
            for _ in 0..40 {
                let mut value = || f64::from((random.between(0.5, 8.0) * random.pick(&[1.0, -1.0])) as f32);
                let (a, b) = (value(), value());
                let (of_a, of_b) = (random.pick(&[0.0, a / 64.0, a / 8.0]), random.pick(&[0.0, b / 128.0, b / 16.0]));
                if of_a == 0.0 && of_b == 0.0 {
                    continue;
                }
                let tapes = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(left, right)| {
                    write_tape(precision, 0, |builder, _| {
                        let a = off(builder, a, left * of_a);
                        let b = off(builder, b, right * of_b);
                        builder.push(op(a, b))
                    })
                });
                // With one choice of signs the two errors add up.
                let worst = tapes.iter().map(|tape| tightness(tape, &[], 1)).fold(0.0, f64::max);
                assert!(worst > 0.9999, "{name} of {a} and {b}: {worst}");
            }
        }
        let of_one: [(&str, Unary); 4] = [
            ("negate", |builder, a| builder.push(Op::Negate(a))),
            ("absolute", |builder, a| builder.push(Op::Absolute(a))),
            ("square", |builder, a| builder.push(Op::Multiply(a, a))),
            ("double", |builder, a| builder.push(Op::Add(a, a))),
        ];
        for (name, op) in of_one {
            for (value, by) in [(3.0, 0.25), (-3.0, -0.25), (1.5, 0.125), (-0.75, -0.375)] {
                let one = write_tape(precision, 0, |builder, _| {
                    let a = off(builder, value, by);
                    op(builder, a)
                });
                assert!(tightness(&one, &[], 1) > 0.9999, "{name} of {value}");
            }
        }
    }
}

#[test]
fn a_divisor_that_is_mostly_error_enlarges_what_the_quotient_rounds() {
    // The ideal divisor is a sixteenth of the computed one, so the rounding error of the quotient counts fifteen times more.
    let mut random = Random(13);
    for precision in Precision::ALL {
        let mut worst = 0.0f64;
        for _ in 0..200 {
            let mut value = || precision.round(&exact(random.between(1.0, 2.0)));
            let (a, b) = (value(), value());
            let tape = write_tape(precision, 0, |builder, _| {
                let (a, b) = (builder.constant(exact(a)), off(builder, b, -b * 0.9375));
                builder.push(Op::Divide(a, b))
            });
            worst = worst.max(tightness(&tape, &[], 1));
        }
        assert!(worst > 1.0 - 1e-9, "{worst}");
    }
}

#[test]
fn arithmetic_of_bounds_errs_to_the_safe_side_by_at_most_two_numbers() {
    let mut random = Random(14);
    for _ in 0..2000 {
        let [a, b] = [0, 1].map(|_| random.between(1.0, 2.0) * power_of_two(random.below(60) as i64 - 30));
        let (large, small) = (a.max(b), a.min(b));
        let above = |found: f64, truth: Rational| exact(found) >= truth && exact(found.next_down().next_down()) <= truth;
        assert!(above(sum_up(a, b), exact(a) + exact(b)), "{a} + {b}");
        assert!(above(product_up(a, b), exact(a) * exact(b)), "{a} * {b}");
        assert!(above(quotient_up(a, b), exact(a) / exact(b)), "{a} / {b}");
        assert!(above(-difference_down(large, small), exact(small) - exact(large)), "{large} - {small}");
    }
    // Zero operands give zero bounds.
    assert_eq!([sum_up(0.0, 3.0), sum_up(3.0, 0.0), product_up(0.0, 3.0), product_up(3.0, 0.0)], [3.0, 3.0, 0.0, 0.0]);
    assert_eq!([quotient_up(0.0, 3.0), difference_down(3.0, 0.0)], [0.0, 3.0]);
    assert!(product_up(0.0, f64::INFINITY).is_nan() && product_up(f64::INFINITY, 0.0).is_nan());
}

/// The error of a product with an inexact factor is the magnitude of the other factor times that factor's error. So the bound shows the range that
/// the analysis uses.
#[test]
fn the_range_of_every_result_is_known() {
    type Write = fn(&mut TapeBuilder, &[Reg]) -> Reg;
    let writes: [(&str, usize, Write); 14] = [
        ("input", 1, |_, x| x[0]),
        ("sum", 2, |builder, x| builder.push(Op::Add(x[0], x[1]))),
        ("difference", 2, |builder, x| builder.push(Op::Subtract(x[0], x[1]))),
        ("product", 2, |builder, x| builder.push(Op::Multiply(x[0], x[1]))),
        ("quotient", 2, |builder, x| builder.push(Op::Divide(x[0], x[1]))),
        ("square", 1, |builder, x| builder.push(Op::Multiply(x[0], x[0]))),
        ("negation", 1, |builder, x| builder.push(Op::Negate(x[0]))),
        ("magnitude", 1, |builder, x| builder.push(Op::Absolute(x[0]))),
        ("maximum", 2, |builder, x| builder.at_least(x[0], x[1])),
        ("minimum", 2, |builder, x| builder.at_most(x[0], x[1])),
        ("magnitude less 1", 1, |builder, x| {
            let one = builder.constant(integer(1));
            let magnitude = builder.push(Op::Absolute(x[0]));
            builder.push(Op::Subtract(magnitude, one))
        }),
        ("square less 1", 1, |builder, x| {
            let one = builder.constant(integer(1));
            let square = builder.push(Op::Multiply(x[0], x[0]));
            builder.push(Op::Subtract(square, one))
        }),
        ("negation plus 3", 1, |builder, x| {
            let three = builder.constant(integer(3));
            let opposite = builder.push(Op::Negate(x[0]));
            builder.push(Op::Add(opposite, three))
        }),
        ("choice", 4, |builder, x| {
            let condition = builder.push(Op::Less(x[0], x[1]));
            builder.push(Op::Select { condition, then: x[2], otherwise: x[3] })
        }),
    ];
    let mut random = Random(3);
    for precision in Precision::ALL {
        for (name, arity, write) in writes {
            for _ in 0..5 {
                let ranges: Vec<[f64; 2]> = (0..arity)
                    .map(|k| {
                        let positive = [random.between(0.5, 1.0), random.between(1.5, 4.0)];
                        let opposite = [-positive[1], -positive[0]];
                        let across = [-positive[0], positive[1]];
                        let mostly_below = [-positive[1], positive[0]];
                        let may_be_across = name != "quotient" || k == 0;
                        let all = [positive, opposite, across, mostly_below];
                        random.pick(if may_be_across { &all } else { &all[..2] })
                    })
                    .collect();
                let tape = write_tape(precision, arity, |builder, x| {
                    let factor = off(builder, 1.0, 1.0 / 1024.0);
                    let result = write(builder, x);
                    builder.push(Op::Multiply(result, factor))
                });
                let found = tightness(&tape, &ranges, if arity == 1 { 150 } else { 30 });
                // The selection has four arguments with 8 cells a side: the largest error is in the corner of the last cell.
                assert!(found > if arity == 4 { 0.85 } else { 0.97 }, "{name} over {ranges:?}: {found}");
                let whole = bound_of_one_cell(&tape, &ranges);
                let found = worst_ratio(&mut random, &tape, &ranges, whole, if arity == 1 { 150 } else { 30 });
                assert!(found > 0.97, "{name} over {ranges:?}, one cell: {found}");
            }
        }
    }
}

#[test]
fn what_the_bound_itself_rounds_is_charged_too() {
    // Values of 2^-60 with errors that use all bits: the rounding error of the operation is negligible compared with that of the bound.
    let mut random = Random(8);
    let tiny = power_of_two(-60);
    let near_one = |random: &mut Random| random.between(1.0, 2.0) * power_of_two(-4 - random.below(8) as i64);
    for precision in Precision::ALL {
        for (name, op) in BINARIES {
            let mut closest = 0.0f64;
            for _ in 0..300 {
                let is_quotient = name == "quotient";
                let (of_a, of_b) = (near_one(&mut random), near_one(&mut random));
                let b = if is_quotient { 1.0 } else { tiny };
                let signs = if is_quotient || name == "difference" { -1.0 } else { 1.0 };
                let tape = write_tape(precision, 0, |builder, _| {
                    let a = off(builder, if name == "product" { random.pick(&[tiny, 1.5]) } else { tiny }, of_a);
                    let b = off(builder, b, signs * of_b);
                    builder.push(op(a, b))
                });
                closest = closest.max(tightness(&tape, &[], 1));
            }
            assert!(closest > 1.0 - 1e-9, "{name}: {closest}");
        }
        // Values whose product uses all bits, times an error that does so too; and a constant whose error is no f64.
        for _ in 0..300 {
            let (value, by) = (f64::from(random.between(1.0, 2.0) as f32), near_one(&mut random));
            let product = write_tape(precision, 0, |builder, _| {
                let a = builder.constant(exact(value));
                let b = off(builder, tiny, by);
                builder.push(Op::Multiply(a, b))
            });
            tightness(&product, &[], 1);
            let third = write_tape(precision, 0, |builder, _| builder.rounded_constant(0.0, exact(by) / integer(3)));
            tightness(&third, &[], 1);
        }
    }
}

#[test]
fn half_a_unit_in_the_last_place_is_what_rounding_may_lose() {
    let mut random = Random(10);
    for precision in Precision::ALL {
        let tape = write_tape(precision, 1, |_, x| x[0]);
        let analysis = Analysis::new(&tape);
        let lowest = if precision == Precision::F32 { -148 } else { -1073 };
        let highest = if precision == Precision::F32 { 126 } else { 1022 };
        for exponent in
            (lowest..=highest).step_by(7).chain([lowest, lowest + 1, -127, -126, -125, -1022, -1023, -1021, -1, 0, 1, highest])
        {
            if exponent < lowest {
                continue;
            }
            let power = power_of_two(exponent);
            for value in [
                power,
                precision.next_up(power),
                power * 1.5,
                precision.next_down(2.0 * power),
                random.between(power, 2.0 * power),
            ] {
                let value = precision.round(&exact(value));
                let half = exact(analysis.half_ulp(value));
                let gap = exact(precision.next_up(value)) - exact(value);
                let rounds_up = half > gap.clone() / integer(2);
                assert!(!rounds_up || exact(5e-324) == gap, "{value:e}: {half} beside {gap}");
                assert!(half >= gap / integer(2), "{value:e}");
                assert_eq!([magnitude(-value, value / 4.0), magnitude(-value / 2.0, value)], [value; 2]);
            }
        }
        assert_eq!(analysis.half_ulp(f64::INFINITY), f64::INFINITY);
    }
}

#[test]
fn a_constant_is_charged_the_exact_distance_to_what_it_stands_for() {
    for (value, stands_for) in [(1.0, 1.25), (1.25, 1.0), (-1.0, 1.0), (0.0, -3.0)] {
        let tape = write_tape(Precision::F64, 0, |builder, _| builder.rounded_constant(value, exact(stands_for)));
        let expected: Rational = crate::adversary::magnitude(exact(value) - exact(stands_for));
        assert_eq!(exact(error_bound(&tape, &[])), expected);
    }
}

//! Each rule of the bound against an adversary: no error that a search finds is above the bound, and each rule is tight somewhere.
//!
//! Constants of these tapes stand for numbers far from their values where a test is about errors that operands bring along: such an error
//! is much larger than what the operation itself rounds, so a bound that leaves it out is broken at once.

use super::*;
use crate::adversary::{Random, seen_error, worst_ratio};
use crate::number::{Rational, integer};
use crate::tape::{Port, State, TapeBuilder};

/// A tape of some inputs.
fn write_tape(precision: Precision, arity: usize, write: impl FnOnce(&mut TapeBuilder, &[Reg]) -> Reg) -> Tape {
    let mut builder = TapeBuilder::new(precision);
    let inputs: Vec<Reg> = (0..arity).map(|k| builder.push(Op::Input(Port(k as u32)))).collect();
    let output = write(&mut builder, &inputs);
    builder.finish("t", (0..arity).map(|k| format!("x{k}")).collect(), output)
}

/// A constant that stands for another number.
fn off(builder: &mut TapeBuilder, value: f64, by: f64) -> Reg {
    builder.rounded_constant(value, exact(value) + exact(by))
}

/// The bound from the whole box as one cell.
fn bound_of_one_cell(tape: &Tape, ranges: &[[f64; 2]]) -> f64 {
    let sides: Vec<Side> = ranges.iter().map(|range| side(tape.precision, *range, 0, 1).unwrap()).collect();
    Analysis::new(tape).error_in(&sides)
}

/// The worst ratio over a box; asserts that no error is above the bound.
fn tightness(tape: &Tape, ranges: &[[f64; 2]], effort: usize) -> f64 {
    worst_ratio(&mut Random(1), tape, ranges, error_bound(tape, ranges), effort)
}

/// How much of a number one unit of roundoff is.
fn ulp_of_one(precision: Precision) -> f64 {
    2.0 * precision.unit_roundoff()
}

type Unary = fn(&mut TapeBuilder, Reg) -> Reg;
type Binary = fn(Reg, Reg) -> Op;
const BINARIES: [(&str, Binary); 4] =
    [("sum", Op::Add), ("difference", Op::Subtract), ("product", Op::Multiply), ("quotient", Op::Divide)];

#[test]
fn every_operation_is_charged_its_rounding_and_little_more() {
    // Results stay inside one binade, so half a unit in the last place is the same everywhere.
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
            // What a constant stands for may lie anywhere: here the tenth, not its f64.
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
                // One choice of signs adds the two errors up.
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
    // The ideal divisor is a sixteenth of the computed one: what the quotient rounds comes back fifteen times.
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
    // Nothing lost, nothing charged.
    assert_eq!([sum_up(0.0, 3.0), sum_up(3.0, 0.0), product_up(0.0, 3.0), product_up(3.0, 0.0)], [3.0, 3.0, 0.0, 0.0]);
    assert_eq!([quotient_up(0.0, 3.0), difference_down(3.0, 0.0)], [0.0, 3.0]);
    assert!(product_up(0.0, f64::INFINITY).is_nan() && product_up(f64::INFINITY, 0.0).is_nan());
}

/// The error of a product with an inexact factor is the magnitude of the other one times that factor's error: so the bound shows which
/// range the analysis knows.
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
                // The choice is between four arguments, 8 cells a side: its corner is in the last of them.
                assert!(found > if arity == 4 { 0.85 } else { 0.97 }, "{name} over {ranges:?}: {found}");
                let whole = bound_of_one_cell(&tape, &ranges);
                let found = worst_ratio(&mut random, &tape, &ranges, whole, if arity == 1 { 150 } else { 30 });
                assert!(found > 0.97, "{name} over {ranges:?}, one cell: {found}");
            }
        }
    }
}

#[test]
fn a_difference_is_exact_up_to_a_ratio_of_two_and_no_further() {
    for precision in Precision::ALL {
        let u = ulp_of_one(precision);
        let difference = write_tape(precision, 2, |builder, x| builder.push(Op::Subtract(x[0], x[1])));
        let sum = write_tape(precision, 2, |builder, x| builder.push(Op::Add(x[0], x[1])));
        // Both ends of both ranges at a ratio of exactly 2.
        for ranges in
            [[[2.0, 4.0], [2.0, 4.0]], [[-4.0, -2.0], [-4.0, -2.0]], [[1.5, 1.5], [3.0, 3.0]], [[3.0, 3.0], [1.5, 1.5]]]
        {
            // However large the numbers are.
            for scale in [-60, 0, 60] {
                let ranges = ranges.map(|range| range.map(|end| end * power_of_two(scale)));
                assert_eq!(error_bound(&difference, &ranges), 0.0, "{ranges:?}");
                let [a, [low, high]] = ranges;
                assert_eq!(error_bound(&sum, &[a, [-high, -low]]), 0.0, "{ranges:?}");
                // Of one sign they are not.
                assert!(error_bound(&sum, &ranges) > 0.0);
                worst_ratio(&mut Random(4), &difference, &ranges, 0.0, 100);
            }
        }
        // One number beyond: 4 - (2 - u/1) = 2 + u has a bit too many, and is rounded by half a unit of its last place.
        let below_two = precision.next_down(2.0);
        for (a, b) in [(4.0, below_two), (below_two, 4.0), (-4.0, -below_two), (-below_two, -4.0)] {
            let ranges = [[a, a], [b, b]];
            assert_eq!(seen_error(&difference, &[a, b]), Some(exact(u / 1.0)), "{a} {b}");
            assert_eq!(error_bound(&difference, &ranges), u, "{a} {b}");
            assert_eq!(error_bound(&sum, &[[a, a], [-b, -b]]), u, "{a} {b}");
        }
        // Nothing is exact where the second may have another sign, or be 0.
        for b in [[-1.0, 1.0], [0.0, 1.0], [-1.0, 0.0]] {
            assert!(error_bound(&difference, &[[1.0, 1.5], b]) > 0.0);
        }
        // The edges over a whole box: a ratio of up to 4 in either direction.
        for sign in [1.0, -1.0] {
            let range = if sign > 0.0 { [1.0, 4.0] } else { [-4.0, -1.0] };
            let found = tightness(&difference, &[range, range], 2000);
            assert!(found > 0.4, "{found}");
        }
        // Exact operands and an exact difference: what follows is charged nothing either.
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
        // The square overflows: infinity less infinity is NaN, of which nothing may be promised.
        assert_eq!(error_bound(&square_less_itself, &[[1.0, largest]]), f64::INFINITY);
        // A sum with itself is no difference.
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
        // A square is not negative, so a divisor that it is part of is not zero.
        let bell = write_tape(precision, 1, |builder, x| {
            let (one, width) = (builder.constant(integer(1)), off(builder, 1e-6f32.into(), 1e-8));
            let square = builder.push(Op::Multiply(x[0], x[0]));
            let divisor = builder.push(Op::Add(square, width));
            builder.push(Op::Divide(one, divisor))
        });
        assert!(error_bound(&bell, &[[-1.0, 1.3]]).is_finite());
        let at_its_top = bound_of_one_cell(&bell, &[[-1e-6, 1.3e-6]]);
        assert!(worst_ratio(&mut Random(15), &bell, &[[-1e-6, 1.3e-6]], at_its_top, 50) > 0.9);
        // x - x is zero and nothing else: added, it moves no range.
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
fn a_maximum_moves_by_no_more_than_what_it_compares() {
    for precision in Precision::ALL {
        // The error of the value where it wins, that of the bound where that wins; the same mirrored.
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
        // A bound that is never reached but might be, were it exact: an exact value that stays on the safe side costs nothing if the
        // bound was rounded towards it, else what the bound is off by.
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
            // Where the value may pass the bound, the bound's error counts in any case.
            let wider = [0.0, 2.0];
            assert_eq!(error_bound(&tape, &[wider]), 0.125);
            assert!(tightness(&tape, &[wider], 50) > 0.999);
            // An exact bound costs nothing.
            let exactly = write_tape(precision, 1, |builder, x| {
                let bound = builder.constant(integer(1));
                if is_minimum { builder.at_most(x[0], bound) } else { builder.at_least(x[0], bound) }
            });
            assert_eq!(error_bound(&exactly, &[range]), 0.0);
        }
        // A computed bound says nothing of how it was rounded: here 0.9 that stands for 1.4.
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
            // Straight from the argument where nothing is off: a sum with zero is charged.
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
        // Always less, never less (a tie is not less), and both.
        assert_eq!(charged(small, large, [[0.0, 0.5], [1.0, 2.0]]), small);
        assert_eq!(charged(small, large, [[0.0, 1.0], [1.0, 2.0]]), large);
        assert_eq!(charged(large, small, [[2.0, 3.0], [1.0, 2.0]]), small);
        assert_eq!(charged(large, small, [[2.5, 3.0], [1.0, 2.0]]), small);
        assert_eq!(charged(large, small, [[1.0, 3.0], [1.0, 2.0]]), large);
        assert_eq!(charged(small, large, [[1.0, 3.0], [1.0, 2.0]]), large);
        // An inexact comparison may choose the other one: nothing is known.
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

#[test]
fn what_the_bound_itself_rounds_is_charged_too() {
    // Values of 2^-60, errors of all significant bits: what the operation rounds is nothing beside what the bound rounds.
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
        // Values whose product has all bits, times an error that has them too; and a constant whose error is no f64.
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
fn nothing_is_promised_where_the_tape_may_leave_its_numbers() {
    for precision in Precision::ALL {
        let largest = precision.largest();
        let half = largest / 2.0;
        let twice = write_tape(precision, 2, |builder, x| builder.push(Op::Add(x[0], x[1])));
        assert!(error_bound(&twice, &[[1.0, half], [1.0, half]]).is_finite());
        assert_eq!(error_bound(&twice, &[[1.0, largest], [1.0, half]]), f64::INFINITY);
        assert_eq!(error_bound(&twice, &[[-largest, -1.0], [-half, -1.0]]), f64::INFINITY);
        // What is lost by rounding alone at the edge: half a unit of the largest number.
        let tiny = [0.0, half * precision.unit_roundoff() * 0.5];
        let found = tightness(&twice, &[[half, largest], tiny], 300);
        assert!(found > 0.2, "{found}");
        let product = write_tape(precision, 2, |builder, x| builder.push(Op::Multiply(x[0], x[1])));
        assert!(error_bound(&product, &[[1.0, half], [-2.0, 2.0]]).is_finite());
        assert_eq!(error_bound(&product, &[[1.0, half], [-2.0, 2.0 + 1e-6]]), f64::INFINITY);
        assert_eq!(error_bound(&product, &[[1.0, half], [-2.0 - 1e-6, 2.0]]), f64::INFINITY);
        // Infinity reaches the result through everything that follows, also through a product with zero.
        let lost = write_tape(precision, 2, |builder, x| {
            let zero = builder.constant(integer(0));
            let square = builder.push(Op::Multiply(x[0], x[1]));
            builder.push(Op::Multiply(square, zero))
        });
        assert_eq!(error_bound(&lost, &[[1.0, largest], [1.0, 2.0]]), f64::INFINITY);
        // An error that no f64 holds, of numbers that are: 1 + 10^200, squared.
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
        // A divisor whose error reaches zero, or passes it.
        for (by, is_finite) in [(-0.5, true), (-1.0, false), (-1.5, false), (1.0, false), (0.5, true)] {
            let off_by = write_tape(precision, 1, |builder, x| {
                let divisor = off(builder, 1.0, by);
                builder.push(Op::Divide(x[0], divisor))
            });
            assert_eq!(error_bound(&off_by, &[[1.0, 2.0]]).is_finite(), is_finite, "{by}");
            worst_ratio(&mut Random(9), &off_by, &[[1.0, 2.0]], error_bound(&off_by, &[[1.0, 2.0]]), 30);
        }
    }
    // A state may hold anything.
    let mut builder = TapeBuilder::new(Precision::F64);
    let state = builder.push(Op::State(State(0)));
    let held = builder.finish_with_states("t", vec![], state, vec![state]);
    assert_eq!(error_bound(&held, &[]), f64::INFINITY);
}

#[test]
fn results_below_the_smallest_normal_number_lose_more() {
    // Products and quotients of which only a few bits, or none, are left.
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
                // Half of the smallest number of f64 is no f64; one whole stands for it. A result below a half of it errs by itself.
                let expected = if precision == Precision::F64 { 0.45 } else { 0.9 };
                assert!(found > expected || scale < 0.2 && found > 0.35 * expected, "{found} at {scale}\n{tape}");
            }
        }
        // Sums of subnormal numbers are exact; they may be charged half of the smallest number, no more.
        let sum = write_tape(precision, 2, |builder, x| builder.push(Op::Add(x[0], x[1])));
        let ranges = [[smallest, 100.0 * smallest]; 2];
        assert!(error_bound(&sum, &ranges) <= smallest);
        tightness(&sum, &ranges, 50);
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
fn cells_hold_every_number_of_the_range() {
    let mut random = Random(11);
    for precision in Precision::ALL {
        for _ in 0..300 {
            // Ranges of a few numbers, whose ends are none of the type, or are.
            let mut low = f64::from((random.between(-4.0, 4.0) * power_of_two(random.below(40) as i64 - 20)) as f32);
            let mut numbers = vec![low];
            for _ in 0..random.below(12) {
                low = precision.next_up(low);
                numbers.push(low);
            }
            let mut range = [numbers[0], *numbers.last().unwrap()];
            if precision == Precision::F32 && random.chance(2) {
                range = [range[0].next_down(), range[1].next_up()];
            }
            let n = 1 << random.below(7);
            let sides: Vec<Side> = (0..n).filter_map(|k| side(precision, range, k, n)).collect();
            for number in numbers {
                assert!(sides.iter().any(|[low, high]| *low <= number && number <= *high), "{number} of {range:?} in {n}");
            }
            for [low, high] in sides {
                assert!(range[0] <= low && low <= high && high <= range[1], "{range:?}");
                assert!([low, high].iter().all(|end| precision.round(&exact(*end)) == *end));
            }
        }
    }
    // No number of f32 in it.
    assert_eq!(side(Precision::F32, [1.0 + 1e-12, 1.0 + 2e-12], 0, 1), None);
    assert_eq!(side(Precision::F64, [0.0, 8.0], 1, 4), Some([2.0, 4.0]));
}

#[test]
fn the_number_of_cells_stays_within_the_budget() {
    let expected = [(0, 10, 256), (1, 10, 256), (2, 10, 64), (3, 10, 16), (4, 10, 8), (6, 10, 4), (12, 10, 2), (13, 10, 1)];
    for (dimensions, operations, side) in expected {
        assert_eq!(cells_per_side(dimensions, operations), side, "{dimensions}");
    }
    // 4096 cells of 1000 operations: longer tapes have fewer.
    assert_eq!(cells_per_side(2, 1000), 64);
    assert_eq!(cells_per_side(2, 4000), 32);
    assert_eq!(cells_per_side(1, 1_000_000), 4);
    assert_eq!(cells_per_side(1, 0), 256);
    assert_eq!([cells_per_side(1, 256_000), cells_per_side(1, 256_001)], [16, 8]);
    // So long that a cell is too many: one all the same.
    assert_eq!(cells_per_side(1, 10_000_000), 1);
    // As many inputs as a file may name.
    for dimensions in [31, 32, 63, 64, 65, 100, 1000] {
        assert_eq!(cells_per_side(dimensions, 10), 1, "{dimensions}");
    }
}

#[test]
fn the_worst_cell_counts_wherever_it_lies() {
    // The error is the sum of the arguments' magnitudes over 64: largest in one corner.
    for precision in Precision::ALL {
        for arity in 1..=3usize {
            for corner in 0..1 << arity {
                let range = |k: usize| if corner >> k & 1 == 1 { [0.0, 1.0] } else { [-1.0, 0.0] };
                let ranges: Vec<[f64; 2]> = (0..arity).map(range).collect();
                let tape = write_tape(precision, arity, |builder, x| {
                    let factor = off(builder, 1.0, 1.0 / 64.0);
                    let products: Vec<Reg> = x.iter().map(|x| builder.push(Op::Absolute(*x))).collect();
                    let products: Vec<Reg> = products.iter().map(|x| builder.push(Op::Multiply(*x, factor))).collect();
                    products.into_iter().reduce(|sum, product| builder.push(Op::Add(sum, product))).unwrap()
                });
                let found = tightness(&tape, &ranges, 1);
                assert!(found > 0.999, "{found} over {ranges:?}");
            }
        }
        // Cells make the bound tight where a whole range would not: x (1 - x) is no more than a quarter, which one range takes for 1.
        let hump = write_tape(precision, 1, |builder, x| {
            let (one, factor) = (builder.constant(integer(1)), off(builder, 1.0, 1.0 / 64.0));
            let rest = builder.push(Op::Subtract(one, x[0]));
            let product = builder.push(Op::Multiply(x[0], rest));
            builder.push(Op::Multiply(product, factor))
        });
        let found = tightness(&hump, &[[0.0, 1.0]], 400);
        assert!(found > 0.98, "{found}");
    }
}

/// Tapes of any operations, over any ranges, whose constants may stand for other numbers.
fn any_tape(random: &mut Random, precision: Precision) -> (Tape, Vec<[f64; 2]>) {
    let arity = 1 + random.below(3);
    let ranges: Vec<[f64; 2]> = (0..arity)
        .map(|_| {
            let low = random.between(-4.0, 4.0) * power_of_two(random.below(12) as i64 - 6);
            [low, low + random.between(0.0, 3.0) * power_of_two(random.below(10) as i64 - 6)]
        })
        .map(|range| crate::adversary::inside(precision, range))
        .collect();
    let written = write_tape(precision, arity, |builder, x| {
        let mut registers = x.to_vec();
        for _ in 0..2 + random.below(3) {
            let value = f64::from((random.between(-3.0, 3.0)) as f32);
            let by = random.pick(&[0.0, 0.0, value * 1e-9, value / 64.0, -value / 512.0]);
            registers.push(off(builder, value, by));
        }
        for _ in 0..2 + random.below(6) {
            let a = random.pick(&registers);
            // Late registers more often: chains, not bushes.
            let b = if random.chance(2) { *registers.last().unwrap() } else { random.pick(&registers) };
            let made = match random.below(12) {
                0 | 1 => builder.push(Op::Add(a, b)),
                2 | 3 => builder.push(Op::Subtract(a, b)),
                4..=6 => builder.push(Op::Multiply(a, b)),
                7 => builder.push(Op::Divide(a, b)),
                8 => builder.push(Op::Negate(b)),
                9 => builder.push(Op::Absolute(b)),
                10 => builder.at_least(b, a),
                _ => {
                    if random.chance(2) {
                        builder.at_most(b, a)
                    } else {
                        let (left, right) = (random.pick(x), random.pick(&registers));
                        let condition = builder.push(Op::Less(left, right));
                        builder.push(Op::Select { condition, then: a, otherwise: b })
                    }
                }
            };
            registers.push(made);
        }
        *registers.last().unwrap()
    });
    (written, ranges)
}

/// Whether the result depends on every quotient: a tape in rational arithmetic has no value where any divisor is zero.
fn divides_to_the_end(tape: &Tape) -> bool {
    let mut live = vec![false; tape.ops.len()];
    live[tape.output.0 as usize] = true;
    for k in (0..live.len()).rev() {
        if live[k] {
            tape.ops[k].operands().iter().for_each(|operand| live[operand.0 as usize] = true);
        } else if matches!(tape.ops[k], Op::Divide(..)) {
            return false;
        }
    }
    true
}

#[test]
fn no_tape_errs_by_more_than_its_bound() {
    let mut random = Random(12);
    let (mut promised, mut tight) = (0, 0);
    for round in 0..160 {
        let precision = Precision::ALL[round % 2];
        let (tape, ranges) =
            std::iter::repeat_with(|| any_tape(&mut random, precision)).find(|(tape, _)| divides_to_the_end(tape)).unwrap();
        let bound = error_bound(&tape, &ranges);
        let found = worst_ratio(&mut random, &tape, &ranges, bound, 60);
        promised += usize::from(bound.is_finite());
        tight += usize::from(found > 0.5);
    }
    // Most have a bound, and of many the search finds more than half.
    assert!(promised > 80 && tight > 40, "{promised} promised, {tight} tight");
}

#[test]
fn a_constant_is_charged_the_exact_distance_to_what_it_stands_for() {
    for (value, stands_for) in [(1.0, 1.25), (1.25, 1.0), (-1.0, 1.0), (0.0, -3.0)] {
        let tape = write_tape(Precision::F64, 0, |builder, _| builder.rounded_constant(value, exact(stands_for)));
        let expected: Rational = crate::adversary::magnitude(exact(value) - exact(stands_for));
        assert_eq!(exact(error_bound(&tape, &[])), expected);
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
                // Bits are shifted out of what becomes subnormal, and of what is rounded up to the smallest normal number.
                let (low, high) = (normal / factor.abs(), 4.0 * normal / factor.abs());
                let above = [precision.next_up(low), high];
                assert_eq!(error_bound(&tape, &[above]), 0.0, "{tape}");
                assert_eq!(error_bound(&tape, &[[-above[1], -above[0]]]), 0.0, "{tape}");
                for range in [[low / 8.0, low], [-low, -low / 8.0], [-low, low]] {
                    let found = tightness(&tape, &[range], 200);
                    let is_exact = factor.abs() >= 1.0;
                    assert_eq!(error_bound(&tape, &[range]) == 0.0, is_exact, "{tape}");
                    // Half of the smallest f64 is none: a whole one stands for it.
                    assert!(is_exact || found > if precision == Precision::F64 { 0.45 } else { 0.9 }, "{found}\n{tape}");
                }
                // A quarter of a number just below four times the smallest normal number is rounded up to that.
                let edge = precision.next_down(low);
                assert!(factor.abs() >= 1.0 || tightness(&tape, &[[edge, edge]], 1) > 0.1, "{tape}");
            }
        }
        // What is no power of two, or not alone in its range, rounds.
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
        // A factor that stands for another number brings its own error along.
        let off_two = write_tape(precision, 1, |builder, x| {
            let factor = off(builder, 2.0, 1.0 / 64.0);
            builder.push(Op::Multiply(x[0], factor))
        });
        assert!(tightness(&off_two, &[[0.5, 3.0]], 20) > 0.9999);
    }
}

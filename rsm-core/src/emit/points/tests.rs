//! Tests of the points against lists worked by hand, and of fused results against `mul_add`.

use super::*;
use crate::model::Outside;
use crate::number::{Precision, exact};
use crate::tape::{Port, State, TapeBuilder};

fn quadratic(precision: Precision) -> Tape {
    let mut tape = TapeBuilder::new(precision);
    let x = tape.push(Op::Input(Port(0)));
    let (a, b) = (tape.constant(exact(0.1)), tape.constant(exact(0.7)));
    let product = tape.push(Op::Multiply(x, a));
    let sum = tape.push(Op::Add(product, b));
    tape.finish("s", vec!["x".to_string()], sum)
}

fn input(range: [f64; 2]) -> Input {
    Input { name: "x".to_string(), unit: "1".to_string(), range, outside: Outside::Extrapolate }
}

fn arguments(point: &Point) -> Vec<f64> {
    point.arguments.iter().copied().map(f64::from_bits).collect()
}

/// The points of a function with this tape.
fn points(tape: &Tape, inputs: &[Input]) -> Vec<Point> {
    super::points(&Function {
        surface: "s".to_string(),
        kind: Kind::Surface,
        unit: String::new(),
        inputs: inputs.to_vec(),
        saturation: None,
        derivatives: vec![],
        kept: vec![],
        rules: vec![],
        tape: tape.clone(),
    })
}

#[test]
fn points_that_fusing_changes_are_found_in_both_precisions() {
    for precision in Precision::ALL {
        let points = points(&quadratic(precision), &[input([0.0, 1.0])]);
        // Without the special points of every function.
        let found = points[9..].iter().filter(|point| point.changes_under_fusing).count();
        assert_eq!((found, points.len()), (SENSITIVE, 9 + SENSITIVE), "{precision:?}: {found}");
    }
}

#[test]
fn fusing_by_hand_gives_what_the_search_says() {
    // 0.1 x + 0.7: the search must mark exactly the points at which mul_add and the two roundings differ.
    for point in points(&quadratic(Precision::F64), &[input([0.0, 1.0])]) {
        let x = arguments(&point)[0];
        assert_eq!(point.changes_under_fusing, !x.is_nan() && x.mul_add(0.1, 0.7) != x * 0.1 + 0.7);
    }
}

#[test]
fn a_tape_without_a_sum_has_no_such_point() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let x = tape.push(Op::Input(Port(0)));
    let square = tape.push(Op::Multiply(x, x));
    let tape = tape.finish("s", vec!["x".to_string()], square);
    assert!(points(&tape, &[input([0.0, 1.0])]).iter().all(|point| !point.changes_under_fusing));
}

#[test]
fn every_function_is_asked_its_middle_its_edges_what_lies_outside_and_special_values() {
    // x - y over [-2, 4] x [0, 10].
    let mut tape = TapeBuilder::new(Precision::F64);
    let [x, y] = [0, 1].map(|k| tape.push(Op::Input(Port(k))));
    let output = tape.push(Op::Subtract(x, y));
    let tape = tape.finish("s", vec!["x".to_string(), "y".to_string()], output);
    let points = points(&tape, &[input([-2.0, 4.0]), input([0.0, 10.0])]);
    let infinity = f64::INFINITY;
    let expected = [
        ([1.0, 5.0], -4.0),
        ([-2.0, 0.0], -2.0),
        ([4.0, 10.0], -6.0),
        ([7.0, 15.0], -8.0),
        ([-5.0, -5.0], 0.0),
        ([infinity, infinity], f64::NAN),
        ([-infinity, -infinity], f64::NAN),
        ([-0.0, -0.0], 0.0),
        ([f64::NAN, 5.0], f64::NAN),
        ([1.0, f64::NAN], f64::NAN),
    ];
    // Without a product, no further points are searched.
    assert_eq!(points.len(), expected.len());
    for (point, (asked, result)) in points.iter().zip(expected) {
        let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|value| value.to_bits()).collect() };
        assert_eq!(point.arguments, bits(&asked));
        let found = f64::from_bits(point.results[0]);
        assert!(found.to_bits() == result.to_bits() || found.is_nan() && result.is_nan(), "{found} for {result} at {asked:?}");
    }
}

/// x is inside a window that contains no special point. The two comparisons have both outcomes at special points, but never together.
#[test]
fn a_comparison_goes_both_ways_where_random_points_of_the_box_show_it() {
    for (low, high, found) in [(0.6, 0.7, true), (0.75, 0.76, true), (0.501, 0.502, true), (0.3, 0.2, false)] {
        let mut tape = TapeBuilder::new(Precision::F64);
        let x = tape.push(Op::Input(Port(0)));
        let [low, high, one, zero] = [low, high, 1.0, 0.0].map(|value| tape.constant(exact(value)));
        let above = tape.push(Op::Less(low, x));
        let above = tape.push(Op::Select { condition: above, then: one, otherwise: zero });
        let below = tape.push(Op::Less(x, high));
        let inside = tape.push(Op::Select { condition: below, then: above, otherwise: zero });
        let is_inside = tape.push(Op::Less(zero, inside));
        let output = tape.push(Op::Select { condition: is_inside, then: x, otherwise: zero });
        let tape = tape.finish("s", vec!["x".to_string()], output);
        let points = points(&tape, &[input([0.0, 1.0])]);
        let inside = points[9..].iter().filter(|point| point.results[0] != 0).count();
        // One point is enough: further points give no new outcome.
        assert_eq!((inside, points.len()), (usize::from(found), 9 + usize::from(found)));
    }
}

#[test]
fn the_points_of_a_step_are_a_sequence() {
    // y = s + 0.3 x, and s := y if y is a number. Each result needs the state of the step before; a rejected candidate must not change the state.
    let mut tape = TapeBuilder::new(Precision::F64);
    let x = tape.push(Op::Input(Port(0)));
    let state = tape.push(Op::State(State(0)));
    let factor = tape.constant(exact(0.3));
    let product = tape.push(Op::Multiply(x, factor));
    let output = tape.push(Op::Add(state, product));
    let nothing = tape.push(Op::Subtract(output, output));
    let one = tape.constant(exact(1.0));
    let condition = tape.push(Op::Less(nothing, one));
    let next = tape.push(Op::Select { condition, then: output, otherwise: state });
    let tape = tape.finish_with_states("s", vec!["x".to_string()], output, vec![next]);
    // The special points leave a state that is not 0; from state 0 fusing would not change 0 + 0.3 x.
    let points = points(&tape, &[input([-1.0, 1.5])]);
    let mut state = 0.0f64;
    for point in &points {
        let x = arguments(point)[0];
        let expected = state + x * 0.3;
        let found = f64::from_bits(point.results[0]);
        assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{found} for {expected} at {x}");
        assert_eq!(point.changes_under_fusing, expected.is_finite() && x.mul_add(0.3, state) != expected);
        if expected.is_finite() {
            state = expected;
        }
    }
    assert_eq!(points[9..].iter().filter(|point| point.changes_under_fusing).count(), SENSITIVE);
}

/// The result of `fused` on a tape of four inputs and a state of 0.9.
fn fused_of(at: [f64; 4], left_first: bool, write: impl FnOnce(&mut TapeBuilder, [Reg; 4]) -> Reg) -> f64 {
    let mut tape = TapeBuilder::new(Precision::F64);
    let inputs = [0, 1, 2, 3].map(|k| tape.push(Op::Input(Port(k))));
    let output = write(&mut tape, inputs);
    let names = ["a", "b", "c", "d"].map(str::to_owned).to_vec();
    fused(&tape.finish_with_states("s", names, output, vec![output]), &[0.9], &at, left_first)[0]
}

/// Writes the operands of an operation, and returns the operation.
type Write<'w> = &'w dyn Fn(&mut TapeBuilder, [Reg; 4]) -> Op;

#[test]
fn what_feeds_a_sum_is_fused_and_nothing_else() {
    // Fusing changes the last bits of a sum at some arguments only: with thirty random points each change occurs.
    let mut random = SplitMix(1);
    for _ in 0..30 {
        let mut share = || random.next_share() + 0.5;
        fuses([share(), share(), share(), -share()]);
    }
}

fn fuses(at: [f64; 4]) {
    let [a, b, c, d] = at;
    let product = |tape: &mut TapeBuilder, x: Reg, y: Reg| tape.push(Op::Multiply(x, y));
    let opposite = |tape: &mut TapeBuilder, x: Reg, y: Reg| {
        let product = tape.push(Op::Multiply(x, y));
        tape.push(Op::Negate(product))
    };
    for left_first in [false, true] {
        let one = |write: &dyn Fn(&mut TapeBuilder, [Reg; 4]) -> Reg| fused_of(at, left_first, write);
        // One product on either side, with or without a sign.
        let cases: [(Write<'_>, f64); 8] = [
            (&|t, [a, b, c, _]| Op::Add(product(t, a, b), c), a.mul_add(b, c)),
            (&|t, [a, b, c, _]| Op::Add(c, product(t, a, b)), a.mul_add(b, c)),
            (&|t, [a, b, c, _]| Op::Subtract(product(t, a, b), c), a.mul_add(b, -c)),
            (&|t, [a, b, c, _]| Op::Subtract(c, product(t, a, b)), (-a).mul_add(b, c)),
            (&|t, [a, b, c, _]| Op::Add(opposite(t, a, b), c), (-a).mul_add(b, c)),
            (&|t, [a, b, c, _]| Op::Add(c, opposite(t, a, b)), (-a).mul_add(b, c)),
            (&|t, [a, b, c, _]| Op::Subtract(opposite(t, a, b), c), (-a).mul_add(b, -c)),
            (&|t, [a, b, c, _]| Op::Subtract(c, opposite(t, a, b)), a.mul_add(b, c)),
        ];
        for (k, (write, expected)) in cases.iter().enumerate() {
            let found = one(&|tape, inputs| {
                let op = write(tape, inputs);
                tape.push(op)
            });
            assert_eq!(found, *expected, "case {k}");
        }
        // Two products: one of them is fused, the other is rounded.
        let sum = one(&|tape, [a, b, c, d]| {
            let (left, right) = (product(tape, a, b), product(tape, c, d));
            tape.push(Op::Add(left, right))
        });
        assert_eq!(sum, if left_first { a.mul_add(b, c * d) } else { c.mul_add(d, a * b) });
        let difference = one(&|tape, [a, b, c, d]| {
            let (left, right) = (product(tape, a, b), product(tape, c, d));
            tape.push(Op::Subtract(left, right))
        });
        assert_eq!(difference, if left_first { a.mul_add(b, -(c * d)) } else { (-c).mul_add(d, a * b) });
        // No product.
        let plain: [(Write<'_>, f64); 8] = [
            (&|_, [a, b, ..]| Op::Add(a, b), a + b),
            (&|_, [a, b, ..]| Op::Subtract(a, b), a - b),
            (&|_, [a, b, ..]| Op::Multiply(a, b), a * b),
            (&|_, [a, b, ..]| Op::Divide(a, b), a / b),
            (&|_, [a, ..]| Op::Negate(a), -a),
            (&|_, [.., d]| Op::Absolute(d), -d),
            (&|_, _| Op::State(State(0)), 0.9),
            (&|_, _| Op::Constant(crate::tape::Constant { value: 0.2, exact: exact(0.2) }), 0.2),
        ];
        for (k, (op, expected)) in plain.iter().enumerate() {
            let found = one(&|tape, inputs| {
                let op = op(tape, inputs);
                tape.push(op)
            });
            assert_eq!(found, *expected, "case {k}");
        }
        // A sum of an opposite that is not the opposite of a product.
        let difference = one(&|tape, [a, b, ..]| {
            let opposite = tape.push(Op::Negate(b));
            tape.push(Op::Add(a, opposite))
        });
        assert_eq!(difference, a - b);
        // Selections use a comparison; for equal numbers and for NaN the second value is selected.
        let (less, more) = if a < b { (0, 1) } else { (1, 0) };
        for (left, right, expected) in [(less, more, c), (more, less, d), (0, 0, d)] {
            let found = one(&|tape, inputs| {
                let condition = tape.push(Op::Less(inputs[left], inputs[right]));
                tape.push(Op::Select { condition, then: inputs[2], otherwise: inputs[3] })
            });
            assert_eq!(found, expected);
        }
    }
}

#[test]
fn bits_are_the_same_or_both_are_no_numbers() {
    let other_nan = f64::from_bits(f64::NAN.to_bits() ^ 1);
    assert!(same(1.0, 1.0) && same(f64::NAN, other_nan));
    assert!(!same(1.0, 1.0f64.next_up()) && !same(0.0, -0.0) && !same(f64::NAN, 1.0) && !same(1.0, f64::NAN));
}

/// The first three numbers of splitmix64 from 0x5eed, computed without this code with integers of any size.
#[test]
fn shares_are_those_of_splitmix() {
    let mut random = SplitMix(0x5eed);
    let found: Vec<f64> = (0..3).map(|_| random.next_share()).collect();
    assert_eq!(found, [0.038848734697185194, 0.3328011087394298, 0.3646818563781382]);
}

/// A window around a single candidate is found if the candidate is among the first 3000.
#[test]
fn three_thousand_candidates_are_tried() {
    let mut random = SplitMix(0x5eed);
    let shares: Vec<f64> = (0..=3000).map(|_| random.next_share()).collect();
    for (candidate, found) in [(0, 1), (2999, 1), (3000, 0)] {
        let share = shares[candidate];
        let mut tape = TapeBuilder::new(Precision::F64);
        let x = tape.push(Op::Input(Port(0)));
        let [low, high, one, zero] = [share.next_down(), share.next_up(), 1.0, 0.0].map(|value| tape.constant(exact(value)));
        let above = tape.push(Op::Less(low, x));
        let above = tape.push(Op::Select { condition: above, then: one, otherwise: zero });
        let below = tape.push(Op::Less(x, high));
        let inside = tape.push(Op::Select { condition: below, then: above, otherwise: zero });
        let is_inside = tape.push(Op::Less(zero, inside));
        let output = tape.push(Op::Select { condition: is_inside, then: x, otherwise: zero });
        let tape = tape.finish("s", vec!["x".to_string()], output);
        assert_eq!(points(&tape, &[input([0.0, 1.0])])[9..].len(), found, "candidate {candidate}");
    }
}

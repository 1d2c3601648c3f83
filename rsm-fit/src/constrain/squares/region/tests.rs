//! Weights and scalings by hand, to the bit where it decides.

use super::*;

fn sides(ends: &[[f64; 2]]) -> Vec<Interval> {
    ends.iter().map(|[low, high]| Interval::new(*low, *high)).collect()
}

fn weight(terms: &[([u32; 2], f64)]) -> Weight {
    Weight { terms: terms.iter().map(|(powers, factor)| (powers.to_vec(), *factor)).collect() }
}

#[test]
fn a_scaling_is_the_middle_and_a_hair_more_than_half() {
    let scaling = Scaling::of(&sides(&[[1.0, 7.0], [-7.0, -1.0], [2.0, 2.0]]));
    assert_eq!((scaling.centres, scaling.halves), (vec![4.0, -4.0, 2.0], vec![3.0_f64.next_up(), 3.0_f64.next_up(), 0.0]));
    // The middle is rounded: what is farther from it counts.
    let [low, high] = [1.0_f64, 1.0_f64.next_up()];
    for ends in [[low, high], [-high, -low]] {
        assert_eq!(Scaling::of(&sides(&[ends])).halves, [f64::EPSILON.next_up()]);
    }
}

#[test]
fn what_is_zero_to_the_bit_is_no_term() {
    // x over [-1, 1] is t times a hair more than 1.
    let x = Monomial { powers: vec![1], coefficient: Interval::point(2.0) };
    let found = Scaling::of(&sides(&[[-1.0, 1.0]])).polynomial(std::slice::from_ref(&x));
    assert_eq!(found.keys().collect::<Vec<_>>(), [&vec![1]]);
    // Over [1, 3] it is 2 + t.
    let found = Scaling::of(&sides(&[[1.0, 3.0]])).polynomial(std::slice::from_ref(&x));
    assert_eq!(found.keys().collect::<Vec<_>>(), [&vec![0], &vec![1]]);
    assert!((found[&vec![0]].low - 4.0).abs() < 1e-14 && (found[&vec![1]].low - 2.0).abs() < 1e-14);
}

#[test]
fn a_box_has_its_sides_and_their_products_as_weights() {
    let found = Scaling::of(&sides(&[[-1.0, 1.0]; 2])).weights(&[], &[0, 1]).unwrap();
    let product = |a: f64, b: f64| weight(&[([0, 0], 1.0), ([0, 1], a), ([1, 0], b), ([1, 1], a * b)]);
    let expected = [
        weight(&[([0, 0], 1.0)]),
        weight(&[([0, 0], 1.0), ([2, 0], -1.0)]),
        weight(&[([0, 0], 1.0), ([0, 2], -1.0)]),
        product(1.0, 1.0),
        product(1.0, -1.0),
        product(-1.0, 1.0),
        product(-1.0, -1.0),
    ];
    assert_eq!(found, expected);
    assert_eq!(found.iter().map(Weight::degree).collect::<Vec<_>>(), [0, 2, 2, 2, 2, 2, 2]);
    assert_eq!(weight(&[]).degree(), 0);
    // Of the second variable alone.
    let found = Scaling::of(&sides(&[[-1.0, 1.0]; 2])).weights(&[], &[1]).unwrap();
    assert_eq!(found[1].terms, [(vec![0], 1.0), (vec![2], -1.0)]);
    assert_eq!(found.len(), 2);
}

/// The weight of a half-space over sides, where it has one.
fn of_space(ends: &[[f64; 2]], normal: &[f64], bound: f64, axes: &[usize]) -> Option<Weight> {
    let space = HalfSpace { normal: normal.to_vec(), bound };
    let box_alone = Scaling::of(&sides(ends)).weights(&[], axes).unwrap();
    let mut found = Scaling::of(&sides(ends)).weights(&[space], axes).expect("a part of the box");
    assert!(found.len() <= box_alone.len() + 1 && found[..box_alone.len()] == box_alone);
    found.drain(box_alone.len()..).next()
}

#[test]
fn a_half_space_is_its_distance_and_what_rounding_may_add() {
    // 1 - 0.3 x - 0.1 y over [0, 6] x [-1, 3].
    let found = of_space(&[[0.0, 6.0], [-1.0, 3.0]], &[0.3, 0.1], 1.0, &[0, 1]).unwrap();
    let mut constant = Interval::point(1.0);
    let mut slopes = Vec::new();
    for (normal, centre, half) in [(0.3, 3.0, 3.0_f64.next_up()), (0.1, 1.0, 2.0_f64.next_up())] {
        constant = constant - Interval::point(normal) * Interval::point(centre);
        let slope = Interval::point(normal) * Interval::point(-half);
        slopes.push(slope.low.midpoint(slope.high));
        constant = constant + Interval::point(slope_error(slope, slope.low.midpoint(slope.high)));
    }
    assert_eq!(found, weight(&[([1, 0], slopes[0]), ([0, 1], slopes[1]), ([0, 0], constant.high)]));
    assert!((constant.high - 0.0).abs() < 1e-14 && (slopes[0] + 0.9).abs() < 1e-14 && (slopes[1] + 0.2).abs() < 1e-14);
}

#[test]
fn a_slope_is_unsure_by_the_farther_end() {
    let [low, high] = [1.0_f64, 1.0_f64.next_up()];
    for middle in [low, high] {
        assert_eq!(slope_error(Interval::new(low, high), middle), f64::EPSILON.next_up());
    }
}

#[test]
fn a_half_space_across_what_nothing_depends_on_is_left_out() {
    let cube = [[-1.0, 1.0]; 3];
    // Along the variables of which something depends it is a weight; what it has no slope along is no term.
    let found = of_space(&cube, &[0.0, 1.0, 0.0], 0.5, &[1, 2]).unwrap();
    assert_eq!(found.terms.iter().map(|it| it.0.clone()).collect::<Vec<_>>(), [[1, 0], [0, 0]]);
    // Across the first, or the last, on which nothing depends.
    assert_eq!(of_space(&cube, &[1.0, 1.0, 0.0], 0.5, &[1, 2]), None);
    assert_eq!(of_space(&cube, &[0.0, 1.0, 1.0], 0.5, &[0, 1]), None);
    assert_eq!(of_space(&[[-0.25, 0.25], [-1.0, 1.0]], &[1.0, 1.0], 0.5, &[1]), None);
    // Such a variable without width is a number: -0.25 - y of the middle 0.75.
    let found = of_space(&[[0.75, 0.75], [-1.0, 1.0]], &[1.0, 1.0], 0.5, &[1]).unwrap();
    assert!(found.terms.len() == 2 && (found.terms[1].1 + 0.25).abs() < 1e-14, "{found:?}");
    // One that does not cut the box says nothing, and one that holds nowhere in it leaves no region.
    assert_eq!(of_space(&cube, &[1.0, 0.0, 0.0], 1.5, &[0, 1, 2]), None);
    let nowhere = HalfSpace { normal: vec![1.0, 0.0, 0.0], bound: -1.5 };
    assert_eq!(Scaling::of(&sides(&cube)).weights(&[nowhere], &[0, 1, 2]), None);
}

#[test]
fn a_half_space_holds_everywhere_or_nowhere_at_its_reach() {
    assert!(holds_everywhere(1.0, 1.0) && !holds_everywhere(0.999, 1.0));
    // No part of the region is lost to rounding: it ends a billionth beyond the reach.
    assert!(!holds_nowhere(-2.0, 2.0) && !holds_nowhere(-1.5, 2.0) && !holds_nowhere(-2.0 * (1.0 + ROUNDING), 2.0));
    assert!(holds_nowhere(-2.0 * (1.0 + 1.5 * ROUNDING), 2.0) && !holds_nowhere(-2.0 * (1.0 + 0.5 * ROUNDING), 2.0));
}

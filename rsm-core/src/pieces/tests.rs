//! Tests of cells by hand, and of each piece's polynomials against the factors in exact arithmetic.

use super::*;
use crate::adversary::Random;
use crate::basis;
use crate::model::{Coding, Knot, Outside, Symmetry};

pub(crate) fn input(name: &str, range: [f64; 2]) -> Input {
    Input { name: name.to_string(), unit: "1".to_string(), range, outside: Outside::Clamp }
}

pub(crate) fn knot(name: &str, at: f64) -> Knot {
    Knot { input: name.to_string(), at }
}

/// A surface of some inputs, without terms.
pub(crate) fn surface_of(inputs: &[Input], coding: Coding) -> Surface {
    let names = inputs.iter().map(|input| input.name.clone()).collect();
    Surface { name: "s".to_string(), unit: "1".to_string(), coding, inputs: names, ..Surface::default() }
}

/// Inputs and a surface with every kind of variable: one or two inputs, knots, no terms.
pub(crate) fn any_surface(random: &mut Random) -> (Vec<Input>, Surface) {
    let coding = random.pick(&[Coding::None, Coding::Range]);
    let inputs: Vec<Input> = ["x", "y"][..1 + random.below(2)]
        .iter()
        .map(|name| {
            let (low, width) = (random.between(0.25, 1.0), random.between(0.5, 3.0));
            let ranges = [[low, low + width], [-low - width, -low], [-width, width], [-low, width]];
            input(name, random.pick(&ranges))
        })
        .collect();
    let mut surface = surface_of(&inputs, coding);
    for input in &inputs {
        let [low, high] = input.range;
        let is_symmetric = low == -high && !random.chance(3);
        if is_symmetric {
            surface.symmetry.push((input.name.clone(), random.pick(&[Symmetry::Even, Symmetry::Odd])));
        } else if low * high > 0.0 && random.chance(2) {
            surface.reciprocal.push(input.name.clone());
        }
        for _ in 0..random.below(3) {
            surface.knots.push(knot(&input.name, random.between(if is_symmetric { 0.0 } else { low }, high)));
        }
    }
    (inputs, surface)
}

#[test]
fn cells_lie_between_the_knots_in_order() {
    let inputs = [input("x", [-1.0, 3.0]), input("y", [-2.0, 2.0]), input("z", [5.0, 6.0])];
    let mut surface = surface_of(&inputs, Coding::Range);
    // Not in increasing order; one knot occurs twice, as in a sum of two surfaces that both have it.
    surface.knots = vec![knot("x", 2.0), knot("y", 1.0), knot("x", 0.5), knot("x", 2.0)];
    let cells = |surface: &Surface| -> Vec<Vec<[f64; 2]>> { all(surface, &inputs).into_iter().map(|it| it.cell).collect() };
    let product = |ys: &[[f64; 2]]| -> Vec<Vec<[f64; 2]>> {
        let xs = [[-1.0, 0.5], [0.5, 2.0], [2.0, 3.0]];
        ys.iter().flat_map(|y| xs.map(|x| vec![x, *y, [5.0, 6.0]])).collect()
    };
    assert_eq!(cells(&surface), product(&[[-2.0, 1.0], [1.0, 2.0]]));
    let places: Vec<Vec<usize>> = all(&surface, &inputs).into_iter().map(|piece| piece.place).collect();
    assert_eq!(places, [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]]);
    // For a symmetric input only the half above 0.
    for kind in [Symmetry::Even, Symmetry::Odd] {
        surface.symmetry = vec![("y".to_string(), kind)];
        assert_eq!(cells(&surface), product(&[[0.0, 1.0], [1.0, 2.0]]));
    }
}

#[test]
fn three_inputs_are_counted_like_digits() {
    let inputs = [input("x", [0.0, 2.0]), input("y", [0.0, 2.0]), input("z", [0.0, 2.0])];
    let mut surface = surface_of(&inputs, Coding::None);
    surface.knots = vec![knot("x", 1.0), knot("y", 1.0), knot("z", 1.0)];
    let places: Vec<usize> = all(&surface, &inputs).iter().map(|it| it.place.iter().rev().fold(0, |n, k| 2 * n + k)).collect();
    assert_eq!(places, [0, 1, 2, 3, 4, 5, 6, 7]);
}

/// Points of a cell: its ends, and two other points between them.
fn points(cell: &[[f64; 2]]) -> Vec<Vec<Rational>> {
    let mut points = vec![vec![]];
    for [low, high] in cell {
        let (low, high) = (exact(*low), exact(*high));
        let along = [0, 2, 5, 7].map(|share| &low + (&high - &low) * integer(share) / integer(7));
        points = points
            .iter()
            .flat_map(|point: &Vec<_>| along.iter().map(|xi| [&point[..], std::slice::from_ref(xi)].concat()))
            .collect();
    }
    points
}

#[test]
fn a_term_is_the_product_of_its_factors_everywhere_in_the_piece() {
    let mut random = Random(1);
    let (mut closed, mut open) = (0, 0);
    for _ in 0..60 {
        let (inputs, surface) = any_surface(&mut random);
        let factors = Factor::all(&surface, &inputs);
        for piece in all(&surface, &inputs) {
            let powers: Vec<u32> = factors.iter().map(|_| random.below(3) as u32).collect();
            let expanded = piece.term(&powers);
            closed += usize::from(expanded.is_empty());
            open += usize::from(expanded.len() > 1);
            for point in points(&piece.cell) {
                let value = |factor: &Factor| factor.value(point[factor.input].clone());
                let each = factors.iter().zip(&powers).map(|(factor, power)| basis::power(&value(factor), *power));
                let truth = each.fold(integer(1), |product, power| product * power);
                let main: Vec<Rational> = factors[..inputs.len()].iter().map(value).collect();
                let found = expanded.iter().fold(integer(0), |sum, (powers, coefficient)| {
                    let each = main.iter().zip(powers).map(|(x, power)| basis::power(x, *power));
                    sum + each.fold(coefficient.clone(), |product, power| product * power)
                });
                assert_eq!(found, truth, "{powers:?} in {:?} of {surface:?}", piece.cell);
            }
        }
    }
    assert!(closed > 10 && open > 30, "{closed} {open}");
}

#[test]
fn sides_are_the_smallest_that_hold_their_variables() {
    let mut random = Random(2);
    for _ in 0..60 {
        let (inputs, surface) = any_surface(&mut random);
        let factors = Factor::all(&surface, &inputs);
        for piece in all(&surface, &inputs) {
            assert_eq!(piece.sides.len(), inputs.len());
            for (k, side) in piece.sides.iter().enumerate() {
                let mut values: Vec<Rational> =
                    points(&piece.cell).iter().map(|point| factors[k].value(point[k].clone())).collect();
                values.sort();
                let expected = [&values[0], values.last().unwrap()].map(Interval::around);
                assert_eq!([side.low, side.high], [expected[0].low, expected[1].high], "{k} of {surface:?}");
            }
        }
    }
}

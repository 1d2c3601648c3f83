//! Tests of extents by hand, and against the exact polynomial for surfaces with every kind of variable.

use super::*;
use crate::adversary::Random;
use crate::exact;
use crate::model::{Coding, Term};
use crate::number::{Precision, Rational};
use crate::pieces::tests::{any_surface, input, knot, surface_of};

fn term(powers: &[u32], coefficient: f64) -> Term {
    Term { powers: powers.to_vec(), coefficient }
}

fn value(surface: &Surface, inputs: &[Input], point: &[f64]) -> Rational {
    let at: Vec<Rational> = point.iter().map(|xi| exact(*xi)).collect();
    exact::polynomial(surface, inputs, &at).unwrap()
}

/// Asserts that no value of the box is outside, and that the values at the returned points differ from the bounds by at most `tolerance`.
fn assert_extent(surface: &Surface, inputs: &[Input], found: &Extent, tolerance: f64, points: impl Iterator<Item = Vec<f64>>) {
    let holds = |value: &Rational| exact(found.range.low) <= *value && *value <= exact(found.range.high);
    for point in points {
        let truth = value(surface, inputs, &point);
        assert!(holds(&truth), "{} at {point:?}, {found:?} of {surface:?}", Precision::F64.round(&truth));
    }
    for (bound, at) in [(found.range.low, &found.least_at), (found.range.high, &found.greatest_at)] {
        assert!(inputs.iter().zip(at).all(|(input, xi)| input.range[0] <= *xi && *xi <= input.range[1]), "{at:?} is outside");
        let truth = value(surface, inputs, at);
        let gap = Precision::F64.round(&(&truth - exact(bound))).abs();
        assert!(holds(&truth) && gap <= tolerance, "{gap} from {bound} at {at:?}, {found:?} of {surface:?}");
    }
}

#[test]
fn a_surface_with_sigmoids_or_waves_is_enclosed_closely_and_its_extremes_are_where_they_are_told() {
    // Narrow, wide, with a hinge, with symmetry: compared with a grid of 801 or 161 x 161 points, which misses the extremes by less than a
    // thousandth.
    let texts = [
        "inputs = [\"x\"]\nwaves = [{ input = \"x\", period = 2.5, order = 7 }]\nterms = [{ powers = [1, 0, 0], coefficient = 0.3 }, { powers = [0, 1, 0], coefficient = 1.0 }, { powers = [1, 0, 1], coefficient = 0.5 }]",
        "inputs = [\"x\"]\nsigmoids = [{ input = \"x\", at = 0.3, width = 0.02 }]\nterms = [{ powers = [1, 0], coefficient = -3.0 }, { powers = [0, 1], coefficient = 1.0 }, { powers = [2, 1], coefficient = 0.5 }]",
        "inputs = [\"x\"]\nsymmetry = { x = \"odd\" }\nsigmoids = [{ input = \"x\", at = 0.2, width = 0.1 }]\nterms = [{ powers = [1, 0], coefficient = -1.0 }, { powers = [0, 2], coefficient = 1.0 }]",
        "inputs = [\"x\", \"y\"]\nknots = [{ input = \"y\", at = 2.0 }]\nsigmoids = [{ input = \"x\", at = -0.5, width = 0.2 }, { input = \"y\", at = 1.0, width = 1.5 }]\n\
         terms = [{ powers = [0, 0, 0, 1, 1], coefficient = 2.0 }, { powers = [1, 0, 1, 0, 0], coefficient = 3.0 }, { powers = [0, 2, 0, 1, 0], coefficient = -1.0 }]",
    ];
    for text in texts {
        let text = format!(
            "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [-1.0, 1.0]\n[inputs.y]\nunit = \"1\"\nrange = [0.0, 3.0]\n[surfaces.s]\nunit = \"1\"\n{text}\n"
        );
        let checked = crate::check::Checked::read(&crate::source::Source::new("m.toml", text))
            .unwrap_or_else(|faults| panic!("{faults}"));
        let surface = &checked.model().surfaces[0];
        let inputs = checked.inputs_of(surface);
        let factors = Factor::all(surface, &inputs);
        let value = |point: &[f64]| -> f64 {
            let values: Vec<f64> = factors.iter().map(|factor| factor.value(point[factor.input])).collect();
            let product = |powers: &[u32]| values.iter().zip(powers).map(|(x, power)| x.powi(*power as i32)).product::<f64>();
            let sum: f64 = surface.terms.iter().map(|term| term.coefficient * product(&term.powers)).sum();
            if crate::basis::is_negated(surface, &inputs, point) { -sum } else { sum }
        };
        let grid = |input: &Input, steps: u32| -> Vec<f64> {
            let [low, high] = input.range;
            (0..=steps).map(|k| low + (high - low) * f64::from(k) / f64::from(steps)).collect()
        };
        let values: Vec<f64> = match &inputs[..] {
            [x] => grid(x, 800).into_iter().map(|x| value(&[x])).collect(),
            [x, y] => grid(x, 160)
                .into_iter()
                .flat_map(|at| grid(y, 160).into_iter().map(move |y| [at, y]))
                .map(|at| value(&at))
                .collect(),
            _ => unreachable!("one or two inputs"),
        };
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let margin = 1e-3 * (greatest - least);
        let found = extent(surface, &inputs);
        assert!(found.range.low <= least && least - found.range.low < margin, "{least} {:?}", found.range);
        assert!(found.range.high >= greatest && found.range.high - greatest < margin, "{greatest} {:?}", found.range);
        assert!(value(&found.least_at) - found.range.low < margin && found.range.high - value(&found.greatest_at) < margin);
    }
}

#[test]
fn every_surface_keeps_its_extent_and_reaches_it() {
    let mut random = Random(1);
    for _ in 0..150 {
        let (inputs, mut surface) = any_surface(&mut random);
        let factors = inputs.len() + surface.knots.len();
        for _ in 0..1 + random.below(4) {
            let mut powers: Vec<u32> = (0..factors).map(|_| [0, 0, 1, 2][random.below(4)]).collect();
            for (k, input) in inputs.iter().enumerate() {
                // An odd input has a power in every term: the surface is 0 where the input is 0.
                if surface.symmetry.contains(&(input.name.clone(), Symmetry::Odd)) {
                    powers[k] = powers[k].max(1);
                }
            }
            surface.terms.push(term(&powers, random.between(-2.0, 2.0)));
        }
        let found = extent(&surface, &inputs);
        let mut points = vec![];
        for corner in 0..1 << inputs.len() {
            points.push(inputs.iter().enumerate().map(|(k, input)| input.range[corner >> k & 1]).collect::<Vec<f64>>());
        }
        for _ in 0..20 {
            points.push(inputs.iter().map(|input| random.between(input.range[0], input.range[1])).collect());
        }
        // The search ends at 1e-9 of the spread of coefficients; the natural values of the returned points are rounded.
        let spread = found.range.width() + found.range.magnitude();
        assert_extent(&surface, &inputs, &found, 1e-7 * spread, points.into_iter());
        assert_eq!(range(&surface, &inputs), found.range);
    }
}

#[test]
fn a_square_of_a_reciprocal_is_least_where_the_reciprocal_is() {
    // (1/x - 1/2)^2 over [1, 4]: 0 at 2, 1/4 at 1, 1/16 at 4. Only 1/4 is not exact. Over [-4, -1] it is mirrored.
    for sign in [1.0, -1.0] {
        let inputs = [input("x", if sign > 0.0 { [1.0, 4.0] } else { [-4.0, -1.0] })];
        let mut surface = surface_of(&inputs, Coding::None);
        surface.reciprocal = vec!["x".to_string()];
        surface.terms = vec![term(&[2], 1.0), term(&[1], -sign), term(&[0], 0.25)];
        let found = extent(&surface, &inputs);
        assert!(found.range.low <= 0.0 && found.range.low >= -1e-8, "{found:?}");
        assert!(found.range.high >= 0.25 && found.range.high <= 0.25 + 1e-12, "{found:?}");
        // 1e-9 of the spread corresponds to 4e-5 in 1/x, and to four times that in x.
        assert!((found.least_at[0] - 2.0 * sign).abs() < 2e-4, "{found:?}");
        assert_eq!(found.greatest_at, [sign]);
    }
}

#[test]
fn of_equal_extremes_the_first_is_named() {
    // max(0, x - 1) - x over [0, 3]: decreases to -1 at 1 and is constant from there on.
    let inputs = [input("x", [0.0, 3.0])];
    let mut surface = surface_of(&inputs, Coding::None);
    surface.knots = vec![knot("x", 1.0)];
    surface.terms = vec![term(&[1, 0], -1.0), term(&[0, 1], 1.0)];
    let found = extent(&surface, &inputs);
    assert_eq!((found.least_at[0], found.greatest_at[0]), (1.0, 0.0));
    surface.terms = vec![term(&[1, 0], 1.0)];
    let found = extent(&surface, &inputs);
    assert_eq!((found.least_at[0], found.greatest_at[0]), (0.0, 3.0));
    // A constant has the same value everywhere.
    surface.terms = vec![term(&[0, 0], 1.5)];
    let found = extent(&surface, &inputs);
    assert_eq!((found.range, found.least_at[0], found.greatest_at[0]), (Interval::point(1.5), 0.0, 0.0));
}

#[test]
fn on_the_other_side_of_an_odd_input_every_value_has_its_opposite() {
    // |x| (2 + y) sign x over [-3, 3] x [-1, 1] without coding: 9 at (3, 1), -9 at (-3, 1).
    let inputs = [input("y", [-1.0, 1.0]), input("x", [-3.0, 3.0])];
    let mut surface = surface_of(&inputs, Coding::None);
    surface.symmetry = vec![("x".to_string(), Symmetry::Odd)];
    surface.terms = vec![term(&[0, 1], 2.0), term(&[1, 1], 1.0)];
    let found = extent(&surface, &inputs);
    assert_eq!((found.least_at, found.greatest_at), (vec![1.0, -3.0], vec![1.0, 3.0]));
    assert!(found.range.low <= -9.0 && found.range.low > -9.0 - 1e-12);
    assert_eq!(found.range.high, -found.range.low);
    // An even input gives no sign: the same terms are from 0 to 9.
    surface.symmetry = vec![("x".to_string(), Symmetry::Even)];
    let found = extent(&surface, &inputs);
    assert_eq!((found.least_at[1], found.greatest_at), (0.0, vec![1.0, 3.0]));
    assert!(found.range.low <= 0.0 && found.range.low > -1e-12);
    // Both symmetries, the even input first: |x| (4 |y| - 3) is -9 at (0, 3) and 3 at (1, 3); its opposite is 9 at (0, -3).
    let inputs = [input("y", [-1.0, 1.0]), input("x", [-3.0, 3.0])];
    surface.symmetry = vec![("y".to_string(), Symmetry::Even), ("x".to_string(), Symmetry::Odd)];
    surface.terms = vec![term(&[0, 1], -3.0), term(&[1, 1], 4.0)];
    let found = extent(&surface, &inputs);
    assert_eq!((found.least_at, found.greatest_at), (vec![0.0, 3.0], vec![0.0, -3.0]));
}

#[test]
fn a_term_without_weight_changes_nothing() {
    let inputs = [input("x", [0.1, 0.9])];
    let mut surface = surface_of(&inputs, Coding::Range);
    surface.terms = vec![term(&[1], 0.7), term(&[0], 0.1)];
    let plain = extent(&surface, &inputs);
    surface.terms.insert(0, term(&[7], 0.0));
    assert_eq!(extent(&surface, &inputs), plain);
    // Terms of the same powers are added; about ten operations are each rounded outward by 2^-52.
    surface.terms = vec![term(&[1], 0.25), term(&[0], 0.5), term(&[1], 0.5)];
    let found = extent(&surface, &inputs);
    assert!(found.range.low <= -0.25 && found.range.low > -0.25 - 4e-15, "{found:?}");
    assert!(found.range.high >= 1.25 && found.range.high < 1.25 + 4e-15, "{found:?}");
}

#[test]
fn a_coefficient_that_no_f64_holds_is_enclosed() {
    // c max(0, x + k) is c x + c k above 0, and c k at 0; at that end nothing else is computed.
    let mut random = Random(3);
    for _ in 0..60 {
        let (c, k) = (random.between(0.1, 1.0), random.between(0.1, 0.9));
        let inputs = [input("x", [-1.0, 1.0])];
        let mut surface = surface_of(&inputs, Coding::None);
        surface.knots = vec![knot("x", -k), knot("x", 0.0)];
        surface.terms = vec![term(&[0, 1, 0], c)];
        let above: Vec<Piece> = pieces::all(&surface, &inputs).into_iter().filter(|it| it.cell == [[0.0, 1.0]]).collect();
        let found = extent_of_piece(&surface, &Factor::all(&surface, &inputs), &above[0]).range;
        let truth = exact(c) * exact(k);
        assert!(exact(found.low) <= truth && truth < exact(found.low.next_up().next_up()), "{c} {k}");
    }
}

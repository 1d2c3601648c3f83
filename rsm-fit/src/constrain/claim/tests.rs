//! Claims against differences of the surface itself, taken from its formula.

use rsm_core::model::{Coding, Knot, Outside, Term};
use rsm_core::pieces;

use super::*;
use crate::random::Random;
use crate::reference::whole;

/// A form of surface with drawn coefficients.
struct Form {
    surface: Surface,
    inputs: Vec<Input>,
    halves: Vec<f64>,
    coefficients: Vec<f64>,
}

fn form(ranges: &[[f64; 2]], knots: &[(usize, f64)], orders: u32, random: &mut Random) -> Form {
    let names: Vec<String> = (0..ranges.len()).map(|k| format!("x{k}")).collect();
    let input = |(name, range): (&String, &[f64; 2])| Input {
        name: name.clone(),
        unit: "1".into(),
        range: *range,
        outside: Outside::Clamp,
    };
    let inputs: Vec<Input> = names.iter().zip(ranges).map(input).collect();
    let knots = knots.iter().map(|(k, at)| Knot { input: names[*k].clone(), at: *at }).collect();
    let mut surface = Surface { inputs: names, coding: Coding::None, knots, ..Surface::default() };
    let powers = crate::design::terms_up_to(&surface, orders);
    let coefficients: Vec<f64> = powers.iter().map(|_| whole(random, 9) / 8.0).collect();
    surface.terms = powers.into_iter().zip(&coefficients).map(|(powers, b)| Term { powers, coefficient: *b }).collect();
    let halves = ranges.iter().map(|[low, high]| (high - low) / 2.0).collect();
    Form { surface, inputs, halves, coefficients }
}

impl Form {
    /// The surface at main variables, with the hinges as they stand in the piece that holds `home`: its formula, read from the definition.
    fn value(&self, x: &[f64], home: &[f64]) -> f64 {
        let input = |name: &String| self.surface.inputs.iter().position(|other| other == name).unwrap();
        let main = |k: usize, x: f64| if self.surface.reciprocal.contains(&self.surface.inputs[k]) { 1.0 / x } else { x };
        let hinge = |knot: &Knot| {
            let k = input(&knot.input);
            // A reciprocal falls, and its hinge opens on the other side: in the variable it is above the knot in both.
            let at = main(k, knot.at);
            if home[k] > at { x[k] - at } else { 0.0 }
        };
        let variables: Vec<f64> = x.iter().copied().chain(self.surface.knots.iter().map(hinge)).collect();
        let term = |term: &Term| {
            variables.iter().zip(&term.powers).fold(term.coefficient, |product, (x, power)| product * x.powi(*power as i32))
        };
        self.surface.terms.iter().map(term).sum()
    }

    /// The first and the second derivative along a direction: differences that are exact for polynomials of fourth order.
    fn derivatives(&self, x: &[f64], home: &[f64], along: &[f64]) -> [f64; 2] {
        let h = 1.0 / 64.0;
        let at = |times: f64| self.value(&x.iter().zip(along).map(|(x, u)| x + times * h * u).collect::<Vec<_>>(), home);
        let [a, b, c, d, e] = [-2.0, -1.0, 0.0, 1.0, 2.0].map(at);
        [(8.0 * (d - b) - (e - a)) / (12.0 * h), (16.0 * (b + d) - 30.0 * c - a - e) / (12.0 * h * h)]
    }

    fn claims(&self, constraints: &[Constraint]) -> Vec<Claim> {
        of(constraints, &self.surface, &self.inputs, &self.halves)
    }

    /// The claim at a point, by its row and by its polynomial.
    fn claimed(&self, claim: &Claim, point: &[f64]) -> f64 {
        let row =
            claim.row(point).into_iter().zip(&self.coefficients).map(|(x, b)| x * Dd::from(*b)).sum::<Dd>() + claim.offset();
        let power = |(x, power): (&f64, &u32)| x.powi(*power as i32);
        let term = |term: &Monomial| {
            term.coefficient.low.midpoint(term.coefficient.high) * point.iter().zip(&term.powers).map(power).product::<f64>()
        };
        let monomials = claim.monomials(&self.coefficients);
        assert!(monomials.iter().all(|term| term.powers.len() == claim.sides.len()));
        let sum: f64 = monomials.iter().map(term).sum();
        near("row and polynomial", row.to_f64(), sum);
        row.to_f64()
    }
}

/// Differences over a 64th of values of some hundreds lose seven digits of sixteen.
fn near(what: &str, found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-7 * (1.0 + expected.abs()), "{what}: {found}, expected {expected}");
}

/// A point of the sides, away from their ends.
fn drawn(claim: &Claim, random: &mut Random) -> Vec<f64> {
    claim.point(&claim.sides.iter().map(|_| 0.1 + 0.8 * random.share()).collect::<Vec<f64>>())
}

fn unit(inputs: usize, k: usize, length: f64) -> Vec<f64> {
    (0..inputs).map(|j| if j == k { length } else { 0.0 }).collect()
}

fn constraint_of(input: &str, increasing: bool) -> Constraint {
    Constraint::Monotone { input: input.to_string(), increasing }
}

#[test]
fn bounds_and_slopes_are_those_of_the_surface() {
    let mut random = Random::new(1);
    for knots in [&[][..], &[(0, 1.0)], &[(1, 2.5), (0, 1.0)]] {
        let form = form(&[[-1.0, 3.0], [2.0, 3.0]], knots, 3, &mut random);
        let pieces = pieces::all(&form.surface, &form.inputs).len();
        let bounds = form.claims(&[Constraint::Bounds { min: Some(-0.75), max: Some(2.5) }]);
        assert_eq!(bounds.len(), 2 * pieces);
        for (k, claim) in bounds.iter().enumerate() {
            let point = drawn(claim, &mut random);
            let value = form.value(&point, &point);
            near("bounds", form.claimed(claim, &point), if k % 2 == 0 { value + 0.75 } else { 2.5 - value });
        }
        let values = values(&form.surface, &form.inputs);
        assert!(values.len() == pieces && values.iter().all(|claim| claim.constraint == 0));
        for claim in values {
            let point = drawn(&claim, &mut random);
            near("value", form.claimed(&claim, &point), form.value(&point, &point));
        }
        for (k, half) in [2.0, 0.5].into_iter().enumerate() {
            for (increasing, sign) in [(true, 1.0), (false, -1.0)] {
                let claims = form.claims(&[Constraint::Convex, constraint_of(&format!("x{k}"), increasing)]);
                let slopes: Vec<&Claim> = claims.iter().filter(|claim| claim.constraint == 1).collect();
                assert_eq!(slopes.len(), pieces);
                for claim in slopes {
                    let point = drawn(claim, &mut random);
                    near("slope", form.claimed(claim, &point), sign * form.derivatives(&point, &point, &unit(2, k, half))[0]);
                }
            }
        }
    }
}

#[test]
fn one_bound_alone_and_odd_inputs() {
    let mut random = Random::new(2);
    let plain = form(&[[-2.0, 2.0]], &[], 3, &mut random);
    let of = |form: &Form, min: Option<f64>, max: Option<f64>| {
        let claims = form.claims(&[Constraint::Bounds { min, max }]);
        // At 0 with no coefficient: what is the distance of 0 from each bound.
        claims.iter().map(|claim| claim.offset().to_f64()).collect::<Vec<_>>()
    };
    assert_eq!(of(&plain, Some(-1.5), None), [1.5]);
    assert_eq!(of(&plain, None, Some(2.5)), [2.5]);
    // An odd surface keeps min to max where it keeps the opposites: the tighter of both.
    let mut odd = form(&[[-2.0, 2.0]], &[], 3, &mut random);
    odd.surface.symmetry = vec![("x0".to_string(), Symmetry::Odd)];
    odd.surface.terms.retain(|term| term.powers[0] > 0);
    odd.coefficients = odd.surface.terms.iter().map(|term| term.coefficient).collect();
    assert_eq!(of(&odd, Some(-1.5), Some(2.5)), [1.5, 1.5]);
    assert_eq!(of(&odd, Some(-3.5), Some(2.5)), [2.5, 2.5]);
    assert_eq!(of(&odd, Some(-1.5), None), [1.5, 1.5]);
    assert_eq!(of(&odd, None, Some(2.5)), [2.5, 2.5]);
    let mut even = form(&[[-2.0, 2.0]], &[], 2, &mut random);
    even.surface.symmetry = vec![("x0".to_string(), Symmetry::Even)];
    assert_eq!(of(&even, Some(-1.5), Some(2.5)), [1.5, 2.5]);
}

#[test]
fn a_reciprocal_falls_where_its_input_rises() {
    let mut random = Random::new(3);
    for reciprocal in ["x0", "x1"] {
        let mut form = form(&[[1.0, 2.0], [0.5, 4.0]], &[], 3, &mut random);
        form.surface.reciprocal = vec![reciprocal.to_string()];
        for k in 0..2 {
            let name = format!("x{k}");
            let turned = if name == reciprocal { -1.0 } else { 1.0 };
            for (increasing, sign) in [(true, 1.0), (false, -1.0)] {
                let claims = form.claims(&[constraint_of(&name, increasing)]);
                let point = drawn(&claims[0], &mut random);
                let slope = form.derivatives(&point, &point, &unit(2, k, form.halves[k]))[0];
                near("slope", form.claimed(&claims[0], &point), turned * sign * slope);
            }
        }
    }
    // And coded.
    let mut coded = form(&[[1.0, 2.0]], &[], 1, &mut random);
    coded.surface.coding = Coding::Range;
    let straight = coded.claims(&[constraint_of("x0", true)])[0].row(&[0.25])[1].to_f64();
    coded.surface.reciprocal = vec!["x0".to_string()];
    let turned = coded.claims(&[constraint_of("x0", true)])[0].row(&[0.25])[1].to_f64();
    assert_eq!([straight, turned], [0.5, -0.5]);
}

#[test]
fn curvature_is_asked_in_every_direction() {
    let mut random = Random::new(4);
    for (ranges, knots) in [
        (&[[-1.0, 3.0]][..], &[][..]),
        (&[[-1.0, 3.0], [2.0, 3.0]], &[]),
        (&[[-1.0, 3.0], [2.0, 3.0], [0.0, 1.0]], &[]),
        (&[[-1.0, 3.0], [2.0, 3.0]], &[(0, 0.5), (1, 2.5)]),
    ] {
        let form = form(ranges, knots, 3, &mut random);
        let (inputs, pieces) = (ranges.len(), pieces::all(&form.surface, &form.inputs));
        for (constraint, sign) in [(Constraint::Convex, 1.0), (Constraint::Concave, -1.0)] {
            let claims = form.claims(&[constraint]);
            let (bent, slopes_across_knots) = claims.split_at(inputs * pieces.len());
            for (k, claim) in bent.iter().enumerate() {
                let largest = k % inputs;
                assert!(claim.sides[inputs..].iter().all(|side| (side.low, side.high) == (-1.0, 1.0)));
                assert_eq!(claim.sides.len(), 2 * inputs - 1);
                for _ in 0..3 {
                    let point = drawn(claim, &mut random);
                    let mut direction = point[inputs..].to_vec();
                    direction.insert(largest, 1.0);
                    let along: Vec<f64> = direction.iter().zip(&form.halves).map(|(u, half)| u * half).collect();
                    let second = form.derivatives(&point[..inputs], &point[..inputs], &along)[1];
                    near("curvature", form.claimed(claim, &point), sign * second);
                }
            }
            // A knot of each of two inputs: two borders each, of two pieces.
            assert_eq!(slopes_across_knots.len(), 2 * knots.len());
            for claim in slopes_across_knots {
                let point = drawn(claim, &mut random);
                let (input, at) = *knots
                    .iter()
                    .find(|(k, at)| {
                        claim.sides[*k].low <= *at
                            && *at <= claim.sides[*k].high
                            && claim.sides[*k].high - claim.sides[*k].low < 1e-9
                    })
                    .unwrap();
                let home = |side: f64| (0..inputs).map(|k| if k == input { at + side } else { point[k] }).collect::<Vec<_>>();
                let slope = |side: f64| form.derivatives(&point, &home(side), &unit(inputs, input, form.halves[input]))[0];
                near("kink", form.claimed(claim, &point), sign * (slope(0.25) - slope(-0.25)));
            }
        }
    }
}

#[test]
fn a_place_is_a_share_of_each_side() {
    let mut random = Random::new(6);
    let claims = form(&[[-1.0, 3.0], [2.0, 3.0]], &[], 1, &mut random).claims(&[Constraint::Convex]);
    assert_eq!(claims[0].point(&[0.0, 0.5, 0.75]), [-1.0, 2.5, 0.5]);
    assert_eq!(claims[0].point(&[1.0, 1.0, 1.0]), [3.0, 3.0, 1.0]);
    let third = double_double(&(integer(1) / integer(3)));
    assert_eq!(third, Dd::ONE / Dd::from(3.0));
}

#[test]
fn a_kink_is_looked_for_in_all_of_an_interval_that_holds_its_knot() {
    // Coded over [0, 3], the knot at 1 is -1/3: no f64.
    let mut random = Random::new(7);
    let mut form = form(&[[0.0, 3.0]], &[(0, 1.0)], 2, &mut random);
    form.surface.coding = Coding::Range;
    let claims = form.claims(&[Constraint::Convex]);
    let side = claims.last().unwrap().sides[0];
    let third = -integer(1) / integer(3);
    assert!(exact(side.low) < third && third < exact(side.high) && side.high == side.low.next_up(), "{side:?}");
}

//! The inequality that a constraint requires of the coefficients: g(x) >= 0 over a piece of the box.
//!
//! In: constraints, a surface with its terms. Out: a [`Claim`] for every piece: g is linear in the coefficients, and the factor of each coefficient
//! is an exact polynomial of the main coded variables. Slopes are per half range of the box, curvatures per square of it, so every g has the unit of
//! the response. The values of coefficients are not used here.
//!
//! ```text
//! bounds      y - min, max - y; with an odd input also of -y
//! monotone    dy/dx_i, the sign turned where the response shall fall, and where x_i falls with xi_i (a reciprocal)
//! convex      u'H(x)u for every direction u: u and -u are one, so one entry of u is 1 and the others run over [-1, 1]: enforced at
//!             points of x and u, and proven over x alone (`curvature.rs`);
//!             at a knot the slope does not fall
//! concave     the same of -y
//! ```

use std::collections::BTreeMap;

use rsm_core::basis::{Factor, Variable};
use rsm_core::bernstein::Monomial;
use rsm_core::interval::Interval;
use rsm_core::model::{Input, Surface, Symmetry};
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::pieces::{self, Piece, Polynomial};

use crate::dd::Dd;
use crate::spec::Constraint;

/// g(x) = offset + sum over the terms of coefficient times basis, which must not be negative for variables in `sides`.
pub(super) struct Claim {
    /// The index of its constraint.
    pub constraint: usize,
    /// For a curvature: the entry of the direction that is 1. The claims of one piece follow one another, one for each entry.
    pub largest: Option<usize>,
    /// The range of the main variables, then of the entries of a direction.
    pub sides: Vec<Interval>,
    basis: Vec<Polynomial>,
    /// The same in double-double.
    rounded: Vec<Vec<(Vec<u32>, Dd)>>,
    offset: Rational,
}

impl Claim {
    fn new(constraint: usize, sides: Vec<Interval>, basis: Vec<Polynomial>, offset: Rational) -> Self {
        let term = |(powers, coefficient): &(Vec<u32>, Rational)| (powers.clone(), double_double(coefficient));
        let rounded = basis.iter().map(|polynomial| polynomial.iter().map(term).collect()).collect();
        Claim { constraint, largest: None, sides, basis, rounded, offset }
    }

    /// The factor of each coefficient at a point.
    pub(super) fn row(&self, point: &[f64]) -> Vec<Dd> {
        let power = |(x, exponent): (&f64, &u32)| (0..*exponent).fold(Dd::ONE, |product, _| product * Dd::from(*x));
        let value = |(powers, coefficient): &(Vec<u32>, Dd)| {
            point.iter().zip(powers).map(power).fold(*coefficient, |product, factor| product * factor)
        };
        self.rounded.iter().map(|polynomial| polynomial.iter().map(value).sum()).collect()
    }

    pub(super) fn offset(&self) -> Dd {
        double_double(&self.offset)
    }

    /// g with these coefficients.
    pub(super) fn monomials(&self, coefficients: &[f64]) -> Vec<Monomial> {
        let mut sums: BTreeMap<Vec<u32>, Rational> = BTreeMap::new();
        let mut add = |powers: &[u32], value: Rational| {
            let entry = sums.entry(powers.to_vec()).or_insert_with(|| integer(0));
            *entry += value;
        };
        add(&vec![0; self.sides.len()], self.offset.clone());
        for (polynomial, coefficient) in self.basis.iter().zip(coefficients) {
            let coefficient = exact(*coefficient);
            for (powers, factor) in polynomial {
                add(powers, factor * &coefficient);
            }
        }
        sums.into_iter().map(|(powers, sum)| Monomial { powers, coefficient: Interval::around(&sum) }).collect()
    }

    /// The point at these shares of the sides.
    pub(super) fn point(&self, shares: &[f64]) -> Vec<f64> {
        let at = |(side, share): (&Interval, &f64)| (side.low + share * (side.high - side.low)).clamp(side.low, side.high);
        self.sides.iter().zip(shares).map(at).collect()
    }
}

fn double_double(value: &Rational) -> Dd {
    let high = Precision::F64.round(value);
    Dd::sum_of(high, Precision::F64.round(&(value - exact(high))))
}

/// The claims of all constraints. `halves`: half of each side of the box.
pub(super) fn of(constraints: &[Constraint], surface: &Surface, inputs: &[Input], halves: &[f64]) -> Vec<Claim> {
    let pieces = pieces::all(surface, inputs);
    let halves: Vec<Rational> = halves.iter().map(|half| exact(*half)).collect();
    let mut claims = Vec::new();
    for (k, constraint) in constraints.iter().enumerate() {
        for piece in &pieces {
            match constraint {
                Constraint::Bounds { min, max } => bounds(k, surface, piece, *min, *max, &mut claims),
                Constraint::Monotone { input, increasing } => {
                    claims.push(monotone(k, surface, inputs, piece, input, *increasing, &halves));
                }
                Constraint::Convex => convex(k, surface, piece, &halves, &integer(1), &mut claims),
                Constraint::Concave => convex(k, surface, piece, &halves, &integer(-1), &mut claims),
            }
        }
        match constraint {
            Constraint::Convex => slopes_across_knots(k, surface, &pieces, &halves, &integer(1), &mut claims),
            Constraint::Concave => slopes_across_knots(k, surface, &pieces, &halves, &integer(-1), &mut claims),
            _ => {}
        }
    }
    claims
}

/// The value of the surface itself, one claim for each piece.
pub(super) fn values(surface: &Surface, inputs: &[Input]) -> Vec<Claim> {
    let mut claims = Vec::new();
    for piece in pieces::all(surface, inputs) {
        claims.push(Claim::new(0, piece.sides.clone(), terms(surface, &piece, &integer(1)), integer(0)));
    }
    claims
}

fn terms(surface: &Surface, piece: &Piece, sign: &Rational) -> Vec<Polynomial> {
    surface.terms.iter().map(|term| scaled(piece.term(&term.powers), sign)).collect()
}

fn scaled(polynomial: Polynomial, factor: &Rational) -> Polynomial {
    polynomial.into_iter().map(|(powers, coefficient)| (powers, coefficient * factor)).collect()
}

/// The derivative with respect to a variable.
fn derivative(polynomial: &Polynomial, variable: usize) -> Polynomial {
    let falls = |(powers, coefficient): &(Vec<u32>, Rational)| {
        let power = powers[variable];
        (power > 0).then(|| {
            let mut powers = powers.clone();
            powers[variable] -= 1;
            (powers, coefficient * integer(i64::from(power)))
        })
    };
    polynomial.iter().filter_map(falls).collect()
}

fn bounds(k: usize, surface: &Surface, piece: &Piece, min: Option<f64>, max: Option<f64>, claims: &mut Vec<Claim>) {
    // For negative values of an odd input the response is -y. It is within the bounds if y is within the opposite bounds.
    let is_odd = surface.symmetry.iter().any(|(_, kind)| *kind == Symmetry::Odd);
    let tighter = |one: Option<f64>, other: Option<f64>, pick: fn(f64, f64) -> f64| match (one, other.filter(|_| is_odd)) {
        (Some(one), Some(other)) => Some(pick(one, -other)),
        (one, other) => one.or(other.map(|other| -other)),
    };
    let (low, high) = (tighter(min, max, f64::max), tighter(max, min, f64::min));
    if let Some(low) = low {
        claims.push(Claim::new(k, piece.sides.clone(), terms(surface, piece, &integer(1)), -exact(low)));
    }
    if let Some(high) = high {
        claims.push(Claim::new(k, piece.sides.clone(), terms(surface, piece, &integer(-1)), exact(high)));
    }
}

fn monotone(
    k: usize,
    surface: &Surface,
    inputs: &[Input],
    piece: &Piece,
    name: &str,
    increasing: bool,
    halves: &[Rational],
) -> Claim {
    let input = inputs.iter().position(|input| input.name == name).expect("a read constraint names an input of its response");
    let falls =
        matches!(Factor::all(surface, inputs)[input].variable, Variable::Reciprocal | Variable::CentredReciprocal { .. });
    let sign = if increasing == falls { -&halves[input] } else { halves[input].clone() };
    let basis = terms(surface, piece, &sign).iter().map(|polynomial| derivative(polynomial, input)).collect();
    Claim::new(k, piece.sides.clone(), basis, integer(0))
}

fn convex(k: usize, surface: &Surface, piece: &Piece, halves: &[Rational], sign: &Rational, claims: &mut Vec<Claim>) {
    let inputs = piece.sides.len();
    let terms = terms(surface, piece, sign);
    for largest in 0..inputs {
        let mut sides = piece.sides.clone();
        sides.extend(vec![Interval::new(-1.0, 1.0); inputs - 1]);
        // The index among the variables of an input's entry in the direction. The largest entry is 1 and has none.
        // mutant `> to >=`: the largest entry itself has none.
        let entry = |input: usize| (input != largest).then(|| inputs + input - usize::from(input > largest));
        let basis = terms.iter().map(|term| {
            let mut sum = Polynomial::new();
            for a in 0..inputs {
                for b in 0..inputs {
                    let second = scaled(derivative(&derivative(term, a), b), &(&halves[a] * &halves[b]));
                    for (mut powers, coefficient) in second {
                        powers.resize(2 * inputs - 1, 0);
                        for variable in [a, b].into_iter().filter_map(entry) {
                            powers[variable] += 1;
                        }
                        sum.push((powers, coefficient));
                    }
                }
            }
            sum
        });
        claims.push(Claim { largest: Some(largest), ..Claim::new(k, sides, basis.collect(), integer(0)) });
    }
}

/// The slope across a knot does not decrease there.
fn slopes_across_knots(
    k: usize,
    surface: &Surface,
    pieces: &[Piece],
    halves: &[Rational],
    sign: &Rational,
    claims: &mut Vec<Claim>,
) {
    for left in pieces {
        for input in 0..left.place.len() {
            let mut place = left.place.clone();
            place[input] += 1;
            let Some(right) = pieces.iter().find(|piece| piece.place == place) else { continue };
            let sign = sign * &halves[input];
            let (above, below) = (terms(surface, right, &sign), terms(surface, left, &-sign));
            let change =
                |(above, below): (&Polynomial, &Polynomial)| [derivative(above, input), derivative(below, input)].concat();
            let mut sides = left.sides.clone();
            sides[input] = Interval::new(
                left.sides[input].high.min(right.sides[input].low),
                right.sides[input].low.max(left.sides[input].high),
            );
            claims.push(Claim::new(k, sides, above.iter().zip(&below).map(change).collect(), integer(0)));
        }
    }
}

#[cfg(test)]
mod tests;

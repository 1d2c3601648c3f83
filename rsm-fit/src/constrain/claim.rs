//! The inequality that a constraint requires of the coefficients: g(x) >= 0 over a piece of the box.
//!
//! In: constraints, a surface with its terms. Out: a [`Claim`] for every piece: g is linear in the coefficients, and the factor of each coefficient
//! is an exact polynomial of the main coded variables. Slopes are per half range of the box, curvatures per square of it, so every g has the unit of
//! the response. The values of coefficients are not used here.
//!
//! A sigmoid or a wave is no polynomial. There g is a polynomial with an error (`parts.rs`), and the constant term of g contains the error.
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
use rsm_core::model::{HalfSpace, Input, Surface, Symmetry};
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::pieces::Polynomial;

use super::parts::{self, Part};
use crate::dd::Dd;
use crate::spec::Constraint;

/// g(x) = offset + sum over the terms of coefficient times basis, which must not be negative for variables in `sides`.
pub(super) struct Claim {
    /// The index of its constraint.
    pub constraint: usize,
    /// For a curvature: the entry of the direction that is 1. The claims of one piece follow one another, one for each entry.
    pub largest: Option<usize>,
    /// The range of the variables of the polynomials, one for each input, then of the entries of a direction.
    pub sides: Vec<Interval>,
    /// The range of the main variables.
    pub main: Vec<Interval>,
    /// For each input whose variable is not the main one, the middle and half of the main variable.
    units: Vec<Option<[f64; 2]>>,
    /// For every coefficient, bounds of what its polynomial leaves out, each with the powers of a monomial of which it is a part.
    errors: Vec<Vec<(Vec<u32>, f64)>>,
    basis: Vec<Polynomial>,
    /// The same in double-double.
    rounded: Vec<Vec<(Vec<u32>, Dd)>>,
    offset: Rational,
}

impl Claim {
    fn new(constraint: usize, sides: Vec<Interval>, basis: Vec<Polynomial>, offset: Rational) -> Self {
        let term = |(powers, coefficient): &(Vec<u32>, Rational)| (powers.clone(), double_double(coefficient));
        let rounded = basis.iter().map(|polynomial| polynomial.iter().map(term).collect()).collect();
        let main = sides.clone();
        let units = vec![None; sides.len()];
        Claim { constraint, largest: None, sides, main, units, errors: Vec::new(), basis, rounded, offset }
    }

    /// The claim with the main variables of a part.
    fn over(self, part: &Part) -> Self {
        Claim { main: part.main(), units: part.units(), ..self }
    }

    /// The half-spaces of a support in the variables of the polynomials.
    pub(super) fn spaces(&self, support: &[HalfSpace]) -> Vec<HalfSpace> {
        parts::in_units(support, &self.units)
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
        let mut monomials: Vec<Monomial> =
            sums.into_iter().map(|(powers, sum)| Monomial { powers, coefficient: Interval::around(&sum) }).collect();
        for (errors, coefficient) in self.errors.iter().zip(coefficients) {
            for (powers, error) in errors {
                let most = (error * coefficient.abs()).next_up();
                monomials.push(Monomial { powers: powers.clone(), coefficient: Interval::new(-most, most) });
            }
        }
        monomials
    }

    /// The main variables at these shares of the sides.
    pub(super) fn main_point(&self, shares: &[f64]) -> Vec<f64> {
        let at = |(side, share): (&Interval, &f64)| (side.low + share * (side.high - side.low)).clamp(side.low, side.high);
        self.main.iter().zip(shares).map(at).collect()
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
    let parts = Part::all(surface, inputs);
    let halves: Vec<Rational> = halves.iter().map(|half| exact(*half)).collect();
    let mut claims = Vec::new();
    for (k, constraint) in constraints.iter().enumerate() {
        for part in &parts {
            match constraint {
                Constraint::Bounds { min, max } => bounds(k, surface, part, *min, *max, &mut claims),
                Constraint::Monotone { input, increasing } => {
                    claims.push(monotone(k, surface, inputs, part, input, *increasing, &halves));
                }
                Constraint::Convex => convex(k, surface, part, &halves, &integer(1), &mut claims),
                Constraint::Concave => convex(k, surface, part, &halves, &integer(-1), &mut claims),
            }
        }
        match constraint {
            Constraint::Convex => slopes_across_knots(k, surface, &parts, &halves, &integer(1), &mut claims),
            Constraint::Concave => slopes_across_knots(k, surface, &parts, &halves, &integer(-1), &mut claims),
            _ => {}
        }
    }
    claims
}

/// The value of the surface itself, one claim for each piece.
pub(super) fn values(surface: &Surface, inputs: &[Input]) -> Vec<Claim> {
    let mut claims = Vec::new();
    for part in Part::all(surface, inputs) {
        claims.push(Claim::new(0, part.sides(), terms(surface, &part, &integer(1)), integer(0)).over(&part));
    }
    claims
}

fn terms(surface: &Surface, part: &Part, sign: &Rational) -> Vec<Polynomial> {
    surface.terms.iter().map(|term| scaled(part.term(&term.powers), sign)).collect()
}

/// The errors of all terms, differentiated once for each entry of `by`, as parts of the monomial with these powers.
fn errors(surface: &Surface, part: &Part, by: &[usize], factor: &Rational, powers: &[u32]) -> Vec<Vec<(Vec<u32>, f64)>> {
    if !parts::has_steps(surface) {
        return Vec::new();
    }
    // The factor is rounded, and so is the product.
    let factor = Precision::F64.round(factor).abs() * (1.0 + 1e-12);
    let of_term = |term: &rsm_core::model::Term| match part.error(&term.powers, by) {
        0.0 => Vec::new(),
        error => vec![(powers.to_vec(), factor * error)],
    };
    surface.terms.iter().map(of_term).collect()
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

fn bounds(k: usize, surface: &Surface, part: &Part, min: Option<f64>, max: Option<f64>, claims: &mut Vec<Claim>) {
    // For negative values of an odd input the response is -y. It is within the bounds if y is within the opposite bounds.
    let is_odd = surface.symmetry.iter().any(|(_, kind)| *kind == Symmetry::Odd);
    let tighter = |one: Option<f64>, other: Option<f64>, pick: fn(f64, f64) -> f64| match (one, other.filter(|_| is_odd)) {
        (Some(one), Some(other)) => Some(pick(one, -other)),
        (one, other) => one.or(other.map(|other| -other)),
    };
    let (low, high) = (tighter(min, max, f64::max), tighter(max, min, f64::min));
    let mut claim = |sign: i64, offset: Rational| {
        let errors = errors(surface, part, &[], &integer(1), &vec![0; part.place().len()]);
        let basis = terms(surface, part, &integer(sign));
        claims.push(Claim { errors, ..Claim::new(k, part.sides(), basis, offset).over(part) });
    };
    if let Some(low) = low {
        claim(1, -exact(low));
    }
    if let Some(high) = high {
        claim(-1, exact(high));
    }
}

fn monotone(
    k: usize,
    surface: &Surface,
    inputs: &[Input],
    part: &Part,
    name: &str,
    increasing: bool,
    halves: &[Rational],
) -> Claim {
    let input = inputs.iter().position(|input| input.name == name).expect("a read constraint names an input of its response");
    let falls =
        matches!(Factor::all(surface, inputs)[input].variable, Variable::Reciprocal | Variable::CentredReciprocal { .. });
    let half = &halves[input] * part.slope(input);
    let sign = if increasing == falls { -&half } else { half.clone() };
    let basis = terms(surface, part, &sign).iter().map(|polynomial| derivative(polynomial, input)).collect();
    let errors = errors(surface, part, &[input], &half, &vec![0; inputs.len()]);
    Claim { errors, ..Claim::new(k, part.sides(), basis, integer(0)).over(part) }
}

fn convex(k: usize, surface: &Surface, part: &Part, halves: &[Rational], sign: &Rational, claims: &mut Vec<Claim>) {
    let inputs = part.place().len();
    let terms = terms(surface, part, sign);
    let half = |input: usize| &halves[input] * part.slope(input);
    for largest in 0..inputs {
        let mut sides = part.sides();
        sides.extend(vec![Interval::new(-1.0, 1.0); inputs - 1]);
        // The index among the variables of an input's entry in the direction. The largest entry is 1 and has none.
        // mutant `> to >=`: the largest entry itself has none.
        let entry = |input: usize| (input != largest).then(|| inputs + input - usize::from(input > largest));
        let raised = |mut powers: Vec<u32>, a: usize, b: usize| {
            powers.resize(2 * inputs - 1, 0);
            for variable in [a, b].into_iter().filter_map(entry) {
                powers[variable] += 1;
            }
            powers
        };
        let basis = terms.iter().map(|term| {
            let mut sum = Polynomial::new();
            for a in 0..inputs {
                for b in 0..inputs {
                    let second = scaled(derivative(&derivative(term, a), b), &(half(a) * half(b)));
                    sum.extend(second.into_iter().map(|(powers, coefficient)| (raised(powers, a, b), coefficient)));
                }
            }
            sum
        });
        let mut all: Vec<Vec<(Vec<u32>, f64)>> = vec![Vec::new(); surface.terms.len()];
        for a in 0..inputs {
            for b in 0..inputs {
                let own = errors(surface, part, &[a, b], &(half(a) * half(b)), &raised(vec![0; inputs], a, b));
                all.iter_mut().zip(own).for_each(|(all, own)| all.extend(own));
            }
        }
        let claim = Claim::new(k, sides, basis.collect(), integer(0)).over(part);
        claims.push(Claim { largest: Some(largest), errors: all, ..claim });
    }
}

/// The slope across a knot does not decrease there.
fn slopes_across_knots(
    k: usize,
    surface: &Surface,
    parts: &[Part],
    halves: &[Rational],
    sign: &Rational,
    claims: &mut Vec<Claim>,
) {
    for left in parts {
        for input in 0..left.place().len() {
            let mut place = left.place().to_vec();
            place[input] += 1;
            let knot = left.upper_end(input);
            // Not an end of a part within a sigmoid, whose slope is continuous.
            if !surface.knots.iter().any(|known| known.input == surface.inputs[input] && known.at == knot) {
                continue;
            }
            let Some(right) = parts.iter().find(|part| part.place() == place) else { continue };
            let factor = |part: &Part| sign * &halves[input] * part.slope(input);
            let (above, below) = (terms(surface, right, &factor(right)), terms(surface, left, &-factor(left)));
            let at_end =
                |polynomial: Polynomial, end: i64| if left.is_local(input) { at(polynomial, input, end) } else { polynomial };
            let change = |(above, below): (&Polynomial, &Polynomial)| {
                [at_end(derivative(above, input), -1), at_end(derivative(below, input), 1)].concat()
            };
            let basis = above.iter().zip(&below).map(change).collect();
            let ([mut sides, mut main], [left_main, right_main]) = ([left.sides(), left.main()], [left.main(), right.main()]);
            main[input] = Interval::new(
                left_main[input].high.min(right_main[input].low),
                right_main[input].low.max(left_main[input].high),
            );
            let mut units = left.units();
            match &mut units[input] {
                None => sides[input] = main[input],
                Some(unit) => *unit = [main[input].low, 0.0],
            }
            let zero = vec![0; place.len()];
            let mut all = errors(surface, right, &[input], &factor(right), &zero);
            let of_left = errors(surface, left, &[input], &factor(left), &zero);
            all.iter_mut().zip(of_left).for_each(|(all, own)| all.extend(own));
            claims.push(Claim { main, units, errors: all, ..Claim::new(k, sides, basis, integer(0)) });
        }
    }
}

/// The polynomial where a variable is 1 or -1.
fn at(polynomial: Polynomial, variable: usize, end: i64) -> Polynomial {
    let fixed = |(mut powers, coefficient): (Vec<u32>, Rational)| {
        let power = std::mem::take(&mut powers[variable]);
        (powers, if power % 2 == 1 { coefficient * integer(end) } else { coefficient })
    };
    polynomial.into_iter().map(fixed).collect()
}

#[cfg(test)]
mod tests;

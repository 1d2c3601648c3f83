//! Lowers a polynomial to nested Horner form.
//!
//! In: terms with the powers of their factors. Out: registers. One factor is outermost; its coefficients are polynomials in the
//! others, nested alike. Of all orders of nesting the one with the fewest operations is taken, of equal ones the shallowest, of those the first.
//! The scales of the variables are folded into the coefficients, exactly, before these are rounded: one operation a variable
//! instead of two, and one rounding less. Where that would run out of the exponent range, variables are scaled one by one.

use crate::model::{Surface, Term};
use crate::number::{Precision, Rational, exact, integer, power};
use crate::tape::{Op, Reg, TapeBuilder};

use super::variables::Variables;

/// Every order of nesting is tried up to this many factors (6! = 720 counts of a small tree); beyond it, orders that differ by one
/// exchange from the order of the file.
const ALL_ORDERS_UP_TO: usize = 6;

/// The terms that count: a coefficient of zero contributes nothing.
pub(super) fn terms(surface: &Surface) -> Vec<&Term> {
    surface.terms.iter().filter(|term| term.coefficient != 0.0).collect()
}

/// The value of the polynomial.
pub(super) fn lower(tape: &mut TapeBuilder, variables: &mut Variables<'_>, surface: &Surface, terms: &[&Term]) -> Reg {
    if terms.is_empty() {
        return tape.constant(integer(0));
    }
    let factors = surface.inputs.len() + surface.knots.len();
    let used: Vec<usize> = (0..factors).filter(|k| terms.iter().any(|term| term.powers[*k] > 0)).collect();
    // All variables first, in the order of the file: their subtractions do not depend on each other and can run side by side.
    let lowered: Vec<_> = used.iter().map(|k| variables.of(tape, *k)).collect();
    let scales: Vec<(usize, Rational)> =
        used.iter().copied().zip(lowered.iter().map(|variable| variable.scale.clone())).collect();
    let folds = scales_fold(tape.precision(), terms, &scales);

    let mut values = vec![None; factors];
    for (k, variable) in used.iter().zip(&lowered) {
        values[*k] = Some(if folds || variable.scale == integer(1) {
            variable.value
        } else {
            let divisor = tape.constant(integer(1) / &variable.scale);
            tape.push(Op::Divide(variable.value, divisor))
        });
    }
    let leaves: Vec<Leaf> = terms
        .iter()
        .map(|term| {
            let scaled = scales.iter().filter(|_| folds).map(|(k, scale)| power(scale, term.powers[*k]));
            Leaf { powers: &term.powers, coefficient: scaled.fold(exact(term.coefficient), |product, scale| product * scale) }
        })
        .collect();
    let order = best_order(terms, &used);
    let mut nest = Nest { tape, values: &values };
    nest.lower(&leaves, &order)
}

/// A term whose coefficient may carry the scales of its variables.
#[derive(Clone)]
struct Leaf<'a> {
    powers: &'a [u32],
    coefficient: Rational,
}

struct Nest<'t, 'v> {
    tape: &'t mut TapeBuilder,
    values: &'v [Option<Reg>],
}

impl Nest<'_, '_> {
    /// (... (a_d v + a_{d-1}) v + ...) v + a_0 with the first factor of `order`; a_j are polynomials in the others.
    fn lower(&mut self, leaves: &[Leaf<'_>], order: &[usize]) -> Reg {
        let Some((first, rest)) = order.split_first() else {
            // Check refuses two terms of the same powers, so one leaf is left.
            return self.tape.constant(leaves[0].coefficient.clone());
        };
        let degree = leaves.iter().map(|leaf| leaf.powers[*first]).max().unwrap_or(0);
        let mut sum: Option<Reg> = None;
        for exponent in (0..=degree).rev() {
            let group: Vec<Leaf<'_>> = leaves.iter().filter(|leaf| leaf.powers[*first] == exponent).cloned().collect();
            let product = sum.map(|sum| {
                let variable = self.values[*first].expect("a factor with a power above 0 is on the tape");
                self.tape.push(Op::Multiply(sum, variable))
            });
            let here = (!group.is_empty()).then(|| self.lower(&group, rest));
            sum = match (product, here) {
                (Some(product), Some(here)) => Some(self.tape.push(Op::Add(product, here))),
                (one, other) => one.or(other),
            };
        }
        sum.expect("there is at least one term")
    }
}

/// Whether every partial product of coefficients, scales and variables stays well inside the exponent range: then folding
/// costs no accuracy. f32 has 2^-126 .. 2^128; 2^+-90 leaves 24 bits of precision and a margin for sums of terms. f64 alike.
fn scales_fold(precision: Precision, terms: &[&Term], scales: &[(usize, Rational)]) -> bool {
    let widest = match precision {
        Precision::F32 => 90,
        Precision::F64 => 900,
    };
    terms.iter().all(|term| {
        let scale_bits: i64 = scales.iter().map(|(k, scale)| i64::from(term.powers[*k]) * magnitude_bits(scale)).sum();
        scale_bits + magnitude_bits(&exact(term.coefficient)) <= widest
    })
}

/// |log2 |value||, rounded up.
fn magnitude_bits(value: &Rational) -> i64 {
    let difference = value.numer().bits() as i64 - value.denom().bits() as i64;
    difference.abs() + 1
}

/// Operations and depth of the nested form in an order, without writing it.
fn cost(powers: &[&[u32]], order: &[usize]) -> (usize, usize) {
    let Some((first, rest)) = order.split_first() else { return (0, 0) };
    let degree = powers.iter().map(|powers| powers[*first]).max().unwrap_or(0);
    let (mut operations, mut depth) = (0, 0);
    let mut started = false;
    for exponent in (0..=degree).rev() {
        let group: Vec<&[u32]> = powers.iter().filter(|powers| powers[*first] == exponent).copied().collect();
        if started {
            operations += 1;
            depth += 1;
        }
        if !group.is_empty() {
            let (inner, inner_depth) = cost(&group, rest);
            operations += inner + usize::from(started);
            depth = if started { depth.max(inner_depth) + 1 } else { inner_depth };
            started = true;
        }
    }
    (operations, depth)
}

/// The order of nesting, outermost first.
fn best_order(terms: &[&Term], used: &[usize]) -> Vec<usize> {
    let powers: Vec<&[u32]> = terms.iter().map(|term| term.powers.as_slice()).collect();
    let mut best = (cost(&powers, used), used.to_vec());
    let mut consider = |order: &[usize]| {
        let candidate = cost(&powers, order);
        if candidate < best.0 {
            best = (candidate, order.to_vec());
        }
    };
    if used.len() <= ALL_ORDERS_UP_TO {
        let mut order = Vec::with_capacity(used.len());
        permutations(used, &mut order, &mut consider);
    } else {
        for a in 0..used.len() {
            for b in a + 1..used.len() {
                let mut order = used.to_vec();
                order.swap(a, b);
                consider(&order);
            }
        }
    }
    best.1
}

/// Every order of `rest` after `prefix`, in lexicographic order of `rest`.
fn permutations(rest: &[usize], prefix: &mut Vec<usize>, visit: &mut impl FnMut(&[usize])) {
    if rest.is_empty() {
        visit(prefix);
        return;
    }
    for k in 0..rest.len() {
        let mut others = rest.to_vec();
        prefix.push(others.remove(k));
        permutations(&others, prefix, visit);
        prefix.pop();
    }
}

//! Lowers a polynomial: variables, scales, and the sums that `levels.rs` writes by the scheme that `scheme.rs` chooses.
//!
//! In: terms with the powers of their factors. Out: a register. The scales of the variables are folded exactly into the coefficients before these are
//! rounded. That saves one operation and one rounding for each variable. If that would exceed the exponent range, variables are scaled one by one.

use crate::model::{Surface, Term};
use crate::number::{Precision, Rational, exact, integer, power};
use crate::tape::{Note, Op, Reg, TapeBuilder};

use super::nest::{Nest, ScaledTerm, Written, degree};
use super::scheme::{self, Candidate};
use super::variables::Variables;

/// The terms with a nonzero coefficient.
pub(super) fn terms(surface: &Surface) -> Vec<&Term> {
    surface.terms.iter().filter(|term| term.coefficient != 0.0).collect()
}

/// The value of the polynomial.
pub(super) fn lower(tape: &mut TapeBuilder, variables: &mut Variables<'_>, surface: &Surface, terms: &[&Term]) -> Reg {
    if terms.is_empty() {
        return tape.constant(integer(0));
    }
    let factors = surface.width();
    let used: Vec<usize> = (0..factors).filter(|k| terms.iter().any(|term| term.powers[*k] > 0)).collect();
    // All variables first, in the order of the file: their subtractions are independent and can run in parallel.
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
    let scaled_terms: Vec<ScaledTerm> = terms
        .iter()
        .map(|term| {
            let scaled = scales.iter().filter(|_| folds).map(|(k, scale)| power(scale, term.powers[*k]));
            ScaledTerm {
                powers: &term.powers,
                coefficient: scaled.fold(exact(term.coefficient), |product, scale| product * scale),
            }
        })
        .collect();
    let scaled_terms: Vec<&ScaledTerm<'_>> = scaled_terms.iter().collect();
    let ready: Vec<Option<usize>> = values.iter().map(|value| value.map(|reg| tape.depth_of(reg))).collect();
    let candidates: Vec<Candidate> = used
        .iter()
        .zip(&scales)
        .map(|(k, (_, scale))| {
            let coded = variables.magnitude(*k);
            let magnitude = if folds { coded / scale } else { coded };
            Candidate {
                factor: *k,
                is_bounded: variables.is_bounded(*k),
                has_powers: i64::from(degree(&scaled_terms, *k)) * magnitude_bits(&magnitude) <= widest(tape.precision()),
            }
        })
        .collect();
    let levels = scheme::best(&scaled_terms, &candidates, &ready);
    let values: Vec<Option<(Reg, usize)>> = values.into_iter().zip(ready).map(|(reg, ready)| reg.zip(ready)).collect();
    let mut output = Written(tape);
    let (value, _) = Nest::new(&mut output, &values).value(&scaled_terms, &levels);
    for (scaled_term, term) in scaled_terms.iter().zip(terms) {
        let note = Note { term: surface.term_name(&term.powers), coefficient: term.coefficient, unit: surface.unit.clone() };
        tape.note(&scaled_term.coefficient, note);
    }
    value
}

/// Whether every partial product of coefficients, scales and variables stays well inside the exponent range, so that folding loses no accuracy.
fn scales_fold(precision: Precision, terms: &[&Term], scales: &[(usize, Rational)]) -> bool {
    terms.iter().all(|term| {
        let scale_bits: i64 = scales.iter().map(|(k, scale)| i64::from(term.powers[*k]) * magnitude_bits(scale)).sum();
        scale_bits + magnitude_bits(&exact(term.coefficient)) <= widest(precision)
    })
}

/// The largest |log2| of a partial product. f32 has 2^-126 .. 2^128; 2^+-90 leaves 24 bits of precision and a margin for sums of terms. Likewise for
/// f64.
fn widest(precision: Precision) -> i64 {
    match precision {
        Precision::F32 => 90,
        Precision::F64 => 900,
    }
}

/// Whether a factor stays well inside the exponent range.
pub(super) fn is_ordinary(precision: Precision, factor: &Rational) -> bool {
    magnitude_bits(factor) <= widest(precision)
}

/// |log2 |value||, rounded up.
fn magnitude_bits(value: &Rational) -> i64 {
    let difference = value.numer().bits() as i64 - value.denom().bits() as i64;
    difference.abs() + 1
}

#[cfg(test)]
mod tests;

//! The range of the true polynomial of a surface over its box.
//!
//! In: a surface and its inputs. Out: an enclosure of its values before `output_range`, and the points of the extremes. Tapes are not used. Lowering
//! uses it to find which bounds of `output_range` can act, and the certificate reports it.

mod bent;
mod spline;

use std::collections::BTreeMap;

use crate::basis::{Factor, Variable};
use crate::bernstein::{self, Monomial};
use crate::interval::Interval;
use crate::model::{Input, Surface, Symmetry};
use crate::number::exact;
use crate::pieces::{self, Piece};

/// An enclosure of the true surface over the box, before `output_range`.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::range;
///
/// let surface = &checked.model().surfaces[0];
/// let found = range::range(surface, &checked.inputs_of(surface));
/// assert!(4.9 < found.low && found.low <= 5.0 && 65.0 <= found.high && found.high < 65.1);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn range(surface: &Surface, inputs: &[Input]) -> Interval {
    extent(surface, inputs).range
}

/// An enclosure of the true polynomial, and the points of the box with the smallest and the largest computed value, in natural units.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Extent {
    /// An interval that contains every value.
    pub range: Interval,
    /// The point of the smallest computed value, in the order of the inputs.
    pub least_at: Vec<f64>,
    /// The point of the largest computed value.
    pub greatest_at: Vec<f64>,
}

/// The extent of the surface over the box, before `output_range`: that of its polynomial, or of the responses of its transform.
#[must_use]
pub(crate) fn extent(surface: &Surface, inputs: &[Input]) -> Extent {
    let of_terms = extent_of_terms(surface, inputs);
    let Some(transform) = surface.transform else { return of_terms };
    let range = transform.over(of_terms.range);
    if transform.is_falling() {
        return Extent { range, least_at: of_terms.greatest_at, greatest_at: of_terms.least_at };
    }
    Extent { range, ..of_terms }
}

/// The enclosure of the polynomial or the spline, before a transform.
#[must_use]
pub(crate) fn of_terms(surface: &Surface, inputs: &[Input]) -> Interval {
    extent_of_terms(surface, inputs).range
}

/// The extent of the true polynomial over the box. The box is divided at the knots: in each piece a hinge is 0 or a plain difference, so the surface
/// is a polynomial there, unless it has sigmoids (`range/bent.rs`).
fn extent_of_terms(surface: &Surface, inputs: &[Input]) -> Extent {
    if let Some(spline) = &surface.spline {
        return spline::extent(spline, inputs);
    }
    let factors = Factor::all(surface, inputs);
    let pieces = pieces::all(surface, inputs);
    let of_piece = |piece: &Piece| match surface.is_bent() {
        true => bent::extent(surface, &factors, piece),
        false => extent_of_piece(surface, &factors, piece),
    };
    let whole = pieces.iter().map(of_piece).reduce(Extent::joined);
    let whole = whole.expect("a box has at least one piece");
    let is_odd = |input: &Input| surface.symmetry.contains(&(input.name.clone(), Symmetry::Odd));
    match inputs.iter().position(is_odd) {
        None => whole,
        // For the other sign of an odd input every value is negated.
        Some(odd) => {
            let opposite = |mut point: Vec<f64>| {
                point[odd] = -point[odd];
                point
            };
            let (least_at, greatest_at) = (opposite(whole.greatest_at.clone()), opposite(whole.least_at.clone()));
            let opposite = Extent { range: -whole.range, least_at, greatest_at };
            whole.joined(opposite)
        }
    }
}

impl Extent {
    fn joined(self, other: Extent) -> Extent {
        let least_at = if other.range.low < self.range.low { other.least_at } else { self.least_at };
        let greatest_at = if other.range.high > self.range.high { other.greatest_at } else { self.greatest_at };
        Extent { range: self.range.hull(other.range), least_at, greatest_at }
    }
}

/// The natural value at which a variable has gone a given share of the way from its smallest to its largest value over [low, high].
fn natural(variable: Variable, [low, high]: [f64; 2], share: f64) -> f64 {
    let xi = match variable {
        // 1/xi decreases with xi.
        Variable::Reciprocal | Variable::CentredReciprocal { .. } => 1.0 / ((1.0 - share) / high + share / low),
        _ => low * (1.0 - share) + high * share,
    };
    xi.clamp(low, high)
}

fn extent_of_piece(surface: &Surface, factors: &[Factor], piece: &Piece) -> Extent {
    let mut monomials: BTreeMap<Vec<u32>, Interval> = BTreeMap::new();
    for term in surface.terms.iter().filter(|term| term.coefficient != 0.0) {
        let of_term = exact(term.coefficient);
        for (powers, coefficient) in piece.term(&term.powers) {
            let coefficient = Interval::around(&(coefficient * &of_term));
            let entry = monomials.entry(powers).or_insert(Interval::point(0.0));
            *entry = *entry + coefficient;
        }
    }
    let monomials: Vec<Monomial> =
        monomials.into_iter().map(|(powers, coefficient)| Monomial { powers, coefficient }).collect();
    let found = bernstein::extent(&monomials, &piece.sides);
    let point = |shares: &[f64]| {
        let each = factors.iter().zip(&piece.cell).zip(shares);
        each.map(|((factor, ends), share)| natural(factor.variable, *ends, *share)).collect()
    };
    Extent { range: found.range, least_at: point(&found.least_at), greatest_at: point(&found.greatest_at) }
}

#[cfg(test)]
mod tests;

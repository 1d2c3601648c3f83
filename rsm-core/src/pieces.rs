//! The pieces of a surface: its box divided at the knots.
//!
//! In: a surface and its inputs. Out: for each piece the ranges of its main coded variables, and every term as a polynomial of them: in a piece a
//! hinge is 0 or a difference. For a symmetric input only the half above 0 is used, which represents both. Exact, except that the ranges are rounded
//! outward.

use crate::basis::{Arithmetic as _, Factor, Shape};
use crate::interval::Interval;
use crate::model::{Input, Surface};
use crate::number::{Rational, exact, integer};
use crate::order;

/// A polynomial: powers of the main variables with exact coefficients. The same powers may occur several times.
pub type Polynomial = Vec<(Vec<u32>, Rational)>;

/// A part of the box without a knot inside.
#[derive(Debug, Clone)]
pub struct Piece {
    /// The range of each input, in natural units.
    pub cell: Vec<[f64; 2]>,
    /// The index of the cell along each input.
    pub place: Vec<usize>,
    /// The range of each main variable.
    pub sides: Vec<Interval>,
    /// For every knot the value of its variable, if the hinge is positive in this piece.
    hinges: Vec<Option<(usize, Rational)>>,
}

/// All pieces of a surface. Those of the first input change fastest.
#[must_use]
pub fn all(surface: &Surface, inputs: &[Input]) -> Vec<Piece> {
    let factors = Factor::all(surface, inputs);
    let parts: Vec<Vec<[f64; 2]>> = inputs.iter().map(|input| parts(surface, input)).collect();
    let mut pieces = Vec::new();
    let mut place = vec![0usize; inputs.len()];
    loop {
        let cell = parts.iter().zip(&place).map(|(parts, k)| parts[*k]).collect();
        pieces.push(Piece::new(&factors, cell, place.clone()));
        let Some(next) = (0..inputs.len()).find(|k| place[*k] + 1 < parts[*k].len()) else { return pieces };
        place[next] += 1;
        place[..next].fill(0);
    }
}

/// The parts of an input's range between its knots; for a symmetric input only the half above 0.
fn parts(surface: &Surface, input: &Input) -> Vec<[f64; 2]> {
    let symmetric = surface.symmetry.iter().any(|(name, _)| *name == input.name);
    let low = if symmetric { 0.0 } else { input.range[0] };
    let mut cuts: Vec<f64> = surface.knots.iter().filter(|knot| knot.input == input.name).map(|knot| knot.at).collect();
    cuts.extend([low, input.range[1]]);
    order::sort(&mut cuts);
    cuts.dedup();
    cuts.windows(2).map(|pair| [pair[0], pair[1]]).collect()
}

impl Piece {
    fn new(factors: &[Factor], cell: Vec<[f64; 2]>, place: Vec<usize>) -> Self {
        let inputs = cell.len();
        // The main variable is monotone in xi within a piece, so its range is between its values at the ends.
        let side = |(factor, ends): (&Factor, &[f64; 2])| {
            let [one, other] = ends.map(|end| Interval::around(&factor.value(exact(end))));
            one.hull(other)
        };
        let sides = factors[..inputs].iter().zip(&cell).map(side).collect();
        let hinge = |factor: &Factor| {
            let Shape::Hinge { at } = factor.shape else { return None };
            let [low, high] = cell[factor.input].map(exact);
            let open = factor.value((low + high) / integer(2)) > Rational::of(0.0);
            Some(open.then(|| (factor.input, factor.variable.value(exact(at)))))
        };
        let hinges = factors[inputs..].iter().filter_map(hinge).collect();
        Piece { cell, place, sides, hinges }
    }

    /// A term of coefficient 1 as a polynomial of the main variables; empty if it contains a hinge that is 0 here.
    ///
    /// # Panics
    /// If it contains a sigmoid, which is not a polynomial on any piece ([`Surface::is_bent`]).
    #[must_use]
    pub fn term(&self, powers: &[u32]) -> Polynomial {
        let (own, of_hinges) = powers.split_at(self.cell.len());
        assert!(of_hinges.iter().skip(self.hinges.len()).all(|power| *power == 0), "a sigmoid is no polynomial");
        let mut expanded = vec![(own.to_vec(), integer(1))];
        for (hinge, power) in self.hinges.iter().zip(of_hinges) {
            for _ in 0..*power {
                expanded = match hinge {
                    Some((input, knot)) => times_difference(&expanded, *input, knot),
                    None => vec![],
                };
            }
        }
        expanded
    }
}

/// A polynomial times (x_k - knot).
fn times_difference(terms: &Polynomial, input: usize, knot: &Rational) -> Polynomial {
    let raised = terms.iter().map(|(powers, coefficient)| {
        let mut powers = powers.clone();
        powers[input] += 1;
        (powers, coefficient.clone())
    });
    let lowered = terms.iter().map(|(powers, coefficient)| (powers.clone(), -(coefficient * knot)));
    raised.chain(lowered).collect()
}

#[cfg(test)]
pub(crate) mod tests;

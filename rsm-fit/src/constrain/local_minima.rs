//! The local minima of a claim: the points where it may be violated.
//!
//! In: a claim with its coefficients, and starting points. Out: the end of a descent from each of them. Values are plain f64 and prove nothing; only
//! [`rsm_core::bernstein::least`] does. If a round of exchange added only the worst point, the next local minimum would become the worst one, and
//! each digit would cost as many rounds as there are local minima.

use rsm_core::bernstein::Monomial;
use rsm_core::order;

/// The first step of a descent, as a share of a side. Local minima of a polynomial of order 5 are wider.
const FIRST_STEP: f64 = 1.0 / 16.0;

/// The last step. The vertex of the parabola through the last three values then leaves about 10^-9 of the depth.
const LAST_STEP: f64 = 1.0 / 2048.0;

/// The largest number of moves of a descent; twenty are usual.
const MOST_MOVES: usize = 400;

/// Minima nearer than this share of every side count as one.
const LEAST_DISTANCE: f64 = 0.01;

/// A polynomial over shares of its sides, prepared for millions of evaluations in a round of exchange.
pub(super) struct BoxPolynomial {
    /// For each term, the coefficient and the indices of its factors among the powers of all variables. Variables that do not occur are left out.
    terms: Vec<(f64, Vec<usize>)>,
    sides: Vec<[f64; 2]>,
    /// The number of powers of each variable, from 0 to the largest.
    kept: usize,
}

/// A point with its value.
#[derive(Debug, Clone)]
pub(super) struct LocalMinimum {
    pub value: f64,
    /// Shares of the sides.
    pub shares: Vec<f64>,
}

impl BoxPolynomial {
    pub(super) fn new(monomials: &[Monomial], sides: Vec<[f64; 2]>) -> Self {
        let kept = monomials.iter().flat_map(|term| &term.powers).max().map_or(1, |largest| *largest as usize + 1);
        let of_one = |term: &Monomial| {
            let factors = term.powers.iter().enumerate().filter(|(_, power)| **power > 0);
            let places = factors.map(|(axis, power)| axis * kept + *power as usize).collect();
            (term.coefficient.low.midpoint(term.coefficient.high), places)
        };
        BoxPolynomial { terms: monomials.iter().map(of_one).collect(), sides, kept }
    }

    pub(super) fn value(&self, shares: &[f64]) -> f64 {
        // mutant `* to +`: capacity, which grows if it is too small.
        // mutant `* to /`: the same.
        let mut powers = Vec::with_capacity(self.sides.len() * self.kept);
        for ([low, high], share) in self.sides.iter().zip(shares) {
            let x = low + share * (high - low);
            powers.extend((0..self.kept).scan(1.0, |next, _| Some(std::mem::replace(next, *next * x))));
        }
        let product = |places: &[usize]| places.iter().map(|place| powers[*place]).product::<f64>();
        self.terms.iter().map(|(coefficient, places)| coefficient * product(places)).sum()
    }

    /// The local minima below a value that descents from `starts` reach, the lowest first, without duplicates.
    pub(super) fn below(&self, most: f64, starts: &[Vec<f64>], is_inside: &dyn Fn(&[f64]) -> bool) -> Vec<LocalMinimum> {
        let inside = starts.iter().filter(|start| is_inside(start));
        let mut found: Vec<LocalMinimum> = inside.map(|start| self.descent(start, is_inside)).collect();
        found.retain(|minimum| minimum.value < most);
        order::ascending(&mut found, |it| it.value);
        let mut apart: Vec<LocalMinimum> = Vec::new();
        for minimum in found {
            let is_near =
                |other: &LocalMinimum| other.shares.iter().zip(&minimum.shares).all(|(a, b)| (a - b).abs() < LEAST_DISTANCE);
            if !apart.iter().any(is_near) {
                apart.push(minimum);
            }
        }
        apart
    }

    /// Moves along one side after the other to a lower value. If no step helps, moves to the vertex of a parabola and halves the step.
    fn descent(&self, start: &[f64], is_inside: &dyn Fn(&[f64]) -> bool) -> LocalMinimum {
        let mut at = LocalMinimum { value: self.value(start), shares: start.to_vec() };
        let mut step = FIRST_STEP;
        // mutant `0 up`: one move less of hundreds, which no known descent needs.
        // mutant `MOST_MOVES doubled`: more moves than needed.
        for _ in 0..MOST_MOVES {
            let mut has_moved = false;
            let before = at.shares.clone();
            for axis in 0..at.shares.len() {
                let tried = |share: f64| {
                    let mut shares = at.shares.clone();
                    shares[axis] = share.clamp(0.0, 1.0);
                    LocalMinimum { value: if is_inside(&shares) { self.value(&shares) } else { f64::INFINITY }, shares }
                };
                let here = at.shares[axis];
                let (below, above) = (tried(here - step), tried(here + step));
                let bend = below.value - 2.0 * at.value + above.value;
                let vertex = here + 0.5 * step * (below.value - above.value) / bend;
                let lowest = if below.value < above.value { below } else { above };
                if lowest.value < at.value {
                    (at, has_moved) = (lowest, true);
                } else if vertex.is_finite() {
                    let vertex = tried(vertex);
                    // mutant `< to <=`: of two points with one value, either is right.
                    if vertex.value < at.value {
                        at = vertex;
                    }
                }
            }
            // Repeats the same move, along a valley that is oblique to the sides (Hooke, Jeeves 1961, J. ACM 8).
            let further: Vec<f64> =
                at.shares.iter().zip(&before).map(|(now, before)| (2.0 * now - before).clamp(0.0, 1.0)).collect();
            if is_inside(&further) {
                let value = self.value(&further);
                // mutant `< to <=`: of two points with one value, either is right.
                if value < at.value {
                    at = LocalMinimum { value, shares: further };
                }
            }
            if !has_moved {
                step /= 2.0;
                if step < LAST_STEP {
                    break;
                }
            }
        }
        at
    }
}

#[cfg(test)]
mod tests;

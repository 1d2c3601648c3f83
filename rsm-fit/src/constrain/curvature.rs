//! The smallest curvature of a surface over all directions: the smallest eigenvalue of its Hessian.
//!
//! In: the polynomial u'H(x)u of a claim. Out: the entries of H as polynomials of x alone, and a measure of them for
//! [`rsm_core::bernstein::least_measure`]. The smallest eigenvalue is concave in H, so over a cell it is at least the smallest over the joint
//! Bernstein coefficients. A search over x and u has twice the variables and does not terminate for convex surfaces of order 4 in four inputs. Bounds
//! are proven by interval arithmetic: H - m I has positive pivots for every matrix in the enclosure. Eigenvalues in f64 only suggest the m to try.

use nalgebra::{DMatrix, DVector};
use rsm_core::bernstein::{Measure, Monomial};
use rsm_core::interval::Interval;

use super::local_minima::BoxPolynomial;

/// Cholesky's factor in f64 is that of a matrix that differs by less than n + 1 roundings of its trace (Rump 2006, Verification of positive
/// definiteness, BIT 46), so by n (n + 1) 2^-53 of its largest entry. Eigenvalues have the same accuracy. The constant is eight times that for n up
/// to 6, for each row.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// The entries of H on and above its diagonal, row by row, from u'H(x)u with the first entry of u equal to 1. The other entries of u are the
/// variables after `inputs`.
pub(super) fn entries(monomials: &[Monomial], inputs: usize) -> Vec<Vec<Monomial>> {
    let mut entries = vec![Vec::new(); inputs * (inputs + 1) / 2];
    for Monomial { powers, coefficient } in monomials {
        let (own, direction) = powers.split_at(inputs);
        let mut factors = direction.iter().enumerate().flat_map(|(k, power)| vec![k + 1; *power as usize]);
        let [a, b] = match [factors.next(), factors.next()] {
            [None, _] => [0, 0],
            [Some(b), None] => [0, b],
            [Some(a), Some(b)] => [a, b],
        };
        // Each entry off the diagonal occurs twice in the sum.
        let coefficient = if a == b { *coefficient } else { coefficient.halved() };
        entries[place(a, b, inputs)].push(Monomial { powers: own.to_vec(), coefficient });
    }
    entries
}

/// The index of the entry in row a and column b >= a.
fn place(a: usize, b: usize, inputs: usize) -> usize {
    a * inputs - a * (a + 1) / 2 + b
}

/// A lower bound of u'Hu over all directions u with `inputs` entries whose largest entry is 1. The square of u is between 1 and `inputs`. So u'Hu is
/// at least the eigenvalue or, if that is negative, `inputs` times it.
pub(super) fn of_directions(eigenvalue: f64, inputs: usize) -> f64 {
    eigenvalue.min(eigenvalue * inputs as f64)
}

/// The smallest eigenvalue of symmetric matrices with this many rows.
pub(super) struct LeastEigenvalue(pub usize);

impl LeastEigenvalue {
    fn entry(&self, values: &[Interval], a: usize, b: usize) -> Interval {
        values[place(a.min(b), a.max(b), self.0)]
    }

    /// The smallest eigenvalue of the middle matrix and its direction, in f64.
    pub(super) fn of_middle(&self, values: &[Interval], rows: &[usize]) -> (f64, DVector<f64>) {
        let middle = |a: usize, b: usize| {
            let entry = self.entry(values, rows[a], rows[b]);
            entry.low.midpoint(entry.high)
        };
        let found = DMatrix::from_fn(rows.len(), rows.len(), middle).symmetric_eigen();
        let least = found.eigenvalues.imin();
        (found.eigenvalues[least], found.eigenvectors.column(least).into_owned())
    }

    /// The direction of the smallest curvature at a point given by shares of the sides: the index of its largest entry, and the other entries, for a
    /// largest entry of 1, as shares of [-1, 1].
    pub(super) fn worst(&self, entries: &[Vec<Monomial>], sides: &[Interval], shares: &[f64]) -> (usize, Vec<f64>) {
        let sides: Vec<[f64; 2]> = sides.iter().map(|side| [side.low, side.high]).collect();
        let value = |entry: &Vec<Monomial>| Interval::point(BoxPolynomial::new(entry, sides.clone()).value(shares));
        let values: Vec<Interval> = entries.iter().map(value).collect();
        let all: Vec<usize> = (0..self.0).collect();
        let (_, direction) = self.of_middle(&values, &all);
        let largest = direction.iamax();
        let others = (0..self.0).filter(|k| *k != largest);
        (largest, others.map(|k| (direction[k] / direction[largest] + 1.0) / 2.0).collect())
    }
}

/// The middle matrix of an enclosure.
struct Middle {
    size: usize,
    /// Row by row.
    entries: Vec<f64>,
    /// The largest difference between an eigenvalue of a matrix in the enclosure and one of the middle matrix, and between a computed and a true
    /// pivot.
    margin: f64,
}

impl Middle {
    /// The middle of these rows and columns. `None` if an entry may be infinite.
    fn of(of: &LeastEigenvalue, values: &[Interval], rows: &[usize]) -> Option<Self> {
        let size = rows.len();
        let (mut entries, mut radius, mut largest) = (Vec::new(), 0f64, 0f64);
        for a in rows {
            for b in rows {
                let entry = of.entry(values, *a, *b);
                let middle = entry.low.midpoint(entry.high);
                radius = radius.max((entry.high - middle).max(middle - entry.low).next_up());
                largest = largest.max(middle.abs());
                entries.push(middle);
            }
        }
        let margin = size as f64 * (radius + ROUNDING * largest);
        margin.is_finite().then_some(Middle { size, entries, margin })
    }

    /// Whether every eigenvalue of every matrix in the enclosure is at least m: Cholesky's factor of the middle minus m and the margin exists in f64.
    fn is_above(&self, m: f64) -> bool {
        let size = self.size;
        let mut left = self.entries.clone();
        for k in 0..size {
            left[k * (size + 1)] -= m + self.margin;
        }
        for k in 0..size {
            let pivot = left[k * (size + 1)];
            if pivot <= 0.0 || pivot.is_nan() {
                return false;
            }
            for a in k + 1..size {
                let share = left[k * size + a] / pivot;
                for b in a..size {
                    left[a * size + b] -= share * left[k * size + b];
                }
            }
        }
        true
    }
}

impl Measure for LeastEigenvalue {
    fn low(&self, values: &[Interval], than: f64) -> f64 {
        let nothing = Interval::point(0.0);
        let is_live = |a: &usize| (0..self.0).any(|b| self.entry(values, *a, b) != nothing);
        let rows: Vec<usize> = (0..self.0).filter(is_live).collect();
        // An input without curvature has the eigenvalue 0 exactly.
        let most = if rows.len() < self.0 { 0.0 } else { f64::INFINITY };
        if rows.is_empty() {
            return most;
        }
        if let [only] = rows[..] {
            return self.entry(values, only, only).low.min(most);
        }
        let Some(middle) = Middle::of(self, values, &rows) else { return f64::NEG_INFINITY };
        if than.is_finite() && middle.is_above(than) {
            return than.min(most);
        }
        let least = DMatrix::from_row_slice(middle.size, middle.size, &middle.entries).symmetric_eigenvalues().min();
        // One margin is for the pivots, the other for the eigenvalue in f64.
        let proven = least - 2.0 * middle.margin;
        if middle.is_above(proven) { proven.min(most) } else { f64::NEG_INFINITY }
    }

    fn high(&self, values: &[Interval]) -> f64 {
        // mutant `any to all`: with one infinite entry, the sum below is infinite too.
        if values.iter().any(|entry| !entry.magnitude().is_finite()) {
            return f64::INFINITY;
        }
        let all: Vec<usize> = (0..self.0).collect();
        let (_, direction) = self.of_middle(values, &all);
        let [mut sum, mut square] = [Interval::point(0.0); 2];
        for a in 0..self.0 {
            let u = Interval::point(direction[a]);
            square = square + u * u;
            for b in 0..self.0 {
                sum = sum + self.entry(values, a, b) * u * Interval::point(direction[b]);
            }
        }
        most_of_quotient(sum, square)
    }
}

/// An upper bound of every quotient of a number and a positive number.
fn most_of_quotient(number: Interval, positive: Interval) -> f64 {
    // mutant `< to <=`: 0 divided by either is 0.
    (number.high / if number.high < 0.0 { positive.high } else { positive.low }).next_up()
}

#[cfg(test)]
mod tests;

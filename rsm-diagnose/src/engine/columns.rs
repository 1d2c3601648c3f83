//! Columns of numbers: products, orthonormal bases, least squares.
//!
//! In: columns of one length, in a space where the noise is white. Out: bases, coefficients, projections of a residual. Independent of the meaning of
//! a column.

use rsm_core::vector::{Work, widest};

/// A column is dependent when less than this share of its length is independent of the columns before it. Such a rest is rounding error: columns of
/// powers up to seven on [-1, 1] keep about ten of 16 digits.
const DEPENDENT: f64 = 1e-6;

/// Inner product, as eight partial sums. Their order is fixed, so they may be computed in vector registers. If the lengths differ, the
/// longer list is cut to the shorter length.
#[must_use]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Cut first: otherwise the chunks and remainders of the two lists would not have the same positions.
    let common = a.len().min(b.len());
    widest(Dot(&a[..common], &b[..common]))
}

/// Two lists of the same length.
struct Dot<'a>(&'a [f64], &'a [f64]);

impl Work for Dot<'_> {
    type Found = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let mut sums = [0.0; 8];
        let ((a8, a_rest), (b8, b_rest)) = (self.0.as_chunks::<8>(), self.1.as_chunks::<8>());
        let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        for (a, b) in a8.iter().zip(b8) {
            for k in 0..8 {
                sums[k] += a[k] * b[k];
            }
        }
        sums.iter().sum::<f64>() + rest
    }
}

/// a - factor b, in place.
pub(crate) fn subtract(a: &mut [f64], b: &[f64], factor: f64) {
    for (x, y) in a.iter_mut().zip(b) {
        *x -= factor * y;
    }
}

/// An orthonormal basis of the span of some columns. Gram-Schmidt is done twice (Kahan and Parlett: "twice is enough"). A column that depends on
/// those before it adds no direction.
#[derive(Debug, Clone, Default)]
pub(crate) struct Basis {
    /// Orthogonal, each of length one.
    pub directions: Vec<Vec<f64>>,
    /// The column that each direction came from.
    from: Vec<usize>,
    /// For each direction, its column as a combination of the directions up to it: one column of the upper triangular factor R.
    triangle: Vec<Vec<f64>>,
}

impl Basis {
    /// The basis of these columns, taken in their order.
    #[must_use]
    pub(crate) fn of<'c>(columns: impl IntoIterator<Item = &'c Vec<f64>>) -> Self {
        let mut basis = Basis::default();
        for (k, column) in columns.into_iter().enumerate() {
            let before = dot(column, column).sqrt();
            let mut own = column.clone();
            let mut parts = vec![0.0; basis.rank()];
            for _ in 0..2 {
                for (part, direction) in parts.iter_mut().zip(&basis.directions) {
                    let more = dot(direction, &own);
                    subtract(&mut own, direction, more);
                    *part += more;
                }
            }
            let norm = dot(&own, &own).sqrt();
            if norm > DEPENDENT * before && norm > 0.0 {
                own.iter_mut().for_each(|x| *x /= norm);
                parts.push(norm);
                basis.triangle.push(parts);
                basis.from.push(k);
                basis.directions.push(own);
            }
        }
        basis
    }

    /// The number of independent columns.
    #[must_use]
    pub(crate) fn rank(&self) -> usize {
        self.directions.len()
    }

    /// The squared length of the projection of a target on the columns.
    #[must_use]
    pub(crate) fn projected_square(&self, target: &[f64]) -> f64 {
        self.directions.iter().map(|direction| dot(direction, target).powi(2)).sum()
    }

    /// Subtracts from a target its projection on the columns. Returns the target's component along each direction.
    pub(crate) fn project_out(&self, target: &mut [f64]) -> Vec<f64> {
        let part = |direction: &Vec<f64>| {
            let part = dot(direction, target);
            subtract(target, direction, part);
            part
        };
        self.directions.iter().map(part).collect()
    }

    /// The logarithm of det(A'A).
    #[must_use]
    pub(crate) fn ln_gram(&self) -> f64 {
        self.triangle.iter().filter_map(|parts| parts.last()).map(|own| 2.0 * own.ln()).sum()
    }

    /// The solution of R x = b.
    fn back(&self, mut b: Vec<f64>) -> Vec<f64> {
        for row in (0..self.rank()).rev() {
            b[row] /= self.triangle[row][row];
            let value = b[row];
            for (above, entry) in b[..row].iter_mut().zip(&self.triangle[row]) {
                *above -= entry * value;
            }
        }
        b
    }
}

/// A least squares solution. A column that depends on columns before it gets the coefficient 0.
#[derive(Debug, Clone)]
pub(crate) struct LeastSquares {
    /// One coefficient for each column.
    pub coefficients: Vec<f64>,
    /// (A'A)^-1. Rows and columns of dependent columns are zero.
    pub covariance: Vec<Vec<f64>>,
    /// The residual: the target minus its projection.
    pub residual: Vec<f64>,
    /// The number of independent columns.
    pub rank: usize,
}

/// Solves the least squares problem. Columns are taken in their order.
#[must_use]
pub(crate) fn solve(columns: &[Vec<f64>], target: &[f64]) -> LeastSquares {
    let width = columns.len();
    let basis = Basis::of(columns);
    let rank = basis.rank();
    let mut residual = target.to_vec();
    let right = basis.project_out(&mut residual);
    let mut coefficients = vec![0.0; width];
    for (value, k) in basis.back(right).into_iter().zip(&basis.from) {
        coefficients[*k] = value;
    }
    let unit = |j: usize| (0..rank).map(|k| if k == j { 1.0 } else { 0.0 }).collect();
    let inverse: Vec<Vec<f64>> = (0..rank).map(|j| basis.back(unit(j))).collect();
    let mut covariance = vec![vec![0.0; width]; width];
    for (a, i) in basis.from.iter().enumerate() {
        for (b, j) in basis.from.iter().enumerate() {
            covariance[*i][*j] = inverse.iter().map(|column| column[a] * column[b]).sum();
        }
    }
    LeastSquares { coefficients, covariance, residual, rank }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_squares_leaves_dependent_columns_out() {
        let x: Vec<f64> = (0..6).map(f64::from).collect();
        let columns = [vec![1.0; 6], x.clone(), x.iter().map(|x| 2.0 + 3.0 * x).collect()];
        let y: Vec<f64> = x.iter().map(|x| 5.0 - x).collect();
        let solved = solve(&columns, &y);
        assert_eq!(solved.rank, 2);
        assert!((solved.coefficients[0] - 5.0).abs() < 1e-12 && (solved.coefficients[1] + 1.0).abs() < 1e-12);
        // The variance of a slope over 0..5: 1/17.5.
        assert!((solved.covariance[1][1] - 1.0 / 17.5).abs() < 1e-15 && solved.covariance[2][2] == 0.0);
    }

    #[test]
    fn a_basis_takes_what_its_columns_explain() {
        let columns = [vec![3.0, 0.0, 0.0], vec![4.0, 2.0, 0.0]];
        let basis = Basis::of(&columns);
        // The first two places of the target, and the determinant of A'A: (3 * 2)^2.
        assert!((basis.projected_square(&[1.0, 2.0, 7.0]) - 5.0).abs() < 1e-14);
        assert!((basis.ln_gram() - 36.0_f64.ln()).abs() < 1e-14);
        let mut target = vec![1.0, 2.0, 7.0];
        let parts = basis.project_out(&mut target);
        assert!(target == [0.0, 0.0, 7.0] && parts == [1.0, 2.0], "{target:?} {parts:?}");
    }

    #[test]
    fn the_beginnings_of_lists_meet_whatever_their_lengths() {
        let ones = [1.0; 20];
        for (a, b) in [(8, 7), (7, 8), (16, 17), (20, 3), (9, 9), (0, 5)] {
            assert_eq!(dot(&ones[..a], &ones[..b]), a.min(b) as f64);
        }
    }
}

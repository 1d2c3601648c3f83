//! Small systems of normal equations.
//!
//! In: inner products of a few columns, some tens at most. Out: solutions, and columns of the inverse. Columns are first scaled to length one. A
//! column of length zero gets the solution 0.

/// Added to the unit diagonal. Finite differences hold nine digits, so columns that agree to nine digits count as one column.
const RIDGE: f64 = 1e-9;

/// The same for columns that are accurate to rounding, where priors separate equal columns: the rounding error of sums over a million rows.
const FINE_RIDGE: f64 = 1e-13;

/// A symmetric matrix, stored row by row, from its lower triangle. `entry` takes the row, then the column.
pub(crate) fn symmetric(size: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let mut matrix = vec![0.0; size * size];
    for i in 0..size {
        for j in 0..=i {
            let value = entry(i, j);
            (matrix[i * size + j], matrix[j * size + i]) = (value, value);
        }
    }
    matrix
}

/// A factorised symmetric matrix.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    size: usize,
    scale: Vec<f64>,
    /// Lower triangle of the Cholesky factor, row by row.
    factor: Vec<f64>,
}

impl Normal {
    /// Factorises a symmetric positive semidefinite matrix, stored row by row, after adding `damping` times its diagonal.
    #[must_use]
    pub(crate) fn new(matrix: &[f64], size: usize, damping: f64) -> Self {
        Self::with_ridge(matrix, size, damping, RIDGE)
    }

    /// Factorises without damping a matrix that is accurate to rounding.
    #[must_use]
    pub(crate) fn fine(matrix: &[f64], size: usize) -> Self {
        Self::with_ridge(matrix, size, 0.0, FINE_RIDGE)
    }

    fn with_ridge(matrix: &[f64], size: usize, damping: f64, ridge: f64) -> Self {
        let scale: Vec<f64> = (0..size)
            .map(|i| {
                let length = matrix[i * size + i].max(0.0).sqrt();
                if length > 0.0 && length.is_finite() { length } else { 1.0 }
            })
            .collect();
        let mut factor = vec![0.0; size * size];
        for i in 0..size {
            for j in 0..=i {
                let mut sum = matrix[i * size + j] / (scale[i] * scale[j]);
                if i == j {
                    // A column of length zero gets a row of the unit matrix.
                    sum = if sum > 0.0 { sum + damping + ridge } else { 1.0 };
                }
                for k in 0..j {
                    sum -= factor[i * size + k] * factor[j * size + k];
                }
                factor[i * size + j] = if i == j { sum.max(ridge).sqrt() } else { sum / factor[j * size + j] };
            }
        }
        Normal { size, scale, factor }
    }

    /// The solution for a right-hand side.
    #[must_use]
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let n = self.size;
        let mut x: Vec<f64> = right.iter().zip(&self.scale).map(|(value, scale)| value / scale).collect();
        for i in 0..n {
            for k in 0..i {
                x[i] -= self.factor[i * n + k] * x[k];
            }
            x[i] /= self.factor[i * n + i];
        }
        for i in (0..n).rev() {
            for k in i + 1..n {
                x[i] -= self.factor[k * n + i] * x[k];
            }
            x[i] /= self.factor[i * n + i];
        }
        x.iter().zip(&self.scale).map(|(value, scale)| value / scale).collect()
    }

    /// The solution, and its inner product with the right-hand side: the reduction of the squared residual.
    pub(crate) fn gain(&self, right: &[f64]) -> (Vec<f64>, f64) {
        let solved = self.solve(right);
        let gain = solved.iter().zip(right).map(|(solved, right)| solved * right).sum();
        (solved, gain)
    }

    /// The i-th column of the inverse: the covariances of unknown i with all unknowns.
    #[must_use]
    pub(crate) fn covariances(&self, i: usize) -> Vec<f64> {
        let mut right = vec![0.0; self.size];
        right[i] = 1.0;
        self.solve(&right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_equations_by_hand() {
        // 4 x + 2 y = 10, 2 x + 3 y = 11: x = 1, y = 3. The inverse is [3 -2; -2 4]/8.
        let normal = Normal::new(&symmetric(2, |i, j| [[4.0, f64::NAN], [2.0, 3.0]][i][j]), 2, 0.0);
        let x = normal.solve(&[10.0, 11.0]);
        // The ridge moves the ninth digit.
        assert!((x[0] - 1.0).abs() < 1e-7 && (x[1] - 3.0).abs() < 1e-7, "{x:?}");
        assert!((normal.covariances(0)[0] - 0.375).abs() < 1e-7);
        // 1 * 10 + 3 * 11.
        assert!((normal.gain(&[10.0, 11.0]).1 - 43.0).abs() < 1e-6);
    }

    #[test]
    fn a_column_without_length_gets_nothing() {
        let x = Normal::new(&[4.0, 0.0, 0.0, 0.0], 2, 0.0).solve(&[8.0, 5.0]);
        assert!((x[0] - 2.0).abs() < 1e-7 && x[1] == 5.0, "{x:?}");
        let x = Normal::new(&[4.0, 0.0, 0.0, 0.0], 2, 0.0).solve(&[8.0, 0.0]);
        assert_eq!(x[1], 0.0);
    }
}

//! Dense symmetric matrices in f64, with the same bits on every machine: sums have a fixed order.
//!
//! In: entries. Out: factors, inverses, products, and a proof that a matrix is positive semidefinite.

/// A square matrix, row by row.
#[derive(Debug, Clone)]
pub(super) struct Matrix {
    pub size: usize,
    pub entries: Vec<f64>,
}

/// Cholesky's factor, row by row; entries above its diagonal are not used.
pub(super) struct Factor(Matrix);

/// The scalar product, in eight partial sums.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a8, a_rest), (b8, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

impl Matrix {
    pub(super) fn zeros(size: usize) -> Self {
        Matrix { size, entries: vec![0.0; size * size] }
    }

    pub(super) fn row(&self, k: usize) -> &[f64] {
        &self.entries[k * self.size..][..self.size]
    }

    pub(super) fn row_mut(&mut self, k: usize) -> &mut [f64] {
        &mut self.entries[k * self.size..][..self.size]
    }

    /// The factor L of LL'. Only entries on and below the diagonal are read. `None` if a pivot is not positive.
    pub(super) fn factor(&self) -> Option<Factor> {
        let size = self.size;
        let mut factor = self.clone();
        for i in 0..size {
            let (above, own) = factor.entries.split_at_mut(i * size);
            for j in 0..i {
                own[j] = (own[j] - dot(&own[..j], &above[j * size..][..j])) / above[j * size + j];
            }
            let pivot = own[i] - dot(&own[..i], &own[..i]);
            if pivot <= 0.0 || !pivot.is_finite() {
                return None;
            }
            own[i] = pivot.sqrt();
        }
        Some(Factor(factor))
    }

    /// Whether it is proven positive semidefinite: the factor of the matrix minus a margin exists in f64. Each computed factor is that of a matrix
    /// that differs by at most n + 1 roundings of the trace in norm (Rump 2006, Verification of positive definiteness, BIT 46).
    pub(super) fn is_positive(&self) -> bool {
        let size = self.size;
        let trace: f64 = (0..size).map(|k| self.entries[k * (size + 1)]).sum();
        let mut less = self.clone();
        // Twice that margin, which also covers the rounding of the trace and of the difference, plus more than any underflow.
        let margin = (size + 2) as f64 * f64::EPSILON * trace + f64::MIN_POSITIVE;
        for k in 0..size {
            less.entries[k * (size + 1)] -= margin;
        }
        less.factor().is_some()
    }

    /// The mean of it and its transpose; both sides of the diagonal have the same bits.
    pub(super) fn symmetric(mut self) -> Self {
        let size = self.size;
        // mutant `0 up`: the first row has no entry before the diagonal.
        for i in 0..size {
            for j in 0..i {
                let mean = 0.5 * (self.entries[i * size + j] + self.entries[j * size + i]);
                self.entries[i * size + j] = mean;
                self.entries[j * size + i] = mean;
            }
        }
        self
    }

    pub(super) fn times(&self, other: &Matrix) -> Self {
        let mut product = Matrix::zeros(self.size);
        for (k, line) in product.entries.chunks_exact_mut(self.size).enumerate() {
            for (j, factor) in self.row(k).iter().enumerate() {
                line.iter_mut().zip(other.row(j)).for_each(|(sum, entry)| *sum += factor * entry);
            }
        }
        product
    }

    /// Multiplies the diagonal by 1 plus a share.
    pub(super) fn increase_diagonal(&mut self, share: f64) {
        for k in 0..self.size {
            self.entries[k * (self.size + 1)] *= 1.0 + share;
        }
    }

    pub(super) fn scaled(&self, factor: f64) -> Self {
        Matrix { size: self.size, entries: self.entries.iter().map(|entry| factor * entry).collect() }
    }

    pub(super) fn plus(&self, share: f64, other: &Matrix) -> Self {
        let entries = self.entries.iter().zip(&other.entries).map(|(a, b)| a + share * b).collect();
        Matrix { size: self.size, entries }
    }
}

impl Factor {
    /// The solution of LL'x = right.
    pub(super) fn solved(&self, right: &[f64]) -> Vec<f64> {
        let size = self.0.size;
        let mut solved = right.to_vec();
        for k in 0..size {
            let row = self.0.row(k);
            solved[k] = (solved[k] - dot(&row[..k], &solved[..k])) / row[k];
        }
        for k in (0..size).rev() {
            let row = self.0.row(k);
            solved[k] /= row[k];
            let found = solved[k];
            solved[..k].iter_mut().zip(row).for_each(|(left, entry)| *left -= found * entry);
        }
        solved
    }

    /// The inverse of LL'.
    pub(super) fn inverse(&self) -> Matrix {
        let size = self.0.size;
        let mut inverse = Matrix::zeros(size);
        let mut unit = vec![0.0; size];
        for k in 0..size {
            unit[k] = 1.0;
            inverse.entries[k * size..][..size].copy_from_slice(&self.solved(&unit));
            unit[k] = 0.0;
        }
        inverse.symmetric()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn random(random: &mut Random, rows: usize, columns: usize) -> Vec<Vec<f64>> {
        (0..rows).map(|_| (0..columns).map(|_| random.below(19) as f64 - 9.0).collect()).collect()
    }

    /// The products of the rows: exact for small whole numbers.
    fn gram(rows: &[Vec<f64>]) -> Matrix {
        let product = |a: &Vec<f64>, b: &Vec<f64>| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        Matrix { size: rows.len(), entries: rows.iter().flat_map(|a| rows.iter().map(move |b| product(a, b))).collect() }
    }

    /// Least eigenvalue 0 less a number that f64 still tells from 0: without a margin rounded pivots would call some of them positive semidefinite.
    #[test]
    fn a_matrix_with_a_negative_eigenvalue_is_not_called_positive_by_rounding() {
        let mut draws = Random::new(8);
        let mut by_pivots = 0;
        for _ in 0..400 {
            let size = 2 + draws.below(9) as usize;
            let mut matrix = gram(&random(&mut draws, size, size - 1));
            let k = draws.below(size as u64) as usize;
            matrix.entries[k * (size + 1)] = matrix.entries[k * (size + 1)].next_down();
            assert!(!matrix.is_positive(), "{matrix:?}");
            by_pivots += usize::from(matrix.factor().is_some());
        }
        assert!(by_pivots > 10, "{by_pivots}");
    }

    #[test]
    fn the_margin_is_some_roundings_of_the_trace() {
        // diag(1, d): a trace of about 1, four times 2^-52 of it.
        let of = |d: f64| Matrix { size: 2, entries: vec![1.0, 0.0, 0.0, d] }.is_positive();
        assert!(of(4.1 * f64::EPSILON) && !of(3.9 * f64::EPSILON) && !of(0.0) && !of(f64::NAN) && !of(f64::INFINITY));
        let tiny = Matrix { size: 1, entries: vec![f64::MIN_POSITIVE] };
        assert!(!tiny.is_positive());
        assert!(Matrix { size: 1, entries: vec![1.5 * f64::MIN_POSITIVE] }.is_positive());
        // Three rows: one of the trace more.
        let of = |d: f64| Matrix { size: 3, entries: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, d] }.is_positive();
        assert!(of(10.2 * f64::EPSILON) && !of(9.8 * f64::EPSILON));
    }

    #[test]
    fn a_scalar_product_counts_every_number_once() {
        for length in 0..40 {
            let numbers: Vec<f64> = (0..length).map(|k| f64::from(k + 1)).collect();
            let others: Vec<f64> = (0..length).map(|k| f64::from(100 - k)).collect();
            let expected: i32 = (0..length).map(|k| (k + 1) * (100 - k)).sum();
            assert_eq!(dot(&numbers, &others), f64::from(expected), "{length}");
        }
    }

    #[test]
    fn a_lift_is_a_share_of_every_number_on_the_diagonal() {
        let mut matrix = Matrix { size: 3, entries: (1..10).map(f64::from).collect() };
        matrix.increase_diagonal(0.5);
        assert_eq!(matrix.entries, [1.5, 2.0, 3.0, 4.0, 7.5, 6.0, 7.0, 8.0, 13.5]);
        assert_eq!(matrix.scaled(2.0).entries[..3], [3.0, 4.0, 6.0]);
    }

    #[test]
    fn factors_solve_and_invert() {
        let mut draws = Random::new(2);
        for size in [1, 2, 7, 8, 9, 30] {
            let mut matrix = gram(&random(&mut draws, size, 2 * size));
            for k in 0..size {
                matrix.entries[k * (size + 1)] += 100.0;
            }
            let factor = matrix.factor().unwrap();
            let right: Vec<f64> = (0..size).map(|k| k as f64 - 3.0).collect();
            let solved = factor.solved(&right);
            let product = matrix.times(&factor.inverse());
            for (i, right) in right.iter().enumerate() {
                assert!((dot(matrix.row(i), &solved) - right).abs() < 1e-10);
                for j in 0..size {
                    let expected = if i == j { 1.0 } else { 0.0 };
                    assert!((product.row(i)[j] - expected).abs() < 1e-10);
                }
            }
        }
        assert!(Matrix { size: 2, entries: vec![1.0, 2.0, 2.0, 1.0] }.factor().is_none());
        assert!(Matrix { size: 2, entries: vec![1.0, 1.0, 1.0, 1.0] }.factor().is_none(), "a pivot of 0");
        let one = Matrix { size: 2, entries: vec![1.0, 2.0, 4.0, 8.0] };
        assert_eq!(one.plus(-0.5, &one).entries, [0.5, 1.0, 2.0, 4.0]);
        assert_eq!(one.symmetric().entries, [1.0, 3.0, 3.0, 8.0]);
    }
}

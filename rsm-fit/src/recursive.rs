//! Recursive least squares: rows one at a time, with a forgetting factor.
//!
//! In: rows of a design matrix with their responses, in the order of time. Out: after each row the coefficients that minimise sum of forgetting^(age)
//! (response - row b)^2. The state is the square-root information form (a triangle R and a right-hand side z with R b = z), updated by Givens
//! rotations in double-double. It starts without rows, not with an assumed covariance, so the result with forgetting factor 1 is that of batch least
//! squares. There is no result until the rows determine the coefficients. Rows are not stored.
//!
//! Source: Golub, Van Loan, Matrix Computations, 6.5.2; Haykin, Adaptive Filter Theory, chapter on square-root adaptive filters
//! (QR-RLS).

use crate::dd::Dd;
use crate::qr::DEPENDENT;

/// The state of recursive least squares.
///
/// ```
/// use rsm_fit::{dd::Dd, recursive::RecursiveLeastSquares};
///
/// let mut line = RecursiveLeastSquares::new(2, 0.99);
/// for time in 0..200 {
///     let time = f64::from(time);
///     line.update(&[Dd::ONE, Dd::from(time)], 3.0 + 0.5 * time);
/// }
/// let found = line.coefficients().unwrap();
/// assert!((found[0] - 3.0).abs() < 1e-9 && (found[1] - 0.5).abs() < 1e-9);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RecursiveLeastSquares {
    /// sqrt(forgetting factor).
    fading: Dd,
    /// The upper triangle, with the right-hand side as last column, row by row.
    triangle: Vec<Vec<Dd>>,
    /// The weighted sum of squares of each column; a small diagonal relative to it means that the column is not determined.
    squares: Vec<Dd>,
    residual_square: Dd,
    rows: usize,
}

impl RecursiveLeastSquares {
    /// A state without rows. The weight of a row is `forgetting` to the power of its age in rows: 1 forgets nothing, 0.99 has a memory of about 100
    /// rows.
    ///
    /// # Panics
    /// If `terms` is 0, or if `forgetting` is not above 0 and at most 1. A factor above 1 would give the oldest rows the largest weight.
    #[must_use]
    pub fn new(terms: usize, forgetting: f64) -> Self {
        assert!(terms > 0, "recursive least squares of no terms");
        assert!(forgetting > 0.0 && forgetting <= 1.0, "forgetting factor {forgetting}, expected above 0 and at most 1");
        RecursiveLeastSquares {
            fading: Dd::from(forgetting).sqrt(),
            triangle: vec![vec![Dd::ZERO; terms + 1]; terms],
            squares: vec![Dd::ZERO; terms],
            residual_square: Dd::ZERO,
            rows: 0,
        }
    }

    /// Adds a row. A row with a NaN or an infinity is rejected, so that it does not destroy the state; the result is then false.
    ///
    /// # Panics
    /// If the row has a different number of terms than the state.
    pub fn update(&mut self, row: &[Dd], response: f64) -> bool {
        assert_eq!(row.len(), self.triangle.len(), "a row has a number for every term");
        if !response.is_finite() || row.iter().any(|x| !x.is_finite()) {
            return false;
        }
        self.rows += 1;
        for row in &mut self.triangle {
            row.iter_mut().for_each(|entry| *entry = *entry * self.fading);
        }
        let forgetting = self.fading * self.fading;
        for (square, x) in self.squares.iter_mut().zip(row) {
            *square = *square * forgetting + *x * *x;
        }
        let mut new: Vec<Dd> = row.iter().copied().chain([Dd::from(response)]).collect();
        for (k, old) in self.triangle.iter_mut().enumerate() {
            if new[k] == Dd::ZERO {
                continue;
            }
            // The rotation that moves new[k] to the diagonal, which is never negative.
            let radius = (old[k] * old[k] + new[k] * new[k]).sqrt();
            let (cosine, sine) = (old[k] / radius, new[k] / radius);
            for (above, below) in old.iter_mut().zip(&mut new).skip(k) {
                (*above, *below) = (cosine * *above + sine * *below, cosine * *below - sine * *above);
            }
        }
        let left = new[row.len()];
        self.residual_square = self.residual_square * forgetting + left * left;
        true
    }

    /// The number of added rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The coefficients; `None` until the rows determine all of them.
    #[must_use]
    pub fn coefficients(&self) -> Option<Vec<f64>> {
        let terms = self.triangle.len();
        let mut b = vec![Dd::ZERO; terms];
        for k in (0..terms).rev() {
            let diagonal = self.triangle[k][k];
            if diagonal.to_f64() <= DEPENDENT * self.squares[k].sqrt().to_f64() {
                return None;
            }
            // Coefficients that are not yet known are 0.
            let known: Dd = self.triangle[k].iter().zip(&b).map(|(r, b)| *r * *b).sum();
            b[k] = (self.triangle[k][terms] - known) / diagonal;
        }
        Some(b.into_iter().map(Dd::to_f64).collect())
    }

    /// The weighted sum of squares of the residuals.
    #[must_use]
    pub fn residual_square(&self) -> f64 {
        self.residual_square.to_f64()
    }
}

#[cfg(test)]
mod tests;

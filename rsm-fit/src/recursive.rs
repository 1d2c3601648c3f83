//! Recursive least squares: rows one at a time, old ones forgotten at a chosen rate.
//!
//! In: rows of a design matrix with their responses, in the order of time. Out: after each row the coefficients that minimise
//! sum of forgetting^(age) (response - row b)^2. Kept in square-root information form (a triangle R and a right-hand side z
//! with R b = z), updated by Givens rotations in double-double: it starts from no rows, not from a made-up covariance, so that
//! with forgetting factor 1 the answer is that of batch least squares. Before the rows determine the coefficients there is no
//! answer. Never keeps a row.
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
    /// Upper triangle with the right-hand side as last column, row by row.
    triangle: Vec<Vec<Dd>>,
    /// Weighted sum of squares of each column, against which its diagonal is judged.
    squares: Vec<Dd>,
    residual_square: Dd,
    rows: usize,
}

impl RecursiveLeastSquares {
    /// Nothing seen yet. The weight of a row is `forgetting` to the power of its age in rows: 1 forgets nothing, 0.99 remembers
    /// about 100 rows.
    ///
    /// # Panics
    /// Unless `terms` is at least 1 and `forgetting` is above 0 and at most 1: a factor above 1 would trust the oldest rows
    /// most.
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

    /// Takes a row in. A row with a NaN or an infinity is refused, so that one bad sample does not poison the state: false
    /// then.
    ///
    /// # Panics
    /// When the row has another number of terms than the state.
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
            // The rotation that takes new[k] into the diagonal, which is never negative.
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

    /// How many rows were taken in.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The coefficients; `None` while the rows do not determine all of them.
    #[must_use]
    pub fn coefficients(&self) -> Option<Vec<f64>> {
        let terms = self.triangle.len();
        let mut b = vec![Dd::ZERO; terms];
        for k in (0..terms).rev() {
            let diagonal = self.triangle[k][k];
            if diagonal.to_f64() <= DEPENDENT * self.squares[k].sqrt().to_f64() {
                return None;
            }
            // What is not known yet is 0.
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

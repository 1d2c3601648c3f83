//! The space in which the residuals of new data are white if nothing is wrong.
//!
//! In: the rows that count, the scale and the correlation of the noise, the columns of the file's terms, and the uncertainty of the file's
//! coefficients. Out: [`Space`], which transforms a column (one value for each row) into a space where ordinary least squares is optimal. The
//! response is not used.
//!
//! The coefficients of a file are estimates. Their error is assumed normal with a covariance sigma^2 C ([`super::sample`] gives C). The covariance of
//! y - f is then sigma^2 (I + X C X'), with X the terms at the new rows. With the eigenvectors u of X C X' and their eigenvalues d, its inverse root
//! is I - sum (1 - 1/sqrt(1 + d)) u u'.

use crate::engine::autoregression::innovations;
use crate::engine::columns::{Basis, dot, subtract};

/// The noise of each row, up to a common factor.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// The relative standard deviation of each row.
    pub scale: Vec<f64>,
    /// The correlation of neighbours in the run order (a first-order autoregression).
    pub rho: f64,
}

/// The transformation to whitened space; see the module.
#[derive(Debug, Clone)]
pub struct Space {
    kept: Vec<usize>,
    scale: Vec<f64>,
    /// Correlation of neighbours in the run order.
    rho: f64,
    /// Eigenvectors and eigenvalues of X C X'.
    directions: Vec<(Vec<f64>, f64)>,
    /// C.
    prior: Vec<Vec<f64>>,
    /// ln of the determinant of the covariance of y - f, sigma 1.
    pub ln_determinant: f64,
}

impl Space {
    /// `kept`: ascending indices of the rows that count; `terms`: the columns of the file's terms at all rows; `prior`: C.
    pub fn new(kept: &[usize], shape: &Shape, terms: &[Vec<f64>], prior: &[Vec<f64>]) -> Self {
        let scale: Vec<f64> = kept.iter().map(|row| shape.scale[*row]).collect();
        let new = innovations(shape.rho, kept.iter().map(|row| (*row, 0.0)));
        let ln_determinant = scale.iter().map(|s| 2.0 * s.ln()).sum::<f64>() + new.map(|it| it.variance.ln()).sum::<f64>();
        let mut space =
            Space { kept: kept.to_vec(), scale, rho: shape.rho, directions: Vec::new(), prior: prior.to_vec(), ln_determinant };
        let whitened: Vec<Vec<f64>> = terms.iter().map(|term| space.whitened(term)).collect();
        let basis = Basis::of(&whitened).directions;
        if basis.is_empty() {
            return space;
        }
        // X = Q R, and the eigenvectors of R C R' turn Q.
        let triangle: Vec<Vec<f64>> = basis.iter().map(|q| whitened.iter().map(|x| dot(q, x)).collect()).collect();
        let spread: Vec<Vec<f64>> = triangle.iter().map(|row| prior.iter().map(|column| dot(row, column)).collect()).collect();
        let product = nalgebra::DMatrix::from_fn(basis.len(), basis.len(), |i, j| dot(&spread[i], &triangle[j]));
        let eigen = nalgebra::SymmetricEigen::new(product);
        for (k, value) in eigen.eigenvalues.iter().enumerate() {
            let mut direction = vec![0.0; space.rows()];
            for (q, part) in basis.iter().zip(eigen.eigenvectors.column(k).iter()) {
                subtract(&mut direction, q, -part);
            }
            space.ln_determinant += value.max(0.0).ln_1p();
            space.directions.push((direction, value.max(0.0)));
        }
        space
    }

    /// The most likely change of the coefficients for a residual, C X'(I + X C X')^-1 r.
    pub fn calibration(&self, residual: &[f64], terms: &[Vec<f64>]) -> Vec<f64> {
        let mut left = self.whitened(residual);
        let parts: Vec<f64> = self.directions.iter().map(|(u, d)| dot(u, &left) * d / (1.0 + d)).collect();
        for ((direction, _), part) in self.directions.iter().zip(parts) {
            subtract(&mut left, direction, part);
        }
        let products: Vec<f64> = terms.iter().map(|term| dot(&self.whitened(term), &left)).collect();
        self.prior.iter().map(|row| dot(row, &products)).collect()
    }

    /// The number of rows that count.
    pub fn rows(&self) -> usize {
        self.kept.len()
    }

    /// A column divided by the noise and decorrelated, with exact coefficients.
    pub fn whitened(&self, column: &[f64]) -> Vec<f64> {
        let values = self.kept.iter().zip(&self.scale).map(|(row, scale)| (*row, column[*row] / scale));
        innovations(self.rho, values).map(|it| it.value / it.sd).collect()
    }

    /// A column in whitened space.
    pub fn in_whitened_space(&self, column: &[f64]) -> Vec<f64> {
        let mut column = self.whitened(column);
        let parts: Vec<f64> = self.directions.iter().map(|(u, d)| (1.0 - 1.0 / (1.0 + d).sqrt()) * dot(u, &column)).collect();
        for ((direction, _), part) in self.directions.iter().zip(parts) {
            subtract(&mut column, direction, part);
        }
        column
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_space_is_the_inverse_root_of_the_covariance() {
        // One term, the constant, at four rows, known as well as from 12 rows: I + 1 1'/12 has the eigenvalue 4/3 along 1; its inverse root maps 1 to
        // sqrt(3)/2.
        let shape = Shape { scale: vec![1.0; 4], rho: 0.0 };
        let (terms, prior) = (vec![vec![1.0; 4]], vec![vec![1.0 / 12.0]]);
        let space = Space::new(&[0, 1, 2, 3], &shape, &terms, &prior);
        for value in space.in_whitened_space(&[1.0; 4]) {
            assert!((value - 0.75_f64.sqrt()).abs() < 1e-15);
        }
        // What is orthogonal to the term stays.
        assert_eq!(space.in_whitened_space(&[1.0, -1.0, 0.0, 0.0])[3].abs(), 0.0);
        // Four rows that are 8 off against twelve that were not: 8 * 4/16.
        assert!((space.calibration(&[8.0; 4], &terms)[0] - 2.0).abs() < 1e-14);
    }

    #[test]
    fn correlation_reaches_over_a_row_that_is_left_out() {
        let shape = Shape { scale: vec![2.0; 4], rho: 0.5 };
        let space = Space::new(&[0, 1, 3], &shape, &[], &[]);
        // Rows 1 and 3 are two steps apart: 0.25. (8/2 - 0.25 * 4/2)/sqrt(1 - 1/16).
        let found = space.whitened(&[2.0, 4.0, 100.0, 8.0]);
        assert!((found[2] - 3.5 / (15.0_f64 / 16.0).sqrt()).abs() < 1e-15);
        let expected = 6.0 * 2.0_f64.ln() + 0.75_f64.ln() + (15.0_f64 / 16.0).ln();
        assert!((space.ln_determinant - expected).abs() < 1e-14);
    }
}

//! The space in which the residuals of new data are white if nothing is wrong.
//!
//! In: the rows that are kept, the scale and the correlation of the noise, the columns of the present terms, and the uncertainty of the file's coefficients. Out: [`Space`],
//! which transforms a column (one value for each row) into a space where ordinary least squares is optimal. Never looks at a response.
//!
//! The coefficients of a file are estimates. Their error is assumed normal with a covariance sigma^2 C ([`super::sample`] says which). The covariance of y - f is then
//! sigma^2 (I + X C X'), with X the terms at the new rows. With the eigenvectors u of X C X' and their eigenvalues d, its inverse root is I - sum (1 - 1/sqrt(1 + d)) u u'.

/// What is known of the noise of each row, up to a common factor.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// Standard deviation of each row, relative.
    pub scale: Vec<f64>,
    /// Correlation of neighbours in the run order (a first-order autoregression).
    pub rho: f64,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Space {
    kept: Vec<usize>,
    scale: Vec<f64>,
    /// Correlation with the row before, by the distance in the run order.
    after: Vec<f64>,
    /// Eigenvectors and eigenvalues of X C X'.
    directions: Vec<(Vec<f64>, f64)>,
    /// C.
    prior: Vec<Vec<f64>>,
    /// ln of the determinant of the covariance of y - f, sigma 1.
    pub ln_determinant: f64,
}

/// A part of a column below this share of it is what rounding leaves of nothing: columns of powers up to seven on [-1, 1] keep some ten digits of 16.
const DEPENDENT: f64 = 1e-6;

impl Space {
    /// `kept` are places among the rows, ascending; `terms` the columns of the present terms at all rows; `prior` is C.
    pub fn new(kept: &[usize], shape: &Shape, terms: &[Vec<f64>], prior: &[Vec<f64>]) -> Self {
        let after: Vec<f64> = kept
            .iter()
            .enumerate()
            .map(|(k, row)| if k == 0 || shape.rho == 0.0 { 0.0 } else { shape.rho.powi((row - kept[k - 1]) as i32) })
            .collect();
        let scale: Vec<f64> = kept.iter().map(|row| shape.scale[*row]).collect();
        let ln_determinant =
            scale.iter().map(|s| 2.0 * s.ln()).sum::<f64>() + after.iter().map(|a| (1.0 - a * a).ln()).sum::<f64>();
        let mut space =
            Space { kept: kept.to_vec(), scale, after, directions: Vec::new(), prior: prior.to_vec(), ln_determinant };
        let whitened: Vec<Vec<f64>> = terms.iter().map(|term| space.whitened(term)).collect();
        let basis = orthonormal(&whitened);
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

    /// The coefficients' move that a residual makes most likely, C X'(I + X C X')^-1 r.
    pub fn calibration(&self, residual: &[f64], terms: &[Vec<f64>]) -> Vec<f64> {
        let mut left = self.whitened(residual);
        let parts: Vec<f64> = self.directions.iter().map(|(u, d)| dot(u, &left) * d / (1.0 + d)).collect();
        for ((direction, _), part) in self.directions.iter().zip(parts) {
            subtract(&mut left, direction, part);
        }
        let products: Vec<f64> = terms.iter().map(|term| dot(&self.whitened(term), &left)).collect();
        self.prior.iter().map(|row| dot(row, &products)).collect()
    }

    /// How many rows are kept.
    pub fn rows(&self) -> usize {
        self.kept.len()
    }

    /// A column in units of the noise and without its correlation, coefficients still exact.
    pub fn whitened(&self, column: &[f64]) -> Vec<f64> {
        let mut last = 0.0;
        let each = self.kept.iter().zip(&self.scale).zip(&self.after).map(|((row, scale), after)| {
            let value = column[*row] / scale;
            let white = (value - after * last) / (1.0 - after * after).sqrt();
            last = value;
            white
        });
        each.collect()
    }

    /// A column in the space.
    pub fn carried(&self, column: &[f64]) -> Vec<f64> {
        let mut column = self.whitened(column);
        let parts: Vec<f64> = self.directions.iter().map(|(u, d)| (1.0 - 1.0 / (1.0 + d).sqrt()) * dot(u, &column)).collect();
        for ((direction, _), part) in self.directions.iter().zip(parts) {
            subtract(&mut column, direction, part);
        }
        column
    }
}

/// a'b.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// a - factor b, in place.
pub(super) fn subtract(a: &mut [f64], b: &[f64], factor: f64) {
    for (x, y) in a.iter_mut().zip(b) {
        *x -= factor * y;
    }
}

/// An orthonormal basis of what columns span (Gram and Schmidt, twice: Kahan and Parlett's "twice is enough"); dependent columns add nothing.
pub(super) fn orthonormal(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for column in columns {
        let before = dot(column, column).sqrt();
        let mut own = column.clone();
        for _ in 0..2 {
            for direction in &basis {
                let part = dot(direction, &own);
                subtract(&mut own, direction, part);
            }
        }
        let norm = dot(&own, &own).sqrt();
        if norm > DEPENDENT * before && norm > 0.0 {
            own.iter_mut().for_each(|x| *x /= norm);
            basis.push(own);
        }
    }
    basis
}

/// ln of the determinant of A'A; columns that others make up are left out.
pub(super) fn ln_gram(columns: &[Vec<f64>]) -> f64 {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut sum = 0.0;
    for column in columns {
        let before = dot(column, column).sqrt();
        let mut own = column.clone();
        for direction in &basis {
            let part = dot(direction, &own);
            subtract(&mut own, direction, part);
        }
        let norm = dot(&own, &own).sqrt();
        if norm > DEPENDENT * before && norm > 0.0 {
            sum += 2.0 * norm.ln();
            own.iter_mut().for_each(|x| *x /= norm);
            basis.push(own);
        }
    }
    sum
}

/// Least squares of `target` on columns, by the normal equations of an orthonormal basis. Columns that others make up get 0.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    /// A coefficient a column.
    pub coefficients: Vec<f64>,
    /// (A'A)^-1, zero for columns that others make up.
    pub covariance: Vec<Vec<f64>>,
    /// What is left of the target.
    pub residual: Vec<f64>,
    /// Columns that count.
    pub rank: usize,
}

/// Solves. Columns are taken in their order.
pub(super) fn solve(columns: &[Vec<f64>], target: &[f64]) -> Solved {
    let width = columns.len();
    // R^-1 by columns, beside the basis: column = sum of basis times R.
    let mut basis: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut triangle: Vec<Vec<f64>> = Vec::new();
    for (k, column) in columns.iter().enumerate() {
        let before = dot(column, column).sqrt();
        let mut own = column.clone();
        let mut parts = vec![0.0; basis.len()];
        for _ in 0..2 {
            for (part, (_, direction)) in parts.iter_mut().zip(&basis) {
                let more = dot(direction, &own);
                subtract(&mut own, direction, more);
                *part += more;
            }
        }
        let norm = dot(&own, &own).sqrt();
        if norm > DEPENDENT * before && norm > 0.0 {
            own.iter_mut().for_each(|x| *x /= norm);
            parts.push(norm);
            triangle.push(parts);
            basis.push((k, own));
        }
    }
    let rank = basis.len();
    let mut residual = target.to_vec();
    let mut right = Vec::with_capacity(rank);
    for (_, direction) in &basis {
        let part = dot(direction, &residual);
        subtract(&mut residual, direction, part);
        right.push(part);
    }
    // R is upper triangular: `triangle[j]` is its column j.
    let back = |mut b: Vec<f64>| {
        for row in (0..rank).rev() {
            b[row] /= triangle[row][row];
            let value = b[row];
            for (above, entry) in b[..row].iter_mut().zip(&triangle[row]) {
                *above -= entry * value;
            }
        }
        b
    };
    let mut coefficients = vec![0.0; width];
    for (value, (k, _)) in back(right).into_iter().zip(&basis) {
        coefficients[*k] = value;
    }
    let inverse: Vec<Vec<f64>> = (0..rank)
        .map(|j| {
            let mut unit = vec![0.0; rank];
            unit[j] = 1.0;
            back(unit)
        })
        .collect();
    let mut covariance = vec![vec![0.0; width]; width];
    for (a, (i, _)) in basis.iter().enumerate() {
        for (b, (j, _)) in basis.iter().enumerate() {
            covariance[*i][*j] = inverse.iter().map(|column| column[a] * column[b]).sum();
        }
    }
    Solved { coefficients, covariance, residual, rank }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_space_is_the_inverse_root_of_the_covariance() {
        // One term, the constant, at four rows, known as well as from 12 rows: I + 1 1'/12 has the eigenvalue 4/3 along 1; its inverse root maps 1 to sqrt(3)/2.
        let shape = Shape { scale: vec![1.0; 4], rho: 0.0 };
        let (terms, prior) = (vec![vec![1.0; 4]], vec![vec![1.0 / 12.0]]);
        let space = Space::new(&[0, 1, 2, 3], &shape, &terms, &prior);
        for value in space.carried(&[1.0; 4]) {
            assert!((value - 0.75_f64.sqrt()).abs() < 1e-15);
        }
        // What is orthogonal to the term stays.
        assert_eq!(space.carried(&[1.0, -1.0, 0.0, 0.0])[3].abs(), 0.0);
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
}

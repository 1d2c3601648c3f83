//! Which columns of a design can be estimated, and the triangle of those that are independent.
//!
//! In: the rows of a design, one number for each column. Out: independent columns with their orthonormal basis and triangle (X = Q R), and each other
//! column as a combination of them. By Gram and Schmidt with a second pass, after which Q is orthogonal to rounding (Giraud, Langou, Rozloznik 2005,
//! "twice is enough").

use crate::plan::optimal::dot;

/// A column is dependent if its component orthogonal to the earlier columns is below this part of it. Settings of a bench have six or seven digits:
/// a difference between columns below 1e-8 is rounding of the settings and no information.
const DEPENDENT: f64 = 1e-8;

/// A column takes part in a combination if its contribution is above this part of the result: below is rounding of [`DEPENDENT`].
const TAKES_PART: f64 = 1e-5;

/// A column that the earlier ones make up.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dependent {
    /// The column.
    pub column: usize,
    /// The independent columns that take part, each with its factor. Empty if the column is zero.
    pub sum: Vec<(usize, f64)>,
}

/// Independent columns of a design.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    /// Their places, ascending.
    pub kept: Vec<usize>,
    /// All other columns.
    pub dependent: Vec<Dependent>,
    /// The orthonormal columns.
    q: Vec<Vec<f64>>,
    /// The columns of R^-1, each as long as its place.
    inverse: Vec<Vec<f64>>,
    /// The logarithm of the product of the diagonal of R.
    log_diagonal: f64,
}

impl Basis {
    pub(super) fn of(rows: &[Vec<f64>]) -> Basis {
        let width = rows.first().map_or(0, Vec::len);
        let mut basis = Basis { kept: vec![], dependent: vec![], q: vec![], inverse: vec![], log_diagonal: 0.0 };
        let mut norms = vec![0.0; width];
        for column in 0..width {
            let mut left: Vec<f64> = rows.iter().map(|row| row[column]).collect();
            let norm = dot(&left, &left).sqrt();
            norms[column] = norm;
            let projection = basis.project_out(&mut left);
            let own = dot(&left, &left).sqrt();
            // R w = projection gives the column as a combination of the kept ones.
            let weights = basis.back(&projection);
            if own <= DEPENDENT * norm || norm == 0.0 {
                let takes_part = |(k, weight): (usize, &f64)| {
                    let place = basis.kept[k];
                    (weight.abs() * norms[place] > TAKES_PART * norm && norm > 0.0).then_some((place, *weight))
                };
                let sum = weights.iter().enumerate().filter_map(takes_part).collect();
                basis.dependent.push(Dependent { column, sum });
                continue;
            }
            left.iter_mut().for_each(|x| *x /= own);
            basis.q.push(left);
            // R^-1 of the larger triangle: the new column is (-R^-1 projection, 1)/own.
            let mut next: Vec<f64> = weights.iter().map(|weight| -weight / own).collect();
            next.push(1.0 / own);
            basis.inverse.push(next);
            basis.kept.push(column);
            basis.log_diagonal += own.ln();
        }
        basis
    }

    /// Subtracts the projection on the kept columns, and returns Q' column.
    fn project_out(&self, left: &mut [f64]) -> Vec<f64> {
        let mut projection = vec![0.0; self.q.len()];
        for _ in 0..2 {
            for (sum, q) in projection.iter_mut().zip(&self.q) {
                let share = dot(q, left);
                left.iter_mut().zip(q).for_each(|(x, q)| *x -= share * q);
                *sum += share;
            }
        }
        projection
    }

    /// R^-1 v.
    fn back(&self, v: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.kept.len()];
        for (column, value) in self.inverse.iter().zip(v) {
            for (sum, entry) in out.iter_mut().zip(column) {
                *sum += entry * value;
            }
        }
        out
    }

    /// ln |X'X| of the kept columns.
    pub(super) fn log_determinant(&self) -> f64 {
        2.0 * self.log_diagonal
    }

    /// Whether a column can be estimated: no combination of columns that is zero contains it.
    pub(super) fn is_estimable(&self, column: usize) -> bool {
        let is_in = |it: &Dependent| it.column == column || it.sum.iter().any(|(other, _)| *other == column);
        !self.dependent.iter().any(is_in)
    }

    /// An entry of (X'X)^-1 of the kept columns, by their places among them.
    pub(super) fn covariance(&self, i: usize, j: usize) -> f64 {
        // R^-1 R^-T: the columns of R^-1 from the larger place on.
        self.inverse[i.max(j)..].iter().map(|column| column[i] * column[j]).sum()
    }

    /// The leverage of each row.
    pub(super) fn leverages(&self, rows: usize) -> Vec<f64> {
        (0..rows).map(|row| self.q.iter().map(|q| q[row] * q[row]).sum()).collect()
    }

    /// The coefficients of the kept columns for another column, by least squares: a column of the alias matrix.
    pub(super) fn coefficients(&self, column: &[f64]) -> Vec<f64> {
        self.back(&self.project_out(&mut column.to_vec()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependent_columns_are_named_with_their_combination() {
        // 1, x, x^2 at -1 and 1, then 2 - 3 x: x^2 = 1, and the last is 2 - 3 x.
        let rows: Vec<Vec<f64>> = [-1.0f64, 1.0, 1.0].iter().map(|x| vec![1.0, *x, x * x, 0.0, 2.0 - 3.0 * x]).collect();
        let basis = Basis::of(&rows);
        assert_eq!(basis.kept, [0, 1]);
        let sums: Vec<(usize, Vec<(usize, f64)>)> = basis
            .dependent
            .iter()
            .map(|it| (it.column, it.sum.iter().map(|(k, weight)| (*k, weight.round())).collect()))
            .collect();
        assert_eq!(sums, [(2, vec![(0, 1.0)]), (3, vec![]), (4, vec![(0, 2.0), (1, -3.0)])]);
        assert!((0..5).all(|column| !basis.is_estimable(column)));
        let alone = Basis::of(&rows.iter().map(|row| row[..3].to_vec()).collect::<Vec<_>>());
        assert!(alone.is_estimable(1) && !alone.is_estimable(0) && !alone.is_estimable(2));
    }

    #[test]
    fn a_straight_line_has_the_numbers_of_the_formula() {
        // 1, x at 0, 1, 2, 5: n = 4, sum 8, squares 30; the determinant 4 * 30 - 64 = 56.
        let x = [0.0, 1.0, 2.0, 5.0];
        let rows: Vec<Vec<f64>> = x.iter().map(|x| vec![1.0, *x]).collect();
        let basis = Basis::of(&rows);
        // Some operations on numbers below 100: a few 1e-15.
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        near(basis.log_determinant(), 56f64.ln());
        near(basis.covariance(0, 0), 30.0 / 56.0);
        near(basis.covariance(1, 0), -8.0 / 56.0);
        near(basis.covariance(1, 1), 4.0 / 56.0);
        for (row, leverage) in basis.leverages(4).into_iter().enumerate() {
            near(leverage, (30.0 - 16.0 * x[row] + 4.0 * x[row] * x[row]) / 56.0);
        }
        // x^2 by least squares: sum x^3 = 134, sum x^2 = 30.
        let squares: Vec<f64> = x.iter().map(|x| x * x).collect();
        let fitted = basis.coefficients(&squares);
        near(fitted[0], (30.0 * 30.0 - 8.0 * 134.0) / 56.0);
        near(fitted[1], (4.0 * 134.0 - 8.0 * 30.0) / 56.0);
    }
}

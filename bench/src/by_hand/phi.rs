//! Functions of small matrices for exponential integrators.
//!
//! In: a matrix A and a span. Out: the functions phi_1, phi_2, phi_3 of A h for the span and for its half, quarter and so on, where phi_0(z) = e^z
//! and phi_k+1(z) = (phi_k(z) - 1/k!)/z. They are computed by scaling and doubling (B. V. Minchev, W. M. Wright, "A review of exponential integrators
//! for first order semi-linear problems", 2005, section 7), which gives the halves without additional cost. No matrix is inverted, so a singular
//! matrix, for example of a free body, is no special case.

/// The norm of A h below which the series are used; there each term is smaller than the one before by a factor of 2 (k + 3).
const SMALL: f64 = 0.5;

/// The number of terms: 0.5^13/(16!/3!) is 3e-17 of the first.
const TERMS: u32 = 13;

/// A square matrix, column by column.
#[derive(Debug, Clone)]
pub(super) struct Matrix<const N: usize>(pub Box<[[f64; N]; N]>);

impl<const N: usize> Matrix<N> {
    pub(super) fn zero() -> Self {
        Matrix(Box::new([[0.0; N]; N]))
    }

    /// The matrix times a vector.
    #[inline]
    pub(super) fn times(&self, vector: &[f64; N]) -> [f64; N] {
        let mut product = [0.0; N];
        for (column, factor) in self.0.iter().zip(vector) {
            for (sum, value) in product.iter_mut().zip(column) {
                *sum += value * factor;
            }
        }
        product
    }

    /// The product self other.
    pub(super) fn product(&self, other: &Self) -> Self {
        let mut product = Self::zero();
        for (column, of_other) in product.0.iter_mut().zip(other.0.iter()) {
            *column = self.times(of_other);
        }
        product
    }

    /// The sum factor self + diagonal I.
    pub(super) fn scaled(&self, factor: f64, diagonal: f64) -> Self {
        let mut scaled = self.clone();
        for (j, column) in scaled.0.iter_mut().enumerate() {
            column.iter_mut().for_each(|value| *value *= factor);
            column[j] += diagonal;
        }
        scaled
    }

    /// The sum factor (self + share other).
    pub(super) fn combined(&self, factor: f64, other: &Self, share: f64) -> Self {
        let mut sum = self.clone();
        for (column, of_other) in sum.0.iter_mut().zip(other.0.iter()) {
            for (value, other) in column.iter_mut().zip(of_other) {
                *value = factor * (*value + share * other);
            }
        }
        sum
    }

    /// The largest column sum.
    pub(super) fn norm(&self) -> f64 {
        self.0.iter().map(|column| column.iter().map(|value| value.abs()).sum()).fold(0.0, f64::max)
    }
}

/// phi_1, phi_2 and phi_3 of A h.
pub(super) struct Functions<const N: usize> {
    pub one: Matrix<N>,
    pub two: Matrix<N>,
    pub three: Matrix<N>,
}

/// The functions of A span/2^k for k from 0 to `levels`.
pub(super) fn functions<const N: usize>(a: &Matrix<N>, span: f64, levels: usize) -> Vec<Functions<N>> {
    let norm = a.norm() * span;
    // A norm that is not finite gives one level of values that are not finite, and the caller stops.
    let doublings = if norm.is_finite() { (norm / SMALL).log2().ceil().max(0.0) as usize } else { 0 };
    let deepest = doublings.max(levels);
    let z = a.scaled(span * 0.5_f64.powi(deepest as i32), 0.0);
    // The series phi_3 = 1/3! + z/4! + z^2/5! ..., nested: each term is the one before times z/(k + 3).
    let mut three = Matrix::zero().scaled(1.0, 1.0);
    for k in (1..=TERMS).rev() {
        three = z.product(&three).scaled(1.0 / f64::from(k + 3), 1.0);
    }
    three = three.scaled(1.0 / 6.0, 0.0);
    let two = z.product(&three).scaled(1.0, 0.5);
    let one = z.product(&two).scaled(1.0, 1.0);
    let mut zero = z.product(&one).scaled(1.0, 1.0);
    let mut now = Functions { one, two, three };
    let mut list = Vec::with_capacity(levels + 1);
    for level in (0..=deepest).rev() {
        if level > 0 {
            // The doubling: phi_1(2z) = (e^z + 1) phi_1/2, phi_2(2z) = (phi_1^2 + 2 phi_2)/4, phi_3(2z) = (phi_1 phi_2 + phi_2 + 2 phi_3)/8.
            let next = Functions {
                one: zero.scaled(0.5, 0.5).product(&now.one),
                two: now.one.product(&now.one).combined(0.25, &now.two, 2.0),
                three: now.one.scaled(1.0, 1.0).product(&now.two).combined(0.125, &now.three, 2.0),
            };
            zero = zero.product(&zero);
            let before = std::mem::replace(&mut now, next);
            if level <= levels {
                list.push(before);
            }
        }
    }
    list.push(now);
    list.reverse();
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    /// phi_1 to phi_3 of a number, from their definition. For numbers of magnitude 1 and more it loses no digits.
    fn plain(z: f64) -> [f64; 3] {
        let one = (z.exp() - 1.0) / z;
        let two = (one - 1.0) / z;
        [one, two, (two - 0.5) / z]
    }

    #[test]
    fn a_triangular_matrix_by_its_eigenvectors() {
        // A = [-2 3; 0 -800] has the eigenvectors (1, 0) and (3, -798): f(A)(3, -798) = f(-800)(3, -798), so the corner is
        // 3 (f(-2) - f(-800))/798.
        let mut a = Matrix::<2>::zero();
        (a.0[0][0], a.0[1][0], a.0[1][1]) = (-2.0, 3.0, -800.0);
        for (level, found) in functions(&a, 1.0, 3).iter().enumerate() {
            let h = 0.5_f64.powi(level as i32);
            let (slow, fast) = (plain(-2.0 * h), plain(-800.0 * h));
            for (k, matrix) in [&found.one, &found.two, &found.three].into_iter().enumerate() {
                let corner = 3.0 * (slow[k] - fast[k]) / 798.0;
                // The tolerance covers eleven doublings of numbers near 1, and the digits that the definition loses at -0.25.
                for (found, expected) in
                    [(matrix.0[0][0], slow[k]), (matrix.0[1][1], fast[k]), (matrix.0[1][0], corner), (matrix.0[0][1], 0.0)]
                {
                    assert!((found - expected).abs() < 1e-12, "level {level}, phi_{}: {found} for {expected}", k + 1);
                }
            }
        }
    }

    #[test]
    fn of_nothing_they_are_the_series_first_terms() {
        let found = &functions(&Matrix::<3>::zero(), 0.1, 0)[0];
        assert_eq!([found.one.0[1][1], found.two.0[1][1], found.three.0[1][1]], [1.0, 0.5, 1.0 / 6.0]);
    }
}

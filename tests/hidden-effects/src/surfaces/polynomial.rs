//! Polynomials in coded inputs and a fit of them, only for this package.
//!
//! In: inputs with ranges, terms with coefficients, rows. Out: values; coefficients by least squares. It shares nothing with rsm-fit: plain f64 and
//! normal equations by Gauss and Jordan with pivoting, which is sufficient for random designs on -1..1 up to third order.

/// An input.
#[derive(Debug, Clone)]
pub struct Input {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Lowest and highest value.
    pub range: [f64; 2],
}

impl Input {
    /// Codes a value: -1..1 over the range.
    pub fn coded(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        (2.0 * value - low - high) / (high - low)
    }

    /// The inverse of `coded`.
    pub fn natural(&self, x: f64) -> f64 {
        let [low, high] = self.range;
        low + (high - low) * (x + 1.0) / 2.0
    }
}

/// A term: powers of the inputs.
pub type Powers = Vec<u32>;

/// A product of powers at coded values.
pub fn monomial(powers: &[u32], x: &[f64]) -> f64 {
    powers.iter().zip(x).map(|(power, x)| x.powi(*power as i32)).product()
}

/// A sum of terms.
pub fn value(terms: &[(Powers, f64)], x: &[f64]) -> f64 {
    terms.iter().map(|(powers, coefficient)| coefficient * monomial(powers, x)).sum()
}

/// All powers of this number of inputs up to an order. Their order has no meaning.
pub fn up_to(inputs: usize, order: u32) -> Vec<Powers> {
    let mut all: Vec<Powers> = vec![Vec::new()];
    for _ in 0..inputs {
        all = all
            .iter()
            .flat_map(|begun| {
                let left = order - begun.iter().sum::<u32>();
                (0..=left).map(move |power| begun.iter().copied().chain([power]).collect())
            })
            .collect();
    }
    all.sort_by_key(|powers| (powers.iter().sum::<u32>(), std::cmp::Reverse(powers.clone())));
    all
}

/// Least squares.
pub fn fit(powers: &[Powers], points: &[Vec<f64>], y: &[f64]) -> Vec<f64> {
    let width = powers.len();
    let mut matrix = vec![vec![0.0; width + 1]; width];
    for (x, y) in points.iter().zip(y) {
        let row: Vec<f64> = powers.iter().map(|powers| monomial(powers, x)).collect();
        for i in 0..width {
            for j in 0..width {
                matrix[i][j] += row[i] * row[j];
            }
            matrix[i][width] += row[i] * y;
        }
    }
    for k in 0..width {
        let pivot = (k..width).max_by(|a, b| matrix[*a][k].abs().total_cmp(&matrix[*b][k].abs())).unwrap_or(k);
        matrix.swap(k, pivot);
        let head = matrix[k].clone();
        for (i, row) in matrix.iter_mut().enumerate() {
            if i != k {
                let factor = row[k] / head[k];
                row.iter_mut().zip(&head).for_each(|(x, h)| *x -= factor * h);
            }
        }
    }
    (0..width).map(|k| matrix[k][width] / matrix[k][k]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_gives_the_polynomial_back() {
        let powers = up_to(2, 2);
        assert_eq!(powers.len(), 6);
        let truth: Vec<(Powers, f64)> = powers.iter().cloned().zip([3.0, -1.0, 2.0, 0.5, -0.25, 4.0]).collect();
        let points: Vec<Vec<f64>> = (0..30).map(|k| vec![f64::from(k % 6) / 2.5 - 1.0, f64::from(k / 6) / 2.0 - 1.0]).collect();
        let y: Vec<f64> = points.iter().map(|x| value(&truth, x)).collect();
        for (found, (_, exact)) in fit(&powers, &points, &y).iter().zip(&truth) {
            assert!((found - exact).abs() < 1e-10);
        }
    }
}

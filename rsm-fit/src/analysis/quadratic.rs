//! A second-order surface: its stationary point with principal axes, and paths.
//!
//! In: y = b0 + b'x + x'Bx in coded variables. Out: the stationary point, the principal axes with their vectors, the path of steepest ascent (ridge
//! analysis: the largest response at each distance from the centre) or descent, and the path along a principal axis. All in coded variables.
//!
//! Source: Hoerl 1959 and Draper 1963 (ridge analysis); Box, Wilson 1951 (steepest ascent); Myers, Montgomery, Anderson-Cook, chapters 5 and 6.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rsm_core::order;
use serde::Serialize;

/// A point of a path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathPoint {
    /// The distance from the start of the path, in coded units; signed along an axis.
    pub distance: f64,
    /// The coded point.
    pub at: Vec<f64>,
    /// The value of the surface there.
    pub value: f64,
}

/// A surface of first or second order.
///
/// ```
/// use rsm_fit::analysis::Quadratic;
///
/// // 5 + 2 x - x^2 - z^2: a maximum at x = 1, z = 0.
/// let surface = Quadratic::new(5.0, &[2.0, 0.0], &[&[-1.0, 0.0], &[0.0, -1.0]]);
/// assert_eq!(surface.stationary_point().unwrap(), [1.0, 0.0]);
/// let path = surface.steepest(&[0.5], true);
/// assert!((path[0].at[0] - 0.5).abs() < 1e-12 && path[0].at[1].abs() < 1e-12);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Quadratic {
    constant: f64,
    slope: DVector<f64>,
    matrix: DMatrix<f64>,
}

impl Quadratic {
    /// A surface from the constant, the slopes and the matrix. The diagonal of the matrix has the pure quadratic coefficients; each element off the
    /// diagonal is half an interaction.
    ///
    /// # Panics
    /// If the matrix is not square with the size of the slopes.
    #[must_use]
    pub fn new(constant: f64, slope: &[f64], matrix: &[&[f64]]) -> Self {
        let width = slope.len();
        assert!(matrix.len() == width && matrix.iter().all(|row| row.len() == width), "a row and a column for each slope");
        let symmetric = |row: usize, column: usize| 0.5 * (matrix[row][column] + matrix[column][row]);
        Quadratic { constant, slope: DVector::from_row_slice(slope), matrix: DMatrix::from_fn(width, width, symmetric) }
    }

    /// A surface from terms of at most second order: powers with coefficients. `None` if a term has a higher order.
    #[must_use]
    pub fn of_terms<'a>(width: usize, terms: impl IntoIterator<Item = (&'a [u32], f64)>) -> Option<Self> {
        let (mut constant, mut slope, mut matrix) = (0.0, DVector::zeros(width), DMatrix::zeros(width, width));
        for (powers, coefficient) in terms {
            let places: Vec<usize> = (0..powers.len()).flat_map(|k| vec![k; powers[k] as usize]).collect();
            match places[..] {
                [] => constant += coefficient,
                [k] if k < width => slope[k] += coefficient,
                [j, k] if k < width => {
                    matrix[(j, k)] += 0.5 * coefficient;
                    matrix[(k, j)] += 0.5 * coefficient;
                }
                _ => return None,
            }
        }
        Some(Quadratic { constant, slope, matrix })
    }

    /// The surface at a coded point.
    #[must_use]
    pub fn value(&self, at: &[f64]) -> f64 {
        let x = DVector::from_row_slice(at);
        self.constant + self.slope.dot(&x) + x.dot(&(&self.matrix * &x))
    }

    /// The point with zero gradient. `None` if there is none, or a whole line of them.
    #[must_use]
    pub fn stationary_point(&self) -> Option<Vec<f64>> {
        let values = self.axes();
        let most = values.iter().map(|(value, _)| value.abs()).fold(0.0, f64::max);
        // The rounding error of eigenvalues: 2^-53 of the largest.
        if values.is_empty() || values.iter().any(|(value, _)| value.abs() <= 1e-14 * most) {
            return None;
        }
        Some(self.matrix.clone().lu().solve(&(&self.slope * -0.5))?.iter().copied().collect())
    }

    /// The principal axes: curvature and unit vector, the largest curvature first.
    #[must_use]
    pub fn axes(&self) -> Vec<(f64, Vec<f64>)> {
        let eigen = SymmetricEigen::new(self.matrix.clone());
        let mut axes: Vec<(f64, Vec<f64>)> = (0..self.slope.len())
            .map(|k| (eigen.eigenvalues[k], eigen.eigenvectors.column(k).iter().copied().collect()))
            .collect();
        order::descending(&mut axes, |it| it.0);
        axes
    }

    /// The points with the largest value (`ascent`), or the smallest, at distances from the centre of the coded variables. For a first-order surface,
    /// this is a straight line along the gradient.
    #[must_use]
    pub fn steepest(&self, distances: &[f64], ascent: bool) -> Vec<PathPoint> {
        let sign = if ascent { 1.0 } else { -1.0 };
        let surface = Quadratic { constant: self.constant, slope: &self.slope * sign, matrix: &self.matrix * sign };
        let axes = surface.axes();
        distances
            .iter()
            .map(|distance| {
                let at = surface.greatest(&axes, *distance);
                let value = self.value(&at);
                PathPoint { distance: *distance, at, value }
            })
            .collect()
    }

    /// The point of the largest value at a distance r: x(m) = (m I - B)^-1 b/2 with |x| = r and m above all curvatures.
    fn greatest(&self, axes: &[(f64, Vec<f64>)], distance: f64) -> Vec<f64> {
        let along: Vec<f64> =
            axes.iter().map(|(_, v)| 0.5 * v.iter().zip(self.slope.iter()).map(|(v, b)| v * b).sum::<f64>()).collect();
        let norm = |m: f64| axes.iter().zip(&along).map(|((c, _), b)| (b / (m - c)).powi(2)).sum::<f64>().sqrt();
        let top = axes.first().map_or(0.0, |(curvature, _)| *curvature);
        let slope = along.iter().map(|b| b * b).sum::<f64>().sqrt();
        let place = |shares: Vec<f64>| -> Vec<f64> {
            (0..axes.len()).map(|k| axes.iter().zip(&shares).map(|((_, v), share)| share * v[k]).sum()).collect()
        };
        if distance == 0.0 {
            return vec![0.0; axes.len()];
        }
        let scale = slope / distance + axes.iter().map(|(c, _)| (top - c).abs()).fold(0.0, f64::max);
        // |x| decreases from m = top to m = top + slope/r, where it is at most r.
        let (mut low, mut high) = (top + 1e-14 * scale, top + slope / distance + 1e-14 * scale);
        if norm(low) < distance {
            // The slope has no component along the axis of the largest curvature, so the path continues along this axis.
            let shares: Vec<f64> =
                axes.iter().zip(&along).map(|((c, _), b)| if top - c > 1e-12 * scale { b / (top - c) } else { 0.0 }).collect();
            let rest = distance * distance - shares.iter().map(|share| share * share).sum::<f64>();
            let mut shares = shares;
            shares[0] = rest.max(0.0).sqrt();
            return place(shares);
        }
        // Up to the last bit of m.
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if norm(middle) > distance { low = middle } else { high = middle }
        }
        place(axes.iter().zip(&along).map(|((c, _), b)| b / (high - c)).collect())
    }

    /// Points along a principal axis (0: the largest curvature) through the stationary point. `None` if there is no such point or axis.
    #[must_use]
    pub fn along_axis(&self, axis: usize, distances: &[f64]) -> Option<Vec<PathPoint>> {
        let start = self.stationary_point()?;
        let (_, direction) = self.axes().into_iter().nth(axis)?;
        let of_one = |distance: &f64| {
            let at: Vec<f64> = start.iter().zip(&direction).map(|(x, d)| x + distance * d).collect();
            PathPoint { distance: *distance, value: self.value(&at), at }
        };
        Some(distances.iter().map(of_one).collect())
    }
}

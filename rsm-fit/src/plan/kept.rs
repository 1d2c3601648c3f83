//! The effect of `where` on a design with fixed points: a factorial, a central composite or a Box-Behnken design.
//!
//! In: the points of the whole design and those that fulfil `where`. Out: the number of removed points, and the lost properties. The properties of
//! such a design belong to the whole set of its points. Without some of them factors are correlated, and the variance of a prediction changes.

use nalgebra::DMatrix;

use super::Design;

/// The remaining part of a design.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// The number of different points of the whole design, without centre points.
    pub of: usize,
    /// The number of points that fulfil `where`.
    pub points: usize,
    /// The largest correlation between the settings of two factors, in the whole design and in the remaining one; 0 for a single factor.
    pub correlation: [f64; 2],
    /// Whether the whole design was rotatable. With fewer points, the variance of a prediction depends on the direction.
    pub was_rotatable: bool,
}

impl Kept {
    /// `all` and `kept`: points with one setting for each factor. `lost`: the terms that only the whole design can estimate.
    pub(super) fn of(
        design: &Design,
        all: &[Vec<f64>],
        kept: &[Vec<f64>],
        centre: &[f64],
        centre_points: usize,
    ) -> (Kept, usize) {
        let was_rotatable = match design {
            Design::CentralComposite { alpha } => *alpha == super::points::rotatable_alpha(centre.len()),
            // Box, Behnken 1960: of the designs in this list those of four and seven factors are rotatable.
            Design::BoxBehnken => matches!(centre.len(), 4 | 7),
            _ => false,
        };
        let order = if design.is_of_first_order() { 1 } else { 2 };
        let told_apart = |points: &[Vec<f64>]| {
            let mut points = points.to_vec();
            points.extend((centre_points > 0).then(|| centre.to_vec()));
            rank(&scaled(&points, all), order)
        };
        let lost = told_apart(all) - told_apart(kept);
        let correlation = [largest_correlation(all), largest_correlation(kept)];
        (Kept { of: all.len(), points: kept.len(), correlation, was_rotatable }, lost)
    }

    /// The number of removed points.
    #[must_use]
    pub fn left_out(&self) -> usize {
        self.of - self.points
    }

    /// A sentence for the user.
    #[must_use]
    pub fn words(&self, design: &str) -> String {
        let [whole, left] = self.correlation;
        // A thousandth is above rounding and below what matters.
        let correlated = if left > whole + 1e-3 {
            format!("two factors have a correlation of {left:.2} ({whole:.2} in the complete design)")
        } else {
            "no two factors are correlated more than in the complete design".to_string()
        };
        let rotatable = if self.was_rotatable { ", and the design is no longer rotatable" } else { "" };
        format!(
            "`where` keeps only {} of the {} points of the {design} design, so the properties of the complete design do not hold: {correlated}{rotatable}",
            self.points, self.of
        )
    }
}

/// Points relative to the middle, in half ranges of the whole design.
fn scaled(points: &[Vec<f64>], all: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let ends = |k: usize| {
        let of = |pick: fn(f64, f64) -> f64, from: f64| all.iter().map(|point| point[k]).fold(from, pick);
        (of(f64::min, f64::INFINITY), of(f64::max, f64::NEG_INFINITY))
    };
    let coded = |(k, x): (usize, &f64)| {
        let (low, high) = ends(k);
        if high > low { (2.0 * x - low - high) / (high - low) } else { 0.0 }
    };
    points.iter().map(|point| point.iter().enumerate().map(coded).collect()).collect()
}

/// The number of terms up to an order, 1 or 2, that the points can estimate.
fn rank(points: &[Vec<f64>], order: usize) -> usize {
    let row = |point: &Vec<f64>| {
        let mut terms = vec![1.0];
        terms.extend(point);
        if order > 1 {
            terms.extend(point.iter().enumerate().flat_map(|(k, x)| point[k..].iter().map(move |z| x * z)));
        }
        terms
    };
    let rows: Vec<Vec<f64>> = points.iter().map(row).collect();
    let Some(first) = rows.first() else { return 0 };
    let matrix = DMatrix::from_row_iterator(rows.len(), first.len(), rows.iter().flatten().copied());
    // The entries are of size 1. A dependent column leaves about 1e-15 times the square root of their number, an independent one at least some
    // hundredths.
    matrix.rank(1e-9 * (rows.len() as f64).sqrt())
}

/// The largest magnitude of the correlation between any two factors.
fn largest_correlation(points: &[Vec<f64>]) -> f64 {
    let Some(factors) = points.first().map(Vec::len) else { return 0.0 };
    let n = points.len() as f64;
    let centred = |k: usize| {
        let mean = points.iter().map(|point| point[k]).sum::<f64>() / n;
        points.iter().map(|point| point[k] - mean).collect::<Vec<f64>>()
    };
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let columns: Vec<Vec<f64>> = (0..factors).map(centred).collect();
    let mut largest = 0f64;
    for (k, a) in columns.iter().enumerate() {
        for b in &columns[..k] {
            let size = (product(a, a) * product(b, b)).sqrt();
            if size > 0.0 {
                largest = largest.max((product(a, b) / size).abs());
            }
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<Vec<f64>> {
        (0..3).flat_map(|a| (0..3).map(move |b| vec![10.0 + f64::from(a), -f64::from(b)])).collect()
    }

    #[test]
    fn correlations_are_those_of_hand() {
        // Of a triangle (0, 0), (1, 0), (0, 1): means 1/3; products -1/9 ... : -1/3 over 2/3.
        let triangle = [vec![0.0, 0.0], vec![1.0, 0.0], vec![0.0, 1.0]];
        assert!((largest_correlation(&triangle) - 0.5).abs() < 1e-15);
        assert!(largest_correlation(&grid()) < 1e-15);
        assert_eq!(largest_correlation(&[vec![1.0], vec![2.0]]), 0.0);
        // One that does not change is correlated with nothing.
        assert_eq!(largest_correlation(&[vec![1.0, 5.0], vec![2.0, 5.0]]), 0.0);
        assert_eq!(largest_correlation(&[]), 0.0);
    }

    #[test]
    fn the_terms_that_points_tell_apart_are_counted() {
        let coded = scaled(&grid(), &grid());
        assert_eq!(coded[0], [-1.0, 1.0]);
        assert_eq!([rank(&coded, 1), rank(&coded, 2)], [3, 6]);
        let diagonal: Vec<Vec<f64>> = coded.iter().filter(|point| point[0] == point[1]).cloned().collect();
        assert_eq!([rank(&diagonal, 1), rank(&diagonal, 2), rank(&[], 2)], [2, 3, 0]);
        // A factor that never changes takes no part.
        assert_eq!(rank(&scaled(&[vec![5.0], vec![5.0]], &[vec![5.0], vec![5.0]]), 1), 1);
    }

    #[test]
    fn what_is_left_is_measured_and_said() {
        let design = Design::CentralComposite { alpha: super::super::points::rotatable_alpha(2) };
        let all = super::super::points::central_composite(2, super::super::points::rotatable_alpha(2));
        let of = |holds: fn(&Vec<f64>) -> bool, centre| {
            let kept: Vec<Vec<f64>> = all.iter().filter(|point| holds(point)).cloned().collect();
            Kept::of(&design, &all, &kept, &[0.0, 0.0], centre)
        };
        // Without the corner (1, 1): 7 points, sums 0 - 1 each, squares 8 - 1, product -1: -1 - 1/7 over 7 - 1/7.
        let (kept, lost) = of(|point| point[0] + point[1] < 1.5, 1);
        assert_eq!((kept.of, kept.points, kept.left_out(), kept.was_rotatable, lost), (8, 7, 1, true, 0));
        assert!(kept.correlation[0] < 1e-15 && (kept.correlation[1] - 8.0 / 48.0).abs() < 1e-14, "{kept:?}");
        assert_eq!(
            kept.words("central-composite"),
            "`where` keeps only 7 of the 8 points of the central-composite design, so the properties of the complete design do not hold: two factors have a \
             correlation of 0.17 (0.00 in the complete design), and the design is no longer rotatable"
        );
        // The corners alone: nothing correlated, and no square told from the constant; one with the centre.
        let (kept, lost) = of(|point| point[0].abs() < 1.2 && point[1].abs() < 1.2 && point[0] != 0.0 && point[1] != 0.0, 1);
        assert_eq!((kept.points, lost), (4, 1));
        assert!(kept.words("x").contains("no two factors are correlated more than"));
        assert_eq!(of(|_| true, 0).0.left_out(), 0);
    }
}

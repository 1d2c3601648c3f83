//! How far the coefficients of a merge can differ from those of one fit of all rows.
//!
//! In: the solved problem of the merge and the number of reductions. Out: a bound for each coefficient, in its unit.
//!
//! Both fits are Householder reductions of the same rows in double-double numbers, in other blocks. A reflection of a column of m numbers changes it
//! by less than 40 m e of its norm (two sums of m products, the norm of the tail, the division: at most 6 m + 31 operations, each with an error of at
//! most e, see below; the sums of large tables have fewer operations and no larger error, `dd/lanes.rs`). A reduction of a block of h rows has one
//! reflection for each of its w columns, and its result is a row block of a later reduction. So each computed triangle is the exact one of rows in
//! which column j is changed by at most d |x_j|, where d = 40 e w (sum of all h). The sum of all h is the number of rows plus w for each reduction,
//! which holds the triangle of those before (Higham, Accuracy and Stability of Numerical Algorithms, 2002, lemma 19.3 and theorem 19.4, applied block
//! by block).
//!
//! To first order, such a change moves the least-squares coefficient b_j by at most
//!
//! ```text
//!   d v_j (|y| + sum_k |x_k| |b_k| + |r| sum_k v_k |x_k|),    v_j^2 the j-th diagonal entry of (X'X)^-1, r the residual
//! ```
//!
//! (Bjorck, Numerical Methods for Least Squares Problems, 1996, 1.4.3, with |(X'X)^-1|_jk <= v_j v_k). Terms of second order are smaller than these
//! if d sum_k v_k |x_k| is at most 1/4; the bound is doubled for them, and there is none otherwise. Coefficients are rounded to f64 in both fits.

use crate::qr::{Growing, Triangle};

/// The relative error of an operation: 2^-100 is above that of every operation of `dd.rs`, where a test checks them.
const OPERATION: f64 = 1.0 / (1u128 << 100) as f64;

/// Errors of a reflection, in operations for each number: 6 m + 31 is at most 40 m.
const OF_REFLECTION: f64 = 40.0;

/// Rounding to f64.
const ROUNDING: f64 = f64::EPSILON / 2.0;

/// A coefficient below this share of the response is set to 0 (`statistics.rs`); one fit may do so, and the other not.
const SET_TO_ZERO: f64 = 1.0 / (1u128 << 84) as f64;

/// Up to this relative change of the columns the doubled terms of first order are a bound.
const SMALL: f64 = 0.25;

/// The work of both fits.
pub(super) struct Work {
    /// All rows.
    pub rows: usize,
    /// The number of reductions: those of the parts, that of the merge, and those of one fit.
    pub reductions: usize,
    /// Whether rows have weights.
    pub is_weighted: bool,
}

/// The bound of each coefficient; `None` if the columns are too nearly dependent for one.
pub(super) fn of(triangle: &Triangle, growing: &Growing, coefficients: &[f64], work: &Work) -> Option<Vec<f64>> {
    let (response, residual) = (triangle.response_square().sqrt().to_f64(), growing.residual_square().sqrt().to_f64());
    let whole = |((moved, v), (b, place)): ((f64, &f64), (&f64, usize))| {
        // One fit divides weights by their mean in f64: each has a relative error of 2^-53, and moves b by that of v_j |r|.
        let weighted = if work.is_weighted { ROUNDING * v * residual } else { 0.0 };
        moved + weighted + 2.0 * ROUNDING * b.abs() + SET_TO_ZERO * response / growing.norm(place)
    };
    let deviations = deviations(growing);
    let moved = before_rounding(triangle, growing, coefficients, work)?;
    Some(moved.into_iter().zip(&deviations).zip(coefficients.iter().zip(0..)).map(whole).collect())
}

/// The bound for coefficients in double-double.
fn before_rounding(triangle: &Triangle, growing: &Growing, coefficients: &[f64], work: &Work) -> Option<Vec<f64>> {
    let width = triangle.columns().len() as f64;
    // The choice of columns is one more reduction of a triangle, in either fit.
    let heights = 2.0 * work.rows as f64 + (work.reductions as f64 + 2.0) * width;
    let change = OF_REFLECTION * OPERATION * width * heights;
    let norms: Vec<f64> = (0..coefficients.len()).map(|place| growing.norm(place)).collect();
    let deviations = deviations(growing);
    let condition: f64 = norms.iter().zip(&deviations).map(|(norm, v)| norm * v).sum();
    let fitted: f64 = norms.iter().zip(coefficients).map(|(norm, b)| norm * b.abs()).sum();
    let response = triangle.response_square().sqrt().to_f64();
    let residual = growing.residual_square().sqrt().to_f64();
    let is_small = change * condition <= SMALL;
    is_small.then(|| deviations.iter().map(|v| 2.0 * change * v * (response + fitted + residual * condition)).collect())
}

/// The square roots of the diagonal of (X'X)^-1.
fn deviations(growing: &Growing) -> Vec<f64> {
    growing.variances().into_iter().map(|variance| variance.sqrt().to_f64()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dd::Dd;
    use crate::qr::{BLOCK, Compressed};
    use crate::random::Random;

    /// The triangle of some rows of 1, x, ..., x^9 on [3, 9], as in NIST's Filip: a condition of some 10^9 of scaled columns.
    fn triangle(rows: &[(f64, f64)]) -> Triangle {
        let mut compressed = Compressed::new(11);
        for (x, y) in rows {
            let powers = (0..10).scan(Dd::ONE, |power, _| Some(std::mem::replace(power, *power * Dd::from(*x))));
            compressed.push(powers.chain([Dd::from(*y)]).collect::<Vec<Dd>>());
        }
        compressed.finish()
    }

    #[test]
    fn coefficients_in_double_double_differ_by_less_than_the_bound() {
        let mut random = Random::new(3);
        let rows: Vec<(f64, f64)> =
            (0..3000).map(|_| (3.0 + 6.0 * random.share(), random.share())).map(|(x, e)| (x, (x - 5.0) / x + e)).collect();
        let all: Vec<usize> = (0..10).collect();
        let single = Growing::of(&triangle(&rows), &all).unwrap().coefficients();
        for size in [30, 700, 1499] {
            let parts: Vec<Triangle> = rows.chunks(size).map(triangle).collect();
            let merged = Triangle::stacked(&parts.iter().collect::<Vec<_>>());
            let growing = Growing::of(&merged, &all).unwrap();
            let found = growing.coefficients();
            let reductions = parts.iter().map(|part| part.rows() / BLOCK + 1).sum::<usize>() + 2 + rows.len() / BLOCK;
            let work = Work { rows: rows.len(), reductions, is_weighted: false };
            let given: Vec<f64> = found.iter().map(|b| b.to_f64()).collect();
            let bound = before_rounding(&merged, &growing, &given, &work).unwrap();
            for ((found, single), bound) in found.iter().zip(&single).zip(&bound) {
                let gap = (*found - *single).to_f64().abs();
                // The bound is that of the worst case, in which all errors have one sign: the gap is 10^9 times smaller here. It still keeps 12
                // digits, of coefficients that f64 would give with some 6.
                assert!(0.0 < gap && gap <= *bound, "{size}: {gap:e}, bound {bound:e} of {found:?}");
                assert!(*bound <= 1e-12 * found.to_f64().abs(), "{size}: bound {bound:e} of {found:?}");
            }
        }
    }
}

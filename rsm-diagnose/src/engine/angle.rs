//! Sine and cosine of angles of any size, and of consecutive multiples of many angles.
//!
//! Searches for waves need them at every row for hundreds of wave numbers on a regular grid.

use rsm_core::elementary;

/// The sine and the cosine of an angle in rad. Up to 800,000 rad they have the same bits on every machine; larger angles are left to the system's
/// library, and are themselves known to 1e-10 rad only.
#[inline]
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    let both = elementary::sin_cos(angle);
    if both.0.is_nan() { angle.sin_cos() } else { both }
}

/// The number of multiples after which sines are computed anew. The error of a multiple grows by at most two roundings a step, to 4e-15.
pub(crate) const BLOCK: usize = 16;

/// The number of multiples that are computed side by side.
pub(crate) const TOGETHER: usize = 8;

/// The sines and the cosines of some multiples of an angle.
pub(crate) type Sines<const W: usize> = ([f64; W], [f64; W]);

/// Sines and cosines of a multiple of each of some angles, one multiple after another: each step is one complex product for each angle.
pub(crate) struct Multiples {
    angles: Vec<f64>,
    /// The sine and the cosine of each angle.
    step: Vec<(f64, f64)>,
    /// Those of the present multiple.
    now: Vec<(f64, f64)>,
    multiple: usize,
}

/// No sines yet, for each of some angles: memory for [`Multiples::take`].
pub(crate) fn no_sines(angles: usize) -> Vec<Sines<TOGETHER>> {
    vec![([0.0; TOGETHER], [0.0; TOGETHER]); angles]
}

impl Multiples {
    /// The first multiple of angles in rad.
    pub(crate) fn new(angles: Vec<f64>, first: usize) -> Self {
        let step = angles.iter().map(|angle| sin_cos(*angle)).collect();
        let mut multiples = Multiples { angles, step, now: Vec::new(), multiple: first };
        multiples.renew();
        multiples
    }

    fn renew(&mut self) {
        self.now.clear();
        let multiple = self.multiple as f64;
        self.now.extend(self.angles.iter().map(|angle| sin_cos(multiple * angle)));
    }

    /// The sine and the cosine of the present multiple of each angle.
    pub(crate) fn now(&self) -> &[(f64, f64)] {
        &self.now
    }

    /// Writes the sines and the cosines of this multiple of each angle and of the next ones, and goes to the multiple after them.
    pub(crate) fn take(&mut self, to: &mut [Sines<TOGETHER>]) {
        for lane in 0..TOGETHER {
            for ((sines, cosines), (sin, cos)) in to.iter_mut().zip(&self.now) {
                (sines[lane], cosines[lane]) = (*sin, *cos);
            }
            self.advance();
        }
    }

    /// Goes to the next multiple.
    pub(crate) fn advance(&mut self) {
        self.multiple += 1;
        if self.multiple.is_multiple_of(BLOCK) {
            return self.renew();
        }
        for ((sin, cos), (by_sin, by_cos)) in self.now.iter_mut().zip(&self.step) {
            (*sin, *cos) = (*sin * by_cos + *cos * by_sin, *cos * by_cos - *sin * by_sin);
        }
    }
}

/// Whole numbers in blocks between multiples of [`BLOCK`], so that threads share the work and the results do not depend on their number.
pub(crate) fn blocks(first: usize, end: usize) -> Vec<std::ops::Range<usize>> {
    let mut list = Vec::new();
    let mut start = first;
    while start < end {
        let next = ((start / BLOCK + 1) * BLOCK).min(end);
        list.push(start..next);
        start = next;
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiples_are_those_of_the_library_from_any_start() {
        let angles = vec![0.0, 1e-3, -2.7, 3.0e3, f64::INFINITY];
        for first in [0, 1, 7, 100] {
            let mut multiples = Multiples::new(angles.clone(), first);
            for multiple in first..first + 3 * BLOCK {
                for (angle, (sin, cos)) in angles.iter().zip(multiples.now()) {
                    let angle = multiple as f64 * angle;
                    // The multiple of an angle of 3000 rad itself is rounded to 6e-11 rad.
                    let bound = 4e-15 + angle.abs() * f64::EPSILON;
                    assert!(!angle.is_finite() || (sin - angle.sin()).abs() < bound && (cos - angle.cos()).abs() < bound);
                }
                multiples.advance();
            }
        }
        assert_eq!(blocks(2, 2 * BLOCK + 3), [2..BLOCK, BLOCK..2 * BLOCK, 2 * BLOCK..2 * BLOCK + 3]);
        assert_eq!(blocks(3, 3), []);
    }

    #[test]
    fn angles_of_any_size_have_a_sine() {
        for angle in [0.3, -7e5, 7e5, 9e5, -3e7, 1e12] {
            let ((sin, cos), (other_sin, other_cos)) = (sin_cos(angle), angle.sin_cos());
            // Both are correct to one unit in the last place.
            assert!((sin - other_sin).abs() <= 2.0 * f64::EPSILON && (cos - other_cos).abs() <= 2.0 * f64::EPSILON, "{angle}");
        }
        assert!(sin_cos(f64::INFINITY).0.is_nan());
    }
}

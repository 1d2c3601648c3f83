//! Limits for the last terms of a series.
//!
//! In: a tolerance. Out: for each order, the limits of the last two terms. The bits are the same on every machine: no power function of the library
//! is used.

/// The highest order; it is odd, because the orders of all parts are. If a block is solved by three iterations of Newton's method from its last
/// solution, the series is that of the solution up to order 2^3 - 1.
const MOST: usize = 25;
const MOST_BY_NEWTON: usize = 7;

/// Limits for the last terms of a series.
pub(super) struct Thresholds {
    tolerance: f64,
    /// For each order: the limits of its term and of the term before.
    list: Vec<(f64, f64)>,
    /// The highest order.
    most: usize,
}

impl Thresholds {
    pub(super) fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// The highest order.
    pub(super) fn most(&self) -> usize {
        self.most
    }

    /// The limits of the last term of an order, and of the term before.
    #[inline]
    pub(super) fn of(&self, order: usize) -> (f64, f64) {
        self.list[order]
    }

    /// `by_newton`: the rates contain blocks that are solved by Newton's method.
    pub(super) fn new(tolerance: f64, by_newton: bool) -> Self {
        let list = (0..=MOST).map(|k| (power(tolerance, k, k + 1), power(tolerance, k.saturating_sub(1), k + 1))).collect();
        // The work per unit of time is smallest near the order 1 - log(tolerance)/2 (Jorba and Zou, section 3.1). Here the order is odd, because the
        // orders of all parts are.
        let (mut best, mut left) = (7, tolerance);
        while left < 1e-4 && best + 2 <= MOST {
            left *= 55.0; // e^4: two orders more
            best += 2;
        }
        Thresholds { tolerance, list, most: if by_newton { best.min(MOST_BY_NEWTON) } else { best } }
    }
}

/// A number to the power a/b, with the same bits on every machine: by bisection between 0 and the larger of 1 and the number.
fn power(number: f64, a: usize, b: usize) -> f64 {
    let raised = |value: f64, times: usize| (0..times).fold(1.0, |product, _| product * value);
    let (mut low, mut high) = (0.0_f64, 1.0_f64.max(number));
    let wanted = raised(number, a);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if raised(middle, b) < wanted { low = middle } else { high = middle }
    }
    high
}

/// A root, to three digits, which is sufficient for a step length.
pub(super) fn root(number: f64, degree: usize) -> f64 {
    if !(number > 0.0 && number.is_finite()) {
        return 0.0;
    }
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        let raised = (0..degree).fold(1.0, |product, _| product * middle);
        if raised < number { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_and_roots_are_those_of_the_library_to_their_digits() {
        for (a, b) in [(0, 1), (1, 2), (6, 7), (23, 25)] {
            let expected = 1e-8_f64.powf(a as f64 / b as f64);
            assert!((power(1e-8, a, b) / expected - 1.0).abs() < 1e-12, "{a}/{b}");
        }
        assert!((root(0.5, 7) - 0.5_f64.powf(1.0 / 7.0)).abs() < 1e-3);
    }
}

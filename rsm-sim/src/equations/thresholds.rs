//! Limits for the last terms of a series.
//!
//! In: a tolerance. Out: for each order, the limits of the last two terms. The bits are the same on every machine: no power function of the library
//! is used.

/// The highest order; it is odd, because the orders of all parts are. If a block is solved by three iterations of Newton's method from its last
/// solution, the series is that of the solution up to order 2^3 - 1.
const MOST: usize = 25;
const MOST_BY_NEWTON: usize = 7;

/// Limits for the last terms of a series.
#[derive(Debug)]
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

/// The steps of a root.
const STEPS: f64 = 4096.0;

/// A root between 0 and 1, to three digits, which is sufficient for a step length: the largest multiple of 1/4096 whose power is below the number.
/// The library's power is only a first guess: products decide, so the bits are the same on every machine.
pub(super) fn root(number: f64, degree: usize) -> f64 {
    if !(number > 0.0 && number.is_finite()) {
        return 0.0;
    }
    let is_below = |step: f64| (0..degree).fold(1.0, |product, _| product * (step / STEPS)) < number;
    let mut step = (number.powf(1.0 / degree as f64) * STEPS).floor().clamp(0.0, STEPS - 1.0);
    while step > 0.0 && !is_below(step) {
        step -= 1.0;
    }
    while step < STEPS - 1.0 && is_below(step + 1.0) {
        step += 1.0;
    }
    step / STEPS
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

    #[test]
    fn a_root_is_the_one_that_bisection_finds() {
        let bisected = |number: f64, degree: usize| {
            let (mut low, mut high) = (0.0_f64, 1.0_f64);
            for _ in 0..12 {
                let middle = 0.5 * (low + high);
                if (0..degree).fold(1.0, |product, _| product * middle) < number { low = middle } else { high = middle }
            }
            low
        };
        for degree in 1..=MOST {
            // Numbers from a Weyl sequence over forty decades, powers of steps, and numbers at the ends of the range.
            let numbers = (1..400).map(|k| 10.0_f64.powf(-40.0 * (f64::from(k) * 2.0_f64.sqrt()).fract()));
            let powers = (0..=64).map(|k| (f64::from(k) / 64.0).powi(degree as i32));
            for number in numbers.chain(powers).chain([f64::MIN_POSITIVE, 5e-324, 1.0, 1.0 - f64::EPSILON, 2.0, 1e300]) {
                assert_eq!(
                    root(number, degree),
                    if number > 0.0 { bisected(number, degree) } else { 0.0 },
                    "{number} {degree}"
                );
            }
        }
        assert_eq!([f64::NAN, f64::INFINITY, -1.0, 0.0].map(|it| root(it, 3)), [0.0; 4]);
    }
}

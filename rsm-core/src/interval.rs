//! Intervals of reals with f64 bounds, rounded outward: every computed interval encloses the exact result.
//!
//! Each operation is computed to nearest, and the result is moved outward by one number. That is at most half a unit in the last place more than
//! directed rounding, and it needs no change of the rounding mode.

use std::ops::{Add, Mul, Neg, Sub};

use crate::number::{Precision, Rational, exact, power_of_two};
use crate::scalar::Scalar;

/// All reals from `low` to `high`, both included. Bounds may be infinite, never NaN.
///
/// ```
/// use rsm_core::interval::Interval;
///
/// let sum = Interval::point(0.1) + Interval::point(0.2);
/// assert!(sum.low <= 0.3 && 0.3 <= sum.high); // rounded outward
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// The lower bound.
    pub low: f64,
    /// The upper bound.
    pub high: f64,
}

impl Interval {
    /// A single number.
    #[must_use]
    pub fn point(value: f64) -> Self {
        Interval { low: value, high: value }
    }

    /// From two bounds in order.
    #[must_use]
    pub fn new(low: f64, high: f64) -> Self {
        debug_assert!(low <= high, "bounds come in order: {low} {high}");
        Interval { low, high }
    }

    /// The smallest interval with f64 bounds that contains a rational.
    #[must_use]
    pub fn around(value: &Rational) -> Self {
        let nearest = Precision::F64.round(value);
        if nearest.is_finite() && exact(nearest) == *value {
            return Interval::point(nearest);
        }
        Interval { low: Precision::F64.round_down(value), high: Precision::F64.round_up(value) }
    }

    /// The largest magnitude in it.
    #[must_use]
    pub fn magnitude(self) -> f64 {
        (-self.low).max(self.high)
    }

    /// The smallest interval that contains both.
    #[must_use]
    pub fn hull(self, other: Interval) -> Self {
        Interval { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// high - low, rounded up.
    #[must_use]
    pub fn width(self) -> f64 {
        (self.high - self.low).next_up()
    }

    /// The values of [`crate::tape::Op::Exponent`] for the numbers in it.
    #[must_use]
    pub fn exponent(self, precision: Precision) -> Self {
        let of = |value: f64| match precision {
            Precision::F64 => value.exponent(),
            Precision::F32 => f64::from((value as f32).exponent()),
        };
        let nearest = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { self.low.abs().min(self.high.abs()) };
        Interval { low: of(nearest), high: of(self.magnitude()) }
    }

    /// The values of [`crate::tape::Op::PowerOfTwo`] for the integers in it; `None` if any of them has no power.
    #[must_use]
    pub fn power_of_two(self, precision: Precision) -> Option<Self> {
        let largest = match precision {
            Precision::F64 => 1023.0,
            Precision::F32 => 127.0,
        };
        if !(self.low > -largest && self.high <= largest) {
            return None;
        }
        // The exponents are integers, so ends that are not integers are rounded outward.
        Some(Interval { low: power_of_two(self.low.floor() as i64), high: power_of_two(self.high.ceil() as i64) })
    }

    /// Half of the interval; exact except for subnormals, which are rounded outward.
    #[must_use]
    pub fn halved(self) -> Self {
        self * Interval::point(0.5)
    }
}

/// Moves a bound outward, unless the operation was obviously exact.
fn outward(low: f64, high: f64) -> Interval {
    // A zero bound of a product or sum is exact or an underflow; the smallest subnormal covers both.
    let bound = |value: f64| if value.is_nan() { f64::INFINITY } else { value };
    Interval { low: -bound(-low.next_down()), high: bound(high.next_up()) }
}

impl Add for Interval {
    type Output = Interval;
    fn add(self, other: Interval) -> Interval {
        if other == Interval::point(0.0) {
            return self;
        }
        if self == Interval::point(0.0) {
            return other;
        }
        outward(self.low + other.low, self.high + other.high)
    }
}

impl Sub for Interval {
    type Output = Interval;
    fn sub(self, other: Interval) -> Interval {
        self + -other
    }
}

impl Neg for Interval {
    type Output = Interval;
    fn neg(self) -> Interval {
        Interval { low: -self.high, high: -self.low }
    }
}

impl Mul for Interval {
    type Output = Interval;
    fn mul(self, other: Interval) -> Interval {
        for (one, two) in [(self, other), (other, self)] {
            if one == Interval::point(0.0) {
                return one;
            }
            if one == Interval::point(1.0) {
                return two;
            }
        }
        let products = [self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high];
        let low = products.into_iter().fold(f64::INFINITY, f64::min);
        let high = products.into_iter().fold(f64::NEG_INFINITY, f64::max);
        outward(low, high)
    }
}

#[cfg(test)]
mod tests;

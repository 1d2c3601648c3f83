//! Intervals that are rounded outward, and units in the last place.
//!
//! In: numbers. Out: [`Span`]s that contain every exact result. Independent of tapes.

/// An interval, rounded outward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    pub low: f64,
    pub high: f64,
}

pub(super) fn span(low: f64, high: f64) -> Span {
    assert!(low <= high, "{low} {high}");
    Span { low, high }
}

impl Span {
    pub(super) const ZERO: Span = Span { low: 0.0, high: 0.0 };

    pub(super) fn point(value: f64) -> Self {
        Span { low: value, high: value }
    }

    pub(super) fn outward(low: f64, high: f64) -> Self {
        span(low.next_down(), high.next_up())
    }

    pub(super) fn largest(self) -> f64 {
        (-self.low).max(self.high)
    }

    /// The smallest magnitude; 0 if it contains 0.
    pub(super) fn least(self) -> f64 {
        self.low.max(-self.high).max(0.0)
    }

    pub(super) fn plus(self, other: Span) -> Self {
        if other == Span::ZERO {
            return self;
        }
        if self == Span::ZERO {
            return other;
        }
        Span::outward(self.low + other.low, self.high + other.high)
    }

    pub(super) fn negated(self) -> Self {
        Span { low: -self.high, high: -self.low }
    }

    pub(super) fn corners(self, other: Span, of: impl Fn(f64, f64) -> f64) -> Self {
        let all = [of(self.low, other.low), of(self.low, other.high), of(self.high, other.low), of(self.high, other.high)];
        let low = all.into_iter().fold(f64::INFINITY, f64::min);
        span(low, all.into_iter().fold(f64::NEG_INFINITY, f64::max))
    }

    pub(super) fn times(self, other: Span) -> Self {
        if self == Span::ZERO || other == Span::ZERO {
            return Span::ZERO;
        }
        let all = self.corners(other, |a, b| a * b);
        Span::outward(all.low, all.high)
    }

    pub(super) fn over(self, other: Span) -> Self {
        assert!(other.least() > 0.0, "a division by {other:?}");
        if self == Span::ZERO {
            return Span::ZERO;
        }
        let all = self.corners(other, |a, b| a / b);
        Span::outward(all.low, all.high)
    }

    pub(super) fn square(self) -> Self {
        let all = self.times(self);
        Span { low: all.low.max(0.0), high: all.high }
    }

    pub(super) fn widened(self, by: f64) -> Self {
        if by == 0.0 { self } else { Span::outward(self.low - by, self.high + by) }
    }

    /// The intersection.
    pub(super) fn both(self, other: Span) -> Self {
        span(self.low.max(other.low), self.high.min(other.high))
    }
}

/// floor(log2 |x|) of a normal number.
pub(super) fn exponent(value: f64) -> i32 {
    assert!(value.abs() >= f64::MIN_POSITIVE, "{value}");
    (value.abs().to_bits() >> 52) as i32 - 1023
}

/// A unit in the last place of numbers of this magnitude and above.
pub(super) fn unit(value: f64) -> f64 {
    2f64.powi(exponent(value) - 52)
}

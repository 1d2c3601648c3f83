//! Ranges of f32 numbers: the possible results of an operation of a step in f32.
//!
//! In: ranges of the operands. Out: the range of the computed results. Rounding is monotone. So the ends of the result's range are the results at the
//! ends of the operands' ranges, rounded as the step rounds them. If the ranges are single numbers, the answer has the bits of the step itself. If
//! the result may be NaN, the range is everything.

use rsm_core::interval::Interval;
use rsm_core::values::Values;

/// All f32 numbers from `low` to `high`, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// The least.
    pub low: f32,
    /// The greatest.
    pub high: f32,
}

impl Range {
    /// Anything may come out.
    pub const WHOLE: Range = Range { low: f32::NEG_INFINITY, high: f32::INFINITY };

    /// One number.
    #[must_use]
    pub fn point(value: f32) -> Self {
        Range::ends(value, value)
    }

    /// From two ends in order; everything where one is NaN.
    #[must_use]
    pub fn ends(low: f32, high: f32) -> Self {
        if low.is_nan() || high.is_nan() { Range::WHOLE } else { Range { low, high } }
    }

    /// Both, and what lies between.
    #[must_use]
    pub fn hull(self, other: Range) -> Self {
        Range { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// The number in the middle, and the two halves that share it; `None` where there is no number between the ends.
    #[must_use]
    pub fn halves(self) -> Option<[Range; 2]> {
        let middle = self.middle();
        (self.low < middle && middle < self.high).then(|| [Range::ends(self.low, middle), Range::ends(middle, self.high)])
    }

    /// A number in the middle.
    #[must_use]
    pub fn middle(self) -> f32 {
        self.low + 0.5 * (self.high - self.low)
    }

    /// The same as reals with f64 ends.
    #[must_use]
    pub fn reals(self) -> Interval {
        Interval { low: f64::from(self.low), high: f64::from(self.high) }
    }

    /// `within` of the step: kept from falling below `low` first, then from rising above `high`.
    #[must_use]
    pub fn within(self, low: Range, high: Range) -> Self {
        let at_least = Range::ends(self.low.max(low.low), self.high.max(low.high));
        Range::ends(at_least.low.min(high.low), at_least.high.min(high.high))
    }

    /// `at_least` of the step.
    #[must_use]
    pub fn at_least(self, bound: f32) -> Self {
        Range::ends(self.low.max(bound), self.high.max(bound))
    }

    /// The range of the square root. IEEE 754 rounds it correctly, so it is monotone. The part of a range below 0 is ignored.
    #[must_use]
    pub fn root(self) -> Self {
        Range::ends(self.low.max(0.0).sqrt(), self.high.max(0.0).sqrt())
    }

    fn of_all(candidates: [f32; 4]) -> Self {
        if candidates.iter().any(|value| value.is_nan()) {
            return Range::WHOLE;
        }
        let low = candidates.into_iter().fold(f32::INFINITY, f32::min);
        Range { low, high: candidates.into_iter().fold(f32::NEG_INFINITY, f32::max) }
    }
}

impl std::ops::Neg for Range {
    type Output = Range;
    fn neg(self) -> Range {
        Range { low: -self.high, high: -self.low }
    }
}

impl std::ops::Add for Range {
    type Output = Range;
    fn add(self, other: Range) -> Range {
        Range::ends(self.low + other.low, self.high + other.high)
    }
}

impl std::ops::Sub for Range {
    type Output = Range;
    fn sub(self, other: Range) -> Range {
        self + -other
    }
}

impl std::ops::Mul for Range {
    type Output = Range;
    fn mul(self, other: Range) -> Range {
        Range::of_all([self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high])
    }
}

impl std::ops::Mul<Range> for f32 {
    type Output = Range;
    fn mul(self, other: Range) -> Range {
        Range::point(self) * other
    }
}

impl std::ops::Div for Range {
    type Output = Range;
    fn div(self, other: Range) -> Range {
        if other.low <= 0.0 && other.high >= 0.0 {
            return Range::WHOLE;
        }
        Range::of_all([self.low / other.low, self.low / other.high, self.high / other.low, self.high / other.high])
    }
}

/// What a surface's tape in f32 may compute.
#[must_use]
pub fn of_tape<const N: usize>(values: &mut Values<'_>, arguments: [Range; N]) -> Range {
    let found = values.over(&arguments.map(Range::reals));
    // Values of an f32 tape are numbers of f32: nothing is rounded here.
    Range::ends(found.low as f32, found.high as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_holds_what_its_points_give_to_the_bit() {
        let mut state = 7u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 40) as f32 / (1u32 << 23) as f32 - 1.0) * 3.7
        };
        for _ in 0..20_000 {
            let mut pair = || {
                let (a, b) = (draw(), draw());
                Range::ends(a.min(b), a.max(b))
            };
            let (x, y) = (pair(), pair());
            let share = draw().abs() / 3.7;
            let pick = |range: Range| (range.low + share * (range.high - range.low)).clamp(range.low, range.high);
            let (a, b) = (pick(x), pick(y));
            let holds = |range: Range, value: f32| range.low <= value && value <= range.high;
            assert!(holds(x + y, a + b) && holds(x - y, a - b) && holds(x * y, a * b) && holds(x / y, a / b));
            assert!(holds(-x, -a) && holds(x.within(Range::point(-1.0), Range::point(0.5)), a.clamp(-1.0, 0.5)));
            let above = x + Range::point(4.0);
            assert!(holds(above.root(), pick(above).sqrt()) && Range::point(2.25).root() == Range::point(1.5));
            let points = (Range::point(a), Range::point(b));
            assert_eq!((points.0 * points.1).low.to_bits(), (a * b).to_bits());
            assert_eq!((points.0 + points.1).high.to_bits(), (a + b).to_bits());
        }
    }

    #[test]
    fn halves_share_their_bound_and_end_where_no_number_is_between() {
        let [left, right] = Range::ends(1.0, 2.0).halves().unwrap();
        assert_eq!((left.high, right.low), (1.5, 1.5));
        assert_eq!(Range::ends(1.0, 1f32.next_up()).halves(), None);
        assert_eq!(Range::point(3.0).halves(), None);
    }
}

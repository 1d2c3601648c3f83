//! The operations of `dd.rs` on several numbers at once.
//!
//! In: numbers of consecutive rows, one in each lane. Out: in each lane the bits that `Dd` gives there, by the same operations in the same order;
//! branches become choices between two results. A compiler makes vector instructions of the loops over lanes.

use super::{Dd, fast_two_sum, product, sum};
use rsm_core::vector::{Work, widest};

/// The number of lanes: one register of AVX-512, two of AVX, four of SSE2.
pub(crate) const LANES: usize = 8;

/// A number in each lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lanes {
    high: [f64; LANES],
    low: [f64; LANES],
}

/// One operation in every lane.
#[inline(always)]
fn each(operation: impl Fn(usize) -> (f64, f64)) -> Lanes {
    let mut result = Lanes::ZERO;
    for lane in 0..LANES {
        (result.high[lane], result.low[lane]) = operation(lane);
    }
    result
}

#[inline(always)]
fn choice(is_first: bool, first: f64, other: f64) -> f64 {
    if is_first { first } else { other }
}

impl Lanes {
    /// Zero in every lane.
    pub(crate) const ZERO: Lanes = Lanes { high: [0.0; LANES], low: [0.0; LANES] };
    /// One in every lane.
    pub(crate) const ONE: Lanes = Lanes { high: [1.0; LANES], low: [0.0; LANES] };

    /// f64 numbers, exactly.
    #[inline(always)]
    pub(crate) fn of(values: [f64; LANES]) -> Self {
        Lanes { high: values, low: [0.0; LANES] }
    }

    /// The same number in every lane.
    #[inline(always)]
    pub(crate) fn splat(value: Dd) -> Self {
        Lanes { high: [value.high; LANES], low: [value.low; LANES] }
    }

    /// The number of a lane.
    pub(crate) fn get(&self, lane: usize) -> Dd {
        Dd { high: self.high[lane], low: self.low[lane] }
    }

    /// Replaces the number of a lane.
    pub(crate) fn set(&mut self, lane: usize, value: Dd) {
        (self.high[lane], self.low[lane]) = (value.high, value.low);
    }

    #[inline(always)]
    pub(crate) fn add(self, other: Self) -> Self {
        each(|k| sum((self.high[k], self.low[k]), (other.high[k], other.low[k])))
    }

    #[inline(always)]
    pub(crate) fn neg(self) -> Self {
        each(|k| (-self.high[k], -self.low[k]))
    }

    #[inline(always)]
    pub(crate) fn sub(self, other: Self) -> Self {
        self.add(other.neg())
    }

    #[inline(always)]
    pub(crate) fn mul(self, other: Self) -> Self {
        each(|k| product((self.high[k], self.low[k]), (other.high[k], other.low[k])))
    }

    #[inline(always)]
    pub(crate) fn div(self, other: Self) -> Self {
        // A call of its own: with all its steps in one loop it becomes vector instructions whatever stands around it.
        widest(Quotient(self, other))
    }

    pub(crate) fn sqrt(self) -> Self {
        let root = Lanes::of(self.high.map(f64::sqrt));
        let rest = self.sub(root.mul(root));
        each(|k| {
            let (high, low) = fast_two_sum(root.high[k], rest.high[k] / (2.0 * root.high[k]));
            let is_plain = self.high[k] <= 0.0;
            (choice(is_plain, root.high[k], high), choice(is_plain, 0.0, low))
        })
    }

    /// In each lane the negative of `value` where this is above zero, otherwise `value`.
    #[inline(always)]
    pub(crate) fn against(self, value: Self) -> Self {
        each(|k| {
            let is_above = self.high[k] > 0.0 || self.high[k] == 0.0 && self.low[k] > 0.0;
            (choice(is_above, -value.high[k], value.high[k]), choice(is_above, -value.low[k], value.low[k]))
        })
    }

    /// In each lane `value`, but 0 where this is 0.
    #[inline(always)]
    pub(crate) fn unless_zero(self, value: Self) -> Self {
        self.choose(Lanes::ZERO, value)
    }

    /// In each lane `zero` where this is 0, otherwise `other`.
    #[inline(always)]
    pub(crate) fn choose(self, zero: Self, other: Self) -> Self {
        each(|k| {
            let is_zero = self.high[k] == 0.0 && self.low[k] == 0.0;
            (choice(is_zero, zero.high[k], other.high[k]), choice(is_zero, zero.low[k], other.low[k]))
        })
    }

    /// Whether every lane has a finite number.
    pub(crate) fn is_finite(&self) -> bool {
        self.high.iter().chain(&self.low).all(|part| part.is_finite())
    }
}

/// The steps of `Dd::div` without its branch. No closure, because a large one stays a call.
#[inline(always)]
fn quotient(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let first = a.0 / b.0;
    let rest = minus(a, b, first);
    let second = rest.0 / b.0;
    let rest = minus(rest, b, second);
    let third = rest.0 / b.0;
    sum(fast_two_sum(first, second), (third, 0.0))
}

/// a minus b times a digit.
#[inline(always)]
fn minus(a: (f64, f64), b: (f64, f64), digit: f64) -> (f64, f64) {
    let (high, low) = product(b, (digit, 0.0));
    sum(a, (-high, -low))
}

/// The quotient in every lane.
struct Quotient(Lanes, Lanes);

impl Work for Quotient {
    type Found = Lanes;

    #[inline(always)]
    fn run(self) -> Lanes {
        let Quotient(a, b) = self;
        let mut result = Lanes::ZERO;
        for k in 0..LANES {
            (result.high[k], result.low[k]) = quotient((a.high[k], a.low[k]), (b.high[k], b.low[k]));
        }
        // A first digit that is infinite or NaN makes the result NaN, and one that is 0 makes it 0 or NaN.
        if !result.high.iter().all(|high| high.is_finite() && *high != 0.0) {
            for k in 0..LANES {
                let first = a.high[k] / b.high[k];
                if !first.is_finite() || first == 0.0 {
                    (result.high[k], result.low[k]) = (first, 0.0);
                }
            }
        }
        result
    }
}

/// The sum of the products of terms and coefficients.
pub(crate) fn value(terms: &[Lanes], coefficients: &[Lanes]) -> Lanes {
    widest(Value(terms, coefficients))
}

struct Value<'a>(&'a [Lanes], &'a [Lanes]);

impl Work for Value<'_> {
    type Found = Lanes;

    #[inline(always)]
    fn run(self) -> Lanes {
        product_of(self.0, self.1)
    }
}

/// The sum of the products of two columns.
#[inline(always)]
pub(crate) fn product_of(one: &[Lanes], other: &[Lanes]) -> Lanes {
    let mut sum = Lanes::ZERO;
    for (x, y) in one.iter().zip(other) {
        sum = sum.add(x.mul(*y));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn same(found: Lanes, expected: impl Fn(usize) -> Dd, what: &str) {
        for lane in 0..LANES {
            let bits = |value: Dd| value.parts().map(|part| if part.is_nan() { f64::NAN.to_bits() } else { part.to_bits() });
            assert_eq!(bits(found.get(lane)), bits(expected(lane)), "{what}: {:?} {:?}", found.get(lane), expected(lane));
        }
    }

    #[test]
    fn every_lane_has_the_bits_of_one_number() {
        let special = [0.0, -0.0, 1.0, -1.0, 1e300, -1e-300, 5e-324, f64::MAX, f64::INFINITY, f64::NAN];
        let mut random = Random::new(11);
        let mut number = || {
            let large = (random.normal()) * 10f64.powi(random.below(60) as i32 - 30);
            match random.below(8) {
                0 => Dd::from(special[random.below(special.len() as u64) as usize]),
                1 => Dd::from(large),
                _ => Dd::sum_of(large, large * 1e-17 * random.normal()),
            }
        };
        for _ in 0..2000 {
            let mut numbers = || std::array::from_fn::<Dd, LANES, _>(|_| number());
            let (a, b) = (numbers(), numbers());
            let lanes = |numbers: [Dd; LANES]| {
                let mut lanes = Lanes::ONE;
                (0..LANES).for_each(|k| lanes.set(k, numbers[k]));
                lanes
            };
            let (x, y) = (lanes(a), lanes(b));
            same(x.add(y), |k| a[k] + b[k], "add");
            same(x.sub(y), |k| a[k] - b[k], "sub");
            same(x.mul(y), |k| a[k] * b[k], "mul");
            same(x.div(y), |k| a[k] / b[k], "div");
            // Without the widest instructions of this machine.
            same(Quotient(x, y).run(), |k| a[k] / b[k], "div");
            same(value(&[x, y], &[y, y]), |k| Dd::ZERO + a[k] * b[k] + b[k] * b[k], "value");
            same(product_of(&[x, y], &[y, y]), |k| Dd::ZERO + a[k] * b[k] + b[k] * b[k], "value");
            same(x.sqrt(), |k| a[k].sqrt(), "sqrt");
            same(x.neg(), |k| -a[k], "neg");
            same(x.against(y), |k| if a[k] > Dd::ZERO { -b[k] } else { b[k] }, "against");
            same(x.choose(x, y), |k| if a[k] == Dd::ZERO { a[k] } else { b[k] }, "choose");
            same(x.unless_zero(y), |k| if a[k] == Dd::ZERO { Dd::ZERO } else { b[k] }, "unless_zero");
            assert_eq!(x.is_finite(), a.iter().all(|a| a.is_finite()));
        }
    }
}

//! Transforms of a response: the terms of a surface describe the transformed response, and the evaluator returns the response itself.
//!
//! In: a value P of the terms, or an interval of them. Out: the response y. The transforms are powers and the logarithm, the family of G. E. P. Box,
//! D. R. Cox, "An Analysis of Transformations", Journal of the Royal Statistical Society B 26 (1964):
//!
//! ```text
//! transform               terms      lambda   response                 P
//! square-root             sqrt y      1/2     P^2                      not negative
//! cube-root               y^(1/3)     1/3     P^3                      any
//! fourth-root             y^(1/4)     1/4     P^4                      not negative
//! log                     log y       0       e^P                      -32 to 32
//! reciprocal-square-root  1/sqrt y   -1/2     1/P^2                    above 0 in the whole box
//! reciprocal              1/y        -1       1/P                      above 0 in the whole box
//! ```
//!
//! The response needs products and at most one division. Outside its limits P is the nearest limit. The exponential is a polynomial and squares, see
//! [`exponential`]: this formula defines the model, in every precision and in the exact reference, and it is within 6e-11 of e^P.

use num_bigint::BigInt;

use crate::basis::Arithmetic;
use crate::interval::Interval;
use crate::model::Transform;
use crate::number::{Rational, exact, integer};

/// The largest |P| for the exponential: e^32 is 8e13.
pub const MOST_EXPONENT: f64 = 32.0;

/// The polynomial of the exponential is evaluated at P/64, and its value is squared six times.
const SQUARINGS: u32 = 6;

/// The order of the Taylor polynomial. For |P| = 32 its first omitted term is 0.5^12/12!, so the 64th power
/// errs by 5.4e-11 at -32 and by 2e-11 at 32.
const ORDER: u32 = 11;

/// The bits behind the point in [`exponential_of_exact`]. Its result is at least 2^-47, and each of 17 products loses about one bit.
const BITS: u32 = 640;

impl Transform {
    /// The power of P that is multiplied, by its magnitude; 1 over it for a reciprocal. `None` for the logarithm.
    pub(crate) fn exponent(self) -> Option<i32> {
        match self {
            Transform::SquareRoot => Some(2),
            Transform::CubeRoot => Some(3),
            Transform::FourthRoot => Some(4),
            Transform::Log => None,
            Transform::ReciprocalSquareRoot => Some(-2),
            Transform::Reciprocal => Some(-1),
        }
    }

    /// The values of P that have a response; the nearest one stands for every other.
    #[must_use]
    pub fn limits(self) -> Interval {
        let above = |low: f64| Interval { low, high: f64::INFINITY };
        match self {
            Transform::SquareRoot | Transform::FourthRoot => above(0.0),
            Transform::ReciprocalSquareRoot | Transform::Reciprocal => above(f64::MIN_POSITIVE),
            Transform::CubeRoot => above(f64::NEG_INFINITY),
            Transform::Log => Interval { low: -MOST_EXPONENT, high: MOST_EXPONENT },
        }
    }

    /// The response for a value P of the terms, limited to [`Transform::limits`].
    ///
    /// ```
    /// use rsm_core::model::Transform;
    ///
    /// assert_eq!(Transform::SquareRoot.response(3.0), 9.0);
    /// assert_eq!(Transform::SquareRoot.response(-3.0), 0.0);
    /// assert!((Transform::Log.response(1.0) - std::f64::consts::E).abs() < 1e-13);
    /// ```
    #[must_use]
    pub fn response<T: Arithmetic>(self, p: T) -> T {
        let p = self.limited(p);
        let Some(exponent) = self.exponent() else { return exponential(&p) };
        let power = crate::basis::power(&p, exponent.unsigned_abs());
        if exponent < 0 { T::of(1.0) / power } else { power }
    }

    fn limited<T: Arithmetic>(self, p: T) -> T {
        let Interval { low, high } = self.limits();
        match (low.is_finite().then(|| T::of(low)), high.is_finite().then(|| T::of(high))) {
            (Some(low), _) if p < low => low,
            (_, Some(high)) if p > high => high,
            _ => p,
        }
    }

    /// The response for an exact P; for the logarithm with an error below 2^-500 of the response.
    #[must_use]
    pub fn exact_response(self, p: Rational) -> Rational {
        match self {
            Transform::Log => exponential_of_exact(&self.limited(p)),
            _ => self.response(p),
        }
    }

    /// At most this share of a response is missing in its formula: that of the exponential is below e^P for every P, because its Taylor polynomial of
    /// odd order is.
    #[must_use]
    pub fn shortfall(self) -> f64 {
        if self == Transform::Log { 6e-11 } else { 0.0 }
    }

    /// The responses for an interval of P, limited to [`Transform::limits`]. Unbounded where a reciprocal may reach 0: no limit hides that.
    #[must_use]
    pub fn over(self, p: Interval) -> Interval {
        let limits = self.limits();
        let end = |p: f64| {
            let p = if self.needs_positive() { p } else { p.clamp(limits.low, limits.high) };
            if !p.is_finite() || self.needs_positive() && p <= 0.0 {
                return Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
            }
            let found = Interval::around(&self.exact_response(exact(p)));
            // The exact response of a logarithm is rounded.
            if self == Transform::Log { Interval { low: found.low.next_down(), high: found.high.next_up() } } else { found }
        };
        end(p.low).hull(end(p.high))
    }

    /// P for a response; `None` if the response has none.
    ///
    /// ```
    /// use rsm_core::model::Transform;
    ///
    /// assert_eq!(Transform::Reciprocal.transformed(4.0), Some(0.25));
    /// assert_eq!(Transform::CubeRoot.transformed(-8.0), Some(-2.0));
    /// assert_eq!(Transform::Log.transformed(0.0), None);
    /// ```
    #[must_use]
    pub fn transformed(self, y: f64) -> Option<f64> {
        if !self.accepts(y) {
            return None;
        }
        Some(match self {
            Transform::SquareRoot => y.sqrt(),
            Transform::CubeRoot => cube_root(y),
            Transform::FourthRoot => y.sqrt().sqrt(),
            Transform::Log => logarithm(y),
            Transform::ReciprocalSquareRoot => 1.0 / y.sqrt(),
            Transform::Reciprocal => 1.0 / y,
        })
        .filter(|p| p.is_finite())
    }

    /// The values of P for responses between two limits, in order; where a limit is no response, the nearest one.
    ///
    /// ```
    /// use rsm_core::model::Transform;
    ///
    /// assert_eq!(Transform::SquareRoot.transformed_range([-1.0, 9.0]), [0.0, 3.0]);
    /// assert_eq!(Transform::Reciprocal.transformed_range([0.5, 4.0]), [0.25, 2.0]);
    /// assert_eq!(Transform::Reciprocal.transformed_range([0.0, 4.0]), [0.25, f64::MAX]);
    /// ```
    #[must_use]
    pub fn transformed_range(self, range: [f64; 2]) -> [f64; 2] {
        let limits = self.limits();
        let (below, above) = (limits.low.max(f64::MIN), limits.high.min(f64::MAX));
        // A limit that is no response is below or above all of them.
        let outside = |y: f64| if (y <= 1.0) != self.is_falling() { below } else { above };
        let [first, second] = range.map(|y| self.transformed(y).unwrap_or_else(|| outside(y)));
        if self.is_falling() { [second, first] } else { [first, second] }
    }

    fn accepts(self, y: f64) -> bool {
        match self {
            Transform::CubeRoot => y.is_finite(),
            Transform::SquareRoot | Transform::FourthRoot => y >= 0.0 && y.is_finite(),
            Transform::ReciprocalSquareRoot | Transform::Reciprocal => y > 0.0 && y.is_finite(),
            Transform::Log => y > 0.0 && logarithm(y).abs() <= MOST_EXPONENT,
        }
    }

    /// The responses that it accepts, in words.
    #[must_use]
    pub fn accepted(self) -> &'static str {
        match self {
            Transform::CubeRoot => "a finite number",
            Transform::SquareRoot | Transform::FourthRoot => "0 or more",
            Transform::ReciprocalSquareRoot | Transform::Reciprocal => "more than 0",
            Transform::Log => "from e^-32 to e^32, 1.3e-14 to 7.9e13",
        }
    }

    /// |dP/dy| for a response: infinite at 0 for a root.
    #[must_use]
    pub fn slope(self, y: f64) -> f64 {
        match (self, self.transformed(y)) {
            (Transform::Log, _) => 1.0 / y,
            (_, Some(p)) if y != 0.0 => (self.lambda() * p / y).abs(),
            _ => f64::INFINITY,
        }
    }
}

/// log y, with the same bits on every machine.
fn logarithm(y: f64) -> f64 {
    crate::elementary::range::value(crate::function::Function::Log, &[y])
}

/// The cube root: of the logarithm, then one step of Newton's method, whose error is the square of the relative error before.
fn cube_root(y: f64) -> f64 {
    if y == 0.0 {
        return y;
    }
    let size = y.abs();
    let start = crate::elementary::range::value(crate::function::Function::Exp, &[logarithm(size) / 3.0]);
    let better = start - (start - size / (start * start)) / 3.0;
    better.copysign(y)
}

/// The coefficient of P^k in the Taylor polynomial of e^(P/64), by its reciprocal k! 64^k: a number of f64.
fn divisor(k: u32) -> f64 {
    (1..=k).map(f64::from).product::<f64>() * 2f64.powi((SQUARINGS * k) as i32)
}

/// The coefficients of the powers of P, the highest first, and the number of squares.
pub(crate) fn exponential_steps() -> (impl Iterator<Item = Rational>, u32) {
    ((0..=ORDER).rev().map(|k| integer(1) / exact(divisor(k))), SQUARINGS)
}

/// (1 + t + t^2/2 + ... + t^11/11!)^64 with t = P/64: it differs from e^P by less than 6e-11 of it for |P| <= 32. The powers are scaled by powers of
/// two only, so the factor 1/64 costs no rounding.
#[must_use]
pub fn exponential<T: Arithmetic>(p: &T) -> T {
    let one = T::of(1.0);
    let mut sum = one.clone() / T::of(divisor(ORDER));
    for k in (0..ORDER).rev() {
        sum = sum * p.clone() + one.clone() / T::of(divisor(k));
    }
    (0..SQUARINGS).fold(sum, |sum, _| sum.clone() * sum)
}

/// [`exponential`] of an exact P from -32 to 32, with an error below 2^-500 of the result: exact powers would have a million digits.
fn exponential_of_exact(p: &Rational) -> Rational {
    let one = BigInt::from(1) << BITS;
    let t = (p * Rational::from_integer(one.clone() >> SQUARINGS)).floor().to_integer();
    let mut factorial = BigInt::from((1..=u64::from(ORDER)).product::<u64>());
    let mut sum = &one / &factorial;
    for k in (1..=ORDER).rev() {
        factorial /= k;
        sum = ((sum * &t) >> BITS) + &one / &factorial;
    }
    for _ in 0..SQUARINGS {
        sum = (&sum * &sum) >> BITS;
    }
    Rational::new(sum, one)
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_traits::ToPrimitive as _;

    #[test]
    fn every_transform_is_undone() {
        for transform in Transform::ALL {
            for y in [1e-9, 0.3, 1.0, 2.0, 1234.5, 7e9] {
                let p = transform.transformed(y).unwrap();
                let found = transform.response(p);
                // A relative error of P by a unit is one of lambda's inverse in y; the logarithm has up to |P| <= 23.
                assert!((found - y).abs() <= 1e-13 * y + 6e-11 * y, "{transform:?} {y} {found}");
                assert!(transform.word().chars().all(|at| at.is_ascii_lowercase() || at == '-'));
                let h = 1e-6 * y;
                let slope = (transform.transformed(y + h).unwrap() - transform.transformed(y - h).unwrap()).abs() / (2.0 * h);
                assert!((slope / transform.slope(y) - 1.0).abs() < 1e-6, "{transform:?} {y}");
            }
            assert_eq!(transform.transformed(f64::NAN), None);
            assert_eq!(transform.transformed(f64::INFINITY), None);
            assert_eq!(transform.transformed(-1.0).is_some(), transform == Transform::CubeRoot);
        }
        assert_eq!(Transform::CubeRoot.transformed(0.0), Some(0.0));
        for y in [-27.0, 1e-300, 64.0, 1e300] {
            let root = Transform::CubeRoot.transformed(y).unwrap();
            assert!((root * root * root / y - 1.0).abs() < 1e-15, "{y} {root}");
        }
    }

    #[test]
    fn the_formula_of_the_exponential_is_near_the_exponential() {
        let mut worst = 0.0f64;
        for k in -640..=640 {
            let p = f64::from(k) / 20.0;
            // The reference: the standard library, which shares nothing with the formula. Its own error and the roundings of 64 equal factors.
            let off = (exponential(&p) / p.exp() - 1.0).abs();
            worst = worst.max(off);
            let below = 1.0 - exponential(&p) / p.exp();
            assert!(below > -64.0 * 4.0 * f64::EPSILON && below <= Transform::Log.shortfall(), "{p} {below}");
            assert!(off < 6e-11 * (p.abs() / 32.0).powi(12) + 64.0 * 4.0 * f64::EPSILON, "{p} {off}");
            let precise = exponential_of_exact(&exact(p));
            let difference = (exact(exponential(&p)) / precise - integer(1)).to_f64().unwrap();
            assert!(difference.abs() < 64.0 * 4.0 * f64::EPSILON, "{p} {difference}");
        }
        assert!(worst > 1e-11, "{worst}: the bound is near");
    }

    #[test]
    fn the_rounded_exact_exponential_is_the_exact_one() {
        // Few digits, so that the exact powers stay small.
        for p in [-32.0, -4.0, 0.5, 2.0, 32.0] {
            let [rounded, whole] = [exponential_of_exact(&exact(p)), exponential(&exact(p))];
            let off = (&rounded / &whole - integer(1)) * Rational::from_integer(BigInt::from(1) << 500);
            assert!(off < integer(1) && off > integer(-1), "{p}");
        }
    }

    #[test]
    fn an_interval_holds_the_responses_in_it() {
        for transform in Transform::ALL {
            for (low, high) in [(0.25, 3.0), (1.0, 1.0), (0.1, 31.0)] {
                let found = transform.over(Interval { low, high });
                for share in [0.0, 0.3, 1.0] {
                    let y = transform.exact_response(exact(low * (1.0 - share) + high * share));
                    assert!(exact(found.low) <= y && y <= exact(found.high), "{transform:?}");
                }
                let ends = [low, high].map(|p| transform.response(p));
                let span = found.high - found.low - (ends[1] - ends[0]).abs();
                assert!(span <= 1e-13 * found.high, "{transform:?} {found:?}");
            }
            assert_eq!(transform.over(Interval { low: -1.0, high: 2.0 }).high.is_finite(), !transform.needs_positive());
        }
    }
}

//! Double-double arithmetic: a number as the unevaluated sum of two f64, some 106 significant bits.
//!
//! In: f64 numbers, exactly. Out: [`Dd`], with a relative error of a few 2^-104 in each operation. With it, least squares on badly conditioned data
//! keeps all digits of the data. It is not used in a control loop. It overflows where f64 does. NaN and infinities give some non-finite number.
//!
//! Sources: Dekker, "A floating-point technique for extending the available precision" (1971); Knuth, The Art of Computer
//! Programming 2, 4.2.2 (the exact sum); Joldes, Muller, Popescu, "Tight and rigorous error bounds for basic building blocks
//! of double-word arithmetic" (2017), algorithms 6, 12 and 17 with their bounds.

use std::cmp::Ordering;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use rsm_core::basis::Arithmetic;

pub(crate) mod lanes;

/// high + low, where high is the sum rounded to f64.
///
/// ```
/// use rsm_fit::dd::Dd;
///
/// let sum = Dd::from(1e20) + Dd::from(1.0) - Dd::from(1e20);
/// assert_eq!(sum.to_f64(), 1.0); // f64 gives 0
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Dd {
    high: f64,
    low: f64,
}

/// The rounded sum and its exact error (Knuth).
#[inline(always)]
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_part = sum - a;
    let a_part = sum - b_part;
    (sum, (a - a_part) + (b - b_part))
}

/// The same for |a| >= |b|, or a = 0 (Dekker).
#[inline(always)]
fn fast_two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    (sum, b - (sum - a))
}

/// Two halves of 26 bits, exactly (Veltkamp).
#[inline(always)]
fn split(a: f64) -> (f64, f64) {
    // 2^27 + 1
    let scaled = 134_217_729.0 * a;
    let high = scaled - (scaled - a);
    (high, a - high)
}

/// The error of a rounded product by splitting: 16 operations, exact if [`is_exact`].
#[inline(always)]
fn split_error(a: f64, b: f64, product: f64) -> f64 {
    let ((a_high, a_low), (b_high, b_low)) = (split(a), split(b));
    ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
}

/// The magnitudes of a product whose error splitting gives exactly, as biased exponents of f64. From 2^-960 on, the error and all products of halves
/// are multiples of 2^-1065, above the smallest f64. Up to 2^1020 the product of the higher halves is finite.
const EXACT: std::ops::Range<u64> = 1023 - 960..1023 + 1020;

/// Whether splitting gives the exact error. A factor above 2^996 is too large to be split, which gives NaN.
#[inline(always)]
fn is_exact(product: f64, error: f64) -> bool {
    // One comparison: below the range the difference wraps.
    (exponent(product).wrapping_sub(EXACT.start) < EXACT.end - EXACT.start) & !error.is_nan()
}

/// The biased exponent of a number: 0 for zero and what is below the smallest normal number.
#[inline(always)]
fn exponent(number: f64) -> u64 {
    number.to_bits() >> 52 & 0x7ff
}

/// The error that a fused multiply-add gives: exact, or the nearest f64 if it is below the smallest one.
#[cold]
#[inline(never)]
fn rare_error(a: f64, b: f64, product: f64) -> f64 {
    a.mul_add(b, -product)
}

/// The rounded product and its error, with the bits of a fused multiply-add. By splitting, because that is a slow function call on the x86-64
/// baseline.
#[inline(always)]
pub(crate) fn two_prod(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    let error = split_error(a, b, product);
    if is_exact(product, error) {
        (product, error)
    } else if is_zero(a, b, product) {
        (product, 0.0)
    } else {
        (product, rare_error(a, b, product))
    }
}

/// Whether a product is zero because a factor is: it has no error.
#[inline(always)]
fn is_zero(a: f64, b: f64, product: f64) -> bool {
    product == 0.0 && (a == 0.0 || b == 0.0)
}

/// The sum of two numbers, each a high and a low part.
#[inline(always)]
fn sum(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let (high, error) = two_sum(a.0, b.0);
    let (low, low_error) = two_sum(a.1, b.1);
    let (high, error) = fast_two_sum(high, error + low);
    fast_two_sum(high, error + low_error)
}

/// Their product.
#[inline(always)]
fn product(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    product_with(a, b, two_prod(a.0, b.0))
}

/// Their product, from that of the high parts with its error.
#[inline(always)]
fn product_with(a: (f64, f64), b: (f64, f64), (product, error): (f64, f64)) -> (f64, f64) {
    let cross = a.1 * b.1 + (a.0 * b.1 + a.1 * b.0);
    fast_two_sum(product, error + cross)
}

impl Dd {
    /// Zero.
    pub const ZERO: Dd = Dd { high: 0.0, low: 0.0 };
    /// One.
    pub const ONE: Dd = Dd { high: 1.0, low: 0.0 };

    /// The exact sum of two f64.
    #[must_use]
    pub fn sum_of(a: f64, b: f64) -> Self {
        let (high, low) = two_sum(a, b);
        Dd { high, low }
    }

    /// The nearest f64.
    #[must_use]
    pub fn to_f64(self) -> f64 {
        self.high
    }

    /// Both parts, for a file. [`Dd::sum_of`] gives the same number again.
    pub(crate) fn parts(self) -> [f64; 2] {
        [self.high, self.low]
    }

    /// The square root; NaN below zero. One Newton step from the f64 root (Karp and Markstein, 1997).
    #[must_use]
    pub fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return Dd::from(self.high.sqrt());
        }
        let root = self.high.sqrt();
        let rest = (self - Dd::from(root) * Dd::from(root)).high;
        let (high, low) = fast_two_sum(root, rest / (2.0 * root));
        Dd { high, low }
    }

    /// The magnitude.
    #[must_use]
    pub fn abs(self) -> Self {
        if self.high < 0.0 { -self } else { self }
    }

    /// Neither NaN nor infinite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.high.is_finite() && self.low.is_finite()
    }
}

impl From<f64> for Dd {
    fn from(value: f64) -> Self {
        Dd { high: value, low: 0.0 }
    }
}

impl Arithmetic for Dd {
    fn of(value: f64) -> Self {
        Dd::from(value)
    }
}

impl PartialOrd for Dd {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        match self.high.partial_cmp(&other.high) {
            Some(Ordering::Equal) => self.low.partial_cmp(&other.low),
            order => order,
        }
    }
}

impl Neg for Dd {
    type Output = Dd;
    #[inline]
    fn neg(self) -> Dd {
        Dd { high: -self.high, low: -self.low }
    }
}

impl Add for Dd {
    type Output = Dd;
    #[inline]
    fn add(self, other: Dd) -> Dd {
        let (high, low) = sum((self.high, self.low), (other.high, other.low));
        Dd { high, low }
    }
}

impl Sub for Dd {
    type Output = Dd;
    #[inline]
    fn sub(self, other: Dd) -> Dd {
        self + -other
    }
}

impl Mul for Dd {
    type Output = Dd;
    #[inline]
    fn mul(self, other: Dd) -> Dd {
        let (high, low) = product((self.high, self.low), (other.high, other.low));
        Dd { high, low }
    }
}

impl Div for Dd {
    type Output = Dd;
    fn div(self, other: Dd) -> Dd {
        // Long division with f64 digits: three of them leave an error below 2^-105.
        let first = self.high / other.high;
        if !first.is_finite() || first == 0.0 {
            return Dd::from(first);
        }
        let rest = self - other * Dd::from(first);
        let second = rest.high / other.high;
        let rest = rest - other * Dd::from(second);
        let third = rest.high / other.high;
        let (high, low) = fast_two_sum(first, second);
        Dd { high, low } + Dd::from(third)
    }
}

impl AddAssign for Dd {
    #[inline]
    fn add_assign(&mut self, other: Dd) {
        *self = *self + other;
    }
}

impl SubAssign for Dd {
    #[inline]
    fn sub_assign(&mut self, other: Dd) {
        *self = *self - other;
    }
}

impl Sum for Dd {
    fn sum<I: Iterator<Item = Dd>>(items: I) -> Dd {
        items.fold(Dd::ZERO, |sum, item| sum + item)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::number::{Rational, exact};

    fn rational(value: Dd) -> Rational {
        exact(value.high) + exact(value.low)
    }

    /// log2 of the relative error of `value` against the exact `truth`.
    fn error_bits(value: Dd, truth: &Rational) -> f64 {
        let error = num_traits::ToPrimitive::to_f64(&((rational(value) - truth) / truth)).unwrap();
        error.abs().log2()
    }

    #[test]
    fn every_operation_keeps_a_hundred_bits() {
        let third = Dd::ONE / Dd::from(3.0);
        let numbers = [third, Dd::from(0.1), -third * third, Dd::sum_of(1e20, 1.0), Dd::sum_of(-7.5, 3e-17), Dd::from(5e-30)];
        // The published bounds are between 2^-104 and 2^-102; the exact cancellation of equal numbers is left out.
        for a in numbers {
            for b in numbers {
                assert!(error_bits(a * b, &(rational(a) * rational(b))) < -102.0, "{a:?} * {b:?}");
                assert!(error_bits(a / b, &(rational(a) / rational(b))) < -101.0, "{a:?} / {b:?}");
                assert!(error_bits(a + b, &(rational(a) + rational(b))) < -102.0, "{a:?} + {b:?}");
                if a != b {
                    assert!(error_bits(a - b, &(rational(a) - rational(b))) < -102.0, "{a:?} - {b:?}");
                }
            }
            let root = a.abs().sqrt();
            assert!(error_bits(root * root, &rational(a.abs())) < -100.0, "sqrt {a:?}");
        }
    }

    #[test]
    fn the_error_of_a_product_has_the_bits_of_a_fused_operation_for_all_numbers() {
        let mut random = crate::random::Random::new(4);
        let special = [0.0, -0.0, 5e-324, -f64::MIN_POSITIVE, f64::MAX, 1.0, f64::INFINITY, f64::NAN, 2f64.powi(996), 1e-146];
        let mut number = || match random.below(6) {
            0 => special[random.below(special.len() as u64) as usize],
            // Any magnitude, and those around the limits of `EXACT`.
            1 => f64::from_bits(random.below(1 << 32) << 32 | random.below(1 << 32)),
            2 => random.normal() * 2f64.powi(-480 + random.below(10) as i32),
            3 => random.normal() * 2f64.powi(505 + random.below(10) as i32),
            4 => random.normal() * 2f64.powi(990 + random.below(10) as i32),
            _ => random.normal() * 2f64.powi(-1070 + random.below(60) as i32),
        };
        let bits = |value: f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
        for _ in 0..200_000 {
            let (a, b) = (number(), number());
            let (product, error) = two_prod(a, b);
            assert_eq!((bits(product), bits(error)), (bits(a * b), bits(a.mul_add(b, -(a * b)))), "{a:e} * {b:e}");
        }
    }

    #[test]
    fn order_looks_at_both_parts() {
        let above = Dd::sum_of(1.0, 1e-25);
        assert!(above > Dd::ONE);
        assert!(-above < -Dd::ONE);
        assert!(Dd::from(f64::NAN).partial_cmp(&Dd::ONE).is_none());
    }
}

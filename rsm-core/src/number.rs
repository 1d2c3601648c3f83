//! Numbers: decimal text to bits and back, bits to exact rationals and back. All reading and writing of numbers is here.
//!
//! A coefficient keeps its bits from the file to the emitted source. Decimals are written as the shortest text that reads back to the same bits
//! (`%.20f` would not). An exact rational is rounded once, to nearest with ties to even, directly to the required format (through f64, an f32 would
//! be rounded twice).

use num_bigint::{BigInt, BigUint, Sign};
use num_rational::BigRational;
use num_traits::{One, Signed, Zero};
use toml::de::DeValue;

/// An exact number.
pub type Rational = BigRational;

/// The scalar type of an evaluator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Precision {
    /// IEEE 754 binary64.
    F64,
    /// IEEE 754 binary32.
    F32,
}

impl Precision {
    /// Both, in the order used in files.
    pub const ALL: [Precision; 2] = [Precision::F64, Precision::F32];

    /// The name used in the command line, in JSON and in Rust.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Precision::F64 => "f64",
            Precision::F32 => "f32",
        }
    }

    /// The number of significant bits, including the hidden one.
    #[must_use]
    pub(crate) fn significand_bits(self) -> i64 {
        match self {
            Precision::F64 => 53,
            Precision::F32 => 24,
        }
    }

    /// The exponent of the smallest subnormal, which is a power of two.
    #[must_use]
    pub(crate) fn smallest_exponent(self) -> i64 {
        match self {
            Precision::F64 => -1074,
            Precision::F32 => -149,
        }
    }

    /// Unit roundoff: half the distance from 1 to the next number, 2^-53 or 2^-24.
    #[must_use]
    pub fn unit_roundoff(self) -> f64 {
        power_of_two(-self.significand_bits())
    }

    /// The largest finite number, as f64.
    #[must_use]
    pub fn largest(self) -> f64 {
        match self {
            Precision::F64 => f64::MAX,
            Precision::F32 => f64::from(f32::MAX),
        }
    }

    /// Rounds a rational to this format, to nearest, ties to even. Infinite when it is too large. The result is
    /// given as f64, which holds every f32 exactly.
    ///
    /// ```
    /// use rsm_core::number::{Precision, Rational};
    ///
    /// let third = Rational::new(1.into(), 3.into());
    /// assert_eq!(Precision::F64.round(&third), 1.0 / 3.0);
    /// assert_eq!(Precision::F32.round(&third), f64::from(1.0f32 / 3.0));
    /// ```
    #[must_use]
    pub fn round(self, value: &Rational) -> f64 {
        round_to_format(value, self)
    }

    /// The next number of this format above `value`, which must be of this format.
    #[must_use]
    pub fn next_up(self, value: f64) -> f64 {
        match self {
            Precision::F64 => value.next_up(),
            Precision::F32 => f64::from((value as f32).next_up()),
        }
    }

    /// The next number of this format below `value`, which must be of this format.
    #[must_use]
    pub fn next_down(self, value: f64) -> f64 {
        -self.next_up(-value)
    }

    /// The smallest number of this format that is not below `value`; infinite above the largest.
    #[must_use]
    pub fn round_up(self, value: &Rational) -> f64 {
        let nearest = self.round(value).max(-self.largest());
        if nearest.is_finite() && exact(nearest) < *value { self.next_up(nearest) } else { nearest }
    }

    /// The largest number of this format that is not above `value`; infinite below the smallest.
    #[must_use]
    pub fn round_down(self, value: &Rational) -> f64 {
        -self.round_up(&-value)
    }
}

/// 2^exponent for an exponent in the range of f64, including subnormals; 0 below.
#[must_use]
pub fn power_of_two(exponent: i64) -> f64 {
    match exponent {
        -1022..=1023 => f64::from_bits(((exponent + 1023) as u64) << 52),
        -1074..=-1023 => f64::from_bits(1 << (exponent + 1074)),
        _ if exponent < 0 => 0.0,
        _ => f64::INFINITY,
    }
}

/// A finite f64 as an exact rational.
///
/// # Panics
/// For NaN and infinities, which a checked model does not contain.
#[must_use]
pub fn exact(value: f64) -> Rational {
    Rational::from_float(value).expect("a checked number is finite")
}

fn round_to_format(value: &Rational, precision: Precision) -> f64 {
    if value.is_zero() {
        return 0.0;
    }
    let numerator = value.numer().abs().to_biguint().expect("absolute");
    let denominator = value.denom().abs().to_biguint().expect("absolute");
    // floor(log2(|value|)) is this or one less.
    let mut exponent = numerator.bits() as i64 - denominator.bits() as i64;
    if shifted_less(&numerator, &denominator, exponent) {
        exponent -= 1;
    }
    // One unit in the last place of the result is 2^ulp.
    let ulp = (exponent - precision.significand_bits() + 1).max(precision.smallest_exponent());
    let (scaled_numerator, scaled_denominator) =
        if ulp < 0 { (numerator << (-ulp) as u64, denominator) } else { (numerator, denominator << ulp as u64) };
    let mut units = &scaled_numerator / &scaled_denominator;
    let twice_rest = (&scaled_numerator - &units * &scaled_denominator) << 1u8;
    let odd = units.bit(0);
    if twice_rest > scaled_denominator || (twice_rest == scaled_denominator && odd) {
        units += BigUint::one();
    }
    let units = u64::try_from(&units).expect("a significand has at most 54 bits");
    // At most 53 bits remain after a carry to a power of two, so the product is exact unless it overflows.
    let magnitude = scale_by_power_of_two(units as f64, ulp);
    let magnitude = if magnitude > precision.largest() { f64::INFINITY } else { magnitude };
    if value.is_negative() { -magnitude } else { magnitude }
}

/// numerator / denominator < 2^exponent
fn shifted_less(numerator: &BigUint, denominator: &BigUint, exponent: i64) -> bool {
    if exponent >= 0 {
        *numerator < (denominator << (exponent as u64))
    } else {
        (numerator << ((-exponent) as u64)) < *denominator
    }
}

/// value * 2^exponent, exact if the result is an f64. In two steps, because 2^exponent may be outside the range of f64.
fn scale_by_power_of_two(value: f64, exponent: i64) -> f64 {
    let half = exponent / 2;
    value * power_of_two(half) * power_of_two(exponent - half)
}

/// A rational from an integer.
#[must_use]
pub fn integer(value: i64) -> Rational {
    Rational::from_integer(BigInt::from(value))
}

/// `base` to an integer power.
#[must_use]
pub fn power(base: &Rational, exponent: u32) -> Rational {
    num_traits::pow(base.clone(), exponent as usize)
}

/// The sign of a rational, without creating another one.
#[must_use]
pub fn sign(value: &Rational) -> Sign {
    value.numer().sign()
}

/// The shortest decimal text that reads back to the same f64, always with a point or an exponent.
///
/// ```
/// use rsm_core::number;
///
/// assert_eq!(number::decimal(0.1), "0.1");
/// assert_eq!(number::decimal(3.0), "3.0");
/// ```
#[must_use]
pub fn decimal(value: f64) -> String {
    format!("{value:?}")
}

/// The shortest decimal text that reads back to the same f32 (for a value that is an f32).
#[must_use]
pub fn decimal_f32(value: f64) -> String {
    format!("{:?}", value as f32)
}

/// A number of a TOML document, integers included, correctly rounded. `None` when the value is not a number.
#[must_use]
pub fn from_toml(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(text) => text.as_str().parse().ok(),
        DeValue::Integer(text) if text.radix() == 10 => text.as_str().parse().ok(),
        DeValue::Integer(text) => i64::from_str_radix(text.as_str(), text.radix()).ok().map(|whole| whole as f64),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio(numerator: i64, denominator: i64) -> Rational {
        Rational::new(BigInt::from(numerator), BigInt::from(denominator))
    }

    #[test]
    fn every_f64_survives_the_way_to_a_rational_and_back() {
        for value in [1.0, -0.1, 5e-324, f64::MAX, f64::MIN_POSITIVE, 38.19, 2f64.powi(-1060) * 3.0] {
            assert_eq!(Precision::F64.round(&exact(value)).to_bits(), value.to_bits(), "{value:e}");
            assert_eq!(decimal(value).parse::<f64>().unwrap().to_bits(), value.to_bits());
        }
        for value in [1.0f32, 0.1, 1e-45, f32::MAX, f32::MIN_POSITIVE] {
            assert_eq!(Precision::F32.round(&exact(f64::from(value))) as f32, value);
        }
    }

    #[test]
    fn a_rational_is_rounded_once() {
        // 1 + 2^-24 + 2^-60: just above the tie between 1 and 1 + 2^-23. Rounded to f64 first, it becomes the tie and goes to even.
        let value = Rational::one() + exact(power_of_two(-24)) + exact(power_of_two(-60));
        assert_eq!(Precision::F32.round(&value), 1.0 + power_of_two(-23));
        assert_eq!((Precision::F64.round(&value) as f32), 1.0);
        assert_eq!(Precision::F64.round(&ratio(1, 3)), 1.0 / 3.0);
        assert_eq!(Precision::F64.round(&ratio(-1, 10)), -0.1);
    }

    #[test]
    fn ties_go_to_even_and_large_numbers_to_infinity() {
        assert_eq!(Precision::F32.round(&(exact(1.0) + exact(power_of_two(-24)))), 1.0);
        assert_eq!(Precision::F32.round(&(exact(1.0) + exact(3.0 * power_of_two(-24)))), 1.0 + 2.0 * power_of_two(-23));
        assert_eq!(Precision::F32.round(&exact(1e39)), f64::INFINITY);
        assert_eq!(Precision::F64.round(&(exact(f64::MAX) * integer(2))), f64::INFINITY);
        // Half of the smallest subnormal is a tie with zero.
        assert_eq!(Precision::F64.round(&(exact(5e-324) / integer(2))), 0.0);
        assert_eq!(Precision::F64.round(&(exact(5e-324) * ratio(3, 4))), 5e-324);
    }

    #[test]
    fn directed_rounding_encloses() {
        let tenth = ratio(1, 10);
        for precision in Precision::ALL {
            assert!(exact(precision.round_up(&tenth)) >= tenth && exact(precision.round_down(&tenth)) <= tenth);
            assert_eq!(precision.next_up(precision.round_down(&tenth)), precision.round_up(&tenth));
            // Beyond the largest number: that number on one side, infinity on the other.
            let (largest, beyond) = (precision.largest(), exact(precision.largest()) * integer(3));
            assert_eq!((precision.round_down(&beyond), precision.round_up(&beyond)), (largest, f64::INFINITY));
            assert_eq!((precision.round_down(&-&beyond), precision.round_up(&-beyond)), (f64::NEG_INFINITY, -largest));
            // Above it, but nearer to it than half a unit: rounding to nearest gives it, rounding up does not.
            let just_above = exact(largest) + exact(1.0) / integer(4);
            assert_eq!((precision.round_down(&just_above), precision.round_up(&just_above)), (largest, f64::INFINITY));
        }
    }
}

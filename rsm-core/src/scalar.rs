//! The scalar types for executing a tape: f64 and f32, with operations besides arithmetic.
//!
//! In: a number. Out: its sign, its exponent, its bits. No rounding.

use crate::number::Precision;

/// A scalar type that a tape can be executed in.
pub trait Scalar:
    Copy
    + PartialOrd
    + std::ops::Neg<Output = Self>
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
    + std::ops::Div<Output = Self>
{
    /// The precision of this type.
    const PRECISION: Precision;
    /// A constant of a tape; exact in this type.
    fn from_constant(value: f64) -> Self;
    /// Clears the sign bit.
    fn absolute(self) -> Self;
    /// The exponent field without its bias, as a number: [`crate::tape::Op::Exponent`].
    fn exponent(self) -> Self;
    /// An integer moved to the exponent field: [`crate::tape::Op::PowerOfTwo`].
    fn power_of_two(self) -> Self;
    /// The nearest integer, of two equally near the even one: [`crate::tape::Op::Nearest`].
    fn to_nearest_whole(self) -> Self;
    /// The low bits of a non-negative integer: [`crate::tape::Op::Load`].
    fn whole(self) -> u32;
    /// The bits, in the low end.
    fn bits(self) -> u64;
}

macro_rules! scalar {
    ($float:ty, $precision:expr) => {
        impl Scalar for $float {
            const PRECISION: Precision = $precision;
            fn from_constant(value: f64) -> Self {
                value as $float
            }
            fn absolute(self) -> Self {
                self.abs()
            }
            fn exponent(self) -> Self {
                const DIGITS: u32 = <$float>::MANTISSA_DIGITS - 1;
                let field = (self.to_bits() << 1) >> (DIGITS + 1);
                field as $float - (<$float>::MAX_EXP - 1) as $float
            }
            fn power_of_two(self) -> Self {
                const DIGITS: u32 = <$float>::MANTISSA_DIGITS - 1;
                // In [2^52, 2^53), in f32 [2^23, 2^24), the last bit of a number is 1. Sum and bias are exact.
                let one_and_a_half = (3u64 << (DIGITS - 1)) as $float;
                let biased = self + (one_and_a_half + (<$float>::MAX_EXP - 1) as $float);
                <$float>::from_bits(biased.to_bits() << DIGITS)
            }
            fn to_nearest_whole(self) -> Self {
                // From 2^52, in f32 2^23, numbers have no fractional digits: the sum is rounded to an integer.
                const LIFT: $float = (3u64 << (<$float>::MANTISSA_DIGITS - 2)) as $float;
                (self + LIFT) - LIFT
            }
            fn whole(self) -> u32 {
                const LIFT: $float = (3u64 << (<$float>::MANTISSA_DIGITS - 2)) as $float;
                (self + LIFT).to_bits() as u32
            }
            fn bits(self) -> u64 {
                u64::from(self.to_bits())
            }
        }
    };
}
scalar!(f64, Precision::F64);
scalar!(f32, Precision::F32);

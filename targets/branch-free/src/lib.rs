//! Comparisons that select without a branch, in f32: the operations that a control step needs in addition to + - * and /.
//!
//! In: numbers. Out: one of them, by one comparison, with the same meaning on every machine; `targets/firmware/exact.h` is the same in C. On x86-64
//! each of the two bounds is one instruction and a select four; elsewhere a hint tells the compiler that the comparison is not predictable. Never
//! allocates, never branches, contains nothing about motors.
//!
//! ```
//! use branch_free::{at_least, at_most, nothing, select};
//!
//! assert_eq!(at_most(at_least(-3.0, 0.0), 1.0), 0.0);
//! assert!(at_least(f32::NAN, 0.0).is_nan());             // a NaN passes a bound
//! assert_eq!(select(f32::NAN, 1.0, 10.0, 20.0), 20.0);    // and is less than nothing
//! assert!(nothing(3.0) == 0.0 && nothing(f32::INFINITY).is_nan());
//! ```
#![no_std]
// Denied, not forbidden: SSE instructions are `unsafe` functions in Rust, and the square root of other machines is inline assembly. There is no other
// unsafe code.
#![deny(unsafe_code)]

/// `bound` if `value < bound`, else `value`: a NaN passes, and for equal numbers the result is `value`.
#[allow(unsafe_code)]
#[inline(always)]
#[must_use]
pub fn at_least(value: f32, bound: f32) -> f32 {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    {
        use core::arch::x86_64::{_mm_cvtss_f32, _mm_max_ss, _mm_set_ss};
        // SAFETY: the `cfg` ensures that the machine has SSE.
        unsafe { _mm_cvtss_f32(_mm_max_ss(_mm_set_ss(bound), _mm_set_ss(value))) }
    }
    #[cfg(not(all(target_arch = "x86_64", target_feature = "sse2")))]
    {
        core::hint::select_unpredictable(value < bound, bound, value)
    }
}

/// `bound` if `bound < value`, else `value`: a NaN passes, and for equal numbers the result is `value`.
#[allow(unsafe_code)]
#[inline(always)]
#[must_use]
pub fn at_most(value: f32, bound: f32) -> f32 {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    {
        use core::arch::x86_64::{_mm_cvtss_f32, _mm_min_ss, _mm_set_ss};
        // SAFETY: the `cfg` ensures that the machine has SSE.
        unsafe { _mm_cvtss_f32(_mm_min_ss(_mm_set_ss(bound), _mm_set_ss(value))) }
    }
    #[cfg(not(all(target_arch = "x86_64", target_feature = "sse2")))]
    {
        core::hint::select_unpredictable(bound < value, bound, value)
    }
}

/// Both bounds, the lower one first: if `high < low` the result is `high`.
#[inline(always)]
#[must_use]
pub fn within(value: f32, low: f32, high: f32) -> f32 {
    at_most(at_least(value, low), high)
}

/// `then` if `left < right`, else `otherwise`, also if either is NaN.
#[allow(unsafe_code)]
#[inline(always)]
#[must_use]
pub fn select(left: f32, right: f32, then: f32, otherwise: f32) -> f32 {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    {
        use core::arch::x86_64::{_mm_and_ps, _mm_andnot_ps, _mm_cmplt_ss, _mm_cvtss_f32, _mm_or_ps, _mm_set_ss};
        // SAFETY: the `cfg` ensures that the machine has SSE.
        unsafe {
            let mask = _mm_cmplt_ss(_mm_set_ss(left), _mm_set_ss(right));
            let chosen = _mm_and_ps(mask, _mm_set_ss(then));
            let other = _mm_andnot_ps(mask, _mm_set_ss(otherwise));
            _mm_cvtss_f32(_mm_or_ps(chosen, other))
        }
    }
    #[cfg(not(all(target_arch = "x86_64", target_feature = "sse2")))]
    {
        core::hint::select_unpredictable(left < right, then, otherwise)
    }
}

/// `value` without its sign.
#[inline(always)]
#[must_use]
pub fn magnitude(value: f32) -> f32 {
    f32::from_bits(value.to_bits() & 0x7FFF_FFFF)
}

/// The square root, rounded to the nearest f32 as IEEE 754 requires: the same bits on every machine. NaN for a NaN and for a number below 0. It is
/// the machine's instruction on x86-64, AArch64 and 32-bit Arm with an FPU; elsewhere it is computed digit by digit.
///
/// ```
/// assert_eq!(branch_free::root(2.25), 1.5);
/// assert!(branch_free::root(-1.0).is_nan());
/// ```
#[allow(unsafe_code)]
#[inline(always)]
#[must_use]
pub fn root(value: f32) -> f32 {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    {
        use core::arch::x86_64::{_mm_cvtss_f32, _mm_set_ss, _mm_sqrt_ss};
        // SAFETY: the `cfg` ensures that the machine has SSE.
        unsafe { _mm_cvtss_f32(_mm_sqrt_ss(_mm_set_ss(value))) }
    }
    #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
    {
        let root: f32;
        // SAFETY: the instruction reads one register and writes another.
        unsafe { core::arch::asm!("fsqrt {0:s}, {1:s}", out(vreg) root, in(vreg) value, options(pure, nomem, nostack)) };
        root
    }
    // The names of these targets end in `eabihf`: numbers are passed in registers of an FPU, so the machine has one. Rust passes such a register to
    // inline assembly only if the FPU also has doubles; so the number passes through a general register.
    #[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
    {
        let mut bits = value.to_bits();
        // SAFETY: the instructions change only the two named registers.
        unsafe {
            core::arch::asm!(
                "vmov s0, {0}",
                "vsqrt.f32 s0, s0",
                "vmov {0}, s0",
                inout(reg) bits,
                out("s0") _,
                options(pure, nomem, nostack)
            );
        }
        f32::from_bits(bits)
    }
    #[cfg(not(any(
        all(target_arch = "x86_64", target_feature = "sse2"),
        all(target_arch = "aarch64", target_feature = "neon"),
        all(target_arch = "arm", target_abi = "eabihf")
    )))]
    {
        root_by_digits(value)
    }
}

/// The same computation with integers, for machines without the instruction.
#[cfg_attr(
    any(
        all(target_arch = "x86_64", target_feature = "sse2"),
        all(target_arch = "aarch64", target_feature = "neon"),
        all(target_arch = "arm", target_abi = "eabihf")
    ),
    allow(dead_code)
)]
fn root_by_digits(value: f32) -> f32 {
    let bits = value.to_bits();
    if bits << 1 == 0 || bits == 0x7F80_0000 {
        return value;
    }
    if bits > 0x7F80_0000 {
        // A NaN, or a number below 0.
        return f32::NAN;
    }
    // value = mantissa * 2^exponent with a mantissa of 24 bits, also if the value is subnormal.
    let (raw, rest) = ((bits >> 23) as i32, bits & 0x007F_FFFF);
    let (mantissa, exponent) = if raw == 0 { (rest, -149) } else { (rest | 0x0080_0000, raw - 150) };
    let up = mantissa.leading_zeros() as i32 - 8;
    let exponent = exponent - up;
    // Shifted so that the exponent is even and the root has 25 bits: 24, and one for rounding. A tie is impossible.
    let moved = 25 + ((exponent + 25) & 1);
    let square = u64::from(mantissa << up) << moved;
    let (mut root, mut bit) = (0u64, 1u64 << 24);
    while bit > 0 {
        let more = root | bit;
        if more * more <= square {
            root = more;
        }
        bit >>= 1;
    }
    let power = (exponent - moved) / 2 + 1;
    // Exact: at most 2^24 times a power of two, far inside the range.
    ((root + 1) >> 1) as f32 * f32::from_bits(((power + 127) as u32) << 23)
}

/// 0 for a finite number, NaN for a NaN or an infinity. The sum of several is 0 or NaN; the comparison `sum < 1.0` shows which.
// The difference of a number with itself is intended here.
#[allow(clippy::eq_op)]
#[inline(always)]
#[must_use]
pub fn nothing(value: f32) -> f32 {
    value - value
}

/// `then` if a sum of results of [`nothing`] is 0 (all numbers were finite), else `otherwise`.
#[inline(always)]
#[must_use]
pub fn if_good(sum_of_nothings: f32, then: f32, otherwise: f32) -> f32 {
    select(sum_of_nothings, 1.0, then, otherwise)
}

/// Counts of bad samples: in total, and in a row up to now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BadSamples {
    /// In total; saturates at the largest `i32`.
    pub all: u32,
    /// In a row up to now: 0 after a good one.
    pub in_a_row: u32,
}

impl BadSamples {
    /// Counts one sample.
    #[inline(always)]
    pub fn count(&mut self, good: bool) {
        let bad = u32::from(!good);
        self.all = add_up_to_the_largest(self.all, bad);
        // A mask of all ones if the sample is bad: keeps the count of the row.
        self.in_a_row = add_up_to_the_largest(self.in_a_row, bad) & 0u32.wrapping_sub(bad);
    }
}

/// The sum of a count and `one`, at most the largest `i32`. `one` is 0 or 1. Such a saturating sum is one instruction on a Cortex-M4.
#[inline(always)]
fn add_up_to_the_largest(count: u32, one: u32) -> u32 {
    let sum = count.wrapping_add(one);
    sum.wrapping_sub(one & (sum >> 31))
}

/// 1 if a count has reached `most`, a number from 1 to 2^23, else 0. Floats are compared, because a compiler makes a branch of a comparison of
/// integers. Up to 2^23 `most` minus a half is exact. A larger count stays above it with any rounding.
#[inline(always)]
#[must_use]
pub fn reached(count: u32, most: u32) -> f32 {
    select(most as f32 - 0.5, count as f32, 1.0, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HARD: [f32; 12] =
        [0.0, -0.0, 1e-45, -1e-45, 1.0, -1.0, 3.5, f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];

    #[test]
    fn every_pair_gives_what_the_comparison_says() {
        for a in HARD {
            for b in HARD {
                assert_eq!(at_least(a, b).to_bits(), if a < b { b } else { a }.to_bits(), "{a} {b}");
                assert_eq!(at_most(a, b).to_bits(), if b < a { b } else { a }.to_bits(), "{a} {b}");
                assert_eq!(select(a, b, 2.0, f32::NAN).to_bits(), if a < b { 2.0 } else { f32::NAN }.to_bits(), "{a} {b}");
            }
            assert_eq!(nothing(a) < 1.0, a.is_finite(), "{a}");
            assert_eq!(magnitude(a).to_bits(), a.abs().to_bits(), "{a}");
        }
    }

    #[test]
    fn a_root_by_digits_has_the_bits_of_the_instruction() {
        let same = |value: f32| {
            let (found, expected) = (root_by_digits(value), root(value));
            found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan()
        };
        // Every sign and exponent, with mantissas all over their range: 4,049 has no common factor with 2^32.
        let drawn = (0..1_060_000u32).map(|k| f32::from_bits(k.wrapping_mul(4_049)));
        for value in drawn.chain(HARD).chain([4.0, 2.0, 1.0f32.next_down(), f32::MIN_POSITIVE, f32::MIN_POSITIVE.next_down()]) {
            assert!(same(value), "{value:e}: {:e}", root_by_digits(value));
        }
        assert_eq!([root_by_digits(2.25), root_by_digits(2.0)], [1.5, core::f32::consts::SQRT_2]);
    }

    #[test]
    fn bad_samples_are_counted_and_stay_at_the_largest_number() {
        let mut bad = BadSamples::default();
        for good in [true, false, false, true, false] {
            bad.count(good);
        }
        assert_eq!(bad, BadSamples { all: 3, in_a_row: 1 });
        let largest = i32::MAX as u32;
        let mut full = BadSamples { all: largest - 1, in_a_row: largest - 1 };
        for _ in 0..3 {
            full.count(false);
            assert_eq!(full, BadSamples { all: largest, in_a_row: largest });
        }
        full.count(true);
        assert_eq!(full, BadSamples { all: largest, in_a_row: 0 });
        assert_eq!([9, 10, 11].map(|count| reached(count, 10)), [0.0, 1.0, 1.0]);
    }
}

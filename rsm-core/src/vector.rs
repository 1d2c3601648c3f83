//! Loops over numbers in adjacent memory with the vector instructions of this machine.
//!
//! In: a loop. Out: its result, from code for AVX2 or AVX-512 if the machine has them, otherwise for the oldest machine of its kind. The bits are the
//! same: every operation is one of IEEE 754 for each number, in the same order, and a compiler for Rust joins no product and sum to a fused
//! operation. A loop that wants fused operations has a text of its own for machines with them ([`Work::run_fused`]).
#![allow(unsafe_code)] // A function for instructions that the machine may not have is called, which is not possible in safe code.

/// A loop over numbers. `run` and everything that it calls on them must have the attribute `inline(always)`: only inlined code becomes vector
/// instructions, and code that stays a call keeps its own instructions.
///
/// ```
/// use rsm_core::vector::{Work, vectorised, widest};
///
/// struct Square<'a>(&'a [f64]);
///
/// impl Work for Square<'_> {
///     type Found = f64;
///
///     #[inline(always)]
///     fn run(self) -> f64 {
///         self.0.iter().map(|it| it * it).sum()
///     }
/// }
///
/// assert_eq!(vectorised(Square(&[3.0, 4.0])), 25.0);
/// assert_eq!(widest(Square(&[3.0, 4.0])), 25.0);
/// ```
pub trait Work {
    /// The result.
    type Found;

    /// The loop.
    fn run(self) -> Self::Found;

    /// The loop for a machine where `f64::mul_add` is one instruction, not a call of a function. It must have the bits of `run`.
    #[inline(always)]
    fn run_fused(self) -> Self::Found
    where
        Self: Sized,
    {
        self.run()
    }
}

// AVX-512 contains AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn with_avx512<W: Work>(work: W) -> W::Found {
    work.run_fused()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2_and_fma<W: Work>(work: W) -> W::Found {
    work.run_fused()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<W: Work>(work: W) -> W::Found {
    work.run()
}

/// Runs a loop with the registers of AVX2, if this machine has them: four numbers in a register. For loops over few numbers.
#[inline]
pub fn vectorised<W: Work>(work: W) -> W::Found {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        if std::arch::is_x86_feature_detected!("fma") {
            // SAFETY: the machine has the instructions.
            return unsafe { with_avx2_and_fma(work) };
        }
        // SAFETY: the machine has the instructions.
        return unsafe { with_avx2(work) };
    }
    // Every 64-bit Arm has fused operations.
    if cfg!(target_arch = "aarch64") { work.run_fused() } else { work.run() }
}

/// Runs a loop with the widest registers of this machine, up to eight numbers in a register.
#[inline]
pub fn widest<W: Work>(work: W) -> W::Found {
    #[cfg(target_arch = "x86_64")]
    if has_eight() {
        // SAFETY: the machine has the instructions.
        return unsafe { with_avx512(work) };
    }
    vectorised(work)
}

/// Runs a loop with registers of eight numbers.
///
/// ```
/// use rsm_core::vector::{Work, has_eight, with_eight};
///
/// struct Largest([f64; 8]);
///
/// impl Work for Largest {
///     type Found = f64;
///
///     #[inline(always)]
///     fn run(self) -> f64 {
///         self.0.into_iter().fold(0.0, f64::max)
///     }
/// }
///
/// if has_eight() {
///     assert_eq!(with_eight(Largest([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])), 8.0);
/// }
/// ```
///
/// # Panics
/// If no register of this machine has eight numbers ([`has_eight`]).
#[inline]
pub fn with_eight<W: Work>(work: W) -> W::Found {
    assert!(has_eight(), "no register of this machine has eight numbers");
    #[cfg(target_arch = "x86_64")]
    // SAFETY: the machine has the instructions.
    return unsafe { with_avx512(work) };
    #[cfg(not(target_arch = "x86_64"))]
    work.run()
}

/// Whether a register of this machine has eight numbers.
#[inline]
#[must_use]
pub fn has_eight() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        std::arch::is_x86_feature_detected!("avx512f")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        false
    }
}

//! Loops over lanes with the widest vector instructions of this machine.
//!
//! In: a loop over lanes. Out: its result, from code for AVX-512 or AVX2 if the machine has them, otherwise for the oldest machine of its kind. The
//! bits are the same: every operation is one of IEEE 754 in each lane, and a compiler for Rust joins no product and sum to a fused operation.
#![allow(unsafe_code)] // A function for instructions that the machine may not have is called, which is not possible in safe code.

/// A loop over lanes. `run` and all that it calls on lanes must be `#[inline(always)]`: code that stays a call keeps its own instructions.
pub(crate) trait Kernel {
    type Output;
    fn run(self) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// Runs a loop.
#[cfg(target_arch = "x86_64")]
pub(crate) fn widest<K: Kernel>(kernel: K) -> K::Output {
    if std::arch::is_x86_feature_detected!("avx512f") {
        // SAFETY: the machine has the instructions.
        unsafe { with_avx512(kernel) }
    } else if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the machine has the instructions.
        unsafe { with_avx2(kernel) }
    } else {
        kernel.run()
    }
}

/// Runs a loop.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) fn widest<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

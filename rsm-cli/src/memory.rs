//! Settings of the allocator.
//!
//! A diagnosis allocates and frees vectors of some hundred kilobytes hundreds of thousands of times. By default the allocator of the GNU C library
//! returns each to the system, which clears every page when it is given out again. Changes no result.

/// Vectors below this size, in bytes, are given out again without the system. 32 MiB is the largest value that `mallopt` documents.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT: i32 = 32 << 20;

/// The memory at the end of the heap, in bytes, that is kept: that of a few such vectors.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT_AT_THE_END: i32 = 4 * KEPT;

/// Keeps freed vectors in the process.
pub(crate) fn keep_freed_vectors() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[allow(unsafe_code)] // A function of the C library without a safe wrapper.
    // SAFETY: both are settings that `mallopt` documents. If it refuses one, nothing changes.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, KEPT);
        libc::mallopt(libc::M_TRIM_THRESHOLD, KEPT_AT_THE_END);
    }
}

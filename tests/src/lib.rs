//! What the tests that cross crates share.
//!
//! In: the random models that the build script wrote, the compilers of this machine. Out: cases, points that hurt, evaluators loaded from
//! what a compiler made of emitted text, reports of a difference. No test stands here.

pub mod backend;
pub mod cases;
pub mod compilers;
pub mod object;
pub mod points;
pub mod report;

mod skipped;
pub use skipped::skipped;

/// Whether this is the campaign `cargo xtask bits`: every point and every combination, in place of the part that `cargo xtask test` runs.
#[must_use]
pub fn is_campaign() -> bool {
    std::env::var_os("RSM_BITS_CAMPAIGN").is_some()
}

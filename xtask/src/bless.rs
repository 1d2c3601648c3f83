//! `cargo xtask bless`: writes anew everything that is generated and checked in. Look at the difference before committing it.
//!
//! Out: `generated/rust` and `generated/c` from `generated/coefficients`; golden files and instruction counts by running their tests with RSM_BLESS=1.

use crate::generated;
use crate::stage::Run;
use crate::test;
use crate::workspace::cargo;

/// Writes everything, in the order of dependence.
pub(crate) fn run() -> bool {
    let with_bless = |arguments: &[&str]| {
        let mut command = cargo(arguments);
        command.env("RSM_BLESS", "1");
        command
    };
    Run::new()
        .command("programs", test::programs())
        .check("generated", generated::refresh)
        .command("golden files", with_bless(&["test", "--workspace", "--exclude", "rsm-bench", "--no-fail-fast"]))
        .command("instructions", with_bless(&["test", "-p", "rsm-bench"]))
        .finish()
}

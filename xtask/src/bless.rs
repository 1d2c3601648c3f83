//! `cargo xtask bless`: writes all files that are generated and checked in. Read the difference before a commit.
//!
//! Out: the coefficient files that tests make, then `generated/rust` and `generated/c` from them, then golden files and instruction counts. Tests
//! with `RSM_BLESS=1` write all of them except the second.

use crate::generated;
use crate::stage::Run;
use crate::test;
use crate::workspace::cargo;

/// The tests that write files when `RSM_BLESS` is set: parts of their names.
const WRITERS: [&str; 12] = [
    "circle::",
    "driveline::",
    "elementary::",
    "emitted::",
    "firmware::",
    "made_up_runs::",
    "measured_motor::",
    "motor::",
    "plans::",
    "refused",
    "rejected",
    "tutorial::",
];

/// Of these, the tests that make coefficient files: everything else depends on the files that they write.
const COEFFICIENTS: [&str; 2] = ["driveline::", "motor::"];

/// Writes everything, in the order of dependence.
pub(crate) fn run() -> bool {
    let with_bless = |arguments: &[&str], names: &[&str]| {
        let mut command = cargo(arguments);
        command.args(names.iter().take(1).map(|_| "--")).args(names).env("RSM_BLESS", "1");
        command
    };
    Run::new()
        .command("programs", test::programs())
        .command("coefficients", with_bless(&["test", "-p", "rsm-cli", "--test", "all"], &COEFFICIENTS))
        .check("generated", generated::refresh)
        .command(
            "golden files",
            with_bless(&["test", "--workspace", "--exclude", "rsm-bench", "--all-targets", "--no-fail-fast"], &WRITERS),
        )
        .command("instructions", with_bless(&["test", "-p", "rsm-bench"], &[]))
        .finish()
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::*;
    use crate::workspace::{root, sources};

    #[test]
    fn every_file_that_reads_the_variable_is_among_the_writers() {
        // The test that compares messages of refused files is a function that the tests of several packages call.
        let is_test = |path: &PathBuf| {
            let own = path.strip_prefix(root()).unwrap_or(path);
            !own.starts_with("xtask") && !own.starts_with("bench") && own != Path::new("tests/src/refused.rs")
        };
        let readers = sources(&root(), "rs")
            .into_iter()
            .filter(is_test)
            .filter(|path| std::fs::read_to_string(path).is_ok_and(|text| text.contains("var_os(\"RSM_BLESS\")")));
        let module = |path: PathBuf| {
            let own = path.strip_prefix(root()).unwrap_or(&path);
            own.to_string_lossy().replace(".rs", "::").replace('/', "::")
        };
        let readers: Vec<String> = readers.map(module).collect();
        assert!(readers.len() > 5, "{readers:?}");
        for reader in readers {
            assert!(WRITERS.iter().any(|it| reader.contains(it)), "`WRITERS` lacks the tests of {reader}");
        }
    }
}

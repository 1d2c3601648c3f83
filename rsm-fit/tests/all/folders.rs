//! Where measured and certified data lie. Included by path in the tests of other crates too.

use std::io::Write;
use std::path::{Path, PathBuf};

/// The published data beside the repository, or `None` where they are not there: said loudly, and a failure in CI.
pub fn shared(set: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(set);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("CI").is_none(), "../shared/data/{set} is missing, and in CI these tests must run");
    // Written past the test harness, which would keep the words of a test that passes; `cargo xtask test` counts such lines.
    let _ = writeln!(std::io::stdout(), "\nSKIPPED: ../shared/data/{set} is missing");
    None
}

/// NIST's Statistical Reference Datasets, which ship with the project.
pub fn nist() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-fit/tests/nist-strd")
}

//! Where measured and certified data lie. Included by path in the tests of other crates too.

#[path = "../../../tests/src/skipped.rs"]
mod skipped;

use std::path::{Path, PathBuf};

use skipped::skipped;

/// The published data beside the repository, or `None` where they are not there: said loudly, and a failure in CI.
pub fn shared(set: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(set);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("CI").is_none(), "../shared/data/{set} is missing, and in CI these tests must run");
    skipped(&format!("../shared/data/{set} is missing"));
    None
}

/// NIST's Statistical Reference Datasets, which ship with the project.
pub fn nist() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-fit/tests/nist-strd")
}

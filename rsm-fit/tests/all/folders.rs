//! The folders of measured and certified data. The tests of other crates include this file by its path.

#[path = "../../../tests/src/skipped.rs"]
mod skipped;

use std::path::{Path, PathBuf};

use skipped::skipped;

/// The published data beside the repository, or `None` if they are missing. In that case a message is printed, and CI fails.
pub fn shared(set: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(set);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("CI").is_none(), "../shared/data/{set} is missing, and in CI these tests must run");
    skipped(&format!("../shared/data/{set} is missing"));
    None
}

/// NIST's Statistical Reference Datasets, which are part of the project.
pub fn nist() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-fit/tests/nist-strd")
}

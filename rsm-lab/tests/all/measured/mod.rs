//! Measured data: an axis, the flux map of a motor, the rolling records of an outrunner. Read where they stand, never copied.

mod emps;

use std::path::{Path, PathBuf};

/// A folder of measured data; `None`, said loudly, without it.
fn folder(set: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(set);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("CI").is_none(), "../shared/data/{set} is missing, and in CI these tests must run");
    eprintln!("SKIPPED: ../shared/data/{set} is missing; this test has shown NOTHING");
    None
}

//! Where the tests find libhelics. Included by path in the other tests of the command.

use std::path::{Path, PathBuf};

use crate::skipped::skipped;

/// The library, by the variable RSM_HELICS, or where `cargo xtask test` puts it; or a loud skip.
pub(crate) fn helics(test: &str) -> Option<PathBuf> {
    let fetched = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/xtask/helics");
    let named = std::env::var_os("RSM_HELICS").map(PathBuf::from);
    let found = named.or(Some(fetched)).filter(|it| it.exists());
    if found.is_none() {
        skipped(&format!("no libhelics (pip install --target target/xtask/helics helics==3.6.1): {test}"));
    }
    found
}

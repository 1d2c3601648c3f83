//! Dask distributed, for the tests of `rsm sweep --engine dask`.
//!
//! In: nothing. Out: the package `distributed` below target/, from PyPI, or a note with the reason why it is missing. Without a network those tests
//! are skipped with a message.

use std::path::PathBuf;
use std::process::Command;

use crate::workspace::scratch;

/// The version that was tested.
const PACKAGE: &str = "distributed==2026.8.0";

/// The folder of the package. The tests use the same path.
fn folder() -> PathBuf {
    scratch("dask")
}

/// Downloads the package, once.
pub(crate) fn ensure() -> Result<(), String> {
    let folder = folder();
    let package = folder.join("distributed/__init__.py");
    if !package.is_file() {
        let mut pip = Command::new("python3");
        pip.args(["-m", "pip", "install", "--quiet", "--upgrade", "--target"]).arg(&folder).arg(PACKAGE);
        let status = pip.status().map_err(|error| format!("python3 cannot be started: {error}"))?;
        if !status.success() || !package.is_file() {
            println!("note: {PACKAGE} cannot be installed by pip ({status}); the tests of sweeps on Dask skip");
            return Ok(());
        }
    }
    println!("present: {}", package.display());
    Ok(())
}

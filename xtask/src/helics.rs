//! The library of HELICS, for the tests of federations.
//!
//! In: nothing. Out: libhelics below target/, from the wheel of PyPI, or a note with the reason why it is missing. Without a network those tests are
//! skipped with a message.

use std::path::PathBuf;
use std::process::Command;

use crate::workspace::scratch;

/// The version that was tested.
const WHEEL: &str = "helics==3.6.1";

/// The folder of the unpacked wheel. The tests use the same path.
pub(crate) fn folder() -> PathBuf {
    scratch("helics")
}

/// Downloads the library, once.
pub(crate) fn ensure() -> Result<(), String> {
    let folder = folder();
    let library = folder.join("helics/install/lib64/libhelics.so");
    if !library.is_file() {
        let mut pip = Command::new("python3");
        pip.args(["-m", "pip", "install", "--quiet", "--no-deps", "--upgrade", "--target"]).arg(&folder).arg(WHEEL);
        let status = pip.status().map_err(|error| format!("python3 cannot be started: {error}"))?;
        if !status.success() || !library.is_file() {
            println!("note: {WHEEL} cannot be installed by pip ({status}); the tests of federations skip");
            return Ok(());
        }
    }
    println!("present: {}", library.display());
    Ok(())
}

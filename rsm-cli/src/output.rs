//! Outputs: files that are whole or absent, and one JSON object on standard output.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::outcome::Refusal;

/// Writes files all or none, as far as a file system allows: each is written beside its place first, and renamed when all of them are
/// on the disk.
pub fn write_all(files: &[(PathBuf, impl AsRef<[u8]>)]) -> Result<(), Refusal> {
    let mut ready = Vec::new();
    for (path, bytes) in files {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let failed = |error: std::io::Error| Refusal::new(format!("{}: cannot be written: {error}", path.display()));
        std::fs::create_dir_all(folder).map_err(failed)?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(".rsm-").suffix(".part");
        #[cfg(unix)]
        {
            // A temporary file is private by default; what is renamed into place must be as readable as any other output.
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(std::fs::Permissions::from_mode(0o644));
        }
        let mut file = builder.tempfile_in(folder).map_err(failed)?;
        file.write_all(bytes.as_ref()).and_then(|()| file.as_file().sync_all()).map_err(failed)?;
        ready.push((file, path));
    }
    for (file, path) in ready {
        file.persist(path).map_err(|error| Refusal::new(format!("{}: cannot be written: {}", path.display(), error.error)))?;
    }
    Ok(())
}

/// Prints one JSON object on standard output.
pub fn json(value: &impl Serialize) -> Result<(), Refusal> {
    let text =
        serde_json::to_string_pretty(value).map_err(|error| Refusal::new(format!("cannot be written as JSON: {error}")))?;
    line(&text)
}

/// Prints a line on standard output; a reader that closed the pipe early is no fault of ours.
pub fn line(text: &str) -> Result<(), Refusal> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Refusal::new(format!("standard output cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}

/// A number for JSON: what is not finite becomes null.
pub fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

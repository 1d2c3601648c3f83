//! Outputs: files that are complete or not written at all, and one JSON object on standard output.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rsm_core::source::files_read;
use serde::Serialize;

use crate::outcome::Refusal;
use crate::replace;

/// Names of files that are not complete yet.
const PREFIX: &str = ".rsm-";
const SUFFIX: &str = ".part";

/// A temporary file exists only during a write: a second, or a minute on a slow network. After an hour it is the rest of a killed run.
const LEFTOVER: std::time::Duration = std::time::Duration::from_secs(3600);

/// Files that this process has written: it may write them again.
static WRITTEN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Writes all files or none, as far as a file system allows: each is written to a temporary file beside its place, and renamed when all of them are
/// on the disk. A symbolic link is kept, and the file that it names is replaced. A pipe or a device is written directly.
///
/// # Errors
/// A file that cannot be written, and a file that this process has read, under any of its names. An existing file of another kind is replaced only
/// with `--force`.
pub fn write_all(files: &[(PathBuf, impl AsRef<[u8]>)]) -> Result<(), Refusal> {
    for (path, bytes) in files {
        refuse(path, bytes.as_ref())?;
    }
    let mut ready = Vec::new();
    let mut through = Vec::new();
    for (path, bytes) in files {
        let failed = |error: std::io::Error| Refusal::new(format!("{}: cannot be written: {error}", path.display()));
        let place = place_of(path);
        if is_stream(&place) {
            through.push((place, path, bytes));
            continue;
        }
        let folder = match place.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        std::fs::create_dir_all(folder).map_err(failed)?;
        remove_leftovers(folder);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        #[cfg(unix)]
        {
            // A temporary file is private by default; the final file must be as readable as any other output.
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(std::fs::Permissions::from_mode(0o644));
        }
        let mut file = builder.tempfile_in(folder).map_err(failed)?;
        file.write_all(bytes.as_ref()).and_then(|()| file.as_file().sync_all()).map_err(failed)?;
        ready.push((file, place, path));
    }
    for (file, place, path) in ready {
        let failed = |error| Refusal::new(format!("{}: cannot be written: {error}", path.display()));
        file.persist(&place).map_err(|error| failed(error.error))?;
        WRITTEN.lock().unwrap_or_else(PoisonError::into_inner).push(place);
    }
    for (place, path, bytes) in through {
        let write = || std::fs::OpenOptions::new().write(true).open(&place)?.write_all(bytes.as_ref());
        match write() {
            // The reader of the pipe has closed it: not an error, as with standard output.
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                return Err(Refusal::new(format!("{}: cannot be written: {error}", path.display())));
            }
            _ => {}
        }
    }
    Ok(())
}

/// The file that a path names, after all symbolic links. The file need not exist.
fn place_of(path: &Path) -> PathBuf {
    let mut place = path.to_path_buf();
    // `/dev/stdout` may be a link to a name that is not a file.
    if is_stream(path) {
        return place;
    }
    // Linux follows at most 40 links.
    for _ in 0..40 {
        let Ok(target) = std::fs::read_link(&place) else { break };
        place = match place.parent() {
            Some(folder) => folder.join(target),
            None => target,
        };
    }
    place
}

/// Whether the path is a pipe or a device, which is written to and not replaced.
fn is_stream(place: &Path) -> bool {
    std::fs::metadata(place).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Whether two paths lead to the same file, also through links.
fn is_same_file(one: &Path, other: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let identity = |path: &Path| std::fs::metadata(path).map(|found| (found.dev(), found.ino())).ok();
        if let (Some(one), Some(other)) = (identity(one), identity(other)) {
            return one == other;
        }
    }
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

/// Refuses to replace a file that was read in this process, and an existing file that is not an output of this kind.
fn refuse(path: &Path, new: &[u8]) -> Result<(), Refusal> {
    let place = place_of(path);
    if is_stream(&place) || WRITTEN.lock().unwrap_or_else(PoisonError::into_inner).iter().any(|it| is_same_file(it, &place)) {
        return Ok(());
    }
    if let Some(read) = files_read().iter().find(|read| is_same_file(read, &place)) {
        return Err(Refusal::new(format!(
            "{}: not written: this is the input file `{}` that was read\n  help: give the output another name",
            path.display(),
            read.display()
        )));
    }
    match std::fs::read(&place) {
        Ok(old) if !replace::may(&old, new) => Err(Refusal::new(format!(
            "{}: not written: the existing file is not an rsm output of this kind\n  help: give the output another name, or --force to replace the file",
            path.display()
        ))),
        _ => Ok(()),
    }
}

/// Removes incomplete files of a killed run. Another run may be writing in the same folder now, so only old files are removed.
fn remove_leftovers(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_part = name.to_str().is_some_and(|name| name.starts_with(PREFIX) && name.ends_with(SUFFIX));
        let age = entry.metadata().and_then(|found| found.modified()).ok().and_then(|time| time.elapsed().ok());
        if is_part && age.is_some_and(|age| age > LEFTOVER) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Prints one JSON object on standard output.
pub fn json(value: &impl Serialize) -> Result<(), Refusal> {
    let text =
        serde_json::to_string_pretty(value).map_err(|error| Refusal::new(format!("cannot be written as JSON: {error}")))?;
    line(&text)
}

/// Prints a line on standard output. If the reader has closed the pipe, this is not an error.
pub fn line(text: &str) -> Result<(), Refusal> {
    match std::io::stdout().write_all(format!("{text}\n").as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Refusal::new(format!("standard output cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints a message on standard error. The reader may have closed it (`2>&1 | head`). This is not an error and does not stop the program, because the
/// files and the exit status are still needed. `eprintln!` would panic. A message is one write, because processes of one federation share the stream:
/// `write_fmt` writes the parts of a message one by one, and parts of another process come between them.
pub fn stderr(text: std::fmt::Arguments<'_>) {
    let _ = std::io::stderr().write_all(text.to_string().as_bytes());
}

/// A number for JSON: null if it is not finite.
pub fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

//! A folder of results: one file for each task, complete or absent.
//!
//! In: results. Out: the stored results. `tasks/HASH.json` is written under a temporary name and renamed. An incomplete file (after a power failure)
//! counts as absent. `starts.log` has a line for each started task: it shows the running tasks after a run was killed.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use crate::run::bytes;
use crate::tasks::Task;

/// The prefix of temporary files.
const PREFIX: &str = ".rsm-";
const SUFFIX: &str = ".part";

/// A temporary file of this age is left over from a killed run.
const LEFTOVER: Duration = Duration::from_secs(3600);

/// A folder of results.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// `None` if the folder is only read.
    log: Option<File>,
}

fn failed(path: &Path, what: &str, error: &std::io::Error) -> String {
    format!("{}: cannot be {what}: {error}", path.display())
}

impl Store {
    /// Opens a folder for writing; creates it if necessary.
    ///
    /// # Errors
    /// A sentence, if the folder cannot be written.
    pub fn open(out: &Path) -> Result<Store, String> {
        let folder = out.join("tasks");
        std::fs::create_dir_all(&folder).map_err(|error| failed(&folder, "made", &error))?;
        let log = out.join("starts.log");
        let opened = OpenOptions::new().create(true).append(true).open(&log);
        let store = Store { folder, log: Some(opened.map_err(|error| failed(&log, "written", &error))?) };
        store.remove_leftovers();
        Ok(store)
    }

    /// Opens a folder for reading only.
    ///
    /// # Errors
    /// A sentence, if the folder has no results.
    pub fn open_read_only(out: &Path) -> Result<Store, String> {
        let folder = out.join("tasks");
        if folder.is_dir() {
            Ok(Store { folder, log: None })
        } else {
            Err(format!("{}: not the output folder of a sweep: found no folder `tasks` in it", out.display()))
        }
    }

    /// Removes temporary files of a killed run. Another run may be writing in the same folder, so only old files are removed.
    fn remove_leftovers(&self) {
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let is_part = name.to_str().is_some_and(|name| name.starts_with(PREFIX) && name.ends_with(SUFFIX));
            let age = entry.metadata().and_then(|found| found.modified()).ok().and_then(|time| time.elapsed().ok());
            if is_part && age.is_some_and(|age| age > LEFTOVER) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }

    fn path(&self, hash: &str) -> PathBuf {
        self.folder.join(format!("{hash}.json"))
    }

    /// The result of a task, if it exists and is complete.
    #[must_use]
    pub fn get(&self, task: &Task) -> Option<Value> {
        let value: Value = serde_json::from_slice(&std::fs::read(self.path(&task.hash)).ok()?).ok()?;
        (value["task"].as_str() == Some(&task.hash)).then_some(value)
    }

    /// Logs the start of a task.
    ///
    /// # Errors
    /// A sentence, if the log cannot be written.
    pub fn start(&self, task: &Task) -> Result<(), String> {
        let Some(mut log) = self.log.as_ref() else { return Ok(()) };
        // A single write, so that lines of threads and processes do not mix.
        log.write_all(format!("{}\n", task.hash).as_bytes()).map_err(|error| format!("starts.log cannot be written: {error}"))
    }

    /// Stores a result.
    ///
    /// # Errors
    /// A sentence, if the result cannot be written.
    pub fn put(&self, task: &Task, result: &Value) -> Result<(), String> {
        let path = self.path(&task.hash);
        let write = || {
            let mut builder = tempfile::Builder::new();
            builder.prefix(PREFIX).suffix(SUFFIX);
            #[cfg(unix)]
            {
                // A temporary file is private by default. The result gets the same permissions as other outputs.
                use std::os::unix::fs::PermissionsExt as _;
                builder.permissions(std::fs::Permissions::from_mode(0o644));
            }
            let mut file = builder.tempfile_in(&self.folder)?;
            file.write_all(&bytes(result))?;
            file.persist(&path).map_err(|error| error.error)?;
            Ok(())
        };
        write().map_err(|error| failed(&path, "written", &error))
    }

    /// The number of result files in the folder, of this list and of others.
    #[must_use]
    pub fn count(&self) -> usize {
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        entries.filter(|it| Path::new(&it.file_name()).extension().is_some_and(|it| it == "json")).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::TaskKind;

    #[test]
    fn half_a_result_is_none_and_a_foreign_one_too() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let task = |hash: &str| Task { hash: hash.into(), what: TaskKind::Diagnosis(0) };
        let result = serde_json::json!({ "task": "a", "value": 0.1 + 0.2 });
        store.put(&task("a"), &result).unwrap();
        assert_eq!(store.get(&task("a")), Some(result));
        let whole = std::fs::read(folder.path().join("tasks/a.json")).unwrap();
        std::fs::write(folder.path().join("tasks/b.json"), &whole).unwrap();
        assert_eq!(store.get(&task("b")), None, "it is that of another task");
        std::fs::write(folder.path().join("tasks/a.json"), &whole[..whole.len() - 3]).unwrap();
        assert_eq!(store.get(&task("a")), None);
        assert_eq!(store.count(), 2);
        assert!(Store::open_read_only(&folder.path().join("tasks")).is_err());
    }
}

//! Fits of a specification given as text, and folders for tests that write files.

use std::path::{Path, PathBuf};

use rsm_core::source::Source;
use rsm_fit::fit::{Outcome, fit};
use rsm_fit::spec::Specification;

/// The specification of a text whose paths are relative to a folder.
pub fn specification(text: &str, folder: &Path) -> Specification {
    Specification::from_source(Source::new("fit.toml", text), folder.to_path_buf()).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The fit of a text.
pub fn fitted(text: &str, folder: &Path) -> Outcome {
    fit(&specification(text, folder), &mut |_| {}).unwrap_or_else(|refused| panic!("{refused}"))
}

/// A folder of its own for a test that writes files; removed when dropped.
pub struct Scratch(pub PathBuf);

impl Scratch {
    /// `name` must be of one test alone.
    pub fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("rsm-fit-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Scratch(folder)
    }

    /// Writes a file.
    pub fn file(&self, name: &str, text: &str) -> &Self {
        std::fs::write(self.0.join(name), text).unwrap();
        self
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

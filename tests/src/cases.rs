//! The models that every back end must agree on.
//!
//! Out: a [`Case`] for each model file of the build script, or of `generated/coefficients`, with its evaluators lowered.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::emit::Unit;
use rsm_core::source::Source;

/// One model with all its evaluators.
#[derive(Debug)]
pub struct Case {
    /// The model file.
    pub file: PathBuf,
    /// The model.
    pub checked: Checked,
    /// Its evaluators, in every precision that can hold it.
    pub unit: Unit,
}

/// The random models: 36 of 1 to 6 inputs and order 1 to 5, and 8 with compensators.
#[must_use]
pub fn random() -> Vec<Case> {
    of_folder(&Path::new(env!("OUT_DIR")).join("models"))
}

/// The coefficient files that are checked in.
#[must_use]
pub fn checked_in() -> Vec<Case> {
    of_folder(&root().join("generated").join("coefficients"))
}

/// The root of the workspace.
///
/// # Panics
/// Never: this package lies in it.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace").to_path_buf()
}

/// Every model file of a folder, by name.
///
/// # Panics
/// When the folder has none, or one of them is refused.
#[must_use]
pub fn of_folder(folder: &Path) -> Vec<Case> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    assert!(!files.is_empty(), "{}: no model file", folder.display());
    files.into_iter().map(of_file).collect()
}

fn of_file(file: PathBuf) -> Case {
    let checked = Source::read(&file).and_then(|source| Checked::read(&source)).unwrap_or_else(|faults| panic!("{faults}"));
    let unit = compile::unit(&checked, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    Case { file, checked, unit }
}

//! Fits of a specification given as text.

use std::cell::RefCell;
use std::path::Path;

use rsm_core::source::Source;
use rsm_fit::fit::{Outcome, fit, fit_sources};
use rsm_fit::spec::Specification;

/// The specification of a text; its paths are relative to a folder.
pub fn specification(text: &str, folder: &Path) -> Specification {
    Specification::from_source(Source::new("fit.toml", text), folder.to_path_buf()).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The fit of a text whose data are in a folder.
pub fn fitted_in(text: &str, folder: &Path) -> Outcome {
    fit(&specification(text, folder), &mut |_| {}).unwrap_or_else(|refused| panic!("{refused}"))
}

/// The fit of a text whose data are in memory.
pub fn fitted(text: &str, files: &Files) -> Outcome {
    let sources = files.0.borrow();
    fit_sources(&specification(text, Path::new("")), &sources, &mut |_| {}).unwrap_or_else(|refused| panic!("{refused}"))
}

/// Files in memory.
#[derive(Default)]
pub struct Files(RefCell<Vec<Source>>);

impl Files {
    /// One file.
    pub fn of(name: &str, text: &str) -> Self {
        let files = Files::default();
        files.file(name, text);
        files
    }

    /// Adds a file, or replaces the file with the same name.
    pub fn file(&self, name: &str, text: &str) -> &Self {
        let mut sources = self.0.borrow_mut();
        sources.retain(|source| source.name() != name);
        sources.push(Source::new(name, text));
        drop(sources);
        self
    }

    /// The file with this name.
    pub fn get(&self, name: &str) -> Source {
        self.0.borrow().iter().find(|source| source.name() == name).expect("a file in memory").clone()
    }
}

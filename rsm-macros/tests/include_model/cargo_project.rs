//! A package of its own, built by cargo as a user's would be: with this crate as a dependency by path.
//!
//! In: a name and files. Out: what cargo says. It shares the target directory of the running test, so that what is compiled is compiled once;
//! it never asks the network, since every package it needs has been built for this test.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A package in the folder for temporary files of this test.
pub struct Project {
    folder: PathBuf,
}

impl Project {
    /// An empty package. What an earlier run left behind is removed.
    pub fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        if folder.exists() {
            std::fs::remove_dir_all(&folder).expect("the folder of an earlier run can be removed");
        }
        let macros = env!("CARGO_MANIFEST_DIR");
        let project = Project { folder };
        project.write(
            "Cargo.toml",
            &format!(
                "[package]\nname = \"{name}\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
                 [dependencies]\nrsm-macros = {{ path = {macros:?} }}\n\n\
                 # Not a member of the workspace that the target directory may lie in.\n[workspace]\n"
            ),
        );
        // The versions that the workspace was built with.
        let lock = std::fs::read_to_string(Path::new(macros).join("../Cargo.lock")).expect("the workspace has a lock file");
        project.write("Cargo.lock", &lock);
        project
    }

    /// Writes a file of the package.
    pub fn write(&self, name: &str, text: &str) {
        let path = self.folder.join(name);
        std::fs::create_dir_all(path.parent().expect("a file stands in a folder")).expect("a folder can be made");
        std::fs::write(&path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    }

    /// The text of a file of the package.
    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Cargo's output.
    pub fn cargo(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO"))
            .current_dir(&self.folder)
            .args(arguments)
            .args(["--offline", "--quiet"])
            .env("CARGO_TARGET_DIR", Path::new(env!("CARGO_TARGET_TMPDIR")).join(".."))
            .env("CARGO_TERM_COLOR", "never")
            // What the outer cargo set for this package is not true of that one.
            .env_remove("CARGO_MANIFEST_DIR")
            .env_remove("RUSTFLAGS")
            .output()
            .expect("cargo can be started")
    }
}

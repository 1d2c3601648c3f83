//! `cargo xtask mutants`: which changes of meaning do the tests of a package not notice?
//!
//! In: further words for the package mutants. Out: its table; its copy of the workspace stays under the target directory, so that a second run is quick.

use crate::stage::Run;
use crate::workspace::{cargo, root, scratch};

/// Builds the tool and runs it.
pub(crate) fn run(words: &[&str]) -> bool {
    let mut mutants = cargo(&["run", "--release", "--quiet", "-p", "mutants", "--"]);
    mutants.arg("--root").arg(root()).arg("--scratch").arg(scratch("mutants")).args(words);
    let mut run = Run::new();
    run.command("mutants", mutants);
    run.finish()
}

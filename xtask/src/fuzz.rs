//! `cargo xtask fuzz`: changed inputs for every reader and the core of every subcommand.
//!
//! In: further arguments for the package fuzz. Out: a line for each subject; inputs that panic or hang, as files under the target directory.

use crate::stage::Run;
use crate::workspace::{cargo, root, scratch};

/// Builds the tool and runs it.
pub(crate) fn run(words: &[&str]) -> bool {
    let mut fuzz = cargo(&["run", "--release", "--quiet", "-p", "fuzz", "--"]);
    fuzz.arg("--root").arg(root()).arg("--scratch").arg(scratch("fuzz")).args(words);
    let mut run = Run::new();
    run.command("fuzz", fuzz);
    run.finish()
}

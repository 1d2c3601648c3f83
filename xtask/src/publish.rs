//! `cargo xtask publish-check`: whether the libraries can be published.
//!
//! Runs `cargo publish` as a dry run over the workspace: cargo packs every package that does not say `publish = false`, in order of dependence, and
//! finds missing metadata, files outside the package and dependencies that are not published. Uploads nothing. Asks the registry for its index.

use std::process::Command;

use crate::stage::Run;
use crate::workspace::cargo;

/// Packs and builds each library from its package alone: minutes.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    run.command("publish, dry", dry(&[]));
    run.finish()
}

/// Packs each library: seconds.
pub(crate) fn quick() -> Command {
    dry(&["--no-verify"])
}

/// What is not committed is packed too: the check is made before a commit.
fn dry(further: &[&str]) -> Command {
    let mut command = cargo(&["publish", "--workspace", "--dry-run", "--allow-dirty"]);
    command.args(further);
    command
}

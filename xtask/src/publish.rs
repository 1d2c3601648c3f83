//! `cargo xtask publish-check`: whether the libraries can be published.
//!
//! Runs `cargo publish` as a dry run over the workspace: cargo packs every package without `publish = false`, in order of dependence, and finds
//! missing metadata, files outside the package and dependencies that are not published. Uploads nothing; only the whole check downloads the index of
//! the registry.

use std::process::Command;

use crate::stage::Run;
use crate::workspace::cargo;

/// Packs each library and builds it from its package alone. Takes minutes.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    run.command("publish, dry", dry());
    run.finish()
}

/// The libraries, in order of dependence; `tests/all/manifests.rs` checks each.
const LIBRARIES: [&str; 10] =
    ["rsm-core", "rsm-macros", "rsm-fit", "rsm-import", "rsm-model", "rsm-sim", "rsm-rigs", "rsm-diagnose", "rsm-sweep", "rsm"];

/// Packs each library, in a second for all. No registry is used, so this works without a network.
pub(crate) fn quick() -> Command {
    let mut command = cargo(&["package", "--no-verify", "--allow-dirty", "--offline", "--quiet"]);
    command.args(LIBRARIES.iter().flat_map(|library| ["-p", library]));
    command
}

/// Uncommitted files are packed too, because the check comes before a commit.
fn dry() -> Command {
    cargo(&["publish", "--workspace", "--dry-run", "--allow-dirty"])
}

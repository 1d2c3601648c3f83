//! `cargo xtask hidden-effects`: is the diagnosis right about records that it cannot have made itself?
//!
//! In: further words for the package hidden-effects. Out: its tables; its cases stay under the target directory, for a look at what went wrong.

use crate::stage::Run;
use crate::workspace::{cargo, root, scratch};

/// Builds the command and the judge, then judges, or verifies when that is the first word.
pub(crate) fn run(words: &[&str]) -> bool {
    let (mode, rest) = match words {
        ["verify", rest @ ..] => ("verify", rest),
        rest => ("judge", rest),
    };
    let cases = scratch("hidden-effects");
    let release = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| root().join("target"), |target| root().join(target))
        .join("release");
    let mut judge = std::process::Command::new(release.join("hidden-effects"));
    judge.arg(mode).arg("--rsm").arg(release.join("rsm")).arg("--out").arg(cases).args(rest);
    Run::new()
        .command("build", cargo(&["build", "--release", "--quiet", "-p", "rsm-cli", "-p", "hidden-effects"]))
        .command(mode, judge)
        .finish()
}

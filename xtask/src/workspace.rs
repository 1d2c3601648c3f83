//! The paths of the workspace, and calls of cargo in it.

#[cfg(test)]
use std::path::Path;
use std::path::PathBuf;
use std::process::Command;

/// The root of the workspace.
pub(crate) fn root() -> PathBuf {
    let mut root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    root.pop();
    root
}

/// The target directory: the one that cargo is set to use, or `target`.
pub(crate) fn target() -> PathBuf {
    root().join(std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from))
}

/// A folder of ours under the target directory.
pub(crate) fn scratch(name: &str) -> PathBuf {
    target().join("xtask").join(name)
}

/// A program of the workspace as cargo has built it, in the folder of a profile.
pub(crate) fn program(profile: &str, name: &str) -> PathBuf {
    target().join(profile).join(name)
}

/// Cargo with arguments, in the root: the same cargo that runs this program.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root()).args(arguments);
    command
}

/// The same without incremental compilation in a fresh clone. Caches for later changes take half of the time of a cold build: 80 s of processor for
/// rsm-fit in place of 42 s. The engine is then one part, so that its loops are inlined: simulations take a quarter less.
pub(crate) fn cargo_for_tests(arguments: &[&str]) -> Command {
    if !is_fresh() {
        return cargo(arguments);
    }
    // After the name of the command: there cargo adds further settings of a caller, and before it they would replace this one.
    let mut command = cargo(&arguments[..1]);
    command.args(["--config", "profile.dev.package.rsm-sim.codegen-units=1"]).args(&arguments[1..]);
    command.env("CARGO_INCREMENTAL", "0");
    command
}

/// Whether nothing was compiled incrementally before, and the user has not set whether it is to be.
pub(crate) fn is_fresh() -> bool {
    // This program itself has such a cache.
    let mut caches = std::fs::read_dir(target().join("debug/incremental")).into_iter().flatten().flatten();
    let is_warm = caches.any(|it| it.file_name().to_string_lossy().starts_with("rsm_core-"));
    !is_warm && std::env::var_os("CARGO_INCREMENTAL").is_none()
}

/// The files with an extension in a folder and in the folders below it, without build outputs and hidden folders.
#[cfg(test)]
pub(crate) fn sources(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder of the workspace").flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() && name != "target" && !name.to_string_lossy().starts_with('.') {
            found.extend(sources(&path, extension));
        } else if path.extension().is_some_and(|it| it == extension) {
            found.push(path);
        }
    }
    found
}

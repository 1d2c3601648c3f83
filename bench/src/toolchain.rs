//! The programs for compiling and counting.
//!
//! In: command lines. Out: their output. If a program is missing or fails, the process stops with its message. The machine is not named: the version
//! goes into `instructions.txt`, because other compilers give other counts.

use std::path::Path;
use std::process::Command;

use rsm_core::number::Precision;

/// Runs a program, which must succeed, and returns its standard output.
///
/// # Panics
/// If it cannot be started or fails.
pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}; `cargo xtask test` installs it"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{said}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Compiles C files in a folder to a program there: plain -O2 for the machine's baseline, as a firmware project starts.
pub fn gcc(folder: &Path, sources: &[String], program: &str) {
    run(Command::new("gcc").current_dir(folder).arg("-O2").args(sources).args(["-o", program]));
}

/// Writes a file to a folder, which is created if it is missing.
///
/// # Panics
/// If it cannot be written.
pub fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    let parent = path.parent().expect("a file stands in a folder");
    let written = std::fs::create_dir_all(parent).and_then(|()| std::fs::write(&path, text));
    written.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// The compiler and its target machine, which determine the counts.
#[must_use]
pub fn gcc_version() -> String {
    let version = run(Command::new("gcc").arg("--version"));
    let machine = run(Command::new("gcc").arg("-dumpmachine"));
    format!("{}, {}", version.lines().next().unwrap_or_default(), machine.trim())
}

/// The scalar type in C.
#[must_use]
pub fn c_type(precision: Precision) -> &'static str {
    match precision {
        Precision::F64 => "double",
        Precision::F32 => "float",
    }
}

/// A number in the form of a C constant expression, infinities and NaN included.
#[must_use]
pub fn c_number(value: f64) -> String {
    if value.is_nan() {
        "__builtin_nan(\"\")".to_string()
    } else if value.is_infinite() {
        format!("{}__builtin_inf()", if value < 0.0 { "-" } else { "" })
    } else {
        rsm_core::number::decimal(value)
    }
}

//! The programs that compile and count.
//!
//! In: command lines. Out: what they printed; a program that is missing or fails is the end, with what it said. Names no machine: the version goes into
//! `instructions.txt`, since other compilers give other counts.

use std::path::Path;
use std::process::Command;

use rsm_core::number::Precision;

/// Runs a program, which must succeed, and gives its standard output.
///
/// # Panics
/// When it cannot be started or fails.
pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}; `cargo xtask test` installs it"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{said}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Compiles C files in a folder to a program there: plain -O2, the machine's baseline, what a firmware project starts from.
pub fn gcc(folder: &Path, sources: &[String], program: &str) {
    run(Command::new("gcc").current_dir(folder).arg("-O2").args(sources).args(["-o", program]));
}

/// Writes a file in a folder, which is made where it is missing.
///
/// # Panics
/// When it cannot be written.
pub fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    let parent = path.parent().expect("a file stands in a folder");
    let written = std::fs::create_dir_all(parent).and_then(|()| std::fs::write(&path, text));
    written.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// What decides about counts: the compiler and the machine it compiles for.
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

/// A number as C reads it in a constant expression, infinities and NaN included.
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

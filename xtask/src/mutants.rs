//! `cargo xtask mutants`: finds changes of the code with which the tests of a package still pass.
//!
//! In: further arguments for the package mutants. Out: its table. Its copy of the workspace remains under the target directory, so that a second run
//! is fast. `quick` is the part that `cargo xtask test` runs: a sample from a fixed seed.

use std::process::Command;

use crate::stage::Run;
use crate::workspace::{cargo, is_fresh, program, root, scratch, target};

/// Builds the tool and runs it.
pub(crate) fn run(words: &[&str]) -> bool {
    let mut run = Run::new();
    run.command("mutants", tool("mutants", words));
    run.finish()
}

/// Mutants of each package in the quick part. Most of its time is for compiling both packages and running every test of these files once.
const SAMPLE: &str = "6";

/// The files of the quick part: every certificate and every statistic depends on them.
const FILES: [&str; 5] = ["rounding", "interval", "bernstein", "statistics", "qr"];

/// The seed is fixed, so the stage gives the same result on every machine. `cargo xtask mutants --sample --seed` draws other samples.
const SEED: &str = "1";

/// A sample of mutants against the unit tests.
pub(crate) fn quick() -> Command {
    let files = FILES.iter().flat_map(|file| ["--file", file]);
    // A folder of its own: another set of mutants in the same folder would compile both packages again each time.
    let words: Vec<&str> = files.chain(["--unit", "--sample", SAMPLE, "--seed", SEED]).collect();
    // The program that an earlier stage has built. It compiles beside the tests, which have built the crates from outside already.
    let mut tool = at(Command::new(program("debug", "mutants")), "mutants-quick", &words);
    tool.arg("--build").arg(target());
    if is_fresh() {
        tool.env("CARGO_INCREMENTAL", "0");
    }
    tool
}

fn tool(folder: &str, words: &[&str]) -> Command {
    at(cargo(&["run", "--release", "--quiet", "-p", "mutants", "--"]), folder, words)
}

fn at(mut tool: Command, folder: &str, words: &[&str]) -> Command {
    tool.arg("--root").arg(root()).arg("--scratch").arg(scratch(folder)).args(words);
    tool
}

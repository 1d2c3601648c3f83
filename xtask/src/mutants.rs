//! `cargo xtask mutants`: which changes of meaning do the tests of a package not notice?
//!
//! In: further words for the package mutants. Out: its table; its copy of the workspace stays under the target directory, so that a second run is quick.
//! `quick` is the part that `cargo xtask test` runs: a sample from a seed that changes with the sources.

use std::process::Command;

use crate::stage::Run;
use crate::workspace::{cargo, root, scratch};

/// Builds the tool and runs it.
pub(crate) fn run(words: &[&str]) -> bool {
    let mut run = Run::new();
    run.command("mutants", tool("mutants", words));
    run.finish()
}

/// Mutants of each package in the quick part. It takes two minutes of processor time where both packages are compiled again, and four where their libraries are too: half of that on
/// two quiet cores. Most goes into compiling and into running every test of these files once.
const SAMPLE: &str = "12";

/// The files of the quick part: what every certificate and every statistic stands on.
const FILES: [&str; 5] = ["rounding", "interval", "bernstein", "statistics", "qr"];

/// A sample of mutants against the unit tests. The seed is that of the last commit, so that each commit draws others and a run can be repeated.
pub(crate) fn quick() -> Command {
    let mut log = Command::new("git");
    let id = log.args(["rev-parse", "--short=8", "HEAD"]).current_dir(root()).output();
    let id = id.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_string()).unwrap_or_default();
    // Without a repository any seed does.
    let seed = u32::from_str_radix(&id, 16).unwrap_or(1).to_string();
    let files = FILES.iter().flat_map(|file| ["--file", file]);
    // A folder of its own: another set of mutants in the same one compiles both packages again each time.
    let words: Vec<&str> = files.chain(["--unit", "--sample", SAMPLE, "--seed", &seed]).collect();
    tool("mutants-quick", &words)
}

fn tool(folder: &str, words: &[&str]) -> Command {
    let mut mutants = cargo(&["run", "--release", "--quiet", "-p", "mutants", "--"]);
    mutants.arg("--root").arg(root()).arg("--scratch").arg(scratch(folder)).args(words);
    mutants
}

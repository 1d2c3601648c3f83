//! `cargo xtask hidden-effects`: tests the diagnosis on records of an independent simulation.
//!
//! In: further arguments for the package hidden-effects. Out: its tables; the files of its cases remain under the target directory, so that failures
//! can be examined.

use crate::stage::Run;
use crate::workspace::{cargo, program, scratch};

/// A few cases for each plant, with the programs that an earlier stage has built.
pub(crate) fn quick() -> std::process::Command {
    judge("debug", "judge", &["--quick"])
}

/// Records like those of real test benches, of plants without a fault: noise of every kind, faults of a logger. Half a second to two seconds for each
/// case, with short records.
pub(crate) fn quick_of_bench(family: &str) -> std::process::Command {
    judge("debug", "judge", &["--family", family, "--rows", "1500"])
}

/// The same for surfaces: every cause once, and a few cases of each further family.
pub(crate) fn quick_surfaces() -> std::process::Command {
    judge("debug", "surfaces", &["--quick"])
}

/// Number of seeds for the whole table of surfaces: each rate is then computed from a hundred cases or more.
const SEEDS: &str = "8";

/// Builds the command and the test program, then runs the test program with the arguments; without arguments for plants and surfaces.
pub(crate) fn run(words: &[&str]) -> bool {
    let (mode, rest) = match words {
        ["verify", rest @ ..] => ("verify", rest),
        ["surfaces", rest @ ..] => ("surfaces", rest),
        ["coverage", rest @ ..] => ("coverage", rest),
        rest => ("judge", rest),
    };
    let judge = judge("release", mode, rest);
    let mut run = Run::new();
    run.command("build", cargo(&["build", "--release", "--quiet", "-p", "rsm-cli", "-p", "hidden-effects"]))
        .command(mode, judge);
    if words.is_empty() {
        run.command("surfaces", self::judge("release", "surfaces", &["--seeds", SEEDS]));
    }
    run.finish()
}

fn judge(profile: &str, mode: &str, rest: &[&str]) -> std::process::Command {
    let mut judge = std::process::Command::new(program(profile, "hidden-effects"));
    judge.arg(mode).arg("--rsm").arg(program(profile, "rsm")).arg("--out").arg(scratch("hidden-effects")).args(rest);
    judge
}

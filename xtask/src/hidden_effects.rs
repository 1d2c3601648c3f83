//! `cargo xtask hidden-effects`: is the diagnosis right about records that it cannot have made itself?
//!
//! In: further words for the package hidden-effects. Out: its tables; its cases stay under the target directory, for a look at what went wrong.

use crate::stage::Run;
use crate::workspace::{cargo, program, scratch};

/// A few cases a plant, with the programs that the tests before it have built.
pub(crate) fn quick() -> std::process::Command {
    judge("debug", "judge", &["--quick"])
}

/// Records as benches make them, of sound plants: noise of every kind, data that a logger spoiled. Half a second to two a case, with short records.
pub(crate) fn quick_of_bench(family: &str) -> std::process::Command {
    judge("debug", "judge", &["--family", family, "--rows", "1500"])
}

/// The same of surfaces: every cause once, and a few of each further family.
pub(crate) fn quick_surfaces() -> std::process::Command {
    judge("debug", "surfaces", &["--quick"])
}

/// Seeds of the whole table of surfaces: a rate over a hundred cases a family and more.
const SEEDS: &str = "8";

/// Builds the command and the judge, then judges, or does what the first word says; without words plants and surfaces both.
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

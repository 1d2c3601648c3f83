//! `cargo xtask constraints`: fits of random feasible problems with constraints.
//!
//! In: seeds. Out: a line for each seed with the time, the largest violation that dense points find, and the excess over a lower bound of the
//! smallest residual sum of squares. The problems and both judges are in `rsm-fit/tests/all/constrained/`. An hour for 270 seeds.

use crate::stage::Run;
use crate::workspace::cargo;

/// Runs the seeds from FIRST to END - 1, written FIRST-END.
pub(crate) fn run(seeds: &str) -> bool {
    let words = ["test", "--release", "--quiet", "-p", "rsm-fit", "--test", "all", "--"];
    let mut campaign = cargo(&words);
    campaign.args(["--ignored", "--nocapture", "every_feasible_fit"]).env("SEEDS", seeds);
    let mut run = Run::new();
    run.command("constraints", campaign);
    run.finish()
}

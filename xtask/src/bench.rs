//! `cargo xtask bench`: times the evaluators with criterion, counts their instructions, prints one table; then one of simulations and diagnoses.
//!
//! In: further words for criterion (a filter, `--quick`), or `simulation` for the second table alone (`--quick` leaves out the diagnoses). Out: the
//! tables of the package rsm-bench, which makes all measurements. `fit`: fits beside those of numpy, statsmodels, polars, duckdb and scikit-learn
//! (`--rows N` of the large table, `--quick`). `loops`: instructions, stack and flash of the control steps on an emulated
//! Cortex-M4F, in C and in Rust; errors and costs of the controllers of a measured motor; rates and round trips of the loops between processes and
//! hosts. The tests that compare these with their budgets print them.

use crate::federation;
use crate::stage::Run;
use crate::workspace::{cargo, program};

/// Duration of each run between processes and hosts, in s.
const SECONDS: u32 = 10;

/// Measures times, then prints the tables.
pub(crate) fn run(words: &[&str]) -> bool {
    if words == ["loops"] {
        let tests = [
            "every_step_costs_the_same_for_every_input",
            "the_firmware_in_rust_has_the_bits",
            "the_readme_tells_the_costs",
            "the_surfaces_err_and_cost",
        ];
        let mut loops = cargo(&["test", "--quiet", "--workspace", "--test", "across", "--"]);
        // One after another, so that their lines do not mix.
        loops.args(tests).args(["--nocapture", "--test-threads", "1"]);
        let mut run = Run::new();
        run.command("loops", loops);
        federation::add(&mut run, SECONDS);
        return run.finish();
    }
    if words.first() == Some(&"fit") {
        let mut table = cargo(&["run", "--quiet", "--release", "-p", "rsm-bench", "--bin", "fit-table", "--"]);
        table.arg(program("release", "rsm")).args(&words[1..]);
        return Run::new()
            .command("build", cargo(&["build", "--release", "--quiet", "-p", "rsm-cli", "--bin", "rsm"]))
            .command("fit", table)
            .finish();
    }
    let mut simulation = cargo(&["run", "--quiet", "--release", "-p", "rsm-bench", "--bin", "simulation-table", "--"]);
    simulation.args(words.iter().filter(|word| **word == "--quick"));
    if words.first() == Some(&"simulation") {
        return Run::new().command("simulation", simulation).finish();
    }
    let mut time = cargo(&["bench", "-p", "rsm-bench", "--bench", "evaluators", "--"]);
    // A tenth of criterion's usual times: 120 cases in a minute and a half. On a quiet machine the medians repeat within a few per cent, enough for a
    // table of ratios.
    time.args(["--quiet", "--noplot", "--warm-up-time", "0.1", "--measurement-time", "0.4", "--sample-size", "20"]).args(words);
    Run::new()
        .command("times", time)
        .command("table", cargo(&["run", "--quiet", "--release", "-p", "rsm-bench", "--bin", "bench-table"]))
        .command("simulation", simulation)
        .finish()
}

//! Developer commands: `cargo xtask test`, `cargo xtask bless`, `cargo xtask bench`, `cargo xtask hidden-effects`, `cargo xtask constraints`,
//! `cargo xtask bits`, `cargo xtask mutants`, `cargo xtask fuzz`, `cargo xtask federation`, `cargo xtask book`, `cargo xtask publish-check`.
//!
//! In: one command. Out: the exit status: 0 if everything passed, 1 if a stage failed, 2 for an unknown command. Runs cargo and the command `rsm`,
//! and prints each command. Imports no crate, not even ours, so that it builds in a second on a machine that has only cargo.

mod bench;
mod bless;
mod book;
mod constraints;
mod dask;
mod failures;
mod federation;
mod fuzz;
mod generated;
mod helics;
mod hidden_effects;
mod mutants;
mod packages;
mod publish;
mod stage;
mod test;
mod totals;
mod workspace;

use std::process::ExitCode;

const USAGE: &str = "\
usage: cargo xtask test     everything that must hold, the same commands as continuous integration
       cargo xtask bless    writes anew what is generated: generated/, golden files, instruction counts
       cargo xtask bench    times and counts the evaluators, prints one table; `bench simulation`: simulations alone
       cargo xtask bench fit [--rows N] [--quick]
                            fits beside those of numpy, statsmodels, polars, duckdb and scikit-learn
       cargo xtask bench loops
                            instructions, stack and flash of the control steps on an emulated Cortex-M4F, errors and costs of the measured motor's controllers, rates of the loops between processes and hosts
       cargo xtask hidden-effects [--seed N] [--family singles|nulls|pairs|outside|faults|records|symmetries|far|beyond|configurations] [--case NAME] [--quick] [--plants new]
                            makes records with hidden effects, runs `rsm diagnose` on them, compares with the truth; without words surfaces too
       cargo xtask hidden-effects coverage [--seed N] [--seeds COUNT] [--rows N]      how often intervals hold the truth
       cargo xtask hidden-effects verify [--seed N] [--quick]
                            compares `rsm simulate` with other code for the same plants, an effect a line
       cargo xtask hidden-effects surfaces [--seed N] [--seeds COUNT] [--family singles|nulls|pairs|triples|outside|swept|stuck|clipped|quantised|duplicated|scaled|direction] [--case NAME] [--quick]
                            surfaces against new data with something hidden in them
       cargo xtask constraints [FIRST-END]
                            fits of random feasible problems with constraints, of the seeds from FIRST to END - 1 (0-270): proofs, violations, distance from the optimum
       cargo xtask bits     the tests of emitted code with 10^6 points for each function, every model, every way of inlining
       cargo xtask mutants [--package NAME] [--file PART] [--function NAME] [--line N] [--change TEXT] [--sample N] [--seed N] [--unit] [--near] [--within SECONDS] [--optimised] [--list]
                            changes the meaning of the code place by place, and names the changes that no test of the package notices
       cargo xtask fuzz [--count INPUTS] [--seed N] [--subject NAME] [--input NUMBER]
                            feeds changed inputs to every reader and to the core of every subcommand; a million where no count is given
       cargo xtask federation
                            both loops between processes and hosts, a minute for each way and each fault, with figures; two hosts need root
       cargo xtask book     builds the book in docs/book and checks its links; installs mdbook below target/ where the search path has none
       cargo xtask publish-check
                            packs every library as `cargo publish` would, in order of dependence, and builds each from its package; uploads nothing";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let held = match words.as_slice() {
        ["test"] => test::run(),
        ["bless"] => bless::run(),
        ["bench", rest @ ..] => bench::run(rest),
        ["hidden-effects", rest @ ..] => hidden_effects::run(rest),
        ["constraints"] => constraints::run("0-270"),
        ["constraints", seeds] => constraints::run(seeds),
        ["bits"] => test::bits(),
        ["mutants", rest @ ..] => mutants::run(rest),
        ["fuzz", rest @ ..] => fuzz::run(rest),
        ["federation"] => federation::run(),
        ["book"] => book::run(),
        ["publish-check"] => publish::run(),
        ["help" | "--help" | "-h"] => {
            println!("{USAGE}");
            true
        }
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    if held { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

//! The command `rsm`: arguments, progress, reports and plots. No mathematics of its own.
//!
//! Every subcommand: with `--json` standard output has one JSON object and nothing else; messages go to standard error. Exit status 0: done; 1: done,
//! and the answer is negative; 2: bad usage or bad input. A reader that closes a stream early (`| head`) does not change the exit status.

// `println!` and `eprintln!` panic if the reader has closed the stream; use the functions of `output`.
#![deny(clippy::print_stdout, clippy::print_stderr)]

/// Prints a line on standard error.
macro_rules! stderr_line {
    ($($words:tt)*) => { $crate::output::stderr(format_args!("{}\n", format_args!($($words)*))) };
}

/// Prints on standard error without an end of line.
macro_rules! stderr_text {
    ($($words:tt)*) => { $crate::output::stderr(format_args!($($words)*)) };
}

mod commands;
mod evaluators;
mod memory;
mod outcome;
mod output;
mod page;
mod plot;
mod replace;
mod report;
mod weakening;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

use commands::equations::{effects, inspect, linearise};
use commands::{
    check, completions, cosim, demo, design, diagnose, emit, eval, experiment, federate, fit, import, man, merge, optimise,
    simulate, stream, sweep, track,
};

/// Fits response surfaces to measured data, emits them as Rust or C, and diagnoses simulations.
#[derive(Parser)]
#[command(name = "rsm", version, max_term_width = 100)]
struct Arguments {
    /// Replace an existing output file, also if rsm did not write it
    #[arg(long, global = true)]
    force: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write the plan of a designed experiment, in random run order
    Design(design::Arguments),
    /// Run a plan on the simulated bench
    Experiment(experiment::Arguments),
    /// Fit response surfaces to measured data and write the model file
    Fit(fit::Arguments),
    /// Fit the parts that `rsm fit --partial` has written for the shards of the data
    Merge(merge::Arguments),
    /// Evaluate a surface with the interpreter
    Eval(eval::Arguments),
    /// Find the best settings for several responses of a model, or a front of them
    Optimise(optimise::Arguments),
    /// Check a model file and certify range and rounding error of its surfaces
    Check(check::Arguments),
    /// Emit evaluators as Rust or C
    Emit(emit::Arguments),
    /// Let a surface follow measured rows in order, by recursive least squares
    Track(track::Arguments),
    /// Convert files of other tools into one record: MDF and MAT files, other encodings, sampling jitter, two clocks
    Import(import::Arguments),
    /// Simulate a plant, with its effects, with the inputs of a record
    Simulate(simulate::Arguments),
    /// Show signals, states, parameters and equations of a plant as the compiler reads them
    Inspect(inspect::Arguments),
    /// Run many simulations or diagnoses as a list of tasks: Monte Carlo, designs, many machines
    Sweep(sweep::Arguments),
    /// List the catalogue of effects, and where each effect can act on a plant
    Effects(effects::Arguments),
    /// Linearise a plant of equations at an operating point: matrices, poles, damping
    Linearise(linearise::Arguments),
    /// Find the causes of the error of a simulation or a surface, and measure what they gain
    Diagnose(diagnose::Arguments),
    /// Run the whole tool chain on shipped data: fit, check, emit, compile, compare bits, run the motor loop
    Demo(demo::Arguments),
    /// Run one part of a HELICS co-simulation: one side of a loop, a recorder or the broker
    Federate(federate::Arguments),
    /// Run a co-simulation from its scenario: start broker and federates, or print the commands for each host
    Cosim(cosim::Arguments),
    /// Run one side of a loop in real time, connected to the other side by UDP: hardware in the loop
    Stream(stream::Arguments),
    /// Print the script that completes rsm commands in a shell
    Completions(completions::Arguments),
    /// Print the manual page, in roff
    Man(man::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    replace::force(arguments.force);
    let result = match arguments.command {
        Command::Design(arguments) => design::run(&arguments),
        Command::Experiment(arguments) => experiment::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Eval(arguments) => eval::run(&arguments),
        Command::Optimise(arguments) => optimise::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Emit(arguments) => emit::run(&arguments),
        Command::Track(arguments) => track::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Effects(arguments) => effects::run(&arguments),
        Command::Linearise(arguments) => linearise::run(&arguments),
        Command::Diagnose(arguments) => diagnose::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Federate(arguments) => federate::run(&arguments),
        Command::Cosim(arguments) => cosim::run(&arguments),
        Command::Stream(arguments) => stream::run(&arguments),
        Command::Completions(arguments) => completions::run(&arguments, Arguments::command()),
        Command::Man(arguments) => man::run(&arguments, Arguments::command()),
    };
    outcome::exit(result)
}

//! The command `rsm`: arguments, progress, reports and plots. No mathematics of its own.
//!
//! Every subcommand: `--json` prints one JSON object on standard output and nothing else there; words go to standard error. Exit status 0:
//! done; 1: done, and the answer is negative; 2: bad usage or bad input. A reader that closes a stream early (`| head`) does not change the exit status.

// Both panic when the reader is gone: `output` has what does not.
#![deny(clippy::print_stdout, clippy::print_stderr)]

/// A line of words on standard error.
macro_rules! tell {
    ($($words:tt)*) => { $crate::output::tell(format_args!("{}\n", format_args!($($words)*))) };
}

/// Words on standard error, without an end of line.
macro_rules! tell_part {
    ($($words:tt)*) => { $crate::output::tell(format_args!($($words)*)) };
}

mod commands;
mod evaluators;
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
    check, completions, cosim, demo, design, diagnose, emit, eval, experiment, federate, fit, import, man, simulate, stream,
    sweep,
};

/// From measured data to evaluators that a 1 kHz control loop can trust.
#[derive(Parser)]
#[command(name = "rsm", version, max_term_width = 100)]
struct Arguments {
    /// Replace an output that stands there already, also where it is no output of rsm
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
    /// Evaluate a surface with the interpreter
    Eval(eval::Arguments),
    /// Check a model file and certify range and rounding error of its surfaces
    Check(check::Arguments),
    /// Emit evaluators as Rust or C
    Emit(emit::Arguments),
    /// Make one clean record of files of other tools: MAT files, other encodings, jitter, two clocks
    Import(import::Arguments),
    /// Run a plant, with its effects, along a record
    Simulate(simulate::Arguments),
    /// What the compiler understood of a plant's equations
    Inspect(inspect::Arguments),
    /// Many simulations or diagnoses as a list of tasks: Monte Carlo, designs, many machines
    Sweep(sweep::Arguments),
    /// The catalogue of effects, and what can stand where on a plant
    Effects(effects::Arguments),
    /// The linear model of a plant of equations at a point: matrices, poles, damping
    Linearise(linearise::Arguments),
    /// What a plant's simulation gets wrong, and why: causes, extended plant, gain
    Diagnose(diagnose::Arguments),
    /// The whole chain on shipped data: fit, check, emit, compile, compare bits, run the motor loop
    Demo(demo::Arguments),
    /// Take part in a lock-step of several processes or hosts on HELICS: a side of a loop, a recorder, the broker
    Federate(federate::Arguments),
    /// Run a co-simulation by its scenario: broker and federates as processes, or the commands for each host
    Cosim(cosim::Arguments),
    /// Run a side of a loop against the wall clock, joined to the other by UDP: hardware in the loop
    Stream(stream::Arguments),
    /// Print the completions of a shell
    Completions(completions::Arguments),
    /// Print the page of the manual, in roff
    Man(man::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    replace::force(arguments.force);
    let result = match arguments.command {
        Command::Design(arguments) => design::run(&arguments),
        Command::Experiment(arguments) => experiment::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Eval(arguments) => eval::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Emit(arguments) => emit::run(&arguments),
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

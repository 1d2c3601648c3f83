//! `rsm completions`: scripts that let a shell complete the command.

use clap::{Args, Command};
use clap_complete::Shell;

use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The shell that runs the script
    shell: Shell,
}

/// Prints the script of a shell for the whole command.
pub fn run(arguments: &Arguments, mut command: Command) -> Outcome {
    let mut script = Vec::new();
    let name = command.get_name().to_string();
    clap_complete::generate(arguments.shell, &mut command, name, &mut script);
    output::line(String::from_utf8_lossy(&script).trim_end())?;
    Ok(Answer::Positive)
}

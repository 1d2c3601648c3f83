//! `rsm man`: the manual page of the command or of a subcommand.

use clap::{Args, Command};
use clap_mangen::Man;

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The subcommand, such as `experiment pmac` [default: the command `rsm` itself]
    subcommand: Vec<String>,
}

/// Prints a page in roff.
pub fn run(arguments: &Arguments, mut command: Command) -> Outcome {
    // `build` gives subcommands their full names: `rsm fit`, not `fit`.
    command.build();
    let mut name = command.get_name().to_string();
    for word in &arguments.subcommand {
        let known: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
        let Some(below) = command.find_subcommand(word) else {
            let known = if known.is_empty() { "none".to_string() } else { known.join(", ") };
            return Err(Refusal::new(format!("found `{word}`, the subcommands of {name} are: {known}")));
        };
        name = format!("{name} {word}");
        command = below.clone();
    }
    // The title has no blanks, because `man` uses it as a file name.
    let mut page = Vec::new();
    let rendered = Man::new(command).title(name.replace(' ', "-")).render(&mut page);
    rendered.map_err(|error| Refusal::new(format!("the page cannot be made: {error}")))?;
    output::line(String::from_utf8_lossy(&page).trim_end())?;
    Ok(Answer::Positive)
}

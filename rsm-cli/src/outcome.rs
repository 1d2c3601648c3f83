//! How a subcommand ends: done, done with a negative answer, or refused.

use std::fmt;
use std::io::Write as _;
use std::process::ExitCode;

use rsm_core::source::Faults;

/// The answer of a subcommand that completed its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// Exit status 0.
    Positive,
    /// Exit status 1, for example: a check fails, or a confidence is not reached.
    Negative,
}

/// The reason why a subcommand could not complete its work: the whole message, exit status 2.
#[derive(Debug)]
pub struct Refusal(pub String);

/// What a subcommand returns.
pub type Outcome = Result<Answer, Refusal>;

impl Refusal {
    /// A refusal with this message.
    pub fn new(message: impl Into<String>) -> Self {
        Refusal(message.into())
    }
}

impl From<Faults> for Refusal {
    fn from(faults: Faults) -> Self {
        Refusal(faults.to_string())
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The exit status of an outcome. A refusal is printed on standard error. A process that has loaded HELICS ends here.
pub fn exit(outcome: Outcome) -> ExitCode {
    let status = match outcome {
        Ok(Answer::Positive) => 0,
        Ok(Answer::Negative) => 1,
        Err(refusal) => {
            stderr_line!("{refusal}");
            2
        }
    };
    // A closed stream does not change the status.
    let _ = std::io::stdout().flush();
    rsm_link::helics::exit_without_destructors(status);
    ExitCode::from(status)
}

//! The command line of the runners, and their common `main`.
//!
//! In: `--seconds N`, `--rate HZ`, `--json`. Out: settings of a loop, or what was found and what is accepted. Exit status 2 for bad usage.

use std::io::Write as _;
use std::process::ExitCode;

use host_loop::Settings;

/// The options of a runner.
#[derive(Debug, Clone, PartialEq)]
pub struct Arguments {
    /// The settings of the loop.
    pub settings: Settings,
    /// Print one JSON object in place of lines.
    pub json: bool,
}

/// An hour at 10 kHz needs 36 million samples of 16 bytes, which a workstation can lock in memory.
const MOST_TICKS: u64 = 36_000_000;

/// Reads the words after the program's name.
///
/// # Errors
/// A sentence with what was found and what is accepted.
pub fn parse(words: impl IntoIterator<Item = String>) -> Result<Arguments, String> {
    let mut seconds = 2.0;
    let mut rate_hz = 1000.0;
    let mut json = false;
    let mut words = words.into_iter();
    while let Some(word) = words.next() {
        let mut positive = || {
            let found = words.next().ok_or_else(|| format!("{word} wants a number"))?;
            let number = found.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
            number.ok_or_else(|| format!("{word}: found `{found}`, wanted is a number above 0"))
        };
        match word.as_str() {
            "--seconds" => seconds = positive()?,
            "--rate" => rate_hz = positive()?,
            "--json" => json = true,
            other => return Err(format!("found `{other}`, accepted are --seconds N, --rate HZ, --json")),
        }
    }
    let settings = Settings::new(rate_hz, seconds);
    if settings.ticks > MOST_TICKS {
        return Err(format!(
            "{} ticks are more than the {MOST_TICKS} whose samples are kept; run shorter or slower",
            settings.ticks
        ));
    }
    Ok(Arguments { settings, json })
}

/// The `main` of a runner: reads the command line, runs, prints. `run` returns the text and the JSON.
#[must_use]
pub fn main(run: impl FnOnce(&Settings) -> (String, String)) -> ExitCode {
    match parse(std::env::args().skip(1)) {
        Ok(Arguments { settings, json }) => {
            let (text, object) = run(&settings);
            // A reader that closes the stream early changes no status.
            let _ = writeln!(std::io::stdout(), "{}", if json { object } else { text });
            ExitCode::SUCCESS
        }
        Err(fault) => {
            let _ = writeln!(std::io::stderr(), "{fault}");
            ExitCode::from(2)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> Result<Arguments, String> {
        parse(line.split_whitespace().map(String::from))
    }

    #[test]
    fn two_seconds_at_1_khz_unless_said_otherwise() {
        assert_eq!(parsed(""), Ok(Arguments { settings: Settings::new(1000.0, 2.0), json: false }));
        assert_eq!(
            parsed("--json --rate 500 --seconds 0.5"),
            Ok(Arguments { settings: Settings::new(500.0, 0.5), json: true })
        );
    }

    #[test]
    fn bad_usage_says_what_was_found_and_what_is_accepted() {
        assert_eq!(parsed("--seconds").unwrap_err(), "--seconds wants a number");
        assert_eq!(parsed("--rate -5").unwrap_err(), "--rate: found `-5`, wanted is a number above 0");
        assert_eq!(parsed("--rate nan").unwrap_err(), "--rate: found `nan`, wanted is a number above 0");
        assert_eq!(parsed("--fast").unwrap_err(), "found `--fast`, accepted are --seconds N, --rate HZ, --json");
        assert!(parsed("--seconds 1e9").unwrap_err().contains("run shorter"));
    }
}

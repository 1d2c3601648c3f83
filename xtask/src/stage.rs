//! Stages run one after another, each with its time; the first failure ends the run.
//!
//! In: a name and a command or a check. Out: a summary: what passed, what failed with the output of each failed test, and how to run it again. The
//! output of a command is printed line by line as it arrives.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::failures::Failures;
use crate::totals::Totals;

/// The stages that have run so far.
pub(crate) struct Run {
    stages: Vec<Stage>,
    totals: Totals,
    failures: Failures,
}

struct Stage {
    name: &'static str,
    took: Duration,
    /// The reason of the failure, and how to run the stage again.
    failure: Option<String>,
}

impl Run {
    pub(crate) fn new() -> Self {
        Run { stages: Vec::new(), totals: Totals::default(), failures: Failures::default() }
    }

    /// Runs a check that returns the reason of a failure. Does nothing after a failed stage.
    pub(crate) fn check(&mut self, name: &'static str, check: impl FnOnce() -> Result<(), String>) -> &mut Self {
        self.stage(name, |_, _| check())
    }

    /// Runs a command, which must end with status 0.
    pub(crate) fn command(&mut self, name: &'static str, mut command: Command) -> &mut Self {
        self.stage(name, |totals, failures| {
            let shown = shown(&command);
            println!("$ {shown}");
            let mut child = command
                .stdout(Stdio::piped())
                .spawn()
                .map_err(|error| format!("cannot start `{}`: {error}", command.get_program().display()))?;
            let output = child.stdout.take().expect("the output was asked for as a pipe");
            let mut reader = BufReader::new(output);
            let mut line = Vec::new();
            let mut seen = Totals::default();
            while reader.read_until(b'\n', &mut line).map_err(|error| format!("reading the output of `{shown}`: {error}"))? > 0
            {
                let text = String::from_utf8_lossy(&line);
                print!("{text}");
                seen.add_line(&text);
                failures.add_line(&text);
                line.clear();
            }
            let status = child.wait().map_err(|error| format!("waiting for `{shown}`: {error}"))?;
            let failed = seen.failed;
            totals.add(seen);
            if status.success() {
                return Ok(());
            }
            if failed == 0 {
                // It did not compile, or a test ended the whole process: this counts as one failure, although no test reported it.
                totals.failed += 1;
            }
            Err(format!("{status}; run it again with\n    {shown}"))
        })
    }

    fn stage(&mut self, name: &'static str, run: impl FnOnce(&mut Totals, &mut Failures) -> Result<(), String>) -> &mut Self {
        if !self.held() {
            return self;
        }
        println!("\n== {name}");
        let started = Instant::now();
        let failure = run(&mut self.totals, &mut self.failures).err();
        let took = started.elapsed();
        println!("== {name}: {}, {:.1} s", if failure.is_none() { "ok" } else { "FAILED" }, took.as_secs_f64());
        self.stages.push(Stage { name, took, failure });
        self
    }

    /// Whether nothing has failed.
    pub(crate) fn held(&self) -> bool {
        self.stages.iter().all(|stage| stage.failure.is_none())
    }

    /// Prints the output of failed tests and the summary, and returns whether everything passed.
    pub(crate) fn finish(&self) -> bool {
        print!("{}", self.failures);
        println!("\nstages");
        for Stage { name, took, failure } in &self.stages {
            println!("  {:<12} {:>7.1} s  {}", name, took.as_secs_f64(), if failure.is_none() { "ok" } else { "FAILED" });
        }
        let total: f64 = self.stages.iter().map(|stage| stage.took.as_secs_f64()).sum();
        println!("  {:<12} {total:>7.1} s", "all");
        for Stage { name, failure, .. } in &self.stages {
            if let Some(why) = failure {
                println!("\n{name} failed: {why}\nlater stages were not run");
            }
        }
        self.held()
    }

    /// The numbers of tests that passed and failed. A failed stage counts as at least one failure.
    pub(crate) fn totals(&self) -> Totals {
        let mut totals = self.totals.clone();
        if !self.held() {
            totals.failed = totals.failed.max(1);
        }
        totals
    }
}

/// A command as a user would type it.
fn shown(command: &Command) -> String {
    let program = std::path::Path::new(command.get_program()).file_name().unwrap_or(command.get_program());
    let set = command.get_envs().filter_map(|(name, value)| Some(format!("{}={}", name.display(), value?.display())));
    let words = std::iter::once(program).chain(command.get_args()).map(|word| word.display().to_string());
    let quoted = set.chain(words).map(|word| if word.contains(' ') { format!("'{word}'") } else { word });
    quoted.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_failure_ends_the_run_and_counts() {
        let mut run = Run::new();
        let mut ran = false;
        run.check("one", || Ok(())).check("two", || Err("it broke".to_string())).check("three", || {
            ran = true;
            Ok(())
        });
        assert!(!ran && !run.held() && !run.finish());
        assert_eq!(run.totals(), Totals { failed: 1, ..Totals::default() });
    }

    #[test]
    fn a_command_is_shown_as_one_would_type_it() {
        let mut command = Command::new("/opt/bin/cargo");
        command.args(["doc", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings");
        assert_eq!(shown(&command), "'RUSTDOCFLAGS=-D warnings' cargo doc --no-deps");
    }

    #[test]
    fn test_results_in_the_output_of_a_command_are_added_up() {
        let mut run = Run::new();
        let mut command = Command::new("printf");
        command.arg("test result: ok. 3 passed; 0 failed; 1 ignored\ntest result: ok. 4 passed; 0 failed; 0 ignored\n");
        run.command("printed", command);
        assert_eq!(run.totals(), Totals { passed: 7, ..Totals::default() });
        run.command("silent failure", Command::new("false"));
        assert_eq!(run.totals(), Totals { passed: 7, failed: 1, ..Totals::default() });
    }
}

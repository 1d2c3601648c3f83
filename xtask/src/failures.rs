//! The output of failed tests, read from what cargo prints.
//!
//! In: the lines of a test run. Out: the name of each failed test with its output, for the end of a summary. If only the last lines of a log are
//! kept, they still show why a test failed.

use std::fmt;

/// The largest number of lines for one test: the last ones, which have the message of the panic. A comparison of two files can print thousands.
const LINES: usize = 80;

/// Failed tests with their output, in the order in which they were printed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Failures {
    tests: Vec<(String, Vec<String>)>,
    /// Whether the next lines are the output of the last test.
    is_output: bool,
}

impl Failures {
    pub(crate) fn add_line(&mut self, line: &str) {
        let line = line.trim_end();
        if let Some(name) = line.strip_prefix("---- ").and_then(|rest| rest.strip_suffix(" ----")) {
            let name = name.strip_suffix(" stdout").unwrap_or(name);
            self.tests.push((name.to_string(), Vec::new()));
            self.is_output = true;
        } else if line == "failures:" || line.starts_with("test result: ") {
            self.is_output = false;
        } else if let (true, Some((_, output))) = (self.is_output, self.tests.last_mut()) {
            output.push(line.to_string());
        }
    }
}

impl fmt::Display for Failures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, output) in &self.tests {
            let end = output.iter().rposition(|line| !line.is_empty()).map_or(0, |last| last + 1);
            let start = end.saturating_sub(LINES);
            writeln!(f, "\nfailed: {name}")?;
            if start > 0 {
                writeln!(f, "    ({start} lines before)")?;
            }
            for line in &output[start..end] {
                writeln!(f, "{}", format!("    {line}").trim_end())?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_output_of_each_failed_test_is_kept_and_nothing_else() {
        let mut failures = Failures::default();
        let printed = "running 3 tests\ntest a::one ... FAILED\ntest two ... ok\n\nfailures:\n\n\
            ---- a::one stdout ----\n\nthread 'a::one' panicked at src/a.rs:3:5:\nleft: 1\n\n---- three stdout ----\nError: late\n\n\nfailures:\n    a::one\n    three\n\ntest result: FAILED. 1 passed; 2 failed\nnot of a test\n";
        for line in printed.lines() {
            failures.add_line(line);
        }
        let expected = "\nfailed: a::one\n\n    thread 'a::one' panicked at src/a.rs:3:5:\n    left: 1\n\nfailed: three\n    Error: late\n";
        assert_eq!(failures.to_string(), expected);
    }

    #[test]
    fn of_a_long_output_the_end_is_kept() {
        let mut failures = Failures::default();
        failures.add_line("---- long stdout ----");
        (0..1000).for_each(|k| failures.add_line(&format!("row {k}")));
        let shown = failures.to_string();
        assert!(shown.starts_with("\nfailed: long\n    (920 lines before)\n    row 920\n") && shown.ends_with("row 999\n"));
        assert_eq!(shown.lines().count(), LINES + 3);
    }
}

//! How many tests passed and failed, read from what cargo prints.
//!
//! In: lines such as `test result: ok. 14 passed; 0 failed; 2 ignored; ...`. Out: sums. Any other line counts nothing.

use std::fmt;

/// Sums over all test binaries.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Totals {
    pub(crate) passed: u64,
    pub(crate) failed: u64,
}

impl Totals {
    pub(crate) fn add_line(&mut self, line: &str) {
        let Some((_, counts)) = line.split_once("test result: ") else { return };
        let mut words = counts.split_whitespace().peekable();
        while let Some(word) = words.next() {
            let Ok(count) = word.parse::<u64>() else { continue };
            match words.peek() {
                Some(&"passed;") => self.passed += count,
                Some(&"failed;") => self.failed += count,
                _ => {}
            }
        }
    }

    pub(crate) fn add(&mut self, other: Totals) {
        self.passed += other.passed;
        self.failed += other.failed;
    }
}

/// The line that continuous integration reads.
impl fmt::Display for Totals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed", self.passed, self.failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_result_lines_count() {
        let mut totals = Totals::default();
        totals.add_line("test result: ok. 14 passed; 0 failed; 3 ignored; 0 measured; 0 filtered out; finished in 0.20s\n");
        totals.add_line("test result: FAILED. 10 passed; 2 failed; 0 ignored; 0 measured; 1 filtered out; finished in 9.00s");
        totals.add_line("test parser::says_3_passed; ... ok");
        totals.add_line("running 14 tests");
        assert_eq!(totals.to_string(), "24 passed, 2 failed");
    }
}

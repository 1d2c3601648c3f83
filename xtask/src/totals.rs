//! The numbers of tests that passed and failed, read from what cargo prints.
//!
//! In: lines such as `test result: ok. 14 passed; 0 failed; 2 ignored; ...`, and `SKIPPED: why` from a test that cannot run on this machine. Out:
//! sums. Any other line is ignored.

use std::collections::BTreeMap;
use std::fmt;

/// Sums over all test binaries.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Totals {
    pub(crate) passed: u64,
    pub(crate) failed: u64,
    /// The number of tests that were skipped, by reason. The test harness counts them as passed.
    pub(crate) skipped: BTreeMap<String, u64>,
}

impl Totals {
    pub(crate) fn add_line(&mut self, line: &str) {
        if let Some((_, why)) = line.split_once("SKIPPED: ") {
            *self.skipped.entry(why.trim().to_owned()).or_default() += 1;
        }
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
        for (why, count) in other.skipped {
            *self.skipped.entry(why).or_default() += count;
        }
    }
}

/// The line that continuous integration reads.
impl fmt::Display for Totals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let skipped: u64 = self.skipped.values().sum();
        write!(f, "{} passed, {} failed", self.passed.saturating_sub(skipped), self.failed)?;
        if skipped > 0 {
            let reasons: Vec<&str> = self.skipped.keys().map(String::as_str).collect();
            write!(f, ", {skipped} skipped: {}", reasons.join("; "))?;
        }
        Ok(())
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

    #[test]
    fn a_test_that_shows_nothing_has_not_passed() {
        let mut totals = Totals::default();
        totals.add_line("test measured ... SKIPPED: ../shared/data/emps is missing\n");
        totals.add_line("SKIPPED: ../shared/data/emps is missing\n");
        totals.add_line("SKIPPED: ../shared/data/r-rsm is missing\n");
        totals.add_line("test result: ok. 14 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.20s\n");
        let told = "11 passed, 0 failed, 3 skipped: ../shared/data/emps is missing; ../shared/data/r-rsm is missing";
        assert_eq!(totals.to_string(), told);
    }
}

//! `instructions.txt`: the counts in the repository.
//!
//! In and out: a text table, one line for each subject, ordered by name. The first line names the compiler: another one gives other counts.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use rsm_core::number::Precision;

use crate::counted::Key;
use crate::surfaces::workspace;

/// The contents of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Budget {
    /// The compiler and machine of the counts.
    pub compiler: String,
    /// Instructions per evaluation.
    pub counts: BTreeMap<Key, u64>,
}

const HEAD: &str = "\
# Instructions per evaluation, counted by callgrind: loads of the arguments, call, evaluation, return. `horner` is written by hand and inlined.
# Written by `cargo xtask bless`. A change here is a change of what every user of the emitted C pays.
";

/// The path of the file.
#[must_use]
pub fn path() -> PathBuf {
    workspace().join("bench/instructions.txt")
}

/// Reads the file in the repository.
///
/// # Panics
/// If it is missing or is not such a table.
#[must_use]
pub fn read() -> Budget {
    let path = path();
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}; cargo xtask bless", path.display()));
    Budget::parse(&text).unwrap_or_else(|line| panic!("{}: cannot read the line `{line}`", path.display()))
}

impl Budget {
    /// The table as text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!("{HEAD}# {}\n", self.compiler);
        for (Key { name, variant, precision }, count) in &self.counts {
            writeln!(text, "{name:<24} {variant:<12} {} {count:>5}", precision.name()).expect("a string takes any text");
        }
        text
    }

    /// The table from text, or the line that cannot be read.
    ///
    /// # Errors
    /// That line.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut budget = Budget { compiler: String::new(), counts: BTreeMap::new() };
        for line in text.lines() {
            if let Some(comment) = line.strip_prefix('#') {
                // The last comment line names the compiler.
                budget.compiler = comment.trim().to_string();
                continue;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let parsed = match words.as_slice() {
                [name, variant, precision, count] => {
                    let precision = Precision::ALL.into_iter().find(|known| known.name() == *precision);
                    precision.zip(count.parse().ok()).map(|(precision, count)| {
                        (Key { name: name.to_string(), variant: variant.to_string(), precision }, count)
                    })
                }
                _ => None,
            };
            let (key, count) = parsed.ok_or_else(|| line.to_string())?;
            budget.counts.insert(key, count);
        }
        Ok(budget)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_survives_the_way_to_text_and_back() {
        let key = |name: &str, precision| Key { name: name.to_string(), variant: "clamp".to_string(), precision };
        let counts = BTreeMap::from([(key("S1", Precision::F32), 21), (key("S1", Precision::F64), 20)]);
        let budget = Budget { compiler: "cc 1.2, x86_64".to_string(), counts };
        assert_eq!(Budget::parse(&budget.text()), Ok(budget));
        assert_eq!(Budget::parse("S1 clamp f16 3"), Err("S1 clamp f16 3".to_string()));
    }
}

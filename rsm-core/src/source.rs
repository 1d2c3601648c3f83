//! A text file and the faults found in it.
//!
//! In: the name and the text of a file. Out: [`Fault`]s with file, line, column, what was found and what is accepted. All faults of a stage are
//! collected, in the order of the file. Never panics on any text.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A text file as read, with its name in messages.
///
/// ```
/// use rsm_core::source::Source;
///
/// let source = Source::new("fit.toml", "model = 3\n");
/// let fault = source.fault(8..9, "`model`: found 3, expected a name").help("write it in quotes");
/// assert_eq!(fault.to_string(), "fit.toml:1:9: `model`: found 3, expected a name\n  help: write it in quotes");
/// ```
#[derive(Debug, Clone)]
pub struct Source {
    name: String,
    text: String,
}

/// Every file that [`Source::read`] has opened in this process.
static READ: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The files that this process has read, by the names given. Code that writes files uses this list so that no input is overwritten. All files are
/// read in one place, so no subcommand can omit one.
#[must_use]
pub fn files_read() -> Vec<PathBuf> {
    READ.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// The format of a file that `rsm import` reads and that is no text, by its first bytes.
fn imported(bytes: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 4] =
        [(b"MDF ", "an MDF"), (b"UnFinMF ", "an MDF"), (b"MATLAB ", "a MAT"), (b"\x89HDF", "an HDF5")];
    KNOWN.iter().find(|(first, _)| bytes.starts_with(first)).map(|(_, format)| *format)
}

impl Source {
    /// A source from its name (as the user wrote it) and its text.
    #[must_use]
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Source { name: name.into(), text: text.into() }
    }

    /// Reads a file. A file that cannot be read, or is not UTF-8, is a fault like any other.
    ///
    /// # Errors
    /// One fault that names the file and the reason of the operating system.
    pub fn read(path: &std::path::Path) -> Result<Self, Faults> {
        Self::of_bytes(path.display().to_string(), Self::bytes(path)?)
    }

    /// A source from the bytes of its text.
    ///
    /// # Errors
    /// One fault at the first byte that is not UTF-8.
    pub fn of_bytes(name: impl Into<String>, bytes: Vec<u8>) -> Result<Self, Faults> {
        let name = name.into();
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Source { name, text }),
            Err(error) => {
                let at = error.utf8_error().valid_up_to();
                let prefix = String::from_utf8_lossy(&error.as_bytes()[..at]).into_owned();
                let source = Source { name, text: prefix };
                if let Some(format) = imported(error.as_bytes()) {
                    let what = format!("found {format} file, expected text");
                    let help = "`rsm import` makes a CSV file of it";
                    return Err(Faults::one(Fault::whole_file(&source.name, what).help(help)));
                }
                let help = "save the file as UTF-8; `rsm import` reads tables in other encodings";
                Err(Faults::one(source.fault(at..at, "a byte that is not UTF-8 text").help(help)))
            }
        }
    }

    /// Opens a file with any content, to be read in parts.
    ///
    /// # Errors
    /// One fault that names the file and the reason of the operating system.
    pub fn open(path: &std::path::Path) -> Result<std::fs::File, Faults> {
        READ.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_path_buf());
        std::fs::File::open(path)
            .map_err(|error| Faults::one(Fault::whole_file(&path.display().to_string(), format!("cannot be read: {error}"))))
    }

    /// The bytes of a file with any content.
    ///
    /// # Errors
    /// One fault that names the file and the reason of the operating system.
    pub fn bytes(path: &std::path::Path) -> Result<Vec<u8>, Faults> {
        READ.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_path_buf());
        std::fs::read(path)
            .map_err(|error| Faults::one(Fault::whole_file(&path.display().to_string(), format!("cannot be read: {error}"))))
    }

    /// The name of this file in messages.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The whole text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Line and column, both counted from 1, of a byte offset. Columns count characters.
    #[must_use]
    pub fn position(&self, offset: usize) -> (usize, usize) {
        let mut end = offset.min(self.text.len());
        while !self.text.is_char_boundary(end) {
            end -= 1;
        }
        let before = &self.text[..end];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// A fault at a byte range of this file.
    #[must_use]
    pub fn fault(&self, span: Range<usize>, what: impl Into<String>) -> Fault {
        let (line, column) = self.position(span.start);
        Fault { file: self.name.clone(), line, column, what: what.into(), help: None }
    }
}

/// A fault of a file: the place, what was found, what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The file as the user named it.
    pub file: String,
    /// The line, from 1; 0 if the fault concerns the whole file.
    pub line: usize,
    /// The column in characters, from 1; 0 if the fault concerns the whole line.
    pub column: usize,
    /// What was found and what is accepted.
    pub what: String,
    /// What to do about it.
    pub help: Option<String>,
}

impl Fault {
    /// A fault of the whole file.
    #[must_use]
    pub fn whole_file(file: &str, what: impl Into<String>) -> Self {
        Fault { file: file.to_string(), line: 0, column: 0, what: what.into(), help: None }
    }

    /// A fault at a line (from 1) and column (from 1, or 0 for the whole line).
    #[must_use]
    pub fn at_line(file: &str, line: usize, column: usize, what: impl Into<String>) -> Self {
        Fault { file: file.to_string(), line, column, what: what.into(), help: None }
    }

    /// Adds what to do about it.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if self.line > 0 {
            write!(f, ":{}", self.line)?;
            if self.column > 0 {
                write!(f, ":{}", self.column)?;
            }
        }
        write!(f, ": {}", self.what)?;
        if let Some(help) = &self.help {
            write!(f, "\n  help: {help}")?;
        }
        Ok(())
    }
}

/// All the faults of one stage, in the order of the file. Never empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults(Vec<Fault>);

impl Faults {
    /// A single fault.
    #[must_use]
    pub fn one(fault: Fault) -> Self {
        Faults(vec![fault])
    }

    /// The faults, in the order of the file.
    #[must_use]
    pub fn list(&self) -> &[Fault] {
        &self.0
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, fault) in self.0.iter().enumerate() {
            if k > 0 {
                writeln!(f)?;
            }
            write!(f, "{fault}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Faults {}

/// Gathers the faults of one stage.
#[derive(Debug, Default)]
pub struct Collector {
    faults: Vec<Fault>,
}

impl Collector {
    /// An empty collection.
    #[must_use]
    pub fn new() -> Self {
        Collector::default()
    }

    /// Adds a fault.
    pub fn push(&mut self, fault: Fault) {
        self.faults.push(fault);
    }

    /// Whether no fault was added.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.faults.is_empty()
    }

    /// The value if there is no fault; otherwise all faults sorted by place.
    ///
    /// # Errors
    /// The collected faults.
    ///
    /// # Panics
    /// If there is neither a value nor a fault: a reader without a result must report why.
    pub fn finish<T>(self, value: Option<T>) -> Result<T, Faults> {
        if self.faults.is_empty() {
            return Ok(value.expect("a stage that gives no value must report a fault"));
        }
        Err(self.in_order())
    }

    fn in_order(mut self) -> Faults {
        // The sort is stable, so faults at one place stay in the order of the rules.
        self.faults.sort_by_key(|fault| (fault.line, fault.column));
        self.faults.dedup();
        Faults(self.faults)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_lines_and_characters_from_one() {
        let source = Source::new("m.toml", "a\nµß = 1\n");
        assert_eq!(source.position(0), (1, 1));
        assert_eq!(source.position(2), (2, 1));
        // µ and ß have two bytes each, and one column each.
        assert_eq!(source.position(6), (2, 3));
        assert_eq!(source.position(10_000), (3, 1));
    }

    #[test]
    fn a_file_that_is_no_text_is_named() {
        let fault = |bytes: &[u8]| Source::of_bytes("a", bytes.to_vec()).unwrap_err().to_string();
        assert_eq!(
            fault(b"MDF     4.10\xff"),
            "a: found an MDF file, expected text\n  help: `rsm import` makes a CSV file of it"
        );
        assert!(fault(b"MATLAB 7.3 \xff").contains("a MAT file"));
        assert!(fault(b"time[s]\n1 \xff").starts_with("a:2:3: a byte that is not UTF-8 text"));
    }

    #[test]
    fn faults_come_in_the_order_of_the_file() {
        let mut collector = Collector::new();
        collector.push(Fault::at_line("f", 3, 1, "late"));
        collector.push(Fault::at_line("f", 1, 2, "early").help("mend it"));
        let faults = collector.finish(Some(())).unwrap_err();
        assert_eq!(faults.to_string(), "f:1:2: early\n  help: mend it\nf:3:1: late");
    }
}

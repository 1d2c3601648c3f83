//! Files of numbered columns: Parquet and Apache Arrow, if this build has the format.
//!
//! ```text
//!   file --Format::of_file--> Format --parquet, arrow--> values of some rows --columns--> Table
//! ```
//!
//! In: a file, the wanted columns. Out: tables of some rows in the order of the file, or one of all rows, with the rules of CSV for names, units and
//! missing cells (`columns.rs`). The first bytes decide about the format, not the name.

use std::io::Read as _;
#[cfg(any(feature = "parquet", feature = "arrow"))]
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use rsm_core::source::{Fault, Faults, Source};

use crate::table::{Table, Wanted};

#[cfg(feature = "arrow")]
mod arrow;
#[cfg(any(feature = "parquet", feature = "arrow"))]
mod columns;
#[cfg(feature = "parquet")]
mod parquet;

/// What is called with each batch of rows.
type Act<'a> = &'a mut dyn FnMut(Table) -> Result<(), Faults>;

/// The format of a file of numbered columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Apache Parquet.
    Parquet,
    /// A file of Apache Arrow, which is also Feather of version 2.
    Arrow,
    /// A stream of Apache Arrow in a file.
    ArrowStream,
}

impl Format {
    /// The format that begins with these bytes, at least six of them if the file has so many.
    pub(crate) fn of(first: &[u8]) -> Option<Format> {
        // A stream begins with a message: four bytes of ones, which no text has, then its length ("Encapsulated message format" of Arrow IPC).
        const KNOWN: [(&[u8], Format); 3] =
            [(b"PAR1", Format::Parquet), (b"ARROW1", Format::Arrow), (&[0xff; 4], Format::ArrowStream)];
        KNOWN.iter().find(|(magic, _)| first.starts_with(magic)).map(|(_, format)| *format)
    }

    /// The format of a file; `None` for a file that cannot be read.
    pub(crate) fn of_file(path: &Path) -> Option<Format> {
        let mut first = Vec::new();
        std::fs::File::open(path).and_then(|file| file.take(8).read_to_end(&mut first)).ok()?;
        Format::of(&first)
    }

    /// Its name with an article.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Format::Parquet => "a Parquet file",
            Format::Arrow => "an Arrow file",
            Format::ArrowStream => "an Arrow stream",
        }
    }

    /// The feature that reads it.
    fn feature(self) -> &'static str {
        if self == Format::Parquet { "parquet" } else { "arrow" }
    }
}

/// Calls `act` with each batch of rows, and returns the number of all rows, which is not 0. `name` is that of the file in messages.
pub(crate) fn read(format: Format, name: &str, path: &Path, wanted: &Wanted, act: Act<'_>) -> Result<usize, Faults> {
    let rows = match format {
        #[cfg(feature = "parquet")]
        Format::Parquet => parquet::read(name, path, wanted, act),
        #[cfg(feature = "arrow")]
        Format::Arrow | Format::ArrowStream => arrow::read(name, path, format == Format::ArrowStream, wanted, act),
        #[allow(unreachable_patterns, reason = "a build with all features has every format")]
        _ => {
            // A build without any format uses neither.
            let _ = (wanted, act);
            Source::open(path)?;
            let fault = Fault::whole_file(name, format!("is {}, which this build does not read", format.words()));
            let help =
                format!("build it with `--features {}`, or export CSV, which may be compressed with gzip", format.feature());
            Err(Faults::one(fault.help(help)))
        }
    }?;
    if rows == 0 { Err(Faults::one(Fault::whole_file(name, "there is no row"))) } else { Ok(rows) }
}

/// Calls a reader of a format. A panic over damaged bytes, which their lengths and offsets can cause, is an error like those that it returns.
#[cfg(any(feature = "parquet", feature = "arrow"))]
fn guarded<T, E: std::fmt::Display>(name: &str, read: impl FnOnce() -> Result<T, E>) -> Result<T, Faults> {
    let broken = |why: String| Faults::one(Fault::whole_file(name, format!("cannot be read: {why}")));
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(read) => read.map_err(|error| broken(error.to_string())),
        Err(_) => Err(broken("it is damaged".to_string())),
    }
}

/// The table of all rows.
pub(crate) fn table(format: Format, name: &str, path: &Path, wanted: &Wanted) -> Result<Table, Faults> {
    let mut whole: Option<Table> = None;
    read(format, name, path, wanted, &mut |batch| {
        match &mut whole {
            Some(whole) => whole.append(batch),
            None => whole = Some(batch),
        }
        Ok(())
    })?;
    Ok(whole.expect("a file with rows has a batch"))
}

#[cfg(all(test, feature = "parquet", feature = "arrow"))]
mod tests;

#[cfg(all(test, not(feature = "parquet"), not(feature = "arrow")))]
#[path = "tests/without.rs"]
mod without;

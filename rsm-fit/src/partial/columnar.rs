//! Reads a file of numbered columns, if this build has its format.
//!
//! In: a file of Parquet or Arrow, the wanted columns. Out: tables of some rows, in the order of the file. Recognises no format.

use std::path::Path;

use rsm_core::source::{Fault, Faults, Source};

use crate::compressed::Columnar;
use crate::table::{Table, Wanted};

/// Calls `act` with each batch of rows, and returns the number of all rows.
pub(super) fn read(
    format: Columnar,
    name: &str,
    path: &Path,
    wanted: &Wanted,
    act: &mut dyn FnMut(&Table) -> Result<(), Faults>,
) -> Result<usize, Faults> {
    match format {
        #[cfg(feature = "parquet")]
        Columnar::Parquet => super::parquet::read(name, path, wanted, act),
        #[cfg(feature = "arrow")]
        Columnar::Arrow | Columnar::ArrowStream => super::arrow::read(name, path, format == Columnar::ArrowStream, wanted, act),
        #[allow(unreachable_patterns, reason = "a build with all features has every format")]
        _ => {
            // A build without any format uses neither.
            let _ = (wanted, act);
            Source::open(path)?;
            let fault = Fault::whole_file(name, format!("is {}, which this build does not read", format.words()));
            let feature = format.name().to_lowercase();
            let help = format!("build it with `--features {feature}`, or export CSV, which may be compressed with gzip");
            Err(Faults::one(fault.help(help)))
        }
    }
}

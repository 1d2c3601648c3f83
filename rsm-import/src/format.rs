//! The format of a file, recognised by its first bytes.

use rsm_core::source::{Fault, Faults};

use crate::log::Log;

/// Reads a file of any format; its first bytes identify the format. A file has one table, or several with one clock.
/// Of a format with thousands of channels only the `wanted` ones are read, if there is one of them.
pub(crate) fn read(name: &str, bytes: &[u8], wanted: &dyn Fn(&str) -> bool) -> Result<Vec<Log>, Faults> {
    if crate::mdf::is_mdf(bytes) {
        return Ok(crate::mdf::read(name, bytes, wanted)?.into_iter().map(Log::with_names_apart).collect());
    }
    let log = if bytes.starts_with(b"MATLAB 7.3") || hdf5_pure::is_hdf5_bytes(bytes) {
        crate::mat73::read(name, bytes)?
    } else if crate::mat::is_mat(bytes) {
        crate::mat::read(name, bytes)?
    } else if let Some(format) = foreign(bytes) {
        let what = format!("found {format}, which is not supported");
        return Err(Faults::one(Fault::whole_file(name, what).help("export it as CSV, MDF 4 or a MAT file")));
    } else {
        crate::sheet::read(name, bytes)?
    };
    Ok(vec![log.with_names_apart()])
}

/// Formats of other tools that are not tables, by their first bytes.
fn foreign(bytes: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 5] = [
        (b"PK\x03\x04", "a zip archive (a spreadsheet?)"),
        (b"\xd0\xcf\x11\xe0", "an old spreadsheet"),
        (b"PAR1", "a Parquet file"),
        (b"ARROW1", "an Arrow file"),
        (b"TDSm", "a TDMS file"),
    ];
    KNOWN.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, format)| *format)
}

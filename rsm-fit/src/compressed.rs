//! Data files as text, also compressed with gzip.
//!
//! In: a file. Out: its text. The first bytes decide, not the name. The hash of a compressed file in the evidence is that of its text, so that the same
//! rows have the same hash.

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use rsm_core::source::{Fault, Faults, Source};

/// The first bytes of a file compressed with gzip (RFC 1952).
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// The bytes of the text of a file.
pub(crate) fn decoded(mut file: impl Read + 'static) -> std::io::Result<Box<dyn Read>> {
    let mut first = Vec::new();
    file.by_ref().take(2).read_to_end(&mut first)?;
    let is_gzip = first == GZIP;
    let whole = std::io::Cursor::new(first).chain(file);
    Ok(if is_gzip { Box::new(MultiGzDecoder::new(whole)) } else { Box::new(whole) })
}

/// The whole text of a file.
pub(crate) fn read(path: &Path) -> Result<Source, Faults> {
    let file = Source::open(path)?;
    let name = path.display().to_string();
    let mut text = Vec::new();
    // A folder can be opened, and fails here.
    let read = decoded(file).and_then(|mut file| file.read_to_end(&mut text));
    read.map_err(|error| Faults::one(Fault::whole_file(&name, format!("cannot be read: {error}"))))?;
    Source::of_bytes(name, text)
}

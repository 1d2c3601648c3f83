//! Data files as text, also compressed with gzip.
//!
//! In: a file. Out: its text. The first bytes decide, not the name. The hash of a compressed file in the evidence is that of its text, so that the
//! same rows have the same hash.

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use rsm_core::source::{Fault, Faults, Source};
use sha2::{Digest as _, Sha256};

use crate::records::hexadecimal;

/// The first bytes of a file compressed with gzip (RFC 1952).
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// The first bytes of a Parquet file.
pub(crate) const PARQUET: &[u8] = b"PAR1";

/// The bytes of the text of a file.
pub(crate) fn decoded(mut file: impl Read + Send + 'static) -> std::io::Result<Box<dyn Read + Send>> {
    let mut first = Vec::new();
    file.by_ref().take(2).read_to_end(&mut first)?;
    let is_gzip = first == GZIP;
    let whole = std::io::Cursor::new(first).chain(file);
    Ok(if is_gzip { Box::new(MultiGzDecoder::new(whole)) } else { Box::new(whole) })
}

/// SHA-256 of the bytes of a file.
pub(crate) fn hash(path: &Path) -> Result<String, Faults> {
    let mut file = Source::open(path)?;
    let mut hash = Sha256::new();
    let mut bytes = vec![0; 1 << 16];
    loop {
        let read = file.read(&mut bytes);
        let name = path.display().to_string();
        match read.map_err(|error| Faults::one(Fault::whole_file(&name, format!("cannot be read: {error}"))))? {
            0 => return Ok(hexadecimal(&hash.finalize())),
            count => hash.update(&bytes[..count]),
        }
    }
}

/// The whole text of a file.
pub(crate) fn read(path: &Path) -> Result<Source, Faults> {
    let file = Source::open(path)?;
    let name = path.display().to_string();
    let mut text = Vec::new();
    // A folder can be opened, and fails here.
    let read = decoded(file).and_then(|mut file| file.read_to_end(&mut text));
    read.map_err(|error| Faults::one(Fault::whole_file(&name, format!("cannot be read: {error}"))))?;
    if text.starts_with(PARQUET) {
        let fault = Fault::whole_file(&name, "is a Parquet file, expected CSV");
        return Err(Faults::one(fault.help("`rsm fit --partial` reads Parquet, and `rsm merge` fits it; or export CSV")));
    }
    Source::of_bytes(name, text)
}

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

/// A file of numbered columns, which is no text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Columnar {
    /// Apache Parquet.
    Parquet,
    /// A file of Apache Arrow, which is also Feather of version 2.
    Arrow,
    /// A stream of Apache Arrow in a file.
    ArrowStream,
}

impl Columnar {
    /// The format that begins with these bytes, at least six of them if the file has so many.
    pub(crate) fn of(first: &[u8]) -> Option<Columnar> {
        // A stream begins with a message: four bytes of ones, which no text has, then its length ("Encapsulated message format" of Arrow IPC).
        const KNOWN: [(&[u8], Columnar); 3] =
            [(b"PAR1", Columnar::Parquet), (b"ARROW1", Columnar::Arrow), (&[0xff; 4], Columnar::ArrowStream)];
        KNOWN.iter().find(|(magic, _)| first.starts_with(magic)).map(|(_, format)| *format)
    }

    /// The format of a file; `None` for a file that cannot be read.
    pub(crate) fn of_file(path: &Path) -> Option<Columnar> {
        let mut first = Vec::new();
        std::fs::File::open(path).and_then(|file| file.take(8).read_to_end(&mut first)).ok()?;
        Columnar::of(&first)
    }

    /// Its name with an article.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Columnar::Parquet => "a Parquet file",
            Columnar::Arrow => "an Arrow file",
            Columnar::ArrowStream => "an Arrow stream",
        }
    }

    /// The name of its format, also that of the feature that reads it.
    pub(crate) fn name(self) -> &'static str {
        if self == Columnar::Parquet { "Parquet" } else { "Arrow" }
    }
}

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
    if let Some(format) = Columnar::of(&text) {
        let fault = Fault::whole_file(&name, format!("is {}, expected CSV", format.words()));
        let help = format!("`rsm fit --partial` reads {}, and `rsm merge` fits it; or export CSV", format.name());
        return Err(Faults::one(fault.help(help)));
    }
    Source::of_bytes(name, text)
}

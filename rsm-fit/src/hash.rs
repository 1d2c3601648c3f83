//! SHA-256 of texts and of files.
//!
//! In: a text; the path of a file. Out: the hash in hexadecimal. Holds no more than a block of a file in memory.

use std::io::Read as _;
use std::path::Path;

use rsm_core::source::{Fault, Faults, Source};
use sha2::{Digest as _, Sha256};

/// SHA-256 in hexadecimal. A source keeps every byte of its file, so this is the output of `sha256sum`.
#[must_use]
pub fn hash(text: &str) -> String {
    hexadecimal(&Sha256::digest(text.as_bytes()))
}

/// SHA-256 of the bytes of a file.
pub(crate) fn of_file(path: &Path) -> Result<String, Faults> {
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

/// Bytes as two hexadecimal digits each.
pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

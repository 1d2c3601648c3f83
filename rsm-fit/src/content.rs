//! What a data file holds: CSV, also compressed with gzip, or the numbered columns of Parquet and Arrow.
//!
//! In: a file. Out: its [`Table`]s and its SHA-256. The first bytes decide, not the name. The hash of a file that is compressed with gzip is that of
//! its text, so that the same rows have the same hash. Numbered columns are read only when a table is requested.

use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use rsm_core::source::{Fault, Faults, Source};

use crate::columnar::{self, Format};
use crate::hash::{self, hash};
use crate::table::{Table, Wanted};

/// The first bytes of a file compressed with gzip (RFC 1952).
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// From this number of bytes on, the hash of a text is worth a thread of its own: it takes a millisecond.
const LONG: usize = 1 << 20;

/// The content of a data file.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_fit::content::Content;
/// use rsm_fit::table::Wanted;
///
/// let content = Content::from(Source::new("bench.csv", "speed[km/h],note\n36,cold\n72,warm\n"));
/// let table = content.table(&Wanted { numbers: vec!["speed".into()], ..Wanted::default() })?;
/// assert_eq!(table.column("speed").unwrap().values, [36.0, 72.0]);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[derive(Debug, Clone)]
pub struct Content(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Text(Source),
    Columns { name: String, path: PathBuf, format: Format },
}

impl From<Source> for Content {
    fn from(source: Source) -> Self {
        Content(Kind::Text(source))
    }
}

impl Content {
    /// Reads a text, and recognises the format of numbered columns.
    ///
    /// # Errors
    /// A file that cannot be read, or is neither UTF-8 nor a known format.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let name = path.display().to_string();
        let file = Source::open(path)?;
        // What was read from a pipe is not there again.
        if file.metadata().is_ok_and(|found| found.is_file())
            && let Some(format) = Format::of_file(path)
        {
            return Ok(Content(Kind::Columns { name, path: path.to_path_buf(), format }));
        }
        let mut text = Vec::new();
        // A folder can be opened, and fails here.
        let read = decoded(file).and_then(|mut file| file.read_to_end(&mut text));
        read.map_err(|error| Faults::one(Fault::whole_file(&name, format!("cannot be read: {error}"))))?;
        if let Some(format) = Format::of(&text) {
            let what = format!("is {} in a pipe or compressed with gzip, expected a file of its own", format.words());
            return Err(Faults::one(Fault::whole_file(&name, what).help("write it to a file without gzip")));
        }
        Ok(Content(Kind::Text(Source::of_bytes(name, text)?)))
    }

    /// The name of the file in messages.
    #[must_use]
    pub fn name(&self) -> &str {
        match &self.0 {
            Kind::Text(source) => source.name(),
            Kind::Columns { name, .. } => name,
        }
    }

    /// The requested columns.
    ///
    /// # Errors
    /// Every fault of the file; a format that this build does not read.
    pub fn table(&self, wanted: &Wanted) -> Result<Table, Faults> {
        match &self.0 {
            Kind::Text(source) => Table::read(source, wanted),
            Kind::Columns { name, path, format } => columnar::table(*format, name, path, wanted),
        }
    }

    /// SHA-256 in hexadecimal: of the text, or of the bytes of a file of numbered columns.
    ///
    /// # Errors
    /// A file of numbered columns that cannot be read.
    pub fn sha256(&self) -> Result<String, Faults> {
        match &self.0 {
            Kind::Text(source) => Ok(hash(source.text())),
            Kind::Columns { path, .. } => hash::of_file(path),
        }
    }

    /// The requested columns and the hash, at the same time if the file is long.
    pub(crate) fn table_and_sha256(&self, wanted: &Wanted) -> Result<(Table, String), Faults> {
        if matches!(&self.0, Kind::Text(source) if source.text().len() < LONG) {
            return Ok((self.table(wanted)?, self.sha256()?));
        }
        std::thread::scope(|scope| {
            let sha256 = scope.spawn(|| self.sha256());
            let table = self.table(wanted);
            let sha256 = sha256.join().expect("a hash is never a panic");
            Ok((table?, sha256?))
        })
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

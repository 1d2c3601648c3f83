//! Reads a CSV block by block.
//!
//! In: the text of a file. Out: its text in blocks of whole rows, each with the header of the file above it, so that a block is read like a file; the
//! SHA-256 of the text. The memory does not depend on the size of the file. Parses no number. A file that is read in blocks and has a fault is read
//! again as a whole by the caller, whose messages then have the lines of the file.

use std::io::Read;

use memchr::{memchr, memrchr};
use sha2::{Digest as _, Sha256};

use crate::hash::hexadecimal;

/// The size of a block in bytes: some 20,000 rows. Larger ones are not faster.
pub(super) const BLOCK: usize = 1 << 20;

/// Where the text is within CSV, as the CSV reader sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    LineStart,
    Comment,
    CellStart,
    Cell,
    Quoted,
    /// Behind a quote within quotes: its end, or the first of two that mean one.
    Quote,
}

/// Finds the ends of rows.
struct Scan {
    place: Place,
    /// Whether the line has more than its end or a comment.
    has_content: bool,
}

impl Scan {
    /// Whether a row, a comment or an empty line ends behind this byte.
    fn ends(&mut self, byte: u8) -> bool {
        let is_end = byte == b'\n' && self.place != Place::Quoted;
        self.place = match (self.place, byte) {
            (Place::Quoted, b'"') => Place::Quote,
            (Place::Quoted, _) => Place::Quoted,
            (Place::Comment, b'\n') => Place::LineStart,
            (Place::Comment, _) | (Place::LineStart, b'#') => Place::Comment,
            (_, b'\n' | b'\r') => Place::LineStart,
            (_, b',') => Place::CellStart,
            (Place::LineStart | Place::CellStart | Place::Quote, b'"') => Place::Quoted,
            _ => Place::Cell,
        };
        self.has_content |= !matches!(self.place, Place::LineStart | Place::Comment);
        is_end
    }
}

/// The blocks of a file.
pub(super) struct Blocks {
    file: Box<dyn Read + Send>,
    /// The least size of a block.
    size: usize,
    hash: Sha256,
    scan: Scan,
    /// The next block: behind the first block it begins with the header. Then bytes that were read and are in no block yet.
    rest: Vec<u8>,
    /// The bytes of `rest` that were scanned, and where its last whole row ends.
    scanned: usize,
    whole: usize,
    /// Where the current line begins in `rest`.
    line: usize,
    /// Whether there is a row with content up to `whole`, without the header.
    has_row: bool,
    header: Option<Vec<u8>>,
    is_at_end: bool,
}

impl Blocks {
    pub(super) fn new(file: Box<dyn Read + Send>, size: usize) -> Self {
        Blocks {
            file,
            size,
            hash: Sha256::new(),
            scan: Scan { place: Place::LineStart, has_content: false },
            rest: Vec::new(),
            scanned: 0,
            whole: 0,
            line: 0,
            has_row: false,
            header: None,
            is_at_end: false,
        }
    }

    /// SHA-256 of the text, once the last block was read.
    pub(super) fn sha256(self) -> String {
        hexadecimal(&self.hash.finalize())
    }

    /// The next block with at least one row; `None` at the end.
    pub(super) fn next(&mut self) -> std::io::Result<Option<Vec<u8>>> {
        while !self.is_at_end && (self.rest.len() < self.size || !self.has_row) {
            self.read()?;
        }
        if !self.has_row {
            return Ok(None);
        }
        let header = self.header.as_ref().expect("rows are below a header");
        // The block keeps its memory: only what is behind its last row is copied.
        let behind = self.rest.len() - self.whole;
        let mut rest = Vec::with_capacity(header.len() + behind + self.size);
        rest.extend(header);
        rest.extend(&self.rest[self.whole..]);
        let moved = |place: usize| place - self.whole + header.len();
        (self.scanned, self.line, self.whole, self.has_row) = (moved(self.scanned), moved(self.line), header.len(), false);
        let mut block = std::mem::replace(&mut self.rest, rest);
        block.truncate(block.len() - behind);
        Ok(Some(block))
    }

    fn read(&mut self) -> std::io::Result<()> {
        let before = self.rest.len();
        self.file.by_ref().take(self.size as u64).read_to_end(&mut self.rest)?;
        let read = &self.rest[before..];
        self.hash.update(read);
        let has_quote = memchr(b'"', read).is_some();
        if read.is_empty() {
            self.is_at_end = true;
            // The last row has no end of line.
            if self.scan.has_content {
                self.row_ends(self.rest.len());
            }
            (self.whole, self.line) = (self.rest.len(), self.rest.len());
        }
        let mut last = if has_quote { None } else { memrchr(b'\n', &self.rest[before..]).map(|at| before + at + 1) };
        while self.scanned < self.rest.len() {
            // Without a quote every end of line ends a row, and only the last one counts.
            if self.has_row
                && !matches!(self.scan.place, Place::Quoted | Place::Quote)
                && let Some(last) = last.take_if(|last| self.scanned < *last)
            {
                self.scan = Scan { place: Place::LineStart, has_content: false };
                (self.scanned, self.whole, self.line) = (last, last, last);
                continue;
            }
            let byte = self.rest[self.scanned];
            self.scanned += 1;
            if self.scan.ends(byte) {
                if self.scan.has_content {
                    self.row_ends(self.scanned);
                }
                (self.whole, self.line) = (self.scanned, self.scanned);
                self.scan.has_content = false;
            }
        }
        Ok(())
    }

    fn row_ends(&mut self, at: usize) {
        if self.header.is_some() {
            self.has_row = true;
        } else {
            let line = &self.rest[self.line..at];
            self.header = Some(line.strip_prefix("\u{feff}".as_bytes()).unwrap_or(line).to_vec());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use rsm_core::source::Source;

    use super::*;
    use crate::content::decoded;
    use crate::hash::hash;
    use crate::table::{Table, Wanted};

    fn blocks(text: &[u8], size: usize) -> (Vec<String>, String) {
        let mut blocks = Blocks::new(decoded(std::io::Cursor::new(text.to_vec())).unwrap(), size);
        let mut found = Vec::new();
        while let Some(block) = blocks.next().unwrap() {
            found.push(String::from_utf8(block).unwrap());
        }
        (found, blocks.sha256())
    }

    #[test]
    fn blocks_of_any_size_have_the_rows_of_the_file() {
        // Comments with quotes, an end of line and a comma within quotes, empty lines, no end of line at the end.
        let text = "# it\"s a comment\n\nx[m],\"a \"\"note\"\"\",y[1]\n1,\"one,\nor 1\",2\r\n# two\n\n3,x\"y,4\n5,,6\n7,\"\",8\n9,z,10";
        let wanted = Wanted { numbers: vec!["x".into(), "y".into()], ..Wanted::default() };
        for text in [text.to_string(), text.replace('\n', "\r\n"), format!("\u{feff}{}", &text[18..])] {
            let whole = Table::read(&Source::new("t.csv", text.clone()), &wanted).unwrap();
            for size in 1..text.len() + 2 {
                let (found, sha256) = blocks(text.as_bytes(), size);
                assert_eq!(sha256, hash(&text));
                assert!(size > 20 || found.len() > 1, "{size}: {found:?}");
                let tables: Vec<Table> =
                    found.iter().map(|block| Table::read(&Source::new("t.csv", block.clone()), &wanted).unwrap()).collect();
                for column in [0, 2] {
                    let values: Vec<f64> = tables.iter().flat_map(|table| table.columns[column].values.clone()).collect();
                    assert_eq!(values, whole.columns[column].values, "{size} {found:?}");
                    assert!(tables.iter().all(|table| table.columns[column].unit == whole.columns[column].unit));
                }
            }
        }
        assert!(blocks(b"", 9).0.is_empty() && blocks(b"# only\n\nx[1]\n# this\n", 4).0.is_empty());
    }

    #[test]
    fn a_compressed_file_is_its_text() {
        let text = "x[1]\n".to_string() + &"12.5\n".repeat(1000);
        let packed = |text: &str| {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(text.as_bytes()).unwrap();
            encoder.finish().unwrap()
        };
        assert_eq!(blocks(&packed(&text), 300), blocks(text.as_bytes(), 300));
        // Two compressed files in one, as `cat a.gz b.gz` makes them.
        let two = [packed(&text[..2000]), packed(&text[2000..])].concat();
        assert_eq!(blocks(&two, 300), blocks(text.as_bytes(), 300));
        // Cut off.
        let packed = packed(&text);
        let mut blocks = Blocks::new(decoded(std::io::Cursor::new(packed[..packed.len() / 2].to_vec())).unwrap(), 300);
        assert!((0..1000).any(|_| blocks.next().is_err()));
    }
}

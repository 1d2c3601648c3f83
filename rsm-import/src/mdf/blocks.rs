//! The blocks of an MDF file: their links, texts, and the bytes of the records.
//!
//! In: the bytes of a file, the address of a block. Out: the block, or what is wrong with it. Every access is checked against the end of the file.
//! No chain of blocks is longer than the file has room for.

use std::borrow::Cow;
use std::io::Read as _;

use flate2::read::ZlibDecoder;

/// The limit of the bytes of all records of a file, decompressed.
pub(super) const LARGEST: u64 = 2_000_000_000;

/// The length of the head of a block: two letters after `##`, its length, the number of its links.
const HEAD: u64 = 24;

/// A value, or a sentence about what is wrong.
pub(super) type Read<T> = Result<T, String>;

/// A file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blocks<'a>(pub &'a [u8]);

/// A block.
#[derive(Debug, Clone)]
pub(super) struct Block<'a> {
    at: u64,
    pub id: [u8; 2],
    links: Vec<u64>,
    pub data: &'a [u8],
}

impl Block<'_> {
    /// The address in a link; 0 if there is no such link.
    pub(super) fn link(&self, place: usize) -> u64 {
        self.links.get(place).copied().unwrap_or(0)
    }

    /// Some bytes of the data.
    pub(super) fn bytes<const N: usize>(&self, at: usize) -> Read<[u8; N]> {
        let part = self.data.get(at..).and_then(|rest| rest.first_chunk::<N>());
        part.copied().ok_or_else(|| format!("the block `{}` at byte {} is too short", name(self.id), self.at))
    }

    pub(super) fn u8(&self, at: usize) -> Read<u8> {
        self.bytes::<1>(at).map(|bytes| bytes[0])
    }

    pub(super) fn u16(&self, at: usize) -> Read<u16> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    pub(super) fn u32(&self, at: usize) -> Read<u32> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&self, at: usize) -> Read<u64> {
        self.bytes(at).map(u64::from_le_bytes)
    }

    pub(super) fn f64(&self, at: usize) -> Read<f64> {
        self.bytes(at).map(f64::from_le_bytes)
    }
}

fn name(id: [u8; 2]) -> String {
    String::from_utf8_lossy(&id).into_owned()
}

impl<'a> Blocks<'a> {
    fn part(&self, at: u64, length: u64) -> Read<&'a [u8]> {
        let range = usize::try_from(at).ok().zip(at.checked_add(length).and_then(|end| usize::try_from(end).ok()));
        let part = range.and_then(|(begin, end)| self.0.get(begin..end));
        part.ok_or_else(|| {
            format!("the file ends at byte {}, before byte {} of a block", self.0.len(), at.saturating_add(length))
        })
    }

    /// The block at an address.
    pub(super) fn block(&self, at: u64) -> Read<Block<'a>> {
        let head = self.part(at, HEAD)?;
        let word = |place: usize| head[place..].first_chunk::<8>().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        if &head[..2] != b"##" {
            return Err(format!("byte {at}: found {:?}, expected a block", String::from_utf8_lossy(&head[..4])));
        }
        let id = [head[2], head[3]];
        let (length, links) = (word(8), word(16));
        let broken = || format!("the block `{}` at byte {at} has a wrong length", name(id));
        let begin = links.checked_mul(8).and_then(|bytes| bytes.checked_add(HEAD)).filter(|begin| *begin <= length);
        let begin = begin.ok_or_else(broken)?;
        let whole = self.part(at, length)?;
        let (head, data) = whole.split_at(begin as usize);
        let links = head[HEAD as usize..].as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
        Ok(Block { at, id, links, data })
    }

    /// The block at an address, which must have one of these names.
    pub(super) fn one_of(&self, at: u64, ids: &[&str]) -> Read<Block<'a>> {
        let block = self.block(at)?;
        if ids.iter().any(|id| id.as_bytes() == block.id) {
            return Ok(block);
        }
        Err(format!("byte {at}: found the block `{}`, expected `{}`", name(block.id), ids.join("` or `")))
    }

    /// A chain of blocks, whose first link is the address of the next one.
    pub(super) fn chain(&self, first: u64, id: &str) -> Read<Vec<Block<'a>>> {
        let (mut all, mut at) = (Vec::new(), first);
        while at != 0 {
            if all.len() as u64 * HEAD > self.0.len() as u64 {
                return Err(format!("the blocks `{id}` from byte {first} on have no end"));
            }
            let block = self.one_of(at, &[id])?;
            at = block.link(0);
            all.push(block);
        }
        Ok(all)
    }

    /// The text at an address: a plain one, or the one inside of the tag `TX`. Without an address it is empty.
    pub(super) fn text(&self, at: u64) -> Read<String> {
        if at == 0 {
            return Ok(String::new());
        }
        let block = self.one_of(at, &["TX", "MD"])?;
        let end = block.data.iter().position(|byte| *byte == 0).unwrap_or(block.data.len());
        let text = String::from_utf8_lossy(&block.data[..end]).into_owned();
        if block.id == *b"TX" {
            return Ok(text.trim().to_string());
        }
        let inside = text.split_once("<TX>").and_then(|(_, rest)| rest.split_once("</TX>"));
        Ok(inside.map_or(String::new(), |(inside, _)| inside.trim().to_string()))
    }

    /// The bytes of the records at an address: one block, or a list of them, as they are or compressed. `left`: the limit of those that are copied.
    pub(super) fn records(&self, at: u64, left: &mut u64) -> Read<Cow<'a, [u8]>> {
        if at == 0 {
            return Ok(Cow::Borrowed(&[]));
        }
        let block = self.block(at)?;
        match &block.id {
            b"DT" => Ok(Cow::Borrowed(block.data)),
            b"DZ" => decompressed(&block, left).map(Cow::Owned),
            b"HL" => self.listed(block.link(0), left).map(Cow::Owned),
            b"DL" => self.listed(at, left).map(Cow::Owned),
            b"LD" | b"DV" => Err("its records are stored by columns (MDF 4.2), which is not supported".to_string()),
            other => Err(format!("byte {at}: found the block `{}`, expected records", name(*other))),
        }
    }

    fn listed(&self, first: u64, left: &mut u64) -> Read<Vec<u8>> {
        let mut all = Vec::new();
        for list in self.chain(first, "DL")? {
            for at in list.links.iter().skip(1).filter(|at| **at != 0) {
                let part = self.one_of(*at, &["DT", "DZ"])?;
                if part.id == *b"DZ" {
                    all.extend(decompressed(&part, left)?);
                } else {
                    take(left, part.data.len() as u64)?;
                    all.extend_from_slice(part.data);
                }
            }
        }
        Ok(all)
    }
}

/// Takes some bytes from those that are left.
fn take(left: &mut u64, bytes: u64) -> Read<()> {
    *left =
        left.checked_sub(bytes).ok_or_else(|| format!("it has more than {LARGEST} bytes of records, which is the limit"))?;
    Ok(())
}

/// The content of a block `DZ`.
fn decompressed(block: &Block<'_>, left: &mut u64) -> Read<Vec<u8>> {
    let (kind, columns) = (block.u8(2)?, block.u32(4)? as usize);
    let (length, compressed) = (block.u64(8)?, block.u64(16)?);
    if kind > 1 {
        return Err(format!("byte {}: found the compression {kind}, expected 0 (deflate) or 1 (transposed deflate)", block.at));
    }
    take(left, length)?;
    let broken = || format!("the compressed block at byte {} is damaged", block.at);
    let from = usize::try_from(compressed).ok().and_then(|length| block.data.get(24..)?.get(..length)).ok_or_else(broken)?;
    let mut content = Vec::new();
    ZlibDecoder::new(from).take(length + 1).read_to_end(&mut content).map_err(|_| broken())?;
    if content.len() as u64 != length {
        return Err(broken());
    }
    if kind == 0 || columns < 2 {
        return Ok(content);
    }
    // Byte k of all records came first, then byte k + 1; what is less than a record is as it was.
    let rows = content.len() / columns;
    let (turned, rest) = content.split_at(rows * columns);
    let mut records = Vec::with_capacity(content.len());
    for row in 0..rows {
        records.extend((0..columns).map(|column| turned[column * rows + row]));
    }
    records.extend_from_slice(rest);
    Ok(records)
}

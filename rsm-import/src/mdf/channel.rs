//! The channels of a record: where their bits are, and what number they are.

use super::blocks::{Block, Blocks, Read};
use super::conversion::Conversion;

/// The nesting limit of structures.
const DEEPEST: usize = 16;

/// What a stored number is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stored {
    Whole {
        is_signed: bool,
    },
    Real,
    /// The number of the record.
    Index,
}

/// A channel of numbers.
#[derive(Debug)]
pub(super) struct Channel {
    pub name: String,
    pub unit: Option<String>,
    /// Whether it is the time of the records.
    pub is_time: bool,
    pub conversion: Conversion,
    stored: Stored,
    is_big: bool,
    /// The first byte, the bit in it, the number of bits.
    byte: usize,
    bit: usize,
    bits: usize,
    /// The bit that marks a number as invalid, counted from the end of the numbers.
    invalid: Option<usize>,
    never_valid: bool,
}

/// Reads a chain of channels with those of its structures. What is no number gets a note.
pub(super) fn channels(
    blocks: &Blocks<'_>,
    first: u64,
    (above, depth): (&str, usize),
    all: &mut Vec<Channel>,
    notes: &mut Vec<String>,
) -> Read<()> {
    for block in blocks.chain(first, "CN")? {
        // Each channel ends in one of both lists. More than the file has room for are structures that contain themselves.
        if all.len() + notes.len() > blocks.0.len() {
            return Err("its structures of channels have no end".to_string());
        }
        let own = blocks.text(block.link(2))?;
        let name = crate::sheet::clean(&if above.is_empty() { own } else { format!("{above}.{own}") });
        let inside = match block.link(1) {
            0 => None,
            at => Some((at, blocks.block(at)?.id)),
        };
        match inside {
            Some((at, [b'C', b'N'])) if depth < DEEPEST => channels(blocks, at, (&name, depth + 1), all, notes)?,
            Some(_) => notes.push(format!("`{name}` is an array in each record and is not read")),
            None => match channel(blocks, &block, &name)? {
                Some(channel) => all.push(channel),
                None => notes.push(format!("`{name}` is no number and is not read")),
            },
        }
    }
    Ok(())
}

fn channel(blocks: &Blocks<'_>, block: &Block<'_>, name: &str) -> Read<Option<Channel>> {
    let (kind, sync, data) = (block.u8(0)?, block.u8(1)?, block.u8(2)?);
    let (bit, byte, bits) = (usize::from(block.u8(3)?), block.u32(4)? as usize, block.u32(8)? as usize);
    let flags = block.u32(12)?;
    let stored = match (kind, data) {
        (3 | 6, _) => Stored::Index,
        (0 | 2 | 4, 0 | 1) => Stored::Whole { is_signed: false },
        (0 | 2 | 4, 2 | 3) => Stored::Whole { is_signed: true },
        (0 | 2 | 4, 4 | 5) if bit == 0 && matches!(bits, 16 | 32 | 64) => Stored::Real,
        _ => return Ok(None),
    };
    let is_whole = matches!(stored, Stored::Whole { .. });
    if is_whole && (bits == 0 || bits > 64 || bit > 7) {
        return Ok(None);
    }
    let at = block.link(4);
    let conversion = Conversion::read(blocks, at, 0)?;
    let mut unit = blocks.text(block.link(6))?;
    if unit.is_empty() && at != 0 {
        unit = blocks.text(blocks.one_of(at, &["CC"])?.link(1))?;
    }
    let is_time = matches!(kind, 2 | 3) && sync == 1;
    if unit.is_empty() && is_time {
        unit = "s".to_string();
    }
    Ok(Some(Channel {
        name: name.to_string(),
        unit: (!unit.is_empty()).then_some(unit),
        is_time,
        conversion,
        stored,
        is_big: matches!(data, 1 | 3 | 5),
        byte,
        bit,
        bits,
        invalid: if flags & 2 == 0 { None } else { Some(block.u32(16)? as usize) },
        never_valid: flags & 1 != 0,
    }))
}

impl Channel {
    /// Whether its bits are in the first bytes of a record.
    pub(super) fn is_inside(&self, bytes: usize) -> bool {
        self.stored == Stored::Index
            || self.byte.checked_add((self.bit + self.bits).div_ceil(8)).is_some_and(|end| end <= bytes)
    }

    /// The number of a record; NaN if it is marked as invalid. `numbers`: the length of the record without the marks.
    pub(super) fn number(&self, record: &[u8], numbers: usize, index: usize) -> f64 {
        let is_marked = |mark: usize| record.get(numbers + mark / 8).is_some_and(|byte| byte >> (mark % 8) & 1 != 0);
        if self.never_valid || self.invalid.is_some_and(is_marked) {
            return f64::NAN;
        }
        self.conversion.apply(self.stored(record, index))
    }

    fn stored(&self, record: &[u8], index: usize) -> f64 {
        if self.stored == Stored::Index {
            return index as f64;
        }
        let own = &record[self.byte..self.byte + (self.bit + self.bits).div_ceil(8)];
        // 64 bits that begin inside of a byte are in nine bytes.
        let next = |sum: u128, byte: &u8| sum << 8 | u128::from(*byte);
        let whole = if self.is_big { own.iter().fold(0, next) } else { own.iter().rev().fold(0, next) };
        let bits = (whole >> self.bit) as u64 & (u64::MAX >> (64 - self.bits));
        match self.stored {
            Stored::Whole { is_signed: true } => ((bits << (64 - self.bits)) as i64 >> (64 - self.bits)) as f64,
            Stored::Real if self.bits == 64 => f64::from_bits(bits),
            Stored::Real if self.bits == 32 => f64::from(f32::from_bits(bits as u32)),
            Stored::Real => half(bits as u16),
            _ => bits as f64,
        }
    }
}

/// A number of IEEE 754 with 16 bits.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023) / 1024.0);
    let size = match exponent {
        0 => fraction * 2f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction) * 2f64.powi(exponent - 15),
    };
    if bits >> 15 == 0 { size } else { -size }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(stored: Stored, is_big: bool, (byte, bit, bits): (usize, usize, usize)) -> Channel {
        let (name, conversion) = (String::new(), Conversion::Same);
        let (unit, invalid) = (None, None);
        Channel { name, unit, is_time: false, conversion, stored, is_big, byte, bit, bits, invalid, never_valid: false }
    }

    #[test]
    fn bits_are_taken_from_where_they_are() {
        let record = [0b1010_0110, 0xff, 0x80, 0x00, 0x3c, 1, 2, 3, 4, 5, 6, 7, 8, 9];
        let unsigned = Stored::Whole { is_signed: false };
        let signed = Stored::Whole { is_signed: true };
        let number = |channel: Channel| channel.stored(&record, 7);
        assert_eq!(number(of(unsigned, false, (0, 1, 3))), 3.0);
        assert_eq!(number(of(signed, false, (0, 4, 4))), -6.0);
        assert_eq!(number(of(signed, false, (1, 0, 16))), f64::from(i16::from_le_bytes([0xff, 0x80])));
        assert_eq!(number(of(signed, true, (1, 0, 16))), f64::from(i16::from_be_bytes([0xff, 0x80])));
        assert_eq!(number(of(unsigned, true, (0, 4, 12))), f64::from(0xa6ff_u32 >> 4));
        let nine = u128::from_le_bytes([1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 0, 0, 0, 0, 0, 0]) >> 3;
        assert_eq!(number(of(unsigned, false, (5, 3, 64))), nine as u64 as f64);
        assert_eq!(number(of(Stored::Real, false, (3, 0, 16))), 1.0);
        assert_eq!(number(of(Stored::Index, false, (99, 0, 64))), 7.0);
        for (bits, value) in [(0x0001, 2f64.powi(-24)), (0xc000, -2.0), (0x7bff, 65504.0), (0xfc00, f64::NEG_INFINITY)] {
            assert_eq!(half(bits), value);
        }
        assert!(half(0x7e00).is_nan());
    }
}

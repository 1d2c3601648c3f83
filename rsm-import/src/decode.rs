//! Bytes to text: finds the encoding of a table.
//!
//! In: the bytes of a file. Out: its text and the name of the encoding. A byte order mark decides. Otherwise text that is valid UTF-8 is UTF-8. All
//! other text is Windows-1252, which contains Latin-1: every byte is valid there, so no file is refused. Text without a mark in which every second
//! byte is 0 is UTF-16.

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};

/// The text of a file, and its encoding.
pub(crate) fn text(bytes: &[u8]) -> (String, &'static str) {
    let encoding = Encoding::for_bom(bytes).map_or_else(|| guess(bytes), |(encoding, _)| encoding);
    let (text, _) = encoding.decode_with_bom_removal(bytes);
    (text.into_owned(), if encoding == WINDOWS_1252 { "Latin-1 (Windows-1252)" } else { encoding.name() })
}

fn guess(bytes: &[u8]) -> &'static Encoding {
    let head = &bytes[..bytes.len().min(400)];
    let zeros = |odd: usize| head.iter().skip(odd).step_by(2).filter(|byte| **byte == 0).count();
    // A table consists of digits and separators: in UTF-16 nearly every second byte is 0, in any other encoding no byte is.
    if zeros(1) * 3 > head.len() {
        UTF_16LE
    } else if zeros(0) * 3 > head.len() {
        UTF_16BE
    } else if std::str::from_utf8(bytes).is_ok() {
        UTF_8
    } else {
        WINDOWS_1252
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_header_in_every_encoding() {
        let header = "Zeit [ms];Drehmoment [N·m];Öltemperatur [°C]\n0;1;2\n";
        let utf16 = |big: bool| -> Vec<u8> {
            header.encode_utf16().flat_map(|unit| if big { unit.to_be_bytes() } else { unit.to_le_bytes() }).collect()
        };
        let latin: Vec<u8> = header.chars().map(|sign| sign as u8).collect();
        let with_mark = |mark: &[u8], bytes: Vec<u8>| [mark, &bytes].concat();
        for (bytes, encoding) in [
            (header.as_bytes().to_vec(), "UTF-8"),
            (with_mark(&[0xef, 0xbb, 0xbf], header.as_bytes().to_vec()), "UTF-8"),
            (latin, "Latin-1 (Windows-1252)"),
            (utf16(false), "UTF-16LE"),
            (utf16(true), "UTF-16BE"),
            (with_mark(&[0xff, 0xfe], utf16(false)), "UTF-16LE"),
            (with_mark(&[0xfe, 0xff], utf16(true)), "UTF-16BE"),
        ] {
            assert_eq!(text(&bytes), (header.to_string(), encoding), "{encoding}");
        }
        // Windows-1252 has characters where Latin-1 has none.
        assert_eq!(text(&[0x80, 0xb5]).0, "€µ");
    }
}

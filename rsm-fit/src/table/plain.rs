//! Reads the rows of a plain CSV, on several threads.
//!
//! In: the text below the header and what is wanted of each column. Out: the numbers and labels of every row; nothing if the text is not plain. Plain
//! text has no quotes, a cell for every column in every row, and a finite number in every wanted cell (or none where NaN is permitted). The CSV
//! reader of the caller reads any other text: it gives the same values, and every fault with its place.

use memchr::memchr;

use super::{MissingAs, is_missing};
use crate::dd::two_prod;
use crate::threads;

/// The size of a piece of the text, in bytes: some 20,000 rows, and some milliseconds of work.
const PIECE: usize = 1 << 20;

/// The powers of ten that f64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

/// Whole numbers below this one are a sum of two f64, the nearest one and a rest up to 2^8.
const WHOLE: u64 = 1 << 62;

/// Rows, by column.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// The line of every row.
    pub lines: Vec<usize>,
    /// The numbers of every column; empty if they are not wanted.
    pub values: Vec<Vec<f64>>,
    /// The labels.
    pub labels: Vec<Vec<String>>,
}

/// The rows of a text that begins at a line. `roles`: whether each column is wanted as numbers and as labels.
pub(super) fn rows(text: &str, line: usize, roles: &[(bool, bool)], missing: MissingAs) -> Option<Rows> {
    let mut ends = vec![0];
    while *ends.last().expect("the start") < text.len() {
        let from = (ends[ends.len() - 1] + PIECE).min(text.len());
        let end = text.as_bytes()[from..].iter().position(|byte| *byte == b'\n').map_or(text.len(), |at| from + at + 1);
        ends.push(end);
    }
    let mut all =
        Some(Rows { lines: Vec::new(), values: vec![Vec::new(); roles.len()], labels: vec![Vec::new(); roles.len()] });
    let mut line = line;
    let piece = |k: usize| Piece::of(&text[ends[k]..ends[k + 1]], roles, missing);
    threads::in_order(ends.len() - 1, piece, |piece| {
        let (Some(rows), Some(mut piece)) = (&mut all, piece) else {
            all = None;
            return;
        };
        if rows.lines.is_empty() {
            piece.rows.lines.iter_mut().for_each(|own| *own += line);
            *rows = piece.rows;
            line += piece.line_ends;
            return;
        }
        rows.lines.extend(piece.rows.lines.iter().map(|own| line + own));
        rows.values.iter_mut().zip(piece.rows.values).for_each(|(all, own)| all.extend(own));
        rows.labels.iter_mut().zip(piece.rows.labels).for_each(|(all, own)| all.extend(own));
        line += piece.line_ends;
    });
    all
}

/// A part of the text.
struct Piece {
    rows: Rows,
    line_ends: usize,
}

impl Piece {
    fn of(text: &str, roles: &[(bool, bool)], missing: MissingAs) -> Option<Piece> {
        let bytes = text.as_bytes();
        // Memory for a few more rows than there are if all are as long as the first.
        let first = memchr(b'\n', bytes).map_or(bytes.len(), |at| at + 1);
        let rows = bytes.len() / first.max(1) * 9 / 8 + 1;
        let values = |(is_number, _): &(bool, bool)| Vec::with_capacity(if *is_number { rows } else { 0 });
        let mut piece = Piece {
            rows: Rows {
                lines: Vec::with_capacity(rows),
                values: roles.iter().map(values).collect(),
                labels: vec![Vec::new(); roles.len()],
            },
            line_ends: 0,
        };
        let mut at = 0;
        while at < bytes.len() {
            if let Some(next) = without_row(bytes, at, roles.len()) {
                at = next;
            } else {
                piece.rows.lines.push(piece.line_ends);
                for (k, ((is_number, is_label), values)) in roles.iter().zip(&mut piece.rows.values).enumerate() {
                    let start = at;
                    let short = if *is_number && !is_label { decimal(bytes, at) } else { None };
                    match short {
                        Some((value, end)) => {
                            values.push(value);
                            at = end;
                        }
                        None => {
                            at = end_of_cell(bytes, at)?;
                            let cell = text[start..at].trim();
                            if *is_label {
                                piece.rows.labels[k].push(cell.to_string());
                            }
                            if *is_number {
                                values.push(number(cell, missing)?);
                            }
                        }
                    }
                    // A comma between cells, and the end of the line behind the last one.
                    if k + 1 < roles.len() {
                        if bytes.get(at) != Some(&b',') {
                            return None;
                        }
                        at += 1;
                    }
                }
                at = behind_line(bytes, at)?;
            }
            piece.line_ends += usize::from(bytes[at - 1] == b'\n');
        }
        Some(piece)
    }
}

/// Where the next line begins if this one is empty, of blanks or a comment.
fn without_row(bytes: &[u8], at: usize, columns: usize) -> Option<usize> {
    let rest = &bytes[at..];
    if matches!(rest[0], b'0'..=b'9' | b'-') {
        return None;
    }
    if rest[0] == b'#' {
        return Some(rest.iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |end| at + end + 1));
    }
    // With one column, a line of blanks is an empty cell.
    let is_blank = |byte: &&u8| columns > 1 && matches!(**byte, b' ' | b'\t');
    behind_line(bytes, at + rest.iter().take_while(is_blank).count())
}

/// Where the next line begins, if this one ends here.
fn behind_line(bytes: &[u8], at: usize) -> Option<usize> {
    match &bytes[at..] {
        [] => Some(at),
        [b'\n', ..] => Some(at + 1),
        [b'\r', b'\n', ..] => Some(at + 2),
        _ => None,
    }
}

/// The end of a cell; `None` if it has a quote, or a carriage return that does not end the line together with a line feed.
fn end_of_cell(bytes: &[u8], at: usize) -> Option<usize> {
    let length = bytes[at..].iter().position(|byte| matches!(byte, b',' | b'\n' | b'\r' | b'"')).unwrap_or(bytes.len() - at);
    let end = at + length;
    match bytes.get(end) {
        Some(b'"') => None,
        Some(b'\r') if bytes.get(end + 1) != Some(&b'\n') => None,
        _ => Some(end),
    }
}

/// The number of a cell.
fn number(cell: &str, missing: MissingAs) -> Option<f64> {
    if missing != MissingAs::Faults && is_missing(cell) {
        return (missing == MissingAs::Nan).then_some(f64::NAN);
    }
    cell.parse().ok().filter(|value: &f64| value.is_finite())
}

/// A decimal without exponent that is a whole cell, and where it ends; `None` for what other code must read.
fn decimal(bytes: &[u8], start: usize) -> Option<(f64, usize)> {
    let is_negative = bytes.get(start) == Some(&b'-');
    let first = start + usize::from(is_negative);
    // One by one, because there are few before the point.
    let (mut whole, mut at) = (0u64, first);
    while let Some(digit @ b'0'..=b'9') = bytes.get(at) {
        whole = whole.checked_mul(10)?.checked_add(u64::from(digit - b'0'))?;
        at += 1;
    }
    let mut count = at - first;
    let mut behind_point = 0;
    if bytes.get(at) == Some(&b'.') {
        let first = at + 1;
        (whole, at) = digits(bytes, first, whole)?;
        behind_point = at - first;
        count += behind_point;
    }
    match bytes.get(at) {
        Some(b',' | b'\n') | None => {}
        Some(b'\r') if bytes.get(at + 1) == Some(&b'\n') => {}
        _ => return None,
    }
    if count == 0 {
        return None;
    }
    let value = over(whole, *POWERS.get(behind_point)?)?;
    // Without a branch, because half of all numbers may be negative.
    Some((f64::from_bits(value.to_bits() | u64::from(is_negative) << 63), at))
}

/// The digit 0 in each byte of a word.
const ZEROS: u64 = 0x30 * BYTES;

/// 1 in each byte of a word.
const BYTES: u64 = 0x0101_0101_0101_0101;

/// A number whose last digits begin at a place, and where they end; `None` if it is 2^64 or more. `before`: the number of the digits before.
#[inline(always)]
fn digits(bytes: &[u8], mut at: usize, before: u64) -> Option<(u64, usize)> {
    const POWERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];
    let mut number = before;
    // Eight bytes at once, the first one lowest.
    while let Some(word) = bytes.get(at..).and_then(<[u8]>::first_chunk) {
        let values = u64::from_le_bytes(*word) ^ ZEROS;
        // A byte above 9 sets its highest bit: 0x76 + 10 is 0x80. Nothing is carried to the next byte.
        let others = (((values & (0x7f * BYTES)) + 0x76 * BYTES) | values) & (0x80 * BYTES);
        if others == 0 {
            // A case of its own: where the next word begins is then known before this one is.
            number = number.checked_mul(POWERS[8])?.checked_add(of_eight(values))?;
            at += 8;
            continue;
        }
        let count = others.trailing_zeros() as usize / 8;
        // The digits as the last ones of eight, behind zeros. Two shifts, because one by 64 bits has no result.
        let last = values << (4 * (8 - count)) << (4 * (8 - count));
        return Some((number.checked_mul(POWERS[count])?.checked_add(of_eight(last))?, at + count));
    }
    while let Some(digit @ b'0'..=b'9') = bytes.get(at) {
        number = number.checked_mul(10)?.checked_add(u64::from(digit - b'0'))?;
        at += 1;
    }
    Some((number, at))
}

/// The number of eight digits, the first one in the lowest byte: pairs of bytes, then of pairs, then of these.
#[inline(always)]
fn of_eight(digits: u64) -> u64 {
    // Each product adds ten, a hundred or ten thousand times the lower part to the higher one.
    let pairs = digits.wrapping_mul(10 << 8 | 1) >> 8 & 0x00ff_00ff_00ff_00ff;
    let fours = pairs.wrapping_mul(100 << 16 | 1) >> 16 & 0x0000_ffff_0000_ffff;
    fours.wrapping_mul(10_000 << 32 | 1) >> 32
}

/// A whole number over a power of ten up to 10^22, rounded once; `None` if it is too large, or so near to the middle of two f64 that more digits must
/// decide.
///
/// Up to 2^53 it is a quotient of two exact numbers (Clinger 1990, How to read floating point numbers accurately). Beyond, the number is the sum of
/// two f64, and so is the quotient: its first part is that of the nearest f64, whose rest is exact; its second part is known to some 2^-52 of itself.
/// If sums with a second part that is 2^-50 smaller and larger are the same f64, it is the nearest one.
#[inline(always)]
fn over(whole: u64, power: f64) -> Option<f64> {
    const SMALLER: f64 = 1.0 - 1.0 / (1u64 << 50) as f64;
    const LARGER: f64 = 1.0 + 1.0 / (1u64 << 50) as f64;
    if whole >= WHOLE {
        return None;
    }
    // Signed numbers become f64 by one instruction.
    let whole = whole as i64;
    let nearest = whole as f64;
    let first = nearest / power;
    if whole <= 1 << 53 {
        return Some(first);
    }
    let further = (whole - nearest as i64) as f64;
    let (product, error) = two_prod(first, power);
    let rest = (nearest - product) - error;
    let second = (rest + further) / power;
    let value = first + SMALLER * second;
    (value == first + LARGER * second).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::table::{Table, Wanted};
    use rsm_core::source::Source;

    /// The same text with a quoted name in its header is read by the CSV reader, because a quoted cell stands in its last row.
    fn both(body: &str, wanted: &Wanted) -> [Result<Table, String>; 2] {
        let read = |text: String| Table::read(&Source::new("t.csv", text), wanted).map_err(|faults| faults.to_string());
        [read(format!("a[1],b,c[1]\n{body}")), read(format!("a[1],b,c[1]\n{body}\"1\",x,1\n"))]
    }

    #[test]
    fn plain_text_gives_what_the_csv_reader_gives() {
        let mut random = Random::new(9);
        let cells = [
            "1",
            "-0",
            "0.1",
            " 2.5 ",
            "3.",
            ".5",
            "+4",
            "1e3",
            "-7.25e-3",
            "12345678901234567890",
            "9007199254740993",
            "0.30000000000000004",
        ];
        let digits = |random: &mut Random| format!("{:.*}", random.below(20) as usize, 1e4 * random.normal());
        let wanted = Wanted { numbers: vec!["a".into(), "c".into()], labels: vec!["b".into()], ..Wanted::default() };
        let nan = Wanted { missing: MissingAs::Nan, ..wanted.clone() };
        for end in ["\n", "\r\n"] {
            let mut body = String::new();
            // Several pieces.
            while body.len() < 2 * PIECE + 1000 {
                match random.below(40) {
                    0 => body += "# a \"comment\", with a comma",
                    1 => body += "",
                    2 => body += "  ",
                    _ => {
                        let mut cell = || match random.below(3) {
                            0 => cells[random.below(cells.len() as u64) as usize].to_string(),
                            _ => digits(&mut random),
                        };
                        body += &format!("{}, label {} ,{}", cell(), cell(), cell());
                    }
                }
                body += end;
            }
            let [plain, csv] = both(&body, &wanted).map(Result::unwrap);
            let rows = plain.rows();
            assert_eq!((plain.lines.as_slice(), csv.lines.len()), (&csv.lines[..rows], rows + 1));
            for (plain, csv) in plain.columns.iter().zip(&csv.columns) {
                let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
                assert_eq!(bits(&plain.values), bits(&csv.values[..plain.values.len()]));
                assert_eq!(plain.labels[..], csv.labels[..plain.labels.len()]);
            }
            let missing = format!("{body},x,NaN{end}");
            let [plain, csv] = both(&missing, &nan).map(Result::unwrap);
            assert!(plain.columns[0].values.last().unwrap().is_nan() && plain.rows() + 1 == csv.rows());
            // A fault has its line, which the pieces before it do not hide.
            let lines = body.matches('\n').count() + 2;
            for bad in ["1,x", "1,x,2,3", "1,x,inf", "1,x,", "x,x,1"] {
                let faults = both(&format!("{body}{bad}{end}"), &wanted).map(Result::unwrap_err);
                assert!(faults[0].starts_with(&format!("t.csv:{lines}")), "{}", faults[0]);
                assert_eq!(faults[0], faults[1]);
            }
        }
    }

    /// Without this code, `f64::from_str` gives the bits.
    #[test]
    fn decimals_have_the_bits_of_the_standard_library() {
        let mut random = Random::new(6);
        let check = |text: &str| {
            for behind in ["", ",2.5,-17.25,123456789\n", "\r\n"] {
                let line = format!("{text}{behind}");
                if let Some((value, end)) = decimal(line.as_bytes(), 0) {
                    assert_eq!(value.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{line:?}");
                    assert_eq!(end, text.len(), "{line:?}");
                }
            }
            decimal(text.as_bytes(), 0).is_some()
        };
        let mut known = 0;
        const COUNT: u32 = 200_000;
        for _ in 0..COUNT {
            // All digits of numbers of many magnitudes, and some of them.
            let number = random.normal() * 10f64.powi(random.below(20) as i32 - 6);
            known += u32::from(check(&format!("{number}")));
            check(&format!("{number:.*}", random.below(20) as usize));
            // Near the middle of two f64: it, and a last digit more or less.
            let middle = (1 << 53) + random.below(1 << 53);
            for whole in [2 * middle, 2 * middle + 1, 2 * middle + 2] {
                check(&format!("{whole}"));
                check(&format!("-{}.{}", whole / 1000, whole % 1000));
            }
        }
        // Nearly all are read here.
        assert!(known > COUNT * 9 / 10, "{known}");
        for text in ["0", "-0", "0.0", "1.", ".5", "-.5", "9223372036854775807", "18446744073709551615", "4611686018427387904"]
        {
            check(text);
        }
        for text in ["", "-", ".", "-.", "1e5", "+1", "1.2.3", "--1", "18446744073709551616", "1.00000000000000000000000", "1 "]
        {
            assert!(!check(text), "{text:?}");
        }
    }

    #[test]
    fn other_text_is_left_to_the_csv_reader() {
        let of = |text: &str| rows(text, 2, &[(true, false), (false, false)], MissingAs::Faults);
        let plain = of("1,x\n\n2,y").unwrap();
        assert_eq!((plain.lines, plain.values), (vec![2, 4], vec![vec![1.0, 2.0], vec![]]));
        for text in ["1,\"x\"\n", "1\n", "1,2,3\n", "1,x\r2,y\n", "x,1\n", "1,x\r", "inf,x\n"] {
            assert!(of(text).is_none(), "{text:?}");
        }
        assert!(of("").unwrap().lines.is_empty());
    }
}

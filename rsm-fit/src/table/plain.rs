//! Reads the rows of a plain CSV, on several threads.
//!
//! In: the text below the header and what is wanted of each column. Out: the numbers and labels of every row; nothing if the text is not plain. Plain
//! text has no quotes, a cell for every column in every row, and a finite number in every wanted cell (or none where NaN is permitted). The CSV
//! reader of the caller reads any other text: it gives the same values, and every fault with its place.

use super::{MissingAs, is_missing};
use crate::threads;

/// The size of a piece of the text, in bytes: some 20,000 rows, and some milliseconds of work.
const PIECE: usize = 1 << 20;

/// The powers of ten that f64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

/// Up to this number f64 holds every whole number: 2^53.
const WHOLE: u64 = 1 << 53;

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
        let (Some(rows), Some(piece)) = (&mut all, piece) else {
            all = None;
            return;
        };
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
        let mut piece = Piece {
            rows: Rows { lines: Vec::new(), values: vec![Vec::new(); roles.len()], labels: vec![Vec::new(); roles.len()] },
            line_ends: 0,
        };
        let mut at = 0;
        while at < bytes.len() {
            if let Some(next) = without_row(bytes, at, roles.len()) {
                at = next;
            } else {
                piece.rows.lines.push(piece.line_ends);
                for (k, (is_number, is_label)) in roles.iter().enumerate() {
                    let start = at;
                    let short = if *is_number && !is_label { decimal(bytes, at) } else { None };
                    match short {
                        Some((value, end)) => {
                            piece.rows.values[k].push(value);
                            at = end;
                        }
                        None => {
                            at = end_of_cell(bytes, at)?;
                            let cell = text[start..at].trim();
                            if *is_label {
                                piece.rows.labels[k].push(cell.to_string());
                            }
                            if *is_number {
                                piece.rows.values[k].push(number(cell, missing)?);
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

/// A short decimal without exponent that is a whole cell, and where it ends. A whole number up to 2^53 over a power of ten up to 10^22 is a quotient
/// of two exact numbers, so it is rounded once (Clinger 1990, How to read floating point numbers accurately).
fn decimal(bytes: &[u8], start: usize) -> Option<(f64, usize)> {
    let is_negative = bytes.get(start) == Some(&b'-');
    let mut at = start + usize::from(is_negative);
    let (mut whole, mut digits, mut behind_point) = (0u64, 0, 0);
    let mut has_point = false;
    loop {
        match bytes.get(at) {
            Some(digit @ b'0'..=b'9') => {
                // 19 digits are below 2^64.
                if digits == 19 {
                    return None;
                }
                whole = 10 * whole + u64::from(digit - b'0');
                digits += 1;
                behind_point += usize::from(has_point);
            }
            Some(b'.') if !has_point => has_point = true,
            Some(b',' | b'\n' | b'\r') | None => break,
            _ => return None,
        }
        at += 1;
    }
    if digits == 0 || whole > WHOLE || bytes.get(at) == Some(&b'\r') && bytes.get(at + 1) != Some(&b'\n') {
        return None;
    }
    let value = whole as f64 / POWERS[behind_point];
    Some((if is_negative { -value } else { value }, at))
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

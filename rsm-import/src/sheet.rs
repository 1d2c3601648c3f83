//! Tables of text: any separator, decimal comma or point, lines before the header, units in the header or in a line of their own.
//!
//! In: bytes. Out: columns of numbers with gaps. One separator and one decimal sign are chosen for the whole file, never for a single cell.

use csv::{ReaderBuilder, Trim};
use rsm_core::source::{Fault, Faults};

use crate::log::{Log, Raw};

/// Separators; at a tie the earlier one is chosen: a comma may be a decimal sign, so it comes last.
const SEPARATORS: [u8; 4] = [b';', b'\t', b'|', b','];

/// The separator is chosen from this many lines. A file may begin with 50 lines of settings.
const LOOKED_AT: usize = 400;

/// Texts that loggers write for a missing sample.
const ABSENT: [&str; 10] = ["", "-", "--", "nan", "n/a", "#n/a", "na", "null", "none", "invalid"];

/// A line of the file, split into cells.
struct Line {
    number: usize,
    cells: Vec<String>,
}

pub(crate) fn read(file: &str, bytes: &[u8]) -> Result<Log, Faults> {
    let (text, encoding) = crate::decode::text(bytes);
    let fault = |line: usize, what: String| Faults::one(Fault::at_line(file, line, 0, what));
    if text.trim().is_empty() {
        return Err(Faults::one(Fault::whole_file(file, "the file is empty")));
    }
    if text.contains('\0') {
        let help = "export it as CSV or as a MAT file (save with -v7)";
        return Err(Faults::one(
            Fault::whole_file(file, "this is neither text nor a MAT file of version 5 or later").help(help),
        ));
    }
    let head: String = text.lines().take(LOOKED_AT).fold(String::new(), |head, line| head + line + "\n");
    let Some(separator) = separator(&head) else {
        let what = "no line of the file is a row of two numbers or more";
        let help = "cells are separated by `;`, a tab, `|` or `,`; a MAT file begins with \"MATLAB\"";
        return Err(Faults::one(Fault::whole_file(file, what).help(help)));
    };
    let lines = lines(&text, separator).map_err(|(line, what)| fault(line, what))?;
    let is_comma = decimal_comma(&lines, separator).map_err(|(line, what)| fault(line, what))?;
    let first = lines.iter().position(|line| is_row(line, is_comma)).unwrap_or(0);
    let width = lines[first].cells.len();
    let Header { names, units, notes } = header(&lines[..first], width);
    let mut log = Log { file: file.to_string(), columns: Vec::new(), lines: Vec::new(), notes, unread: Vec::new() };
    let sign = if is_comma { "decimal comma" } else { "decimal point" };
    let named = match separator {
        b'\t' => "tabs".to_string(),
        sign => format!("`{}`", char::from(sign)),
    };
    log.notes.insert(0, format!("text in {encoding}, cells separated by {named}, {sign}"));
    let mut columns: Vec<(Vec<f64>, Vec<String>)> = vec![Default::default(); width];
    let mut foreign: Option<(usize, String, usize)> = None;
    for line in &lines[first..] {
        if line.cells.len() != width {
            // A truncated last line, or text below the table.
            let count = foreign.as_ref().map_or(0, |it| it.2) + 1;
            let (number, found) = foreign.map_or((line.number, cells(line.cells.len())), |it| (it.0, it.1));
            foreign = Some((number, found, count));
            continue;
        }
        log.lines.push(line.number);
        for (cell, (values, texts)) in line.cells.iter().zip(&mut columns) {
            values.push(number(cell, is_comma).unwrap_or(f64::NAN));
            texts.push(cell.clone());
        }
    }
    if let Some((number, found, count)) = foreign {
        // Up to one line in a hundred is a fault of the file. More means a second table.
        if count > 1 + log.lines.len() / 100 {
            let what = format!("the row has {found}, the first row of numbers (line {}) has {width}", lines[first].number);
            return Err(fault(number, what));
        }
        log.notes
            .push(format!("left out: {count} of {} lines, the first (line {number}) has {found}", log.lines.len() + count));
    }
    for (k, (values, texts)) in columns.into_iter().enumerate() {
        let (name, unit) = (names[k].clone(), units[k].clone());
        let is_number = values.iter().any(|value| !value.is_nan());
        if !is_number && texts.iter().all(|text| is_absent(text)) {
            if !name.is_empty() {
                log.notes.push(format!("`{name}` has no values and is left out"));
            }
            continue;
        }
        let name = if name.is_empty() { format!("column_{}", k + 1) } else { name };
        if is_number {
            let strange = texts.iter().zip(&values).position(|(text, value)| value.is_nan() && !is_absent(text));
            if let Some(row) = strange {
                let count = texts.iter().zip(&values).filter(|(text, value)| value.is_nan() && !is_absent(text)).count();
                let found: String = texts[row].chars().take(40).collect();
                log.notes.push(format!(
                    "`{name}`: {count} cells are not numbers and count as missing samples, the first is `{found}` (line {})",
                    log.lines[row]
                ));
            }
        }
        log.columns.push(Raw { name, unit, values, texts: if is_number { Vec::new() } else { texts } });
    }
    Ok(log)
}

fn cells(count: usize) -> String {
    if count == 1 { "1 cell".to_string() } else { format!("{count} cells") }
}

fn is_absent(cell: &str) -> bool {
    ABSENT.iter().any(|absent| absent.eq_ignore_ascii_case(cell))
}

/// The separator that gives the most numbers for each line.
fn separator(head: &str) -> Option<u8> {
    let count = |separator: u8| -> usize {
        let numbers = |line: &str| {
            let cells: Vec<&str> = line.split(char::from(separator)).map(|cell| cell.trim().trim_matches('"')).collect();
            let is_number = |cell: &&&str| number(cell, false).is_some() || (separator != b',' && number(cell, true).is_some());
            let numbers = cells.iter().filter(is_number).count();
            // Most cells of a row must be numbers. This excludes the comma for `1,5;2,5`.
            if cells.len() > 1 && 2 * numbers >= cells.len() { numbers } else { 0 }
        };
        head.lines().map(numbers).sum()
    };
    let counts = SEPARATORS.map(|separator| (count(separator), separator));
    let best = counts.iter().map(|(count, _)| *count).max().filter(|count| *count > 0)?;
    counts.iter().find(|(count, _)| *count == best).map(|(_, separator)| *separator)
}

fn lines(text: &str, separator: u8) -> Result<Vec<Line>, (usize, String)> {
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(separator)
        .trim(Trim::All)
        .from_reader(text.as_bytes());
    let mut lines = Vec::new();
    for record in reader.records() {
        let record = record
            .map_err(|error| (error.position().map_or(0, |at| at.line() as usize), format!("not a table of cells: {error}")))?;
        let number = record.position().map_or(0, |at| at.line() as usize);
        if record.iter().all(str::is_empty) {
            continue;
        }
        lines.push(Line { number, cells: record.iter().map(str::to_string).collect() });
    }
    Ok(lines)
}

/// A number as loggers write it; `None` for all other texts and for a number that is not finite.
fn number(cell: &str, is_comma: bool) -> Option<f64> {
    let value: f64 = if is_comma {
        if cell.contains('.') {
            return None;
        }
        cell.replace(',', ".").parse().ok()?
    } else {
        cell.parse().ok()?
    };
    value.is_finite().then_some(value)
}

/// Whether the decimal sign of the file is a comma.
fn decimal_comma(lines: &[Line], separator: u8) -> Result<bool, (usize, String)> {
    if separator == b',' {
        // Numbers with decimal commas are then in quotes.
        let quoted = lines.iter().flat_map(|line| &line.cells).any(|cell| cell.contains(',') && number(cell, true).is_some());
        let pointed = lines.iter().flat_map(|line| &line.cells).any(|cell| cell.contains('.') && number(cell, false).is_some());
        return Ok(quoted && !pointed);
    }
    let with = |sign: char, is_comma: bool| {
        lines.iter().find(|line| {
            // Only cells in rows of numbers count: a version `1.2` at the beginning of the file must not decide.
            is_row(line, is_comma) && line.cells.iter().any(|cell| cell.contains(sign) && number(cell, is_comma).is_some())
        })
    };
    match (with(',', true), with('.', false)) {
        (Some(comma), Some(point)) => Err((
            comma.number.max(point.number),
            format!("line {} has a decimal comma, line {} a decimal point", comma.number, point.number),
        )),
        (comma, _) => Ok(comma.is_some()),
    }
}

/// Whether a line is a row of the table: it has two cells or more, and at least one number. Of its cells that are not empty, more than half are
/// numbers, where a time of day or a date counts as one.
fn is_row(line: &Line, is_comma: bool) -> bool {
    let filled = line.cells.iter().filter(|cell| !is_absent(cell)).count();
    let numbers = line.cells.iter().filter(|cell| number(cell, is_comma).is_some()).count();
    let has_instant = line.cells.iter().any(|cell| crate::clock::instant(cell).is_some());
    line.cells.len() >= 2 && numbers >= 1 && 2 * (numbers + usize::from(has_instant)) > filled
}

struct Header {
    names: Vec<String>,
    units: Vec<Option<String>>,
    notes: Vec<String>,
}

/// Names and units in the lines above the first row of numbers.
fn header(above: &[Line], width: usize) -> Header {
    let mut notes = Vec::new();
    let wide: Vec<&Line> = above.iter().filter(|line| line.cells.len() == width).collect();
    let Some(last) = wide.last() else {
        notes.push("there is no header: columns are called column_1, column_2, ...".to_string());
        return Header { names: vec![String::new(); width], units: vec![None; width], notes };
    };
    let unit_of = |cell: &str| {
        let bare = cell.trim_start_matches(['[', '(', '/']).trim_end_matches([']', ')']).trim().to_string();
        (bare.is_empty() || rsm_fit::units::check(&bare).is_ok()).then_some(bare)
    };
    let filled = last.cells.iter().filter(|cell| !cell.is_empty()).count();
    let of_last: Vec<Option<String>> = last.cells.iter().map(|cell| unit_of(cell)).collect();
    let is_units = wide.len() > 1
        && filled > 0
        && 2 * last.cells.iter().zip(&of_last).filter(|(cell, unit)| !cell.is_empty() && unit.is_some()).count() > filled;
    let (line, below) = if is_units { (wide[wide.len() - 2], Some(of_last)) } else { (*last, None) };
    if above.len() > 1 + usize::from(is_units) {
        notes.push(format!("lines before the header (line {}) are not read", line.number));
    }
    let mut names = Vec::new();
    let mut units = Vec::new();
    for (k, cell) in line.cells.iter().enumerate() {
        let (name, unit) = name_and_unit(cell);
        names.push(name);
        units.push(unit.or_else(|| below.as_ref().and_then(|below| below[k].clone()).filter(|unit| !unit.is_empty())));
    }
    Header { names, units, notes }
}

/// Splits `Speed [rpm]`, `Speed (rpm)`, `Speed / rpm`, `Speed in rpm` into a name and a unit. Only a unit in brackets may be unknown.
fn name_and_unit(cell: &str) -> (String, Option<String>) {
    let cell = cell.trim_start_matches('#').trim();
    let known = |unit: &str| rsm_fit::units::check(unit.trim()).is_ok();
    if let Some((name, unit)) = cell.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')) {
        let unit = unit.trim();
        return (clean(name), (!unit.is_empty()).then(|| unit.to_string()));
    }
    if let Some((name, unit)) = cell.strip_suffix(')').and_then(|rest| rest.rsplit_once('(')).filter(|(_, unit)| known(unit)) {
        return (clean(name), Some(unit.trim().to_string()));
    }
    for between in [" / ", " in ", "/ "] {
        if let Some((name, unit)) = cell.rsplit_once(between).filter(|(name, unit)| !name.trim().is_empty() && known(unit)) {
            return (clean(name), Some(unit.trim().to_string()));
        }
    }
    (clean(cell), None)
}

/// A name without the characters that are not allowed in a header of ours.
pub(crate) fn clean(name: &str) -> String {
    let plain: String = name.chars().map(|sign| if "[]\",\r\n".contains(sign) { '_' } else { sign }).collect();
    plain.trim().trim_start_matches('#').trim().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(text: &str) -> Log {
        read("t.csv", text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"))
    }

    #[test]
    fn separators_and_decimal_signs_of_several_tools() {
        for (text, comma) in [
            ("t [s],x [m]\n0.5,1.5\n1,2.5\n", false),
            ("t [s];x [m]\n0,5;1,5\n1;2,5\n", true),
            ("t [s]\tx [m]\n0,5\t1,5\n1\t2,5\n", true),
            ("t [s]|x [m]\r\n0.5|1.5\r\n1|2.5\r\n", false),
            ("\"t [s]\",\"x [m]\"\n\"0,5\",\"1,5\"\n\"1\",\"2,5\"\n", true),
            ("t [s];x [m];\n0,5;1,5;\n1;2,5;\n", true),
        ] {
            let log = log(text);
            let columns: Vec<(&str, Option<&str>, &[f64])> =
                log.columns.iter().map(|it| (it.name.as_str(), it.unit.as_deref(), it.values.as_slice())).collect();
            assert_eq!(columns, [("t", Some("s"), &[0.5, 1.0][..]), ("x", Some("m"), &[1.5, 2.5][..])], "{text}");
            assert_eq!(log.notes[0].contains("decimal comma"), comma, "{:?}", log.notes);
        }
    }

    #[test]
    fn the_header_is_found_below_the_head_of_the_file() {
        let log = log("Logger 7;Version 1.2\nOperator;M. Müller;Bench 3\n\nZeit;Speed (rpm);Moment / N*m;;Name\ns;;;V;\n\
                       0;10;1,5;;a\n0,5;11;-;;b\n1;12;1,7;;c\nEnd of measurement\n");
        let columns: Vec<(&str, Option<&str>)> = log.columns.iter().map(|it| (it.name.as_str(), it.unit.as_deref())).collect();
        assert_eq!(columns, [("Zeit", Some("s")), ("Speed", Some("rpm")), ("Moment", Some("N*m")), ("Name", None)]);
        assert!(log.columns[2].values[1].is_nan() && log.columns[3].texts == ["a", "b", "c"]);
        assert_eq!(log.lines, [6, 7, 8]);
        assert!(log.notes.iter().any(|note| note.contains("1 of 4 lines")), "{:?}", log.notes);
    }

    #[test]
    fn two_signs_for_decimals_are_a_fault() {
        let said = read("t.csv", b"a;b\n1,5;2\n1.5;2\n").unwrap_err().to_string();
        assert!(said.starts_with("t.csv:3: line 2 has a decimal comma, line 3 a decimal point"), "{said}");
        let said = read("t.csv", b"a;b\n1;2\n1;2;3\n1;2;3\n1;2;3\n").unwrap_err().to_string();
        assert!(said.starts_with("t.csv:3: the row has 3 cells"), "{said}");
        assert!(read("t.csv", b"some words\nand more\n").unwrap_err().to_string().contains("two numbers"));
    }
}

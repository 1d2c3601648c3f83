//! The file of a part: TOML, with every number to the bit, and its own hash at the end.
//!
//! In: a [`Part`]; the text of a file. Out: the text; a part, or what is wrong with the file. A cut or changed file is recognised by the hash before
//! anything else is read, so that no sum of a damaged file counts.

use std::fmt::Write as _;
use std::path::PathBuf;

use rsm_core::model_file::{FORMAT, quoted, read_format};
use rsm_core::number::decimal;
use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_core::toml_reader::{self, TableReader, Value};

use super::{Part, Sums, design_of, rules};
use crate::dd::Dd;
use crate::hash::hash;
use crate::left_out::MissingCells;
use crate::qr::Triangle;
use crate::records::DataFile;
use crate::spec::Specification;

/// The first line.
const FIRST: &str = "# A part of a fit, made by `rsm fit --partial` for `rsm merge`.";

/// What precedes the hash at the end.
const END: &str = "\n[end]\nsha256 = \"";

/// The largest count in a file: f64 holds every whole number up to it, and sums of counts do not overflow.
const MOST: i64 = 1 << 53;

/// What to do with a file that is not whole.
const AGAIN: &str = "make it again with `rsm fit --partial`";

impl Part {
    /// The text of the file.
    #[must_use]
    pub fn write(&self) -> String {
        format!("{}{END}{}\"\n", body(self), self.sha256)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// A file that is not a part, that is not whole, or of another format.
    pub fn read(source: &Source) -> Result<Part, Faults> {
        let sha256 = intact(source).map_err(Faults::one)?;
        let mut faults = Collector::new();
        let part = read(source, &mut faults).map(|part| Part { sha256, ..part });
        faults.finish(part)
    }
}

/// The text before the hash.
pub(super) fn body(part: &Part) -> String {
    let mut out = format!("{FIRST}\nformat = {FORMAT}\nmodel = {}\n", quoted(&part.specification.model));
    if let Some(source) = part.specification.source() {
        let name = source.name().rsplit(['/', '\\']).next().unwrap_or_default();
        let (file, text) = (quoted(name), quoted(source.text()));
        let _ = writeln!(out, "\n[specification]\nfile = {file}\nsha256 = \"{}\"\ntext = {text}", hash(source.text()));
    }
    for file in &part.files {
        let _ = writeln!(out, "\n[[data]]\nfile = {}\nsha256 = \"{}\"\nrows = {}", quoted(&file.name), file.sha256, file.rows);
    }
    let pair = |[a, b]: [f64; 2]| format!("[{}, {}]", decimal(a), decimal(b));
    for ((input, unit), span) in part.specification.inputs.iter().zip(&part.units).zip(&part.spans) {
        let _ = writeln!(out, "\n[inputs.{}]\nunit = {}", input.name, quoted(unit));
        if span[0] <= span[1] {
            let _ = writeln!(out, "values = {}", pair(*span));
        }
    }
    let units = &part.units[part.specification.inputs.len()..];
    for ((response, unit), sums) in part.specification.responses.iter().zip(units).zip(&part.sums) {
        let _ = writeln!(out, "\n[sums.{}]\nunit = {}\nrows = {}", response.surface.name, quoted(unit), sums.triangle.rows());
        if sums.triangle.rows() > 0 {
            let _ = writeln!(out, "values = {}", pair(sums.span));
        }
        let _ = writeln!(out, "rows_outside = {}\nrows_left_out = {}", sums.rows_outside, sums.left_out);
        let cell = |it: &MissingCells| {
            format!("{{ file = {}, column = {}, cells = {} }}", quoted(&it.file), quoted(&it.column), it.cells)
        };
        if !sums.cells.is_empty() {
            let _ = writeln!(out, "missing = [{}]", sums.cells.iter().map(cell).collect::<Vec<_>>().join(", "));
        }
        if let Some([weight, logs]) = sums.weights {
            let _ = writeln!(out, "weight = {}\nlog_weight = {}", pair(weight.parts()), pair(logs.parts()));
        }
        let columns = sums.triangle.columns();
        // Each entry has two numbers; their sum is the entry.
        let _ = writeln!(out, "height = {}\ncolumns = [", columns.first().map_or(0, Vec::len));
        for column in columns {
            // A column of a triangle ends with zeros.
            let end = column.iter().rposition(|entry| *entry != Dd::ZERO).map_or(0, |last| last + 1);
            let numbers: Vec<String> = column[..end].iter().flat_map(|entry| entry.parts()).map(decimal).collect();
            let _ = writeln!(out, "  [{}],", numbers.join(", "));
        }
        let _ = writeln!(out, "]");
    }
    out
}

/// Checks first line, format and hash. Returns the hash.
fn intact(source: &Source) -> Result<String, Fault> {
    let whole = |what: &str| Fault::whole_file(source.name(), what);
    let text = source.text();
    let mut lines = text.lines();
    if lines.next() != Some(FIRST) {
        return Err(whole("is not a part of a fit").help("`rsm fit SPECIFICATION --partial FILE` makes one"));
    }
    let format = lines.next().unwrap_or_default();
    if let Some(found) = format.strip_prefix("format = ").filter(|found| *found != FORMAT.to_string()) {
        let what = format!("`format`: found {found}, this version reads format {FORMAT}");
        return Err(Fault::at_line(source.name(), 2, 1, what).help("make and merge all parts with one version of rsm"));
    }
    let end = text.rfind(END).and_then(|at| Some((&text[..at], text[at + END.len()..].strip_suffix("\"\n")?)));
    let Some((body, expected)) = end.filter(|(_, it)| it.len() == 64 && it.bytes().all(|byte| byte.is_ascii_hexdigit())) else {
        return Err(whole("is not whole: the hash at its end is missing").help(AGAIN));
    };
    if hash(body) != expected {
        return Err(whole("was changed: its text does not have the hash at its end").help(AGAIN));
    }
    Ok(expected.to_string())
}

fn read(source: &Source, faults: &mut Collector) -> Option<Part> {
    let document = toml_reader::parse(source, faults)?;
    let mut top = TableReader::document(source, &document);
    if !read_format(&mut top, faults) {
        return None;
    }
    top.text("model", faults);
    let specification = read_specification(&mut top, faults)?;
    let files = read_files(&mut top, faults);
    let mut units = Vec::new();
    let mut spans = Vec::new();
    let mut inputs = table("inputs", &mut top, faults)?;
    for input in &specification.inputs {
        let mut reader = entry(&mut inputs, &input.name, faults)?;
        units.push(reader.text("unit", faults)?);
        spans.push(span(&mut reader, faults)?);
        reader.finish(faults);
    }
    let mut responses = table("sums", &mut top, faults)?;
    let mut sums = Vec::new();
    // The number of candidates does not depend on ranges.
    let ranges: Vec<_> = specification
        .inputs
        .iter()
        .map(|input| rsm_core::model::Input {
            name: input.name.clone(),
            unit: String::new(),
            range: [0.0, 1.0],
            outside: input.outside,
        })
        .collect();
    for response in &specification.responses {
        let width = design_of(&specification, response, &ranges).1.width();
        let mut reader = entry(&mut responses, &response.surface.name, faults)?;
        units.push(reader.text("unit", faults)?);
        sums.push(read_sums(&mut reader, width + 1, response.weights.is_some(), faults)?);
        reader.finish(faults);
    }
    top.optional("end");
    top.finish(faults);
    let name = source.name().to_string();
    Some(Part { name, specification, files: files?, units, spans, sums, sha256: String::new() })
}

fn read_specification(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<Specification> {
    let mut reader = table("specification", top, faults)?;
    let (file, _, text) = (reader.text("file", faults)?, reader.text("sha256", faults)?, reader.text("text", faults)?);
    let read = Specification::from_source(Source::new(file, text), PathBuf::new());
    match read.and_then(|specification| rules::check(&specification).map(|()| specification)) {
        Ok(specification) => Some(specification),
        Err(found) => {
            found.list().iter().for_each(|fault| faults.push(fault.clone()));
            None
        }
    }
}

fn read_files(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<Vec<DataFile>> {
    let value = top.required("data", faults)?;
    let items = top.array("`data`", value, faults)?;
    let of_one = |item: Value<'_>| {
        let mut reader = TableReader::of(top.source(), item, "`data`", faults)?;
        let (name, sha256) = (reader.text("file", faults)?, reader.text("sha256", faults)?);
        let rows = count("rows", &mut reader, faults)?;
        reader.finish(faults);
        Some(DataFile { name, sha256, rows })
    };
    items.into_iter().map(of_one).collect()
}

fn table<'a>(key: &'static str, top: &mut TableReader<'a>, faults: &mut Collector) -> Option<TableReader<'a>> {
    let value = top.required(key, faults)?;
    TableReader::of(top.source(), value, format!("`{key}`"), faults)
}

/// A table whose name is free.
fn entry<'a>(section: &mut TableReader<'a>, name: &str, faults: &mut Collector) -> Option<TableReader<'a>> {
    let found = section.entries().find(|(key, ..)| *key == name).map(|(_, _, value)| value);
    match found {
        Some(value) => TableReader::of(section.source(), value, format!("{} `{name}`", section.who()), faults),
        None => {
            faults.push(section.fault(section.span(), format!("`{name}` is missing")));
            None
        }
    }
}

fn count(key: &'static str, reader: &mut TableReader<'_>, faults: &mut Collector) -> Option<usize> {
    let value = reader.required(key, faults)?;
    let found = reader.whole(&format!("`{key}`"), value, 0, MOST, faults)?;
    usize::try_from(found).ok()
}

fn pair(key: &'static str, reader: &mut TableReader<'_>, faults: &mut Collector) -> Option<[f64; 2]> {
    let value = reader.required(key, faults)?;
    let numbers = reader.numbers(&format!("`{key}`"), value, faults)?;
    let found = numbers.try_into().ok();
    if found.is_none() {
        faults.push(reader.fault(value.span(), format!("`{key}`: expected two numbers")));
    }
    found
}

/// `values`, the smallest and the largest; without rows there are none.
fn span(reader: &mut TableReader<'_>, faults: &mut Collector) -> Option<[f64; 2]> {
    match reader.optional("values") {
        Some(_) => pair("values", reader, faults),
        None => Some([f64::INFINITY, f64::NEG_INFINITY]),
    }
}

fn read_sums(reader: &mut TableReader<'_>, width: usize, is_weighted: bool, faults: &mut Collector) -> Option<Sums> {
    let rows = count("rows", reader, faults)?;
    let span = span(reader, faults)?;
    let (rows_outside, left_out) = (count("rows_outside", reader, faults)?, count("rows_left_out", reader, faults)?);
    let cells = match reader.optional("missing") {
        Some(value) => {
            let items = reader.array("`missing`", value, faults)?;
            let cell = |item: Value<'_>| {
                let mut cell = TableReader::of(reader.source(), item, "`missing`", faults)?;
                let (file, column) = (cell.text("file", faults)?, cell.text("column", faults)?);
                let cells = count("cells", &mut cell, faults)?;
                cell.finish(faults);
                Some(MissingCells { file, column, cells })
            };
            items.into_iter().map(cell).collect::<Option<Vec<_>>>()?
        }
        None => Vec::new(),
    };
    let number = |[high, low]: [f64; 2]| Dd::sum_of(high, low);
    let weights = match is_weighted {
        true => Some([number(pair("weight", reader, faults)?), number(pair("log_weight", reader, faults)?)]),
        false => None,
    };
    let height = count("height", reader, faults)?;
    let value = reader.required("columns", faults)?;
    let items = reader.array("`columns`", value, faults)?;
    // As a triangle has: no more entries than columns, and no more than rows.
    if items.len() != width || height > width.min(rows) {
        let what = format!(
            "found {} columns of {height} entries, expected {width} columns of at most {}",
            items.len(),
            width.min(rows)
        );
        faults.push(reader.fault(value.span(), what));
        return None;
    }
    let mut columns = Vec::new();
    for item in items {
        let numbers = reader.numbers("`columns`", item, faults)?;
        if numbers.len() % 2 != 0 || numbers.len() / 2 > height {
            let what =
                format!("found a column of {} numbers, expected two for each of at most {height} entries", numbers.len());
            faults.push(reader.fault(item.span(), what));
            return None;
        }
        let mut column: Vec<Dd> = numbers.chunks_exact(2).map(|pair| number([pair[0], pair[1]])).collect();
        column.resize(height, Dd::ZERO);
        columns.push(column);
    }
    Some(Sums { triangle: Triangle::of_columns(columns, rows), span, rows_outside, left_out, cells, weights })
}

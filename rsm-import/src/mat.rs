//! MAT files of version 5 (and 6 and 7, which have the same format): every array of numbers becomes columns.
//!
//! Source: The MathWorks, "MAT-File Format" (data elements, tags, small elements, `miMATRIX`, `miCOMPRESSED`). A field `b` of a structure `a` becomes
//! the column `a.b`; columns of a matrix `m` become `m_1`, `m_2`, ...; a structure with `values` and `label` (a Simulink log) becomes a column with
//! the name of the label. Objects (timeseries, timetable, table) are not described in that document; a note lists them. No input makes this reader
//! panic or read past the end.

use std::io::Read as _;

use rsm_core::source::{Fault, Faults};

use crate::log::{Log, Raw};

/// The nesting limit; no record is nested so deeply.
const DEEPEST: usize = 16;

/// The largest size of an array after decompression: 100 million numbers.
const LARGEST: u64 = 800_000_000;

pub(crate) fn is_mat(bytes: &[u8]) -> bool {
    bytes.len() >= 128 && matches!(&bytes[126..128], b"IM" | b"MI") && bytes.starts_with(b"MATLAB")
}

pub(crate) fn read(file: &str, bytes: &[u8]) -> Result<Log, Faults> {
    let mut found =
        Found { is_little: &bytes[126..128] == b"IM", columns: Vec::new(), notes: vec!["MAT file, version 5 to 7".into()] };
    found.elements(&bytes[128..], 128).map_err(|what| Faults::one(Fault::whole_file(file, what)))?;
    finish(file, found.columns, found.notes)
}

/// The log of the variables. It is a fault if it has no column of two or more rows.
pub(crate) fn finish(file: &str, columns: Vec<Raw>, notes: Vec<String>) -> Result<Log, Faults> {
    if columns.iter().all(|column| column.values.len() < 2) {
        let mut what = "the MAT file holds no array of two numbers or more".to_string();
        notes.iter().skip(1).for_each(|note| what += &format!("; {note}"));
        return Err(Faults::one(Fault::whole_file(file, what)));
    }
    Ok(Log { file: file.to_string(), columns, lines: Vec::new(), notes, unread: Vec::new() })
}

/// The columns of an array that is stored column by column.
pub(crate) fn columns(name: &str, rows: usize, values: &[f64], into: &mut Vec<Raw>) {
    let (rows, parts) = match values.len().checked_div(rows) {
        // An array with a single row is one signal.
        Some(parts) if rows > 1 => (rows, parts),
        _ => (values.len(), 1),
    };
    for (k, part) in values.chunks(rows.max(1)).enumerate() {
        let name = crate::sheet::clean(&if parts > 1 { format!("{name}_{}", k + 1) } else { name.to_string() });
        // A number that is not finite is a missing sample.
        let values = part.iter().map(|value| if value.is_finite() { *value } else { f64::NAN }).collect();
        into.push(Raw { name, unit: None, values, texts: Vec::new() });
    }
}

/// The content of an element.
enum Value {
    Numbers { rows: usize, values: Vec<f64> },
    Text(String),
    Fields(Vec<(String, Value)>),
    Other(&'static str),
}

struct Found {
    is_little: bool,
    columns: Vec<Raw>,
    notes: Vec<String>,
}

/// A data element: its type and its bytes.
struct Element<'a> {
    kind: u32,
    data: &'a [u8],
}

impl Found {
    fn u32(&self, bytes: &[u8]) -> u32 {
        let four: [u8; 4] = bytes[..4].try_into().unwrap_or_default();
        if self.is_little { u32::from_le_bytes(four) } else { u32::from_be_bytes(four) }
    }

    /// The element at the start, and its number of bytes with padding.
    fn element<'a>(&self, bytes: &'a [u8]) -> Result<(Element<'a>, usize), String> {
        let short = || "the MAT file ends within an array: it is cut off or damaged".to_string();
        if bytes.len() < 8 {
            return Err(short());
        }
        let first = self.u32(bytes);
        if first >> 16 != 0 {
            let size = (first >> 16) as usize;
            let data = bytes.get(4..4 + size).filter(|_| size <= 4).ok_or_else(short)?;
            return Ok((Element { kind: first & 0xffff, data }, 8));
        }
        let size = self.u32(&bytes[4..]) as usize;
        let data = bytes.get(8..8usize.saturating_add(size)).ok_or_else(short)?;
        // Compressed elements are not padded.
        let padded = if first == COMPRESSED { size } else { size.div_ceil(8) * 8 };
        Ok((Element { kind: first, data }, (8 + padded).min(bytes.len())))
    }

    fn elements(&mut self, mut bytes: &[u8], start: usize) -> Result<(), String> {
        let all = bytes.len();
        while bytes.len() >= 8 {
            let (element, taken) =
                self.element(bytes).map_err(|what| format!("{what} (byte {})", start + all - bytes.len()))?;
            match element.kind {
                COMPRESSED => {
                    let mut inflated = Vec::new();
                    flate2::read::ZlibDecoder::new(element.data)
                        .take(LARGEST)
                        .read_to_end(&mut inflated)
                        .map_err(|error| format!("a compressed array cannot be read: {error}"))?;
                    let (inner, _) = self.element(&inflated)?;
                    if inner.kind == MATRIX {
                        self.variable(inner.data)?;
                    }
                }
                MATRIX => self.variable(element.data)?,
                _ => {}
            }
            bytes = &bytes[taken..];
        }
        Ok(())
    }

    fn variable(&mut self, data: &[u8]) -> Result<(), String> {
        let (name, value) = self.matrix(data, 0)?;
        self.take(&name, value);
        Ok(())
    }

    /// Adds the columns of a value under its name.
    fn take(&mut self, name: &str, value: Value) {
        match value {
            Value::Numbers { rows, values } => columns(name, rows, &values, &mut self.columns),
            Value::Text(_) => {}
            Value::Other(what) => {
                self.notes.push(format!("`{name}` is {what} and is not read; save its time and its data as arrays"));
            }
            Value::Fields(fields) => {
                let label = fields.iter().find_map(|(field, value)| match value {
                    Value::Text(text) if field == "label" && !text.trim().is_empty() => Some(text.trim().to_string()),
                    _ => None,
                });
                for (field, value) in fields {
                    let is_values = field == "values" && label.is_some();
                    let full = match (&label, is_values) {
                        (Some(label), true) => label.clone(),
                        _ if name.is_empty() => field,
                        _ => format!("{name}.{field}"),
                    };
                    self.take(&full, value);
                }
            }
        }
    }

    /// Name and value of the content of a `miMATRIX`.
    fn matrix(&self, mut data: &[u8], depth: usize) -> Result<(String, Value), String> {
        if depth > DEEPEST {
            return Err(format!("structures in structures, deeper than {DEEPEST}"));
        }
        let mut next = || -> Result<Element<'_>, String> {
            let (element, taken) = self.element(data)?;
            data = &data[taken..];
            Ok(element)
        };
        let flags = next()?;
        if flags.data.len() < 8 {
            return Err("an array without flags: the MAT file is damaged".to_string());
        }
        let flags = self.u32(flags.data);
        let class = flags & 0xff;
        let is_complex = flags & 0x800 != 0;
        // An object without dimensions.
        if class == 17 {
            return Ok((String::new(), Value::Other("an object of a class (timeseries, table or the like)")));
        }
        let dimensions: Vec<usize> = next()?.data.chunks_exact(4).map(|four| self.u32(four) as usize).collect();
        let name = String::from_utf8_lossy(next()?.data).into_owned();
        let rows = dimensions.first().copied().unwrap_or(0);
        let value = match class {
            // Double, single, and whole numbers of 8 to 64 bits.
            6..=15 => {
                let values = self.numbers(&next()?)?;
                if is_complex { Value::Other("complex") } else { Value::Numbers { rows, values } }
            }
            4 => {
                let codes = self.numbers(&next()?)?;
                Value::Text(codes.iter().filter_map(|code| char::from_u32(*code as u32)).collect())
            }
            2 => {
                let length = next()?;
                let length = if length.data.len() >= 4 { self.u32(length.data) as usize } else { 0 };
                let names = next()?.data.to_vec();
                if length == 0 {
                    return Err("a structure without names: the MAT file is damaged".to_string());
                }
                let names: Vec<String> =
                    names.chunks(length).map(|name| String::from_utf8_lossy(name).trim_end_matches('\0').to_string()).collect();
                let count = dimensions.iter().try_fold(1usize, |product, it| product.checked_mul(*it)).unwrap_or(0);
                let mut fields = Vec::new();
                for k in 0..count {
                    for field in &names {
                        if data.len() < 8 {
                            return Err("a structure with fewer values than it declares: the MAT file is damaged".to_string());
                        }
                        let (element, taken) = self.element(data)?;
                        data = &data[taken..];
                        if element.data.is_empty() {
                            continue;
                        }
                        let (_, value) = self.matrix(element.data, depth + 1)?;
                        // An array of structures: each structure gets its number.
                        fields.push((if count > 1 { format!("{}\u{0}{field}", k + 1) } else { field.clone() }, value));
                    }
                }
                Value::Fields(if count > 1 { by_number(fields) } else { fields })
            }
            1 => Value::Other("a cell array"),
            5 => Value::Other("a sparse matrix"),
            _ => Value::Other("an object of a class (timeseries, table or the like)"),
        };
        Ok((name, value))
    }

    /// Numbers of any stored type, as f64.
    fn numbers(&self, element: &Element<'_>) -> Result<Vec<f64>, String> {
        macro_rules! read {
            ($kind:ty) => {{
                const WIDTH: usize = size_of::<$kind>();
                element
                    .data
                    .chunks_exact(WIDTH)
                    .map(|bytes| {
                        let bytes: [u8; WIDTH] = bytes.try_into().unwrap_or_default();
                        (if self.is_little { <$kind>::from_le_bytes(bytes) } else { <$kind>::from_be_bytes(bytes) }) as f64
                    })
                    .collect()
            }};
        }
        Ok(match element.kind {
            1 => read!(i8),
            2 | 16 => read!(u8),
            3 => read!(i16),
            4 | 17 => read!(u16),
            5 => read!(i32),
            6 | 18 => read!(u32),
            7 => read!(f32),
            9 => read!(f64),
            12 => read!(i64),
            13 => read!(u64),
            other => return Err(format!("an array of the unknown type {other}: the MAT file is damaged")),
        })
    }
}

/// `miMATRIX` and `miCOMPRESSED`.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Makes a structure of the fields of each numbered structure.
fn by_number(fields: Vec<(String, Value)>) -> Vec<(String, Value)> {
    let mut numbered: Vec<(String, Value)> = Vec::new();
    for (name, value) in fields {
        let (number, field) = name.split_once('\u{0}').unwrap_or(("", &name));
        match numbered.last_mut() {
            Some((last, Value::Fields(inner))) if last == number => inner.push((field.to_string(), value)),
            _ => numbered.push((number.to_string(), Value::Fields(vec![(field.to_string(), value)]))),
        }
    }
    numbered
}

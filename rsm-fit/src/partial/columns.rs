//! Tables from a file of numbered columns: Parquet or Arrow.
//!
//! In: the names of all columns and which of them are numbers, batches of values. Out: tables of some rows, with the same rules as those of CSV. A
//! column is named as in the header of a CSV, `name[unit]`. Numbers are f64 exactly: a whole number beyond 2^53 that f64 does not hold is refused. A
//! value that is absent is a missing cell. Reads no file.

use rsm_core::source::{Fault, Faults};

use crate::missing::MissingAs;
use crate::table::{Column, Table, Wanted};

/// The largest number of rows of a table: some MB of numbers.
pub(super) const BATCH: usize = 1 << 15;

/// The wanted columns of a file.
pub(super) struct Columns<'a> {
    file: &'a str,
    missing: MissingAs,
    /// The name and the unit of every column.
    headers: Vec<(String, Option<String>)>,
    /// The places of the wanted columns in the file, each once.
    pub(super) places: Vec<usize>,
}

impl<'a> Columns<'a> {
    /// Finds the wanted columns.
    ///
    /// # Errors
    /// A column that is not there or does not hold numbers.
    pub(super) fn of(
        file: &'a str,
        headers: impl Iterator<Item = String>,
        is_number: &dyn Fn(usize) -> bool,
        wanted: &Wanted,
    ) -> Result<Self, Faults> {
        let whole_file = |what: String| Faults::one(Fault::whole_file(file, what));
        let headers: Vec<(String, Option<String>)> = headers.map(|header| split(&header)).collect();
        let mut places = Vec::new();
        for wanted in &wanted.numbers {
            let Some(place) = headers.iter().position(|(name, _)| name == wanted) else {
                let names: Vec<String> = headers.iter().map(|(name, _)| format!("`{name}`")).collect();
                return Err(whole_file(format!("there is no column `{wanted}`; the columns are {}", names.join(", "))));
            };
            if !is_number(place) {
                return Err(whole_file(format!("column {} `{wanted}`: found a type that is not a number", place + 1)));
            }
            if !places.contains(&place) {
                places.push(place);
            }
        }
        Ok(Columns { file, missing: wanted.missing, headers, places })
    }

    /// A table of `count` rows behind the first `rows` of the file. `values` are those of each wanted column, NaN where there is none.
    ///
    /// # Errors
    /// A column with another number of rows; a value that is no number, where none may be missing; a number that f64 does not hold.
    pub(super) fn table(&self, rows: usize, count: usize, values: Vec<Vec<f64>>) -> Result<Table, Faults> {
        let mut columns = Vec::with_capacity(values.len());
        for (place, values) in self.places.iter().zip(values) {
            if values.len() != count {
                return Err(Faults::one(Fault::whole_file(self.file, "its columns have different numbers of rows")));
            }
            let (name, unit) = self.headers[*place].clone();
            let is_bad = |value: &f64| value.is_infinite() || value.is_nan() && self.missing != MissingAs::Nan;
            if let Some(at) = values.iter().position(is_bad) {
                let found = if values[at].is_nan() { "no number" } else { "a number that f64 does not hold" };
                let what = format!("column {} `{name}`: row {}: found {found}", place + 1, rows + at + 1);
                let fault = Fault::whole_file(self.file, what);
                return Err(Faults::one(fault.help("`missing = \"drop-row\"` leaves rows without a number out")));
            }
            columns.push(Column { name, unit, place: place + 1, values, labels: Vec::new() });
        }
        Ok(Table { file: self.file.to_string(), header_line: 0, columns, lines: (rows + 1..=rows + count).collect() })
    }
}

/// A whole number as f64. One that f64 does not hold becomes infinite, which is refused.
pub(super) fn whole(value: i128) -> f64 {
    if value as f64 as i128 == value { value as f64 } else { f64::INFINITY }
}

/// `name[unit]`.
fn split(header: &str) -> (String, Option<String>) {
    match header.strip_suffix(']').and_then(|header| header.split_once('[')) {
        Some((name, unit)) => (name.trim().to_string(), Some(unit.trim().to_string())),
        None => (header.trim().to_string(), None),
    }
}

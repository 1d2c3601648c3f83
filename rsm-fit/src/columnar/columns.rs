//! Tables from a file of numbered columns: Parquet or Arrow.
//!
//! In: the names and types of all columns, batches of values. Out: tables of some rows, with the same rules as those of CSV. A column is named as in
//! the header of a CSV, `name[unit]`. Numbers are f64 exactly: a whole number beyond 2^53 that f64 does not hold is refused. A value that is absent
//! is a missing cell. A label is the text of the cell that the value has in a CSV. Reads no file.

use rsm_core::source::{Collector, Fault, Faults};

use super::Act;
use crate::missing::MissingAs;
use crate::table::{Column, Table, Wanted, header};

/// The largest number of rows of a table: some MB of numbers.
pub(super) const BATCH: usize = 1 << 15;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Whole numbers.
    Whole,
    /// Floating point numbers.
    Float,
    /// Text or booleans, which are only labels.
    Label,
    /// Anything else: times, decimals, lists.
    Other,
}

/// A wanted column.
pub(super) struct WantedColumn {
    /// Its place among all columns, from 0.
    pub(super) place: usize,
    pub(super) is_number: bool,
    pub(super) is_label: bool,
    kind: Kind,
    /// The first row without a number, and how many there are.
    missing: Option<(usize, usize)>,
    /// The first row with a number that a table does not hold, and how many there are.
    refused: Option<(usize, usize)>,
}

/// The values of some rows of a wanted column.
#[derive(Debug, Default)]
pub(super) struct Values {
    /// NaN where there is none, infinite where f64 does not hold the number; empty if numbers are not wanted.
    pub(super) numbers: Vec<f64>,
    /// Empty texts where there is no value; empty if labels are not wanted.
    pub(super) labels: Vec<String>,
}

/// The columns of a file.
pub(super) struct Columns<'a> {
    file: &'a str,
    missing: MissingAs,
    /// The request, for the contrasts of categories.
    request: &'a Wanted,
    /// All columns, without rows.
    all: Vec<Column>,
    /// The wanted ones, in the order of the file.
    pub(super) wanted: Vec<WantedColumn>,
    /// The number of rows until now.
    rows: usize,
}

impl<'a> Columns<'a> {
    /// Finds the wanted columns.
    ///
    /// # Errors
    /// Every fault of the header; a wanted column that is not there or does not hold what is wanted of it.
    pub(super) fn of(
        file: &'a str,
        headers: &[String],
        kind: &dyn Fn(usize) -> Kind,
        request: &'a Wanted,
    ) -> Result<Self, Faults> {
        let mut faults = Collector::new();
        let mut tell = |what: String, help: Option<&'static str>| {
            let fault = Fault::whole_file(file, what);
            faults.push(if let Some(help) = help { fault.help(help) } else { fault });
        };
        let all = header::columns(headers.iter().map(String::as_str), &mut tell);
        let wanted = &request.in_file(|name| all.iter().any(|column| column.name == name));
        let roles = header::roles(&all, wanted, &mut tell);
        let mut columns = Columns { file, missing: wanted.missing, request, all, wanted: Vec::new(), rows: 0 };
        for (place, (is_number, is_label)) in roles.into_iter().enumerate() {
            let (kind, name) = (kind(place), &columns.all[place].name);
            if is_number && !matches!(kind, Kind::Whole | Kind::Float) {
                tell(format!("column {} `{name}`: found a type that is not a number", place + 1), None);
            }
            // A column that only has the name of a run number may hold anything.
            if kind == Kind::Other && !wanted.any_label && wanted.labels.contains(name) {
                let what = "found a type that is no label, expected text, numbers or booleans";
                tell(format!("column {} `{name}`: {what}", place + 1), None);
            }
            let is_label = is_label && kind != Kind::Other;
            if is_number || is_label {
                columns.wanted.push(WantedColumn { place, is_number, is_label, kind, missing: None, refused: None });
            }
        }
        faults.finish(Some(columns))
    }

    /// Calls `act` with the table of the next `count` rows: one of `values` for each wanted column. After a row with a fault, rows are only counted.
    ///
    /// # Errors
    /// A column with another number of rows; those of `act`.
    pub(super) fn add(&mut self, count: usize, values: Vec<Values>, act: Act<'_>) -> Result<(), Faults> {
        let rows = self.rows;
        self.rows += count;
        let mut table = Table {
            file: self.file.to_string(),
            header_line: 0,
            columns: self.all.clone(),
            lines: (rows + 1..=rows + count).collect(),
        };
        let mut is_clean = true;
        for (column, values) in self.wanted.iter_mut().zip(values) {
            let lengths = [(column.is_number, values.numbers.len()), (column.is_label, values.labels.len())];
            if lengths.iter().any(|(is_wanted, length)| *is_wanted && *length != count) {
                return Err(Faults::one(Fault::whole_file(self.file, "its columns have different numbers of rows")));
            }
            let count_bad = |found: &mut Option<(usize, usize)>, is_bad: &dyn Fn(f64) -> bool| {
                for row in (0..values.numbers.len()).filter(|row| is_bad(values.numbers[*row])) {
                    found.get_or_insert((rows + row + 1, 0)).1 += 1;
                }
            };
            count_bad(&mut column.refused, &f64::is_infinite);
            if self.missing != MissingAs::Nan {
                count_bad(&mut column.missing, &f64::is_nan);
            }
            is_clean &= column.refused.is_none() && column.missing.is_none();
            let target = &mut table.columns[column.place];
            (target.values, target.labels) = (values.numbers, values.labels);
        }
        if is_clean { act(table.with_contrasts(self.request)?) } else { Ok(()) }
    }

    /// The number of rows of the file, once all are added.
    ///
    /// # Errors
    /// Every column with a row that was refused.
    pub(super) fn finish(self) -> Result<usize, Faults> {
        let mut faults = Collector::new();
        for column in &self.wanted {
            let (place, name) = (column.place + 1, &self.all[column.place].name);
            let others = |count: usize, what: &str| match count {
                1 => format!("no other cell of this column {what}"),
                count => format!("{count} cells of this column {what}"),
            };
            if let Some((row, count)) = column.missing {
                let others = if count == 1 { others(1, "is missing") } else { others(count, "are missing") };
                let what = format!("column {place} `{name}`: row {row}: found no number; {others}");
                let fault = Fault::whole_file(self.file, what);
                faults.push(if let MissingAs::Counted(help) = self.missing { fault.help(help) } else { fault });
            }
            if let Some((row, count)) = column.refused {
                let found = match column.kind {
                    Kind::Float => "found a number that is not finite",
                    _ => "found a number that f64 does not hold",
                };
                let others = if count == 1 { others(1, "is refused") } else { others(count, "are refused") };
                faults.push(Fault::whole_file(self.file, format!("column {place} `{name}`: row {row}: {found}; {others}")));
            }
        }
        faults.finish(Some(self.rows))
    }
}

/// A whole number as f64. One that f64 does not hold becomes infinite, which is refused.
pub(super) fn whole(value: i128) -> f64 {
    if value as f64 as i128 == value { value as f64 } else { f64::INFINITY }
}

/// A floating point number as a label: the shortest decimal of the same f64. NaN is a missing cell.
pub(super) fn label_of(value: f64) -> String {
    if value.is_nan() { String::new() } else { format!("{value:?}") }
}

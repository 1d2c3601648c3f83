//! What a file holds, whatever its format: columns with gaps.

use rsm_core::source::{Fault, Faults};

/// A column as its file has it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Raw {
    pub name: String,
    pub unit: Option<String>,
    /// NaN where there is no sample.
    pub values: Vec<f64>,
    /// The texts of its cells, where none of them is a number: times of day and dates.
    pub texts: Vec<String>,
}

/// A file.
#[derive(Debug, Clone)]
pub(crate) struct Log {
    pub file: String,
    pub columns: Vec<Raw>,
    /// The line of every row; empty where a file has no lines.
    pub lines: Vec<usize>,
    /// What was done to read it.
    pub notes: Vec<String>,
}

impl Log {
    /// Reads a file of any format: what it is, its first bytes say.
    pub(crate) fn read(name: &str, bytes: &[u8]) -> Result<Log, Faults> {
        let log = if bytes.starts_with(b"MATLAB 7.3") || hdf5_pure::is_hdf5_bytes(bytes) {
            crate::mat73::read(name, bytes)?
        } else if crate::mat::is_mat(bytes) {
            crate::mat::read(name, bytes)?
        } else if let Some(format) = foreign(bytes) {
            let what = format!("this is {format}, which is not read");
            return Err(Faults::one(Fault::whole_file(name, what).help("export it as CSV or as a MAT file")));
        } else {
            crate::sheet::read(name, bytes)?
        };
        Ok(log.with_names_apart())
    }

    /// Two columns of one name: the second gets a number, or goes if it says the same.
    fn with_names_apart(mut self) -> Self {
        let mut kept: Vec<Raw> = Vec::new();
        for mut column in std::mem::take(&mut self.columns) {
            let same = |values: &[f64], others: &[f64]| {
                values.len() == others.len() && values.iter().zip(others).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
            };
            let of_the_name: Vec<&Raw> = kept.iter().filter(|it| it.name == column.name).collect();
            if of_the_name
                .iter()
                .any(|it| it.unit == column.unit && it.texts == column.texts && same(&it.values, &column.values))
            {
                self.notes.push(format!("`{}` stands there twice with the same values: one is left out", column.name));
                continue;
            }
            if !of_the_name.is_empty() {
                let mut number = 2;
                while kept.iter().any(|it| it.name == format!("{}_{number}", column.name)) {
                    number += 1;
                }
                let name = format!("{}_{number}", column.name);
                self.notes.push(format!("`{}` stands there twice with other values: the later one is `{name}`", column.name));
                column.name = name;
            }
            kept.push(column);
        }
        self.columns = kept;
        self
    }

    pub(crate) fn names(&self) -> String {
        // As many as can be read in one message.
        const MOST: usize = 40;
        let mut names: Vec<String> = self.columns.iter().take(MOST).map(|column| format!("`{}`", column.name)).collect();
        if self.columns.len() > MOST {
            names.push(format!("{} more", self.columns.len() - MOST));
        }
        names.join(", ")
    }

    pub(crate) fn column(&self, name: &str) -> Option<&Raw> {
        let exact = self.columns.iter().find(|column| column.name == name);
        exact.or_else(|| {
            let mut alike = self.columns.iter().filter(|column| column.name.eq_ignore_ascii_case(name));
            alike.next().filter(|_| alike.next().is_none())
        })
    }
}

/// Formats of other tools that are not tables, by their first bytes.
fn foreign(bytes: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 6] = [
        (b"MDF     ", "an MDF file"),
        (b"UnFinMF ", "an MDF file"),
        (b"PK\x03\x04", "a zip archive (a spreadsheet?)"),
        (b"\xd0\xcf\x11\xe0", "an old spreadsheet"),
        (b"PAR1", "a Parquet file"),
        (b"TDSm", "a TDMS file"),
    ];
    KNOWN.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, format)| *format)
}

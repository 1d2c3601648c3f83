//! The user's options for the columns: parses the texts of the command line.

use std::str::FromStr;

/// `NAME=VALUE[unit]`: a column of the record, and where it comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Its name in the record.
    pub name: String,
    /// A column of a file, a number, or the column of a second file: what stands behind the `=`.
    pub value: String,
    /// The unit, where one is given.
    pub unit: Option<String>,
}

impl FromStr for Named {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let grammar = || format!("found `{text}`, expected NAME=COLUMN or NAME=COLUMN[unit]");
        let (name, rest) = text.split_once('=').ok_or_else(grammar)?;
        let (value, unit) = match rest.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')) {
            Some((value, unit)) => (value, Some(unit.trim().to_string())),
            None => (rest, None),
        };
        let (name, value) = (name.trim(), value.trim());
        if name.is_empty() || value.is_empty() || name.contains(['[', ']', ',', '"', '\n', '#']) {
            return Err(grammar());
        }
        Ok(Named { name: name.to_string(), value: value.to_string(), unit })
    }
}

/// The options of an import. The default takes every column of numbers as it is.
#[derive(Debug, Clone, Default)]
pub struct Wishes {
    /// Columns of the record by the names of the files; empty: all, under their own names.
    pub columns: Vec<Named>,
    /// Columns that no file has: one number for every row.
    pub constants: Vec<Named>,
    /// The column of time, where its name does not say so.
    pub time: Option<String>,
    /// Columns that hold their value until the next sample, by their names in the record.
    pub hold: Vec<String>,
    /// The period of the record, in s; the mean one of the first file if absent.
    pub period: Option<f64>,
    /// One signal in the first file and in each further one, `FIRST=SECOND`: what their clocks are aligned by.
    pub align: Option<Named>,
}

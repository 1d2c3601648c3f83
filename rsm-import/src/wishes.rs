//! The user's options for the columns: parses the texts of the command line.

use std::str::FromStr;

/// `NAME=VALUE[unit]`: a column of the record and its source.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Its name in the record.
    pub name: String,
    /// The text after the `=`: a column of a file, a number, or the column of a second file.
    pub value: String,
    /// The unit, if one is given.
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

/// The options of an import. By default every column of numbers is imported without a change.
#[derive(Debug, Clone, Default)]
pub struct Wishes {
    /// Columns of the record with their names in the files. Empty: all columns with their own names.
    pub columns: Vec<Named>,
    /// Columns that are in no file: one number for every row.
    pub constants: Vec<Named>,
    /// The time column, if its name does not show it.
    pub time: Option<String>,
    /// Columns with a zero-order hold, by their names in the record.
    pub hold: Vec<String>,
    /// The period of the record, in s. Default: the mean period of the first file.
    pub period: Option<f64>,
    /// One signal in the first file and in each further file, `FIRST=SECOND`; their clocks are aligned with it.
    pub align: Option<Named>,
}

impl Wishes {
    /// Whether a column may be needed: all are imported, or two clocks are aligned by any signal, or it is named. Of several columns with one name
    /// the later ones have a number behind it.
    pub(crate) fn may_need(&self, name: &str, files: usize) -> bool {
        if self.columns.is_empty() || files > 1 && self.align.is_none() {
            return true;
        }
        let is_named = |wish: &String| {
            let number = wish.split_at_checked(name.len()).filter(|it| it.0.eq_ignore_ascii_case(name)).map(|it| it.1);
            number
                .is_some_and(|number| number.is_empty() || number.strip_prefix('_').is_some_and(|it| it.parse::<u32>().is_ok()))
        };
        let align = self.align.iter().flat_map(|it| [&it.name, &it.value]);
        self.columns.iter().map(|it| &it.value).chain(align).any(is_named)
    }
}

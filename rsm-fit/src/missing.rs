//! What a missing cell is, and what a fit does with a row that has one.
//!
//! In: the text of a cell. Out: whether it is missing. Contains no other rule about data.

/// What a fit does if a row has no number in a column that a response uses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Missing {
    /// It is refused.
    #[default]
    Error,
    /// It leaves the row out for this response. Other responses keep it.
    DropRow,
}

/// The texts of a missing cell beside an empty one, in upper or lower case: marks of R, Python, SQL and spreadsheets (`#NV` in German), and NaN as
/// programs print it. A calculation's error (`#DIV/0!`) is none of them, nor a number that may stand for one (-9999).
pub const MARKS: [&str; 12] =
    ["nan", "-nan", "nan(ind)", "-nan(ind)", "na", "n/a", "<na>", "null", "none", "#n/a", "#na", "#nv"];

/// Whether a cell is missing: empty, or one of [`MARKS`].
#[must_use]
pub fn is_missing(cell: &str) -> bool {
    cell.is_empty() || MARKS.iter().any(|mark| mark.eq_ignore_ascii_case(cell))
}

/// How a missing cell in a column of numbers is read: an empty one, or one of [`MARKS`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MissingAs {
    /// Each is a fault, as any other text.
    #[default]
    Faults,
    /// One fault for each column, at the first of its missing cells, with their number and this help.
    Counted(&'static str),
    /// As NaN.
    Nan,
}

/// The help of a refused missing cell.
pub(crate) const HELP: &str = "fill the cells, or leave such rows out with `missing = \"drop-row\"` in the specification";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_whole_cells() {
        for cell in ["", "NaN", "nan", "NA", "n/a", "#N/A", "#NV", "null", "NULL", "None", "-nan(ind)", "<NA>"] {
            assert!(is_missing(cell), "{cell}");
        }
        for cell in ["0", "-9999", "inf", "-", "?", ".", "#DIV/0!", "nano", "no", "N A"] {
            assert!(!is_missing(cell), "{cell}");
        }
    }
}

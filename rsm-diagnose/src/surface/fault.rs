//! A fault of new data, and what a check found.
//!
//! In: nothing. Out: types that all checks share. Checks nothing.

/// A fault of the data.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// The kind: "constant", "stuck", "clipped", "quantised", "duplicated row", "duplicated block", "scaled from a run on", "scaled in a range of
    /// runs", "depends on the direction of approach".
    pub what: &'static str,
    /// The column; `row` if all columns are meant.
    pub column: String,
    /// First and last row in the run order, from 0.
    pub rows: (usize, usize),
    /// Further numbers for JSON: names with values.
    pub numbers: Vec<(&'static str, f64)>,
    /// For the direction of approach: the input.
    pub input: Option<String>,
    /// Whether its rows are left out.
    pub is_left_out: bool,
    /// A sentence.
    pub sentence: String,
}

impl Fault {
    /// A fault whose rows are left out, without further numbers.
    pub(super) fn new(what: &'static str, column: &str, rows: (usize, usize), sentence: String) -> Self {
        Fault { what, column: column.to_string(), rows, numbers: Vec::new(), input: None, is_left_out: true, sentence }
    }
}

/// What a check found.
#[derive(Default)]
pub(super) struct Found {
    /// The faults.
    pub faults: Vec<Fault>,
    /// Further rows that are left out: they have no fault, but their errors are no independent noise. They share a rounding error, are a biased
    /// sample beside a limit, or may belong to either side of a change.
    pub doubtful: Vec<usize>,
    /// The step of the response if equal points share its rounding error, otherwise 0. Few rows on a grid may be fitted without any error, which then
    /// looks like a noise of zero: a uniform number of one step, added to each reading, makes the errors continuous.
    pub dither: f64,
}

/// Rows as ranges of neighbours: first and last.
pub(super) fn ranges(rows: &[usize]) -> Vec<(usize, usize)> {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for row in rows {
        match ranges.last_mut() {
            Some(range) if *row == range.1 + 1 => range.1 = *row,
            _ => ranges.push((*row, *row)),
        }
    }
    ranges
}

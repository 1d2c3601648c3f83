//! The inputs of a run at every row, and the reasons why a run may end before its last row.

use std::fmt;

/// Inputs at every row.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// The instant of each row in s.
    pub time: &'a [f64],
    /// For each input, in the order of the machine: its value at every row.
    pub values: &'a [Vec<f64>],
}

impl Inputs<'_> {
    pub(super) fn at(&self, row: usize) -> Vec<f64> {
        self.values.iter().map(|it| it[row]).collect()
    }
}

/// Why a run ended before its last row. This is a numerical result, not a program fault.
#[derive(Debug, Clone, PartialEq)]
pub enum Stopped {
    /// A value is no longer finite after this row (from 0).
    NotFinite {
        /// The row.
        row: usize,
        /// The state or output.
        name: String,
    },
    /// A row needs more steps than the limit.
    TooManySteps {
        /// The row.
        row: usize,
    },
    /// A row has more events than the limit: conditions change back and forth.
    TooManyEvents {
        /// The row.
        row: usize,
    },
    /// A nonlinear block has no solution near its last one.
    NoSolution {
        /// The row.
        row: usize,
    },
    /// The run cannot be computed as required, for example because a fixed step does not fit the rows: a sentence.
    Step(String),
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Stopped::NotFinite { row, name } => {
                write!(f, "row {}: `{name}` is no longer finite: the plant is unstable, or a start is missing", row + 1)
            }
            Stopped::TooManySteps { row } => write!(
                f,
                "row {}: more than {MOST_STEPS} steps to the next row: shorten the rows, or allow a larger error",
                row + 1
            ),
            Stopped::TooManyEvents { row } => {
                write!(f, "row {}: more than {MOST_EVENTS} events to the next row: a condition switches to and fro", row + 1)
            }
            Stopped::NoSolution { row } => {
                write!(f, "row {}: a set of nonlinear equations has no solution near its last one", row + 1)
            }
            Stopped::Step(what) => write!(f, "{what}"),
        }
    }
}

/// The largest number of steps from one row to the next. A stiff method that needs more follows a motion that is a million times faster than the
/// record shows.
pub(super) const MOST_STEPS: usize = 200_000;

/// The largest number of events from one row to the next.
pub(super) const MOST_EVENTS: usize = 10_000;

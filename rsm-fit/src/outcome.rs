//! The outcome of a response, and the progress that a fit reports.

use crate::selection::ChosenBy;
use crate::statistics::ResponseStatistics;
use crate::verdict::Verdict;

/// What a fit tells while it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress<'a> {
    /// A data file is being read.
    Reading {
        /// Its name, as the specification has it.
        file: &'a str,
    },
    /// A response is being fitted.
    Fitting {
        /// Its name.
        response: &'a str,
        /// Its place among all, from 1.
        number: usize,
        /// How many there are.
        of: usize,
    },
    /// A step of the ladder.
    Step {
        /// The response.
        response: &'a str,
        /// The order that is open.
        order: u32,
        /// Terms so far.
        terms: usize,
        /// C so far.
        confidence: f64,
    },
}

/// What became of a response.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseOutcome {
    /// Its name.
    pub name: String,
    /// How it ended.
    pub verdict: Verdict,
    /// So many fitted rows lie outside the range of an input. They are fitted as measured.
    pub rows_outside: usize,
    /// Its figures; none when it could not be fitted.
    pub statistics: Option<ResponseStatistics>,
    /// What the terms were chosen by.
    pub chosen_by: ChosenBy,
}

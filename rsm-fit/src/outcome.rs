//! The outcome of a response, and the progress that a fit reports.

use crate::selection::ChosenBy;
use crate::statistics::ResponseStatistics;
use crate::verdict::Verdict;

/// Progress messages of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress<'a> {
    /// A data file is being read.
    Reading {
        /// Its name in the specification.
        file: &'a str,
    },
    /// A response is being fitted.
    Fitting {
        /// Its name.
        response: &'a str,
        /// Its number, from 1.
        number: usize,
        /// The number of responses.
        of: usize,
    },
    /// A step of the ladder.
    Step {
        /// The response.
        response: &'a str,
        /// The current order.
        order: u32,
        /// The current number of terms.
        terms: usize,
        /// The current C.
        confidence: f64,
    },
}

/// The outcome of a response.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseOutcome {
    /// Its name.
    pub name: String,
    /// Its verdict.
    pub verdict: Verdict,
    /// The number of fitted rows outside the range of an input. They are fitted as measured.
    pub rows_outside: usize,
    /// Its figures; `None` if it could not be fitted.
    pub statistics: Option<ResponseStatistics>,
    /// What the choice of terms was based on.
    pub chosen_by: ChosenBy,
}

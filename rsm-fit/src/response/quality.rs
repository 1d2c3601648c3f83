//! The quality of a surface on rows that were not used for any choice, and what the rows were used for.
//!
//! In: the figures of a fit and its rows. Out: numbers, and sentences for the user. Computes no figure.

use super::Task;
use crate::selection::{Choice, ChosenBy, Sample};
use crate::statistics::{CrossValidation, RowsUsed};

/// The quality of a surface on rows that were not used for any choice.
pub(super) struct Quality {
    /// Whether a constraint is active.
    pub is_held: bool,
    /// The explained share of the spread about the mean on those rows; `None` if there are none.
    pub explained: Option<f64>,
    /// The same on the rows that chose the terms.
    pub centred: Option<f64>,
    pub cross_validated: Option<CrossValidation>,
}

impl Quality {
    /// What the rows of a response were used for, in words.
    pub(super) fn words(&self, task: &Task<'_>, chosen: &Choice, has_found_steps: bool) -> RowsUsed {
        let fitted = task.fit.rows();
        let validate = task.validate.as_ref().map(Sample::rows);
        let terms = match (chosen.by, validate) {
            (ChosenBy::Nobody, _) => "none: the terms were given".to_string(),
            (ChosenBy::Validation, Some(rows)) => format!("{rows} validation rows"),
            (ChosenBy::LeftOut { parts }, _) => format!("the fitted rows, left out in {parts} parts in turn"),
            (ChosenBy::Formula(name), _) => format!("the fitted rows themselves, by {name}"),
            _ => "the fitted rows themselves: they are too few to leave any out".to_string(),
        };
        let validation = match (chosen.by, validate) {
            (_, None) => "none".to_string(),
            (ChosenBy::Validation, Some(rows)) => format!("{rows} rows, which also chose the terms"),
            (_, Some(rows)) => format!("{rows} holdout rows, not used for any choice"),
        };
        let error = match (&task.test, &self.cross_validated, chosen.by, validate) {
            (Some(test), ..) => format!("{} test rows, not used for anything else", test.rows()),
            (None, _, by, Some(rows)) if by != ChosenBy::Validation => {
                format!("{rows} validation rows, not used for any choice")
            }
            (None, Some(cross), by, _) if !self.is_held => {
                let (rows, parts) = (cross.errors.rows, cross.parts);
                let again = match (by == ChosenBy::Nobody, has_found_steps) {
                    (true, false) => "the fit repeated without them",
                    (false, false) => "fit and choice of terms repeated without them",
                    (_, true) => {
                        "fit, choice of terms and of the parameters of the form repeated without them; the same rows also chose this form over powers only"
                    }
                };
                format!("{rows} rows left out in {parts} parts in turn, {again}")
            }
            (None, Some(_), ..) => "none: constraints are active, and cross-validation does not repeat them".to_string(),
            (None, None, ChosenBy::Nobody, None) => "none: there are too few rows to leave any out".to_string(),
            (None, None, ..) => "none: the only error is that on the rows that chose the terms".to_string(),
        };
        RowsUsed { coefficients: format!("{fitted} rows"), terms, validation, error }
    }
}

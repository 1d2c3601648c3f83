//! The nominal, the calibrated and the extended plant along the evaluation records, for the comparison in a report.
//!
//! In: fits. Out: [`Compared`]. Runs no simulation.

use super::levenberg::Fit;
use super::model::Model;
use super::whitened_residuals::WhitenedResiduals;

/// The plants to compare.
pub struct Compared<'a> {
    /// Training records.
    pub whitened: &'a WhitenedResiduals,
    /// Records that no fit used; may be empty.
    pub unseen: &'a WhitenedResiduals,
    /// The plant as in its file.
    pub nominal: &'a Model,
    /// The extended plant, as fitted to the training records.
    pub fit: &'a Fit,
    /// The nominal plant along the evaluation records.
    pub nominal_there: &'a Fit,
    /// The same, calibrated within its tolerances. Causes must explain the error of this plant.
    pub before: &'a Fit,
    /// The extended plant along the evaluation records.
    pub after: &'a Fit,
    /// Whether structure is left, so that a correction may help.
    pub structure: bool,
}

impl Compared<'_> {
    /// The evaluation records.
    pub(super) fn evaluation_records(&self) -> &WhitenedResiduals {
        if self.unseen.records.is_empty() { self.whitened } else { self.unseen }
    }
}

//! The nominal, the calibrated and the extended plant along the evaluation records, for the comparison in a report.
//!
//! In: fits. Out: [`Compared`]. Never simulates.

use super::levenberg::Fit;
use super::model::Model;
use super::whitened_residuals::WhitenedResiduals;

/// What is compared.
pub struct Compared<'a> {
    /// Training records.
    pub whitened: &'a WhitenedResiduals,
    /// Records that no fit saw; may be empty.
    pub unseen: &'a WhitenedResiduals,
    /// The plant as its file says.
    pub nominal: &'a Model,
    /// The extended plant, as fitted to the training records.
    pub fit: &'a Fit,
    /// The nominal plant along the evaluation records.
    pub nominal_there: &'a Fit,
    /// The same, calibrated within its tolerances: what causes are asked to explain.
    pub before: &'a Fit,
    /// The extended plant along them.
    pub after: &'a Fit,
    /// Whether structure is left, so that a correction is worth a try.
    pub structure: bool,
}

impl Compared<'_> {
    /// The records that judge.
    pub(super) fn judged(&self) -> &WhitenedResiduals {
        if self.unseen.records.is_empty() { self.whitened } else { self.unseen }
    }
}

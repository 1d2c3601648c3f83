//! The possible verdicts of both diagnoses.

/// The verdict of a diagnosis of a surface or of a plant (docs/book/src/reference/formats.md 4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The data agree with the file, within its tolerances and the noise.
    NoDiscrepancy,
    /// The causes explain the error; the residual is noise.
    Explained,
    /// Structure is left that no known cause explains, or the search reached its work limit.
    Unexplained,
}

impl Verdict {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Verdict::NoDiscrepancy => "no-discrepancy",
            Verdict::Explained => "explained",
            Verdict::Unexplained => "unexplained",
        }
    }
}

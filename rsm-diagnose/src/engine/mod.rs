//! Statistics for both diagnoses. The diagnosis of a surface and the diagnosis of a plant provide the columns and residuals.
//!
//! In: columns, residuals, counts of trials. Out: bases, solutions, probabilities, limits of work. Independent of surfaces, plants and effects.

pub(crate) mod angle;
pub(crate) mod autoregression;
pub(crate) mod columns;
pub(crate) mod combinations;
pub(crate) mod holdout;
pub(crate) mod levenberg;
pub(crate) mod normal;
pub(crate) mod probability;
pub(crate) mod significance;
pub(crate) mod verdict;
pub(crate) mod work;

//! What both diagnoses need of statistics, once: a surface and a plant are providers of columns and residuals to it.
//!
//! In: columns, residuals, counts of trials. Out: bases, solutions, probabilities, limits of work. Knows neither surfaces nor plants nor effects.

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

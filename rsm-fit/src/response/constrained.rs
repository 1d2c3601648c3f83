//! Constraints on the chosen terms of a response.
//!
//! In: a surface with its least-squares coefficients, the solved problem. Out: its figures with constraints, or a verdict without a surface.

use rsm_core::model::Surface;

use super::Task;
use crate::constrain::{self, Constrained, ConstraintStatistics};
use crate::design::Design;
use crate::qr::Growing;
use crate::statistics::{self, ResponseStatistics};
use crate::verdict::Verdict;

/// Whether a constraint is active.
pub(super) fn is_held(statistics: &ResponseStatistics) -> bool {
    statistics.constraints.as_ref().is_some_and(|constraints| constraints.active)
}

impl Task<'_> {
    /// The figures with constraints on the chosen terms; unchanged if the constraints are inactive.
    pub(super) fn constrained(
        &self,
        surface: &Surface,
        design: &Design,
        problem: &Growing,
        free: ResponseStatistics,
    ) -> Result<ResponseStatistics, Verdict> {
        let constraints = &self.response.constraints;
        let low = self.fit.response.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.fit.response.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // For a constant response its magnitude, or 1 if that is 0.
        let spread = [high - low, high.abs()].into_iter().find(|spread| *spread > 0.0).unwrap_or(1.0);
        let own = self.own(surface);
        let places = self.own_places(surface);
        let task = constrain::Task { surface: &own, inputs: self.own_inputs(), constraints, problem, places: &places, spread };
        let (mut statistics, told) = match task.run() {
            Constrained::Inactive { constraints } => {
                let told = ConstraintStatistics {
                    active: false,
                    constraints,
                    shift: constrain::SHIFT * spread,
                    rounds: 0,
                    residual_sd_without: free.residual_sd,
                    validation_without: free.validation.clone(),
                    largest_change: None,
                };
                (free, told)
            }
            Constrained::Active { coefficients, constraints, rounds, shift, largest_change } => {
                let statistics = self.fit.observed(|fitted| statistics::of_constrained(design, &coefficients, fitted));
                let told = ConstraintStatistics {
                    active: true,
                    constraints,
                    shift: shift * spread,
                    rounds,
                    residual_sd_without: free.residual_sd,
                    validation_without: free.validation,
                    largest_change: Some(largest_change),
                };
                (self.with_apart(surface, design, statistics), told)
            }
            Constrained::Infeasible { constraints } => return Err(Verdict::Infeasible { constraints }),
            Constrained::NotProven(why) => return Err(Verdict::NotProven(why)),
        };
        statistics.constraints = Some(told);
        Ok(statistics)
    }
}

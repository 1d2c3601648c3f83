//! The report on a constraint without a proof.
//!
//! In: the last search over the claims, the rounds. Out: for every constraint without a proof: the bounded quantity, the difference between the bound
//! and the requirement, and the limit of work that ended the search, in words and as data.

use serde::Serialize;

use super::claim::Claim;
use super::{Found, MOST_SHIFT, SHIFT, Task};
use crate::observations::Named;
use crate::spec::Constraint;

/// The end of a search without a proof.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NotProven {
    /// The constraints without a proof.
    pub constraints: Vec<Unproven>,
    /// The limit that ended the search.
    pub stopped_by: Stop,
    /// The last margin of the constraints, as a share of the spread of the response.
    pub shift: f64,
    /// The number of rounds of exchange.
    pub rounds: usize,
    /// The used share of the work for proofs, from 0 to 1.
    pub work: f64,
}

/// A constraint without a proof.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unproven {
    /// In the words of the specification.
    pub constraint: String,
    /// The bounded quantity.
    pub quantity: &'static str,
    /// The proven lower bound, in the unit of the response; the constraint requires 0. Minus infinity (null in JSON) if no search was completed.
    pub bound: f64,
    /// The same as a share of the spread of the response.
    pub share_of_spread: f64,
    /// The smallest value found; not negative if only the proof is missing. Null if there is none.
    pub seen: Option<f64>,
    /// The point of that value.
    pub at: Option<Named<f64>>,
}

/// The limit that ended a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stop {
    /// The margin of the constraints reached its largest value.
    LargestShift,
    /// With this margin no coefficients exist; with a smaller one they do.
    NoneSoFarInside,
    /// The quadratic program found no solution within its own limits.
    Program,
}

impl NotProven {
    /// The report from the last search.
    pub(super) fn new(
        task: &Task<'_>,
        claims: &[Claim],
        found: &[Found],
        rounds: &super::Rounds,
        work: f64,
        stopped_by: Stop,
    ) -> Self {
        let of_one = |(k, constraint): (usize, &Constraint)| {
            let own = || claims.iter().zip(found).filter(|(claim, _)| claim.constraint == k);
            let bound = own().map(|(_, found)| found.bound).fold(f64::INFINITY, f64::min);
            let seen = own()
                .filter(|(_, found)| found.seen.is_finite())
                .min_by(|(_, one), (_, other)| one.seen.total_cmp(&other.seen));
            let point = |(claim, found): (&Claim, &Found)| task.natural(&claim.main_point(&found.shares));
            let quantity = match constraint {
                Constraint::Bounds { .. } => "distance from the bounds",
                Constraint::Monotone { .. } => "slope per half range",
                Constraint::Convex | Constraint::Concave => "curvature per half range squared",
            };
            let (share_of_spread, seen_value) = (bound / task.spread, seen.map(|(_, found)| found.seen));
            let at = seen.map(point);
            let told = Unproven { constraint: constraint.to_string(), quantity, bound, share_of_spread, seen: seen_value, at };
            (bound < task.enough()).then_some(told)
        };
        let constraints = task.constraints.iter().enumerate().filter_map(of_one).collect();
        // The last shift was rejected, so nothing was enforced with it.
        let shift = rounds.shift.min(MOST_SHIFT);
        NotProven { constraints, stopped_by, shift, rounds: rounds.count, work }
    }
}

impl std::fmt::Display for NotProven {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "not proven to hold over the whole region: ")?;
        for (k, one) in self.constraints.iter().enumerate() {
            let Unproven { constraint, quantity, bound, share_of_spread, seen, at } = one;
            let separator = if k == 0 { "" } else { "; " };
            write!(
                f,
                "{separator}{constraint} ({quantity} is proven to be at least {bound:.2e}, {:.1e} of the spread, but 0 is required",
                share_of_spread.abs()
            )?;
            if let (Some(seen), Some(at)) = (seen, at) {
                let place = at.0.iter().map(|(name, x)| format!("{name} = {x:.4}")).collect::<Vec<_>>().join(", ");
                let kind = if *seen < 0.0 { "broken" } else { "holds at all examined points" };
                write!(f, "; {kind}, smallest value found {seen:.2e} at {place}")?;
            }
            write!(f, ")")?;
        }
        let (shift, rounds, work) = (self.shift, self.rounds, 100.0 * self.work);
        let why = match self.stopped_by {
            Stop::LargestShift => {
                format!("the constraints were enforced with a margin of {shift:.1e} of the spread, the largest allowed margin")
            }
            Stop::NoneSoFarInside => {
                format!(
                    "no coefficients keep them with a margin of {shift:.1e} of the spread, but some do with a margin of {SHIFT:.0e}"
                )
            }
            Stop::Program => "the quadratic program for the coefficients did not converge".to_string(),
        };
        write!(f, ". The search ended after {rounds} rounds and {work:.0} % of the work for proofs: {why}")
    }
}

//! Constraints that hold over the whole supported region, not only at points.
//!
//! In: a surface with its least-squares coefficients, the constraints, the solved problem. Out: coefficients that meet the constraints with the
//! smallest increase of the residual sum of squares, with a proof; or that there are none. Coefficients that already meet them are not changed. Does
//! not choose terms, and does not use points outside the support.
//!
//! A semi-infinite program, solved by exchange (Hettich, Kortanek 1993, SIAM Review 35). The constraints are enforced at points. Then
//! [`bernstein::least`] searches the whole region for the worst point. It either proves that no constraint is violated, or returns a new point, which
//! is added with the other local minima where a constraint is violated (`local_minima.rs`). Points that are no longer active are dropped
//! (`points.rs`). At the points a constraint is enforced with a margin, [`SHIFT`], so that the minima between them, which shrink with the square of
//! the distance of points, become at least 0 after finitely many rounds. If they do not, or if only the proof is missing, the shift grows
//! (`rounds.rs`). Convexity is searched and proven in all directions at once (`curvature.rs`). A claim that a search neither
//! violates nor proves is proven by sums of squares (`squares.rs`). The region is the box cut by the support.

mod claim;
mod curvature;
mod local_minima;
mod parts;
mod points;
mod program;
mod rounds;
mod squares;
mod unproven;

use rsm_core::basis::{Factor, Variable};
use rsm_core::bernstein::{self, Place, Search};
use rsm_core::interval::Interval;
use rsm_core::model::{Input, Surface};
use serde::Serialize;

use crate::dd::Dd;
use crate::design::Coded;
use crate::observations::{Named, ValidationStatistics};
use crate::qr::Growing;
use crate::random::Random;
use crate::spec::Constraint;
use crate::support::Region;
use claim::Claim;
use curvature::LeastEigenvalue;
use points::Points;
use program::Solution;
pub use rounds::SHIFT;
use rounds::{MOST_SHIFT, Rounds};
use squares::Work;
pub use unproven::{NotProven, Stop, Unproven};

/// The tolerance of a proof, as a share of that spread. Where a surface is 0 for all coefficients, rounding leaves an error of this size.
pub const SLACK: f64 = 1e-12;

/// The limit of multiplications of all certificates for one surface: about two minutes. Above it, a claim that a search does not prove is "not
/// proven".
const MOST_WORK: u64 = 1_000_000_000_000;

/// One certificate may use one part in this many of the limit. The shift doubles ten times from the first to the largest.
const WORK_SHARES: u64 = 10;

/// Cells at the support's edge that are no wider than this share of a side count as inside. Few cells become so small, because the half-spaces enter
/// the bounds of larger ones. A surface that falls by its spread over a half range violates a constraint by 10^-9 of it there.
const FINEST: f64 = 1.0 / (1u64 << 30) as f64;

/// The largest number of parts of a surface with sigmoids or waves. A sigmoid takes some twenty parts of an input, a wave two for each period. A
/// search takes a millisecond for each part, and there are some ten rounds of it.
pub const MOST_PARTS: usize = 2000;

/// The number of parts of the box on which a surface is nearly a polynomial, if it is above the limit for constraints.
#[must_use]
pub fn too_many_parts(surface: &Surface, inputs: &[Input]) -> Option<usize> {
    let count = if parts::has_steps(surface) { parts::Part::count(surface, inputs) } else { 1 };
    (count > MOST_PARTS).then_some(count)
}

/// The work of a search that proves what one with the usual work neither broke nor proved, at the edge of a support: a second or
/// two.
const LONGER: usize = 8;

/// The report on the constraints of a surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConstraintStatistics {
    /// Whether they changed the coefficients.
    pub active: bool,
    /// The report of every constraint.
    pub constraints: Vec<ConstraintReport>,
    /// The margin at points, in the unit of the response.
    pub shift: f64,
    /// The number of rounds of exchange.
    pub rounds: usize,
    /// The square root of the residual mean square without constraints.
    pub residual_sd_without: Option<f64>,
    /// The errors on validation rows without constraints.
    pub validation_without: Option<ValidationStatistics>,
    /// The largest change of the surface over the supported region.
    pub largest_change: Option<Change>,
}

/// The report of a constraint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConstraintReport {
    /// In the words of the specification.
    pub constraint: String,
    /// The proven distance over the whole supported region, in the unit of the response: from the surface to its bound, or from the slope (per half
    /// range of the input) or curvature (per half range squared) to 0.
    pub distance: f64,
    /// The points at which it is active.
    pub points: Vec<Named<f64>>,
}

/// The largest change of a surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// The value with constraints minus the value without.
    pub value: f64,
    /// The point.
    pub at: Named<f64>,
}

/// The outcome for the coefficients.
#[derive(Debug, Clone, PartialEq)]
pub enum Constrained {
    /// The given coefficients meet the constraints.
    Inactive {
        /// The report of every constraint.
        constraints: Vec<ConstraintReport>,
    },
    /// Changed coefficients meet the constraints.
    Active {
        /// The changed coefficients, of all columns of the problem.
        coefficients: Vec<f64>,
        /// The report of every constraint.
        constraints: Vec<ConstraintReport>,
        /// The number of rounds of exchange.
        rounds: usize,
        /// The margin at points, as a share of the spread.
        shift: f64,
        /// The largest change of the surface.
        largest_change: Change,
    },
    /// No coefficients meet the constraints.
    Infeasible {
        /// Constraints that contradict one another or the terms.
        constraints: Vec<String>,
    },
    /// Coefficients may exist, but there is no proof.
    NotProven(NotProven),
}

/// A surface whose coefficients are to be constrained.
pub struct Task<'a> {
    /// The surface with its terms, their least-squares coefficients and its support.
    pub surface: &'a Surface,
    /// Its inputs.
    pub inputs: &'a [Input],
    /// The constraints.
    pub constraints: &'a [Constraint],
    /// The solved problem.
    pub problem: &'a Growing,
    /// The place of each term of the surface in the problem. Other columns of the problem, such as those of blocks, are not constrained.
    pub places: &'a [usize],
    /// The largest minus the smallest measured response.
    pub spread: f64,
}

/// The result of one search over a claim.
struct Found {
    bound: f64,
    seen: f64,
    /// The point of the smallest value, as shares of the sides of the claim.
    shares: Vec<f64>,
}

impl Task<'_> {
    /// Finds the coefficients.
    #[must_use]
    pub fn run(&self) -> Constrained {
        let region = Region::new(self.surface, self.inputs);
        let halves: Vec<f64> = region.sides.iter().map(|[low, high]| (high - low) / 2.0).collect();
        let claims = claim::of(self.constraints, self.surface, self.inputs, &halves);
        let mut coefficients: Vec<f64> = self.surface.terms.iter().map(|term| term.coefficient).collect();
        let mut work = Work { left: MOST_WORK };
        let mut found = self.search(&claims, &coefficients);
        if self.is_unbroken(&found) {
            found = self.proof(&claims, &coefficients, found, &mut work);
        }
        if self.is_proven(&found) {
            return Constrained::Inactive { constraints: self.reports(&claims, &found, &[]) };
        }
        let free = self.problem.coefficients();
        let own: Vec<Dd> = self.own(&free);
        let mut points = Points { task: self, free: &own, claims: &claims, lengths: Vec::new(), points: Vec::new() };
        if let Err(constraint) = points.first() {
            return Constrained::Infeasible { constraints: vec![self.constraints[constraint].to_string()] };
        }
        // mutant `0 up`: any seed gives a valid result.
        let mut random = Random::new(0);
        let mut rounds = Rounds::new();
        let mut is_complete = false;
        let mut stopped_by = Stop::LargestShift;
        while let Some(shift) = rounds.next(is_complete) {
            let (c, active) = match program::shortest(&points.rows(shift), self.problem.chosen().len()) {
                Solution::Shortest { c, active } => (c, active),
                Solution::Infeasible => match self.contradiction(&points) {
                    Some(constraints) => return Constrained::Infeasible { constraints },
                    None => {
                        stopped_by = Stop::NoneSoFarInside;
                        break;
                    }
                },
                Solution::Failed => {
                    stopped_by = Stop::Program;
                    break;
                }
            };
            let step = self.problem.coefficients_of(c);
            let all: Vec<f64> = free.iter().zip(&step).map(|(free, step)| (*free + *step).to_f64()).collect();
            coefficients = self.own(&all);
            found = self.search(&claims, &coefficients);
            let mut local_minima = Vec::new();
            if !self.is_proven(&found) {
                local_minima = points.local_minima(&coefficients, &active, &mut random);
                // A proof is attempted if no violated point is known.
                if local_minima.is_empty() && self.is_unbroken(&found) {
                    found = self.proof(&claims, &coefficients, found, &mut work);
                }
            }
            if self.is_proven(&found) {
                let held: Vec<(usize, Vec<f64>)> = active
                    .iter()
                    .map(|k| &points.points[*k])
                    .map(|point| (point.claim, claims[point.claim].main_point(&point.shares)))
                    .collect();
                let constraints = self.reports(&claims, &found, &held);
                let largest_change = self.largest_change(&coefficients);
                return Constrained::Active { coefficients: all, constraints, rounds: rounds.count, shift, largest_change };
            }
            rounds.note(-found.iter().map(|found| found.seen).fold(f64::INFINITY, f64::min));
            match points.exchange(&active, &found, &local_minima) {
                // A larger shift gives the proof more margin.
                Ok(is_new) => is_complete = !is_new,
                Err(constraint) => {
                    return Constrained::Infeasible { constraints: vec![self.constraints[constraint].to_string()] };
                }
            }
        }
        let spent = (MOST_WORK - work.left) as f64 / MOST_WORK as f64;
        Constrained::NotProven(NotProven::new(self, &claims, &found, &rounds, spent, stopped_by))
    }

    /// Of numbers for each column of the problem, those of the terms of the surface.
    fn own<T: Copy>(&self, all: &[T]) -> Vec<T> {
        self.places.iter().map(|place| all[*place]).collect()
    }

    /// A row for the terms of the surface as a row for the columns of the problem.
    fn in_problem(&self, row: &[Dd]) -> Vec<Dd> {
        let mut all = vec![Dd::ZERO; self.problem.chosen().len()];
        self.places.iter().zip(row).for_each(|(place, x)| all[*place] = *x);
        all
    }

    /// A set of constraints that contradict one another at these points, such that without any one of them the others do not. `None` if they
    /// contradict only with a grown shift, because the constraints may then be feasible.
    fn contradiction(&self, points: &Points<'_>) -> Option<Vec<String>> {
        let contradict = |constraints: &[usize]| {
            let is_asked = |k: &usize| constraints.contains(&points.claims[points.points[*k].claim].constraint);
            let rows = points.rows(SHIFT).into_iter().enumerate().filter(|(k, _)| is_asked(k)).map(|(_, row)| row);
            matches!(program::shortest(&rows.collect::<Vec<_>>(), self.problem.chosen().len()), Solution::Infeasible)
        };
        let mut kept: Vec<usize> = (0..self.constraints.len()).collect();
        if !contradict(&kept) {
            return None;
        }
        for k in kept.clone() {
            let others: Vec<usize> = kept.iter().copied().filter(|other| *other != k).collect();
            if contradict(&others) {
                kept = others;
            }
        }
        Some(self.names(kept.into_iter()))
    }

    fn names(&self, constraints: impl Iterator<Item = usize>) -> Vec<String> {
        let mut indices: Vec<usize> = constraints.collect();
        indices.sort_unstable();
        indices.dedup();
        indices.into_iter().map(|k| self.constraints[k].to_string()).collect()
    }

    /// The tolerance of a proof below zero, in the unit of the response.
    fn enough(&self) -> f64 {
        -SLACK * self.spread
    }

    fn is_proven(&self, found: &[Found]) -> bool {
        found.iter().all(|found| found.bound >= self.enough())
    }

    /// Whether no violated point of a claim is known.
    fn is_unbroken(&self, found: &[Found]) -> bool {
        found.iter().all(|found| found.seen >= self.enough())
    }

    /// The smallest value of every claim over the region, with the usual work.
    fn search(&self, claims: &[Claim], coefficients: &[f64]) -> Vec<Found> {
        let mut found = Vec::new();
        for claim in claims {
            match claim.largest {
                None => found.push(self.least(claim, &claim.monomials(coefficients), self.enough(), 1)),
                // One search for all directions.
                Some(0) => found.extend(self.least_curvature(claim, coefficients)),
                Some(_) => {}
            }
        }
        found
    }

    /// A certificate for every claim whose bound is not sufficient.
    fn proof(&self, claims: &[Claim], coefficients: &[f64], mut found: Vec<Found>, work: &mut Work) -> Vec<Found> {
        let inputs = self.inputs.len();
        for (k, claim) in claims.iter().enumerate() {
            let count = if claim.largest.is_some() { inputs } else { 1 };
            if claim.largest.unwrap_or(0) > 0 || found[k..k + count].iter().all(|found| found.bound >= self.enough()) {
                continue;
            }
            let monomials = claim.monomials(coefficients);
            // A support has up to 80 half-spaces of four inputs. They make squares large, and cells at its edge many.
            if claim.largest.is_none() && !self.surface.support.is_empty() {
                found[k] = self.least(claim, &monomials, self.enough(), LONGER);
                if found[k].bound >= self.enough() {
                    continue;
                }
            }
            let (entries, enough) = match claim.largest {
                None => (vec![monomials], self.enough()),
                Some(_) => (curvature::entries(&monomials, inputs), self.enough() / inputs as f64),
            };
            let given = work.left.min(MOST_WORK / WORK_SHARES);
            let mut own = Work { left: given };
            let bound = squares::least_eigenvalue(
                &entries,
                &claim.sides[..inputs],
                &claim.spaces(&self.surface.support),
                enough,
                &mut own,
            );
            work.left -= given - own.left;
            if let Some(bound) = bound {
                found[k..k + count].iter_mut().for_each(|found| found.bound = curvature::of_directions(bound, count));
            }
        }
        found
    }

    /// The result of one search for the smallest curvature, for the claims of all directions in a piece. All have the same bound. The worst point
    /// belongs to the claim whose entry is the largest of its direction.
    fn least_curvature(&self, first: &Claim, coefficients: &[f64]) -> Vec<Found> {
        let inputs = self.inputs.len();
        let (measure, hessian) = (LeastEigenvalue(inputs), curvature::entries(&first.monomials(coefficients), inputs));
        let place = |cell: &[[f64; 2]]| self.place(first, cell);
        let enough = self.enough() / inputs as f64;
        let spaces = first.spaces(&self.surface.support);
        let wanted = Search { place: &place, spaces: &spaces, finest: FINEST, enough };
        let sides = &first.sides[..inputs];
        let least = bernstein::least_measure(&hessian, sides, &measure, &wanted);
        let bound = curvature::of_directions(least.bound, inputs);
        let (largest, direction) = measure.worst(&hessian, sides, &least.at);
        let of_one = |k: usize| {
            let is_worst = k == largest;
            let shares = if is_worst { [&least.at[..], &direction[..]].concat() } else { Vec::new() };
            Found { bound, seen: if is_worst { least.seen } else { f64::INFINITY }, shares }
        };
        (0..inputs).map(of_one).collect()
    }

    fn least(&self, claim: &Claim, monomials: &[bernstein::Monomial], enough: f64, times: usize) -> Found {
        let place = |cell: &[[f64; 2]]| self.place(claim, cell);
        let spaces = claim.spaces(&self.surface.support);
        let wanted = Search { place: &place, spaces: &spaces, finest: FINEST, enough };
        let found = bernstein::least_for(times, monomials, &claim.sides, &wanted);
        Found { bound: found.bound, seen: found.seen, shares: found.at }
    }

    /// The position of a cell of a claim, given as shares of its sides, relative to the support.
    fn place(&self, claim: &Claim, cell: &[[f64; 2]]) -> Place {
        let variable = |(side, shares): (&Interval, &[f64; 2])| {
            let at = |share: f64| {
                Interval::point(side.low) + Interval::point(share) * (Interval::point(side.high) - Interval::point(side.low))
            };
            at(shares[0]).hull(at(shares[1]))
        };
        let cell: Vec<Interval> = claim.main.iter().zip(cell).take(self.inputs.len()).map(variable).collect();
        let mut place = Place::Inside;
        for space in &self.surface.support {
            let parts = space.normal.iter().zip(&cell).map(|(n, x)| Interval::point(*n) * *x);
            let sum = parts.fold(Interval::point(0.0), |sum, part| sum + part);
            if sum.low > space.bound {
                return Place::Outside;
            }
            if sum.high > space.bound {
                place = Place::Partly;
            }
        }
        place
    }

    fn reports(&self, claims: &[Claim], found: &[Found], held: &[(usize, Vec<f64>)]) -> Vec<ConstraintReport> {
        let of_one = |(k, constraint): (usize, &Constraint)| {
            let bounds = claims.iter().zip(found).filter(|(claim, _)| claim.constraint == k).map(|(_, found)| found.bound);
            let mut points: Vec<Named<f64>> = Vec::new();
            for (claim, point) in held {
                let point = self.natural(point);
                // Exchange may leave neighbouring points for one minimum; they are reported once.
                if claims[*claim].constraint == k && !points.iter().any(|known| self.are_close(known, &point)) {
                    points.push(point);
                }
            }
            ConstraintReport { constraint: constraint.to_string(), distance: bounds.fold(f64::INFINITY, f64::min), points }
        };
        self.constraints.iter().enumerate().map(of_one).collect()
    }

    fn are_close(&self, one: &Named<f64>, other: &Named<f64>) -> bool {
        let distances = one.0.iter().zip(&other.0).map(|((_, a), (_, b))| (a - b).abs());
        // A hundredth of the range.
        distances.zip(self.inputs).all(|(distance, input)| distance < 0.01 * (input.range[1] - input.range[0]))
    }

    /// A point of coded variables in natural units.
    fn natural(&self, point: &[f64]) -> Named<f64> {
        let factors = Factor::all(self.surface, self.inputs);
        let each = self.inputs.iter().zip(&factors).zip(point);
        Named(each.map(|((input, factor), x)| (input.name.clone(), natural(factor.variable, Coded(*x), input))).collect())
    }

    fn largest_change(&self, coefficients: &[f64]) -> Change {
        let mut largest = (0.0, vec![0.0; self.inputs.len()]);
        for claim in claim::values(self.surface, self.inputs) {
            let mut monomials = claim.monomials(coefficients);
            let free: Vec<f64> = self.surface.terms.iter().map(|term| -term.coefficient).collect();
            monomials.extend(claim.monomials(&free));
            for sign in [1.0, -1.0] {
                let turned: Vec<bernstein::Monomial> = monomials
                    .iter()
                    .map(|term| bernstein::Monomial { coefficient: term.coefficient * Interval::point(sign), ..term.clone() })
                    .collect();
                let found = self.least(&claim, &turned, f64::INFINITY, 1);
                // mutant `< to <=`: of two changes with one size, either is the largest.
                if found.seen.is_finite() && found.seen < -f64::abs(largest.0) {
                    largest = (sign * found.seen, claim.main_point(&found.shares));
                }
            }
        }
        Change { value: largest.0, at: self.natural(&largest.1) }
    }
}

/// xi for x, within the range of the input; for a symmetric input its magnitude.
fn natural(variable: Variable, Coded(x): Coded, input: &Input) -> f64 {
    let centred = |low: f64, high: f64| (low + high) / 2.0 + x * (high - low) / 2.0;
    let xi = match variable {
        Variable::Natural | Variable::Magnitude => x,
        Variable::ScaledMagnitude { high } => x * high,
        Variable::Centred { low, high } => centred(low, high),
        Variable::Reciprocal => 1.0 / x,
        Variable::CentredReciprocal { low, high } => 1.0 / centred(1.0 / high, 1.0 / low),
    };
    xi.clamp(input.range[0], input.range[1])
}

#[cfg(test)]
mod tests;

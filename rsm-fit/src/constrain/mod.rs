//! Constraints that hold over the whole supported region, and not only at points.
//!
//! In: a surface with its least-squares coefficients, the constraints, the solved problem. Out: coefficients that keep the
//! constraints at the least cost in the residual sum of squares, with the proof that they do; or that there are none. Coefficients
//! that keep them anyway are left as they are, to the bit. Never chooses terms, never looks beyond the support.
//!
//! A semi-infinite program by exchange (Hettich, Kortanek 1993, SIAM Review 35): the constraints are enforced at points, then
//! [`bernstein::least`] looks for the worst place of the whole region and either proves that there is none or gives it as a new
//! point, with the other local minima where a constraint is broken (`local_minima.rs`); points that no longer hold are dropped (`points.rs`). At the points a constraint is enforced [`SHIFT`]
//! inside, so that the dips between them, which shrink with the square of their distance, end at 0 and not only tend to it. Where
//! they still have not after `SHIFTED_ROUNDS`, or only the proof is missing, the shift grows up to `MOST_SHIFT`. Convexity is searched and proven in all
//! directions at once (`curvature.rs`). What a search neither breaks nor proves is proven by sums of squares (`squares.rs`). Region: the
//! box cut by the support; a cell of the search that the support's edge cuts counts as a whole once it is small.

mod claim;
mod curvature;
mod local_minima;
mod points;
mod program;
mod squares;
mod unproven;

use rsm_core::basis::{Factor, Variable};
use rsm_core::bernstein::{self, Place, Search};
use rsm_core::interval::Interval;
use rsm_core::model::{HalfSpace, Input, Surface};
use serde::Serialize;

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
use squares::Work;
pub use unproven::{NotProven, Stop, Unproven};

/// How far inside a constraint is enforced at first, as a share of the spread of the response.
pub const SHIFT: f64 = 1e-7;

/// What a proof may miss, as a share of that spread: where a surface is 0 whatever its coefficients, rounding leaves so much.
pub const SLACK: f64 = 1e-12;

/// Rounds with the first shift, unless one finds no further place before. Each later one takes [`GROWTH`] times the shift of the one
/// before it.
const SHIFTED_ROUNDS: usize = 25;

/// Ten rounds for a digit: exchange gains a digit faster than that, so the two meet near where it stands when the shift begins to grow.
const GROWTH: f64 = 1.25;

/// The same where all places are known, and only the proof is missing: cells of half the width have a quarter of the excess.
const GROWTH_OF_PROOF: f64 = 2.0;

/// The largest shift: below the noise of usual measurements. Beyond it the outcome is "not proven".
const MOST_SHIFT: f64 = 1e-4;

/// Work of all certificates for one surface, in multiplications: some two minutes. Beyond it, what a search alone does not prove is "not proven".
const MOST_WORK: u64 = 1_000_000_000_000;

/// A certificate may take this share of it: the shift doubles ten times from the first to the largest.
const WORK_SHARES: u64 = 10;

/// What is told of the constraints on a surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConstraintStatistics {
    /// Whether they changed the coefficients.
    pub active: bool,
    /// Every constraint.
    pub constraints: Vec<ConstraintReport>,
    /// How far inside they are enforced at points, in the unit of the response.
    pub shift: f64,
    /// Rounds of exchange.
    pub rounds: usize,
    /// Root of the residual mean square without constraints.
    pub residual_sd_without: Option<f64>,
    /// The errors on unseen data without constraints.
    pub validation_without: Option<ValidationStatistics>,
    /// Where the surface was changed most, over the supported region.
    pub largest_change: Option<Change>,
}

/// A constraint and how it stands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConstraintReport {
    /// In the words of the specification.
    pub constraint: String,
    /// Proven: over the whole supported region the surface keeps this distance from the bound, the slope (per half range of the
    /// input) or the curvature (per half range squared) this distance from 0; in the unit of the response.
    pub distance: f64,
    /// Where it holds the surface.
    pub points: Vec<Named<f64>>,
}

/// The largest change of a surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// With constraints less without.
    pub value: f64,
    /// Where.
    pub at: Named<f64>,
}

/// What became of the coefficients.
#[derive(Debug, Clone, PartialEq)]
pub enum Constrained {
    /// They keep the constraints as they are.
    Inactive {
        /// Every constraint, as it stands.
        constraints: Vec<ConstraintReport>,
    },
    /// Others keep them.
    Active {
        /// The others.
        coefficients: Vec<f64>,
        /// Every constraint, as it stands.
        constraints: Vec<ConstraintReport>,
        /// Rounds of exchange.
        rounds: usize,
        /// How far inside they are enforced at points, as a share of the spread.
        shift: f64,
        /// Where the surface was changed most.
        largest_change: Change,
    },
    /// None do.
    Infeasible {
        /// Constraints that contradict each other, or the terms.
        constraints: Vec<String>,
    },
    /// Some may, but there is no proof.
    NotProven(NotProven),
}

/// A surface whose coefficients are sought.
pub struct Task<'a> {
    /// With its terms, their least-squares coefficients and its support.
    pub surface: &'a Surface,
    /// Its inputs.
    pub inputs: &'a [Input],
    /// What to keep.
    pub constraints: &'a [Constraint],
    /// The solved problem, with the terms in the order of the surface.
    pub problem: &'a Growing,
    /// Largest less least measured response.
    pub spread: f64,
}

/// What one search says of a claim.
struct Found {
    bound: f64,
    seen: f64,
    /// Where it was seen, shares of the sides of the claim.
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
        let mut points = Points { task: self, free: &free, claims: &claims, lengths: Vec::new(), points: Vec::new() };
        if let Err(constraint) = points.first() {
            return Constrained::Infeasible { constraints: vec![self.constraints[constraint].to_string()] };
        }
        // mutant `0 up`: any seed does.
        let mut random = Random::new(0);
        let mut rounds = Rounds { count: 0, shift: SHIFT };
        let mut is_complete = false;
        let mut stopped_by = Stop::LargestShift;
        while let Some(shift) = rounds.next(is_complete) {
            let (c, active) = match program::shortest(&points.rows(shift), free.len()) {
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
            coefficients = free.iter().zip(&step).map(|(free, step)| (*free + *step).to_f64()).collect();
            found = self.search(&claims, &coefficients);
            let mut local_minima = Vec::new();
            if !self.is_proven(&found) {
                local_minima = points.local_minima(&coefficients, &active, &mut random);
                // A proof is sought where no place is known that would break it.
                if local_minima.is_empty() && self.is_unbroken(&found) {
                    found = self.proof(&claims, &coefficients, found, &mut work);
                }
            }
            if self.is_proven(&found) {
                let held: Vec<(usize, Vec<f64>)> = active
                    .iter()
                    .map(|k| &points.points[*k])
                    .map(|point| (point.claim, claims[point.claim].point(&point.shares)))
                    .collect();
                let constraints = self.reports(&claims, &found, &held);
                let largest_change = self.largest_change(&coefficients);
                return Constrained::Active { coefficients, constraints, rounds: rounds.count, shift, largest_change };
            }
            match points.exchange(&active, &found, &local_minima) {
                // A shift that grows leaves the proof more room.
                Ok(is_new) => is_complete = !is_new,
                Err(constraint) => {
                    return Constrained::Infeasible { constraints: vec![self.constraints[constraint].to_string()] };
                }
            }
        }
        let spent = (MOST_WORK - work.left) as f64 / MOST_WORK as f64;
        Constrained::NotProven(NotProven::new(self, &claims, &found, &rounds, spent, stopped_by))
    }

    /// The constraints that contradict each other at these points: without any one of them the others do not. None where they do so only with a shift
    /// that has grown: what needs a larger one than the first may be possible.
    fn contradiction(&self, points: &Points<'_>) -> Option<Vec<String>> {
        let contradict = |constraints: &[usize]| {
            let is_asked = |k: &usize| constraints.contains(&points.claims[points.points[*k].claim].constraint);
            let rows = points.rows(SHIFT).into_iter().enumerate().filter(|(k, _)| is_asked(k)).map(|(_, row)| row);
            matches!(program::shortest(&rows.collect::<Vec<_>>(), points.free.len()), Solution::Infeasible)
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

    /// What a proof may miss, in the unit of the response, below zero.
    fn enough(&self) -> f64 {
        -SLACK * self.spread
    }

    fn is_proven(&self, found: &[Found]) -> bool {
        found.iter().all(|found| found.bound >= self.enough())
    }

    /// Whether no place was seen where a claim is broken.
    fn is_unbroken(&self, found: &[Found]) -> bool {
        found.iter().all(|found| found.seen >= self.enough())
    }

    /// The least value of every claim over the region, with the usual work.
    fn search(&self, claims: &[Claim], coefficients: &[f64]) -> Vec<Found> {
        let mut found = Vec::new();
        for claim in claims {
            match claim.largest {
                None => found.push(self.least(claim, &claim.monomials(coefficients), self.enough())),
                // One search for all directions.
                Some(0) => found.extend(self.least_curvature(claim, coefficients)),
                Some(_) => {}
            }
        }
        found
    }

    /// A certificate for every claim whose bound is not enough.
    fn proof(&self, claims: &[Claim], coefficients: &[f64], mut found: Vec<Found>, work: &mut Work) -> Vec<Found> {
        let inputs = self.inputs.len();
        for (k, claim) in claims.iter().enumerate() {
            let count = if claim.largest.is_some() { inputs } else { 1 };
            if claim.largest.unwrap_or(0) > 0 || found[k..k + count].iter().all(|found| found.bound >= self.enough()) {
                continue;
            }
            let monomials = claim.monomials(coefficients);
            let (entries, enough) = match claim.largest {
                None => (vec![monomials], self.enough()),
                Some(_) => (curvature::entries(&monomials, inputs), self.enough() / inputs as f64),
            };
            let given = work.left.min(MOST_WORK / WORK_SHARES);
            let mut own = Work { left: given };
            let bound = squares::least_eigenvalue(&entries, &claim.sides[..inputs], &self.surface.support, enough, &mut own);
            work.left -= given - own.left;
            if let Some(bound) = bound {
                found[k..k + count].iter_mut().for_each(|found| found.bound = curvature::of_directions(bound, count));
            }
        }
        found
    }

    /// What one search for the least curvature says of the claims of all directions in a piece: each has its bound, and the worst place belongs to the one whose entry is the
    /// largest of that direction.
    fn least_curvature(&self, first: &Claim, coefficients: &[f64]) -> Vec<Found> {
        let inputs = self.inputs.len();
        let (measure, hessian) = (LeastEigenvalue(inputs), curvature::entries(&first.monomials(coefficients), inputs));
        let place = |cell: &[[f64; 2]]| self.place(first, cell);
        let enough = self.enough() / inputs as f64;
        let wanted = Search { place: &place, finest: finest(inputs), enough };
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

    fn least(&self, claim: &Claim, monomials: &[bernstein::Monomial], enough: f64) -> Found {
        let place = |cell: &[[f64; 2]]| self.place(claim, cell);
        let wanted = Search { place: &place, finest: finest(self.inputs.len()), enough };
        let found = bernstein::least(monomials, &claim.sides, &wanted);
        Found { bound: found.bound, seen: found.seen, shares: found.at }
    }

    /// Where a cell of a claim, given as shares of its sides, lies in the support.
    fn place(&self, claim: &Claim, cell: &[[f64; 2]]) -> Place {
        let variable = |(side, shares): (&Interval, &[f64; 2])| {
            let at = |share: f64| {
                Interval::point(side.low) + Interval::point(share) * (Interval::point(side.high) - Interval::point(side.low))
            };
            at(shares[0]).hull(at(shares[1]))
        };
        let cell: Vec<Interval> = claim.sides.iter().zip(cell).take(self.inputs.len()).map(variable).collect();
        let of_one = |space: &HalfSpace| {
            let parts = space.normal.iter().zip(&cell).map(|(n, x)| Interval::point(*n) * *x);
            let sum = parts.fold(Interval::point(0.0), |sum, part| sum + part);
            if sum.low > space.bound {
                Place::Outside
            } else if sum.high > space.bound {
                Place::Partly
            } else {
                Place::Inside
            }
        };
        let places: Vec<Place> = self.surface.support.iter().map(of_one).collect();
        if places.contains(&Place::Outside) {
            Place::Outside
        } else if places.contains(&Place::Partly) {
            Place::Partly
        } else {
            Place::Inside
        }
    }

    fn reports(&self, claims: &[Claim], found: &[Found], held: &[(usize, Vec<f64>)]) -> Vec<ConstraintReport> {
        let of_one = |(k, constraint): (usize, &Constraint)| {
            let bounds = claims.iter().zip(found).filter(|(claim, _)| claim.constraint == k).map(|(_, found)| found.bound);
            let mut points: Vec<Named<f64>> = Vec::new();
            for (claim, point) in held {
                let point = self.natural(point);
                // Neighbours of one place, as exchange leaves them, are told once.
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
                let found = self.least(&claim, &turned, f64::INFINITY);
                // mutant `< to <=`: of two changes of one size either is the largest.
                if found.seen.is_finite() && found.seen < -f64::abs(largest.0) {
                    largest = (sign * found.seen, claim.point(&found.shares));
                }
            }
        }
        Change { value: largest.0, at: self.natural(&largest.1) }
    }
}

/// Rounds of exchange, and how far inside each enforces the constraints.
struct Rounds {
    count: usize,
    shift: f64,
}

impl Rounds {
    /// The shift of the next round. `is_complete`: all places are known, and only the proof is missing. None where it would be too large.
    fn next(&mut self, is_complete: bool) -> Option<f64> {
        self.count += 1;
        self.shift *= match (is_complete, self.count > SHIFTED_ROUNDS) {
            (true, _) => GROWTH_OF_PROOF,
            (false, true) => GROWTH,
            (false, false) => 1.0,
        };
        (self.shift <= MOST_SHIFT).then_some(self.shift)
    }
}

/// Cells of the support's edge no wider than this share of a side count as a whole: some thousand of them with each number of inputs.
fn finest(inputs: usize) -> f64 {
    const OF_INPUTS: [f64; 6] = [1.0 / 1024.0, 1.0 / 1024.0, 1.0 / 1024.0, 1.0 / 64.0, 1.0 / 16.0, 1.0 / 8.0];
    OF_INPUTS[inputs.min(OF_INPUTS.len() - 1)]
}

/// xi of x, within the range of the input; of a symmetric one its magnitude.
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

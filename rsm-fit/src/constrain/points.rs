//! The points at which constraints are enforced, and their exchange.
//!
//! In: claims, the solved problem. Out: the rows of the least-distance program. After each round, inactive points are dropped and points where a
//! claim is violated are added. Does not solve the program and proves nothing.

use rsm_core::bernstein::Place;

use super::claim::Claim;
use super::local_minima::BoxPolynomial;
use super::program::Row;
use super::{Found, Task};
use crate::dd::Dd;
use crate::random::Random;

/// The number of random points for each round and claim from which a descent searches for a violation. Further descents start from the active points.
const DRAWN: usize = 48;

/// Up to this number of claims, each gets all its random points; with more claims, each is smaller.
const MOST_FULL: usize = 32;

/// The largest number of points added for one claim in a round.
const MOST_PLACES: usize = 48;

/// A point that has been inactive for this many rounds is dropped. The residual sum of squares rises from round to round, so points of an earlier
/// round do not return forever.
const MOST_INACTIVE_ROUNDS: usize = 6;

/// The number of points of the first round, for all claims together. A search takes a millisecond and gives the worst point; the program takes ten
/// times as long with a thousand rows as with a hundred.
const FIRST_POINTS: usize = 150;

/// At most so many claims get points of the first round. A piece between knots is a claim, and so is a part of a sigmoid.
const MOST_WITH_POINTS: usize = 600;

/// A row with at least 1/100 of the length of its claim's longest row gets the full shift.
const NEAR_ZERO: f64 = 100.0;

/// The points at which claims are enforced.
pub(super) struct Points<'a> {
    pub task: &'a Task<'a>,
    /// The coefficients of the terms without constraints.
    pub free: &'a [Dd],
    pub claims: &'a [Claim],
    /// The longest row of each claim among its first points.
    pub lengths: Vec<f64>,
    pub points: Vec<Point>,
}

/// A point at which a claim is enforced: normal . c >= least + shift * gain.
pub(super) struct Point {
    pub claim: usize,
    /// Shares of the sides of the claim.
    pub shares: Vec<f64>,
    /// Of length 1.
    normal: Vec<Dd>,
    least: Dd,
    gain: Dd,
    /// The number of rounds in which it was inactive.
    inactive_rounds: usize,
    /// Whether it belongs to the first grid, which is kept.
    is_first: bool,
}

impl Points<'_> {
    /// Creates a grid for every claim. An error has the index of a constraint that no coefficients can meet.
    pub(super) fn first(&mut self) -> Result<(), usize> {
        for (k, claim) in self.claims.iter().enumerate() {
            let points = self.grid(claim);
            let length = |shares: &Vec<f64>| norm(&claim.row(&claim.point(shares)));
            self.lengths.push(points.iter().map(length).fold(0.0, f64::max));
            // Of very many claims, the parts of a surface with sigmoids, only some get points. The search finds what the others need.
            if k % self.claims.len().div_ceil(MOST_WITH_POINTS) > 0 {
                continue;
            }
            for point in points {
                self.push(k, point, true)?;
            }
        }
        Ok(())
    }

    /// The points of a grid over the sides of a claim that are in the region, as shares of the sides.
    fn grid(&self, claim: &Claim) -> Vec<Vec<f64>> {
        let axes = claim.sides.len();
        let wanted = FIRST_POINTS / self.claims.len();
        // mutant `3 down`: two steps are the smallest number.
        let steps = (3..=16usize).take_while(|steps| steps.pow(axes as u32) <= wanted).last().unwrap_or(2);
        let mut shares = vec![Vec::new()];
        for _ in 0..axes {
            let next = |begun: &Vec<f64>| {
                (0..steps).map(|k| [&begun[..], &[k as f64 / (steps - 1) as f64]].concat()).collect::<Vec<_>>()
            };
            shares = shares.iter().flat_map(next).collect();
        }
        shares.retain(|shares| self.is_inside(claim, shares));
        shares
    }

    /// Whether a point of a claim may be in the region.
    fn is_inside(&self, claim: &Claim, shares: &[f64]) -> bool {
        let cell: Vec<[f64; 2]> = shares.iter().map(|share| [*share, *share]).collect();
        self.task.place(claim, &cell) != Place::Outside
    }

    /// The rows of the program.
    pub(super) fn rows(&self, shift: f64) -> Vec<Row> {
        let row = |point: &Point| Row { normal: point.normal.clone(), distance: point.least + Dd::from(shift) * point.gain };
        self.points.iter().map(row).collect()
    }

    /// The local minima where a claim is violated. Descents start from the active points and from random points.
    pub(super) fn local_minima(&self, coefficients: &[f64], active: &[usize], random: &mut Random) -> Vec<(usize, Vec<f64>)> {
        let mut found = Vec::new();
        for (k, claim) in self.claims.iter().enumerate() {
            let sides: Vec<[f64; 2]> = claim.sides.iter().map(|side| [side.low, side.high]).collect();
            let held = active.iter().map(|point| &self.points[*point]).filter(|point| point.claim == k);
            let mut starts: Vec<Vec<f64>> = held.map(|point| point.shares.clone()).collect();
            // mutant `0 up`: one start less of many.
            // mutant `DRAWN doubled`: more starts. The search finds what they miss, one round later.
            let drawn = (DRAWN * MOST_FULL / self.claims.len()).clamp(2, DRAWN);
            starts.extend((0..drawn).map(|_| sides.iter().map(|_| random.share()).collect()));
            let polynomial_on_box = BoxPolynomial::new(&claim.monomials(coefficients), sides);
            let broken = polynomial_on_box.below(self.task.enough(), &starts, &|shares| self.is_inside(claim, shares));
            // mutant `MOST_PLACES doubled`: the others are added in the next round.
            found.extend(broken.into_iter().take(MOST_PLACES).map(|minimum| (k, minimum.shares)));
        }
        found
    }

    /// Drops inactive points, and adds points where claims are violated: the worst ones from a search, and the local minima. Returns whether any of
    /// them is new.
    pub(super) fn exchange(
        &mut self,
        active: &[usize],
        found: &[Found],
        local_minima: &[(usize, Vec<f64>)],
    ) -> Result<bool, usize> {
        for (k, point) in self.points.iter_mut().enumerate() {
            point.inactive_rounds = if active.contains(&k) { 0 } else { point.inactive_rounds + 1 };
        }
        self.points.retain(|point| point.is_first || point.inactive_rounds < MOST_INACTIVE_ROUNDS);
        let count = self.points.len();
        let worst = found.iter().enumerate().filter(|(_, found)| found.seen < self.task.enough());
        let worst = worst.map(|(k, found)| (k, found.shares.clone()));
        for (k, shares) in worst.chain(local_minima.iter().cloned()) {
            if !self.points.iter().any(|point| point.claim == k && point.shares == shares) {
                self.push(k, shares, false)?;
            }
        }
        Ok(self.points.len() > count)
    }

    fn push(&mut self, k: usize, shares: Vec<f64>, is_first: bool) -> Result<(), usize> {
        let claim = &self.claims[k];
        let row = claim.row(&claim.point(&shares));
        let value: Dd = row.iter().zip(self.free).map(|(x, b)| *x * *b).sum::<Dd>() + claim.offset();
        // Where a claim hardly depends on the coefficients (for example near the origin, for a surface without constant term), the shift is reduced
        // in proportion.
        let share = (NEAR_ZERO * norm(&row) / self.lengths[k]).min(1.0);
        let projected = self.task.problem.projected(self.task.in_problem(&row));
        let length = projected.iter().map(|x| *x * *x).sum::<Dd>().sqrt();
        if length == Dd::ZERO {
            // The claim does not depend on the coefficients here: it is met or not.
            let holds = value.to_f64() >= self.task.enough();
            return if holds { Ok(()) } else { Err(claim.constraint) };
        }
        let gain = Dd::from(self.task.spread * share) / length;
        let normal = projected.into_iter().map(|x| x / length).collect();
        let least = Dd::ZERO - value / length;
        self.points.push(Point { claim: k, shares, normal, least, gain, inactive_rounds: 0, is_first });
        Ok(())
    }
}

fn norm(row: &[Dd]) -> f64 {
    row.iter().map(|x| *x * *x).sum::<Dd>().sqrt().to_f64()
}

#[cfg(test)]
mod tests;

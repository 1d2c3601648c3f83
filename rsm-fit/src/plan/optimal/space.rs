//! The region of an optimal design, and the terms that it must estimate.
//!
//! In: terms as powers of coded variables; a box, levels, half-spaces or candidates. Out: the row of a point, rows along a line, random points,
//! moments. Chooses no run.

use super::linear::{add_square, dot};
use crate::plan::design::Condition;
use crate::random::Random;

/// A point counts as on a bound if it exceeds it by at most this part of a half range, because of rounding.
pub(super) const ON_A_FACE: f64 = 1e-9;

/// The number of points for moments without a formula. The error of the mean is about a hundredth, which is enough to choose between designs.
const POINTS: usize = 8192;

/// The number of combinations of levels up to which all of them are used in place of random points.
const COMBINATIONS: usize = 65_536;

/// The number of draws after which a region counts as empty.
const DRAWS: usize = 200_000;

/// Terms and region, in coded variables.
#[derive(Debug, Clone, Default)]
pub(in crate::plan) struct Space {
    /// For each term, one power for each factor.
    pub terms: Vec<Vec<u32>>,
    /// The two ends of each factor's range.
    pub ends: Vec<[f64; 2]>,
    /// The allowed levels of a factor, ascending; `None` if all values within the ends are allowed.
    pub levels: Vec<Option<Vec<f64>>>,
    /// The conditions on every point, in coded variables; only `at_most` is used.
    pub conditions: Vec<Condition>,
    /// The only allowed points; `None` if all points of the region are allowed.
    pub candidates: Option<Vec<Vec<f64>>>,
}

impl Space {
    /// The terms at a point.
    pub(in crate::plan) fn row(&self, point: &[f64]) -> Vec<f64> {
        let term = |powers: &Vec<u32>| powers.iter().zip(point).fold(1.0, |product, (power, x)| product * raised(*x, *power));
        self.terms.iter().map(term).collect()
    }

    /// The terms at `point + t direction`, as coefficients of t^0, t^1, ...
    pub(super) fn rows_along(&self, point: &[f64], direction: &[f64]) -> Vec<Vec<f64>> {
        let degree =
            |powers: &Vec<u32>| powers.iter().zip(direction).filter(|(_, d)| **d != 0.0).map(|(power, _)| *power).sum::<u32>();
        let most = self.terms.iter().map(degree).max().unwrap_or(0) as usize;
        let mut rows = vec![vec![0.0; self.terms.len()]; most + 1];
        let mut product = Vec::with_capacity(most + 1);
        for (k, powers) in self.terms.iter().enumerate() {
            product.clear();
            product.push(1.0);
            for ((power, x), d) in powers.iter().zip(point).zip(direction) {
                for _ in 0..*power {
                    if *d == 0.0 {
                        product.iter_mut().for_each(|c| *c *= x);
                        continue;
                    }
                    product.push(0.0);
                    for m in (0..product.len()).rev() {
                        product[m] = product[m] * x + if m > 0 { product[m - 1] * d } else { 0.0 };
                    }
                }
            }
            for (row, c) in rows.iter_mut().zip(&product) {
                row[k] = *c;
            }
        }
        rows
    }

    /// Whether a point is in the box and fulfils all conditions.
    pub(in crate::plan) fn holds(&self, point: &[f64]) -> bool {
        let in_box = self.ends.iter().zip(point).all(|([low, high], x)| *x >= low - ON_A_FACE && *x <= high + ON_A_FACE);
        in_box && self.conditions.iter().all(|condition| slack(condition, point) >= -ON_A_FACE)
    }

    /// The interval of t in which `point + t direction` is in the region; `None` if there is none.
    pub(super) fn reach(&self, point: &[f64], direction: &[f64]) -> Option<[f64; 2]> {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut keep = |slope: f64, room: f64| {
            // slope t <= room.
            if slope > 0.0 {
                high = high.min(room / slope);
            } else if slope < 0.0 {
                low = low.max(room / slope);
            }
            slope != 0.0 || room >= -ON_A_FACE
        };
        let mut is_in = true;
        for (([least, most], x), d) in self.ends.iter().zip(point).zip(direction) {
            is_in &= keep(*d, most - x) && keep(-d, x - least);
        }
        for condition in &self.conditions {
            let slope = dot(&condition.weights, direction);
            // Rounding error of a line along the face.
            let slope = if slope.abs() < 1e-12 { 0.0 } else { slope };
            is_in &= keep(slope, slack(condition, point));
        }
        (is_in && low <= high && low.is_finite() && high.is_finite()).then_some([low, high])
    }

    /// The normals of the conditions on whose faces a point lies.
    pub(super) fn faces(&self, point: &[f64]) -> Vec<&[f64]> {
        let on = |condition: &&Condition| slack(condition, point).abs() <= ON_A_FACE;
        self.conditions.iter().filter(on).map(|condition| condition.weights.as_slice()).collect()
    }

    /// A uniformly distributed random point; `None` if no draw is in the region.
    pub(in crate::plan) fn anywhere(&self, random: &mut Random) -> Option<Vec<f64>> {
        if let Some(candidates) = &self.candidates {
            return Some(candidates[random.below(candidates.len() as u64) as usize].clone());
        }
        let coordinate = |(k, [low, high]): (usize, &[f64; 2]), random: &mut Random| match &self.levels[k] {
            Some(levels) => levels[random.below(levels.len() as u64) as usize],
            None => low + (high - low) * random.share(),
        };
        (0..DRAWS).find_map(|_| {
            let point: Vec<f64> = self.ends.iter().enumerate().map(|of| coordinate(of, random)).collect();
            self.holds(&point).then_some(point)
        })
    }

    /// The mean of the products of two terms over the region, row by row, with `more` rows and columns of zeros added; `None` if the region is empty.
    pub(in crate::plan) fn moments(&self, more: usize) -> Option<Vec<f64>> {
        let (p, q) = (self.terms.len(), self.terms.len() + more);
        let mut moments = vec![0.0; q * q];
        if let (None, true) = (&self.candidates, self.conditions.is_empty()) {
            for (i, one) in self.terms.iter().enumerate() {
                for (j, other) in self.terms.iter().enumerate() {
                    let of = |(k, (a, b)): (usize, (&u32, &u32))| self.moment(k, a + b);
                    moments[i * q + j] = one.iter().zip(other).enumerate().map(of).product();
                }
            }
            return Some(moments);
        }
        let drawn: Vec<Vec<f64>>;
        let points = match &self.candidates {
            Some(candidates) => candidates,
            None => {
                drawn = self.drawn();
                &drawn
            }
        };
        let mut small = vec![0.0; p * p];
        for point in points {
            add_square(&mut small, 1.0 / points.len() as f64, &self.row(point));
        }
        for i in 0..p {
            moments[i * q..i * q + p].copy_from_slice(&small[i * p..(i + 1) * p]);
        }
        (!points.is_empty()).then_some(moments)
    }

    /// Points that represent the region, each with the same share of it: the candidates, all combinations of a few levels, or the random points of
    /// [`Space::moments`]. Empty if no point is in the region.
    pub(in crate::plan) fn sample(&self) -> Vec<Vec<f64>> {
        if let Some(candidates) = &self.candidates {
            return candidates.clone();
        }
        let levels: Option<Vec<Vec<f64>>> = self.levels.iter().cloned().collect();
        let combinations = |all: &Vec<Vec<f64>>| all.iter().fold(1usize, |count, levels| count.saturating_mul(levels.len()));
        if let Some(levels) = levels.filter(|all| combinations(all) <= COMBINATIONS) {
            let mut points = crate::plan::points::full_factorial(&levels);
            points.retain(|point| self.holds(point));
            return points;
        }
        self.drawn()
    }

    /// A fixed stream, so that a criterion does not depend on the seed of the plan.
    fn drawn(&self) -> Vec<Vec<f64>> {
        let mut random = Random::new(0);
        (0..POINTS).map_while(|_| self.anywhere(&mut random)).collect()
    }

    /// The mean of a power of a factor.
    fn moment(&self, factor: usize, power: u32) -> f64 {
        match &self.levels[factor] {
            Some(levels) => levels.iter().map(|x| raised(*x, power)).sum::<f64>() / levels.len() as f64,
            None => {
                let [low, high] = self.ends[factor];
                (raised(high, power + 1) - raised(low, power + 1)) / (f64::from(power + 1) * (high - low))
            }
        }
    }

    /// Whether every factor may have any value within its ends.
    pub(in crate::plan) fn is_continuous(&self) -> bool {
        self.candidates.is_none() && self.levels.iter().all(Option::is_none)
    }
}

/// The distance to the bound.
fn slack(condition: &Condition, point: &[f64]) -> f64 {
    condition.at_most.unwrap_or(f64::INFINITY) - dot(&condition.weights, point)
}

/// x^power by multiplication, because `powi` may differ between machines.
pub(super) fn raised(x: f64, power: u32) -> f64 {
    (0..power).fold(1.0, |product, _| product * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::monomials_up_to;

    fn square() -> Space {
        Space { terms: monomials_up_to(2, 2), ends: vec![[-1.0, 1.0]; 2], levels: vec![None; 2], ..Space::default() }
    }

    #[test]
    fn terms_are_counted_and_rows_along_a_line_are_rows() {
        for (factors, order, count) in [(2, 2, 6), (3, 3, 20), (5, 2, 21), (1, 4, 5)] {
            assert_eq!(monomials_up_to(factors, order).len(), count);
        }
        assert_eq!(monomials_up_to(2, 2), [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]);
        let space = square();
        let (point, direction) = ([0.5, -0.25], [1.0, 2.0]);
        let along = space.rows_along(&point, &direction);
        let t = 0.5;
        let row = space.row(&[1.0, 0.75]);
        for (k, value) in row.iter().enumerate() {
            // Dyadic numbers: exact.
            assert_eq!(along[0][k] + t * along[1][k] + t * t * along[2][k], *value);
        }
    }

    #[test]
    fn lines_end_at_the_box_and_at_conditions() {
        let mut space = square();
        assert_eq!(space.reach(&[0.5, 0.0], &[1.0, 0.0]), Some([-1.5, 0.5]));
        space.conditions.push(Condition { weights: vec![1.0, 1.0], at_most: Some(0.75), at_least: None });
        assert_eq!(space.reach(&[0.5, 0.0], &[1.0, 0.0]), Some([-1.5, 0.25]));
        assert_eq!(space.faces(&[0.5, 0.25]), [&[1.0, 1.0]]);
        // Along the face.
        assert_eq!(space.reach(&[0.5, 0.25], &[1.0, -1.0]), Some([-0.75, 0.5]));
        assert!(space.holds(&[0.5, 0.25]) && !space.holds(&[0.5, 0.3]));
    }

    #[test]
    fn moments_of_a_box_are_those_of_its_formula_and_near_those_of_points() {
        let mut space = square();
        let exact = space.moments(1).unwrap();
        // 1, x^2: 1/3; x^2 y^2: 1/9; x^4: 1/5; behind, zeros.
        assert!((exact[8] - 1.0 / 3.0).abs() < 1e-15 && (exact[3 * 7 + 3] - 0.2).abs() < 1e-15 && exact[3] == exact[8]);
        assert!((exact[3 * 7 + 5] - 1.0 / 9.0).abs() < 1e-15 && exact[6 * 7 + 6] == 0.0);
        space.conditions.push(Condition { weights: vec![1.0, 0.0], at_most: Some(5.0), at_least: None });
        for (drawn, exact) in space.moments(1).unwrap().iter().zip(&exact) {
            // A mean of 8192 numbers of a standard deviation below 0.6: five of them.
            assert!((drawn - exact).abs() < 0.033, "{drawn} {exact}");
        }
    }
}

//! The region in scaled variables, t in [-1, 1] for every side, and polynomials that are not negative in it.
//!
//! In: sides, half-spaces, polynomials of x. Out: polynomials of t that enclose them, and weights: polynomials of t whose coefficients are exact in
//! f64. The enclosures cover the whole region, including rounding errors.

use std::collections::BTreeMap;

use rsm_core::bernstein::Monomial;
use rsm_core::interval::Interval;
use rsm_core::model::HalfSpace;

/// Powers with an enclosure of the coefficient. Terms that are exactly 0 are left out.
pub(super) type Polynomial = BTreeMap<Vec<u32>, Interval>;

/// A polynomial of t that is not negative in the region.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Weight {
    pub terms: Vec<(Vec<u32>, f64)>,
}

impl Weight {
    pub(super) fn degree(&self) -> u32 {
        self.terms.iter().map(|(powers, _)| powers.iter().sum()).max().unwrap_or(0)
    }
}

/// More than the rounding error of a sum with one number for each input.
const ROUNDING: f64 = 1e-9;

/// x = centre + half t.
pub(super) struct Scaling {
    centres: Vec<f64>,
    halves: Vec<f64>,
}

impl Scaling {
    /// The scaling in which every x of a side has its t in [-1, 1].
    pub(super) fn of(sides: &[Interval]) -> Self {
        let centres: Vec<f64> = sides.iter().map(|side| side.low.midpoint(side.high)).collect();
        let half = |(side, centre): (&Interval, &f64)| {
            let exact = (side.high - centre).max(centre - side.low);
            // A side of width 0 has no variable t.
            if side.low == side.high { 0.0 } else { exact.next_up() }
        };
        let halves = sides.iter().zip(&centres).map(half).collect();
        Scaling { centres, halves }
    }

    /// The polynomial of t.
    pub(super) fn polynomial(&self, monomials: &[Monomial]) -> Polynomial {
        let mut sum = Polynomial::new();
        for Monomial { powers, coefficient } in monomials {
            let mut product = vec![(Vec::new(), *coefficient)];
            for (k, power) in powers.iter().enumerate() {
                let factor = self.power(k, *power);
                let longer = |(begun, value): &(Vec<u32>, Interval)| {
                    let with = |(j, of_t): (usize, &Interval)| ([&begun[..], &[j as u32]].concat(), *value * *of_t);
                    factor.iter().enumerate().map(with).collect::<Vec<_>>()
                };
                product = product.iter().flat_map(longer).collect();
            }
            for (powers, value) in product {
                let entry = sum.entry(powers).or_insert(Interval::point(0.0));
                *entry = *entry + value;
            }
        }
        sum.retain(|_, value| *value != Interval::point(0.0));
        sum
    }

    /// The coefficients of (c + h t)^power, the lowest first.
    fn power(&self, k: usize, power: u32) -> Vec<Interval> {
        let mut product = vec![Interval::point(1.0)];
        for _ in 0..power {
            let mut next = vec![Interval::point(0.0); product.len() + 1];
            for (j, coefficient) in product.iter().enumerate() {
                next[j] = next[j] + *coefficient * Interval::point(self.centres[k]);
                next[j + 1] = next[j + 1] + *coefficient * Interval::point(self.halves[k]);
            }
            product = next;
        }
        product
    }

    /// Weights of the variables `axes`: 1, 1 - t_k^2, the products of the distances from an end of one side and an end of another, and for every
    /// half-space that cuts the box the distance from it. `None` if no point of the box is in all half-spaces.
    ///
    /// With the first two alone, sums of squares exist. The products allow a lower degree or fewer cells (Schmuedgen 1991, Mathematische Annalen
    /// 289): 3 cells in place of 11 for a surface of four inputs.
    pub(super) fn weights(&self, spaces: &[HalfSpace], axes: &[usize]) -> Option<Vec<Weight>> {
        let monomial = |factors: &[usize]| {
            axes.iter().map(|k| factors.iter().filter(|factor| *factor == k).count() as u32).collect::<Vec<u32>>()
        };
        let mut weights = vec![Weight { terms: vec![(monomial(&[]), 1.0)] }];
        for k in axes {
            weights.push(Weight { terms: vec![(monomial(&[]), 1.0), (monomial(&[*k, *k]), -1.0)] });
        }
        for (place, a) in axes.iter().enumerate() {
            for b in &axes[..place] {
                for [s, r] in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
                    let terms =
                        // mutant `* to /`: both are 1 or -1.
                        [(monomial(&[]), 1.0), (monomial(&[*a]), s), (monomial(&[*b]), r), (monomial(&[*a, *b]), s * r)];
                    weights.push(Weight { terms: terms.to_vec() });
                }
            }
        }
        for space in spaces {
            let is_across = |k: usize| space.normal[k] != 0.0 && self.halves[k] > 0.0 && !axes.contains(&k);
            if (0..self.halves.len()).any(is_across) {
                continue;
            }
            let mut constant = Interval::point(space.bound);
            let mut terms = Vec::new();
            for k in 0..self.halves.len() {
                let normal = Interval::point(space.normal[k]);
                constant = constant - normal * Interval::point(self.centres[k]);
                let slope = normal * Interval::point(-self.halves[k]);
                let middle = slope.low.midpoint(slope.high);
                // |t_k| is at most 1, so the constant changes by at most this.
                constant = constant + Interval::point(slope_error(slope, middle));
                if middle != 0.0 {
                    terms.push((monomial(&[k]), middle));
                }
            }
            let reach: f64 = terms.iter().map(|(_, slope)| slope.abs()).sum();
            if holds_everywhere(constant.high, reach) {
                continue;
            }
            if holds_nowhere(constant.high, reach) {
                return None;
            }
            terms.push((monomial(&[]), constant.high));
            weights.push(Weight { terms });
        }
        Some(weights)
    }
}

/// An upper bound of the difference between a slope and a number inside its enclosure.
fn slope_error(slope: Interval, middle: f64) -> f64 {
    (slope.high - middle).max(middle - slope.low).next_up()
}

/// Whether a constant plus terms of at most this size is never negative: the half-space does not cut the box.
fn holds_everywhere(constant: f64, reach: f64) -> bool {
    constant >= reach
}

/// Whether it is negative everywhere, with certainty.
fn holds_nowhere(constant: f64, reach: f64) -> bool {
    constant < -reach * (1.0 + ROUNDING)
}

#[cfg(test)]
impl Scaling {
    /// The centres and halves as exact numbers.
    pub(super) fn exact(&self) -> (Vec<rsm_core::number::Rational>, Vec<rsm_core::number::Rational>) {
        let all = |values: &[f64]| values.iter().map(|value| rsm_core::number::exact(*value)).collect();
        (all(&self.centres), all(&self.halves))
    }
}

#[cfg(test)]
mod tests;

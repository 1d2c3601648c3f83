//! Half-spaces that cut a cell of a search: a better bound of the values inside.
//!
//! In: lower bounds of a measure at the joint Bernstein coefficients of a cell, half-spaces. Out: a lower bound of the measure where all half-spaces
//! hold. With L(x) = n . x - bound, which is not positive there, and any factor f >= 0, the measure is at least measure + f L. L is linear, so it has
//! Bernstein coefficients of every degree: its values at the points of a regular grid. The sum is at least its smallest coefficient (weak duality of
//! Lagrange). Without it, a cell at the edge counts as a whole, however far beyond the edge its worst point is.

use crate::interval::Interval;
use crate::model::HalfSpace;

/// The largest number of pivots; a few more than half-spaces that are active at one point are usual.
const MOST_PIVOTS: usize = 40;

/// An entry below this share of the largest one in its row is rounding error and no pivot.
const NO_PIVOT: f64 = 1e-9;

/// L as a function of shares of the sides: the factor of each share, and the value where all are 0.
pub(super) struct Edge {
    slopes: Vec<Interval>,
    start: Interval,
}

impl Edge {
    pub(super) fn all(spaces: &[HalfSpace], sides: &[Interval]) -> Vec<Edge> {
        let of_one = |space: &HalfSpace| {
            let normals = || space.normal.iter().map(|n| Interval::point(*n)).zip(sides);
            let low = normals().fold(-Interval::point(space.bound), |sum, (n, side)| sum + n * Interval::point(side.low));
            let width = |side: &Interval| Interval::point(side.high) - Interval::point(side.low);
            Edge { slopes: normals().map(|(n, side)| n * width(side)).collect(), start: low }
        };
        spaces.iter().map(of_one).collect()
    }

    /// Whether it cuts a cell: whether L is positive somewhere. In f64; a mistake by rounding costs some of the bound.
    fn is_cutting(&self, spans: &[[f64; 2]]) -> bool {
        let most = |(slope, [low, high]): (&Interval, &[f64; 2])| (slope.high * low).max(slope.high * high);
        self.slopes.iter().zip(spans).map(most).sum::<f64>() + self.start.high > 0.0
    }

    /// The lower ends of L's Bernstein coefficients over a cell. Along a variable of degree 0, the smaller end of the side.
    fn along(&self, degrees: &[usize], spans: &[[f64; 2]]) -> Vec<f64> {
        let mut all = Vec::with_capacity(degrees.iter().map(|degree| degree + 1).product());
        all.push(self.start.low);
        for ((slope, degree), [low, high]) in self.slopes.iter().zip(degrees).zip(spans) {
            let at = |share: Interval| (*slope * share).low;
            let ends = [Interval::point(*low), Interval::point(*high)];
            let each: Vec<f64> = if *degree == 0 {
                vec![at(ends[0]).min(at(ends[1]))]
            } else {
                let share = |k: usize| {
                    let part = k as f64 / *degree as f64;
                    let part = Interval::new(part.next_down(), part.next_up());
                    ends[0] + part * (ends[1] - ends[0])
                };
                (0..=*degree).map(|k| at(share(k))).collect()
            };
            // In place from the end, so that no number is overwritten before it is used.
            let (before, length) = (all.len(), each.len());
            all.resize(before * length, 0.0);
            for k in (0..before).rev() {
                let sum = all[k];
                each.iter().enumerate().for_each(|(j, part)| all[k * length + j] = (sum + part).next_down());
            }
        }
        all
    }
}

/// The lower bound, and the number of multiplications. It needs no accuracy of the factors: whatever is not negative gives a bound.
pub(super) fn raised(lows: &[f64], edges: &[Edge], degrees: &[usize], spans: &[[f64; 2]]) -> (f64, usize) {
    let cutting = edges.iter().filter(|edge| edge.is_cutting(spans));
    let cutting: Vec<Vec<f64>> = cutting.map(|edge| edge.along(degrees, spans)).collect();
    let (factors, pivots) = best_factors(lows, &cutting);
    let raised = |(k, low): (usize, &f64)| {
        let add = |sum: f64, (along, factor): (&Vec<f64>, &f64)| (sum + (factor * along[k]).next_down()).next_down();
        cutting.iter().zip(&factors).filter(|(_, factor)| **factor > 0.0).fold(*low, add)
    };
    let size = (cutting.len() + 1) * (lows.len() + cutting.len());
    (lows.iter().enumerate().map(raised).fold(f64::INFINITY, f64::min), (pivots + 2) * size)
}

/// The factors f >= 0 with nearly the largest min over k of lows[k] + sum of f[e] along[e][k], by the dual simplex method (Lemke 1954). The linear
/// program is that of weights w of the coefficients: the smallest w . lows where w >= 0, sum of w = 1, w . along[e] <= 0. The factors are the reduced
/// costs of its slack variables. It starts from the smallest coefficient alone. Also the number of pivots.
fn best_factors(lows: &[f64], along: &[Vec<f64>]) -> (Vec<f64>, usize) {
    let (count, rows) = (lows.len(), along.len());
    let Some(first) = (0..count).min_by(|a, b| lows[*a].total_cmp(&lows[*b])) else { return (vec![0.0; rows], 0) };
    let width = count + rows;
    // The column of weights comes first, then that of slack variables, then the right-hand side.
    let mut costs: Vec<f64> = lows.iter().map(|low| low - lows[first]).chain(vec![0.0; rows]).collect();
    let mut table = vec![vec![0.0; width + 1]; rows + 1];
    table[0][..count].fill(1.0);
    table[0][width] = 1.0;
    for (e, along) in along.iter().enumerate() {
        let line = &mut table[e + 1];
        line.iter_mut().zip(along).for_each(|(entry, l)| *entry = l - along[first]);
        line[count + e] = 1.0;
        line[width] = -along[first];
    }
    let mut pivots = 0;
    while pivots < MOST_PIVOTS {
        let Some(row) = (0..=rows).min_by(|a, b| table[*a][width].total_cmp(&table[*b][width])) else { break };
        let largest = table[row][..width].iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
        if table[row][width] >= 0.0 || !largest.is_finite() {
            break;
        }
        let ratio = |k: &usize| costs[*k] / -table[row][*k];
        let falls = |k: &usize| table[row][*k] < -NO_PIVOT * largest;
        // Without a column, no mixture of the coefficients is in all half-spaces.
        let Some(column) = (0..width).filter(falls).min_by(|a, b| ratio(a).total_cmp(&ratio(b))) else { break };
        let pivot = table[row][column];
        table[row].iter_mut().for_each(|entry| *entry /= pivot);
        let line = table[row].clone();
        for (_, other) in table.iter_mut().enumerate().filter(|(k, _)| *k != row) {
            let share = other[column];
            other.iter_mut().zip(&line).for_each(|(entry, own)| *entry -= share * own);
        }
        pivots += 1;
        let share = costs[column];
        costs.iter_mut().zip(&line).for_each(|(cost, own)| *cost -= share * own);
    }
    let positive = |factor: &f64| if *factor > 0.0 && factor.is_finite() { *factor } else { 0.0 };
    (costs[count..].iter().map(positive).collect(), pivots)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_an_edge_the_work_is_two_passes_over_the_coefficients() {
        assert_eq!(raised(&[1.0, 2.0, 0.5], &[], &[2], &[[0.0, 1.0]]), (0.5, 6));
    }

    /// x + y over the unit square where x + y >= 1: without the edge the bound is 0.
    #[test]
    fn the_least_value_of_a_line_beyond_an_edge_is_that_on_the_edge() {
        let side = Interval::new(0.0, 1.0);
        let space = HalfSpace { normal: vec![-1.0, -1.0], bound: -1.0 };
        let edges = Edge::all(&[space], &[side, side]);
        let (found, _) = raised(&[0.0, 1.0, 1.0, 2.0], &edges, &[1, 1], &[[0.0, 1.0]; 2]);
        assert!((1.0 - 1e-12..=1.0).contains(&found), "{found}");
    }

    #[test]
    fn an_edge_beyond_the_lowest_value_changes_nothing() {
        let side = Interval::new(0.0, 1.0);
        let edges = Edge::all(&[HalfSpace { normal: vec![1.0], bound: 0.5 }], &[side]);
        assert_eq!(raised(&[3.0, 4.0], &edges, &[1], &[[0.0, 1.0]]).0, 3.0);
    }

    /// -x - y where x <= 0.25 and y <= 0.5: -0.75, in the corner of two edges.
    #[test]
    fn a_corner_of_two_edges_needs_two_factors() {
        let side = Interval::new(0.0, 1.0);
        let spaces = [([1.0, 0.0], 0.25), ([0.0, 1.0], 0.5), ([1.0, 1.0], 1.9)];
        let spaces: Vec<HalfSpace> =
            spaces.iter().map(|(normal, bound)| HalfSpace { normal: normal.to_vec(), bound: *bound }).collect();
        let (found, _) = raised(&[0.0, -1.0, -1.0, -2.0], &Edge::all(&spaces, &[side, side]), &[1, 1], &[[0.0, 1.0]; 2]);
        assert!((-0.75 - 1e-12..=-0.75).contains(&found), "{found}");
    }

    /// For every factor the bound is below all values in the region; here for factors and polynomials that vary.
    #[test]
    fn the_bound_is_below_every_value_in_the_region() {
        for k in 0..200 {
            let number = |step: usize| ((k * 37 + step * 101) % 19) as f64 - 9.0;
            let coefficients: Vec<f64> = (0..9).map(number).collect();
            let spaces = [
                HalfSpace { normal: vec![number(11), number(12)], bound: number(13) / 8.0 },
                HalfSpace { normal: vec![number(14), number(15)], bound: number(16) / 8.0 },
            ];
            let sides = [Interval::new(-1.0, 2.0), Interval::new(0.5, 1.0)];
            let (found, _) = raised(&coefficients, &Edge::all(&spaces, &sides), &[2, 2], &[[0.0, 1.0]; 2]);
            for i in 0..=20 {
                for j in 0..=20 {
                    let [s, t] = [i, j].map(|step| f64::from(step) / 20.0);
                    let weights = |s: f64| [(1.0 - s) * (1.0 - s), 2.0 * s * (1.0 - s), s * s];
                    let value: f64 =
                        (0..9).map(|place| coefficients[place] * weights(s)[place / 3] * weights(t)[place % 3]).sum();
                    let (x, y) = (-1.0 + 3.0 * s, 0.5 + 0.5 * t);
                    let is_inside = spaces.iter().all(|space| space.normal[0] * x + space.normal[1] * y <= space.bound);
                    assert!(!is_inside || value >= found - 1e-12, "{k}: {value} {found}");
                }
            }
        }
    }
}

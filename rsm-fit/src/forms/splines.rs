//! Fits a tensor spline: its coefficients with a penalty on second differences, and the numbers of cells and the penalty by cross-validation.
//!
//! In: rows, the ranges of the inputs, the degree; the numbers of cells, if they are given. Out: coefficients with the penalty, and the errors on
//! rows left out. The coefficients c minimise
//!
//! ```text
//! sum over rows of w (y - spline)^2 + penalty rows/coefficients * sum of squared second differences of c along each input
//! ```
//!
//! (P. H. C. Eilers, B. D. Marx, "Flexible smoothing with B-splines and penalties", 1996). So coefficients without rows continue their neighbours
//! in a straight line, and the number of cells matters little once it is large enough. A row has few basis functions that are not zero, so the
//! normal equations are banded, and so is their factor.

use rsm_core::basis;
use rsm_core::check::MOST_SPLINE_INPUTS;
use rsm_core::model::{Input, Spline, Surface};

use super::drawn;
use crate::design::Design;
use crate::selection::Sample;
use crate::spec::SplineSpec;
use crate::split;
use crate::statistics::{Judged, TriedCells};

/// The number of parts that are left out in turn.
pub(crate) const PARTS: usize = 5;

/// Penalties are tried from the first to the last, by decades. Below the first, a coefficient without rows would depend on rounding errors; above the
/// last, the spline is a plane.
const PENALTIES: [i32; 2] = [-7, 2];

/// Numbers of cells along an input, in the order in which they are tried.
const CELLS: [u32; 15] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192];

/// The most coefficients of a spline whose cells are chosen: more do not pay on maps of some hundred points, and the table would be long.
const MOST_COEFFICIENTS: usize = 420;

/// The fewest coefficients are taken whose error is at most this many times the smallest.
const NEAR: f64 = 1.02;

/// With more rows, a random sample chooses cells and penalty. All rows give the coefficients.
const MOST_ROWS: usize = 20_000;

/// A fitted spline.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fitted {
    pub spline: Spline,
    pub penalty: f64,
    /// The trace of the matrix from responses to fitted values: how many free coefficients the spline is worth.
    pub effective: f64,
    /// Cells in which no row lies.
    pub empty_cells: usize,
}

/// A search for a spline.
pub(crate) struct Search<'a> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    pub wanted: &'a SplineSpec,
}

impl Search<'_> {
    /// The spline of all rows; `None` if no penalty makes the equations regular, as when all points are on one line of two inputs.
    pub(crate) fn run(&self, sample: &Sample) -> Option<(Fitted, Vec<TriedCells>)> {
        let (cells, penalty, tried) = self.choose(sample)?;
        let grid = Grid::new(self.wanted.degree, &cells, self.inputs);
        let all: Vec<usize> = (0..sample.rows()).collect();
        let normal = grid.normal(sample, &all);
        let factor = normal.factor(&grid, penalty)?;
        let coefficients = factor.refined(&normal, &grid, penalty);
        let effective = factor.effective(&normal);
        let spline = Spline { degree: self.wanted.degree, cells: cells.clone(), coefficients };
        let is_sound = spline.coefficients.iter().all(|it| it.is_finite());
        is_sound.then(|| (Fitted { empty_cells: grid.empty_cells(sample), spline, penalty, effective }, tried))
    }

    /// The cells and the penalty, and what was tried. Given ones are kept.
    fn choose(&self, sample: &Sample) -> Option<(Vec<u32>, f64, Vec<TriedCells>)> {
        let (picked, ..) = drawn(sample, MOST_ROWS);
        let few: Sample;
        let sample = if picked.len() < sample.rows() {
            let mut is_picked = vec![false; sample.rows()];
            picked.iter().for_each(|row| is_picked[*row] = true);
            few = sample.chosen(|row| is_picked[row]);
            &few
        } else {
            sample
        };
        let part_of = split::parts(&sample.groups, PARTS, 3);
        let mut tried: Vec<TriedCells> = Vec::new();
        let mut errors_of = |cells: &[u32]| -> Option<f64> {
            if let Some(known) = tried.iter().find(|known| known.cells == cells) {
                return Some(known.rmse);
            }
            let (penalty, rmse) = self.errors(sample, &part_of, cells)?;
            tried.push(TriedCells { cells: cells.to_vec(), penalty, rmse });
            Some(rmse)
        };
        if let Some(cells) = &self.wanted.cells {
            errors_of(cells);
            let penalty = self.wanted.penalty.or_else(|| tried.first().map(|it| it.penalty))?;
            return Some((cells.clone(), penalty, tried));
        }
        let width = self.inputs.len();
        let is_small = |cells: &[u32]| {
            let count: usize = cells.iter().map(|cells| (cells + self.wanted.degree) as usize).product();
            count <= MOST_COEFFICIENTS && count <= sample.rows()
        };
        // The same number along each input, then up and down along one of them.
        let mut best: Option<(Vec<u32>, f64)> = None;
        for count in CELLS {
            let cells = vec![count; width];
            if !is_small(&cells) {
                break;
            }
            let Some(rmse) = errors_of(&cells) else { continue };
            if best.as_ref().is_none_or(|(_, least)| rmse < *least) {
                best = Some((cells, rmse));
            }
        }
        let (mut cells, mut least) = best?;
        let mut moved = width > 1;
        while moved {
            moved = false;
            for k in 0..width {
                for step in [1, -1] {
                    let place = CELLS.iter().position(|count| *count == cells[k])?;
                    let Some(next) = place.checked_add_signed(step).and_then(|place| CELLS.get(place)) else { continue };
                    let mut other = cells.clone();
                    other[k] = *next;
                    if !is_small(&other) {
                        continue;
                    }
                    if let Some(rmse) = errors_of(&other).filter(|rmse| *rmse < least) {
                        (cells, least, moved) = (other, rmse, true);
                    }
                }
            }
        }
        let count = |one: &TriedCells| one.cells.iter().map(|cells| (cells + self.wanted.degree) as usize).product::<usize>();
        let near = tried.iter().filter(|one| one.rmse <= NEAR * least);
        let chosen = near.min_by(|a, b| count(a).cmp(&count(b)).then(a.rmse.total_cmp(&b.rmse)))?.clone();
        Some((chosen.cells, self.wanted.penalty.unwrap_or(chosen.penalty), tried))
    }

    /// The penalty with the smallest error on parts left out, and this error.
    fn errors(&self, sample: &Sample, part_of: &[usize], cells: &[u32]) -> Option<(f64, f64)> {
        let grid = Grid::new(self.wanted.degree, cells, self.inputs);
        let parts = part_of.iter().max().map_or(0, |most| most + 1);
        if parts < 2 {
            return None;
        }
        let rows = |part: usize| -> Vec<usize> { (0..sample.rows()).filter(|row| part_of[*row] == part).collect() };
        let rows: Vec<Vec<usize>> = (0..parts).map(rows).collect();
        let each: Vec<Normal> = rows.iter().map(|rows| grid.normal(sample, rows)).collect();
        let whole = each.iter().skip(1).fold(each[0].clone(), |sum, part| sum.plus(part, 1.0));
        let penalties: Vec<f64> = match self.wanted.penalty {
            Some(penalty) => vec![penalty],
            None => (PENALTIES[0]..=PENALTIES[1]).map(|power| 10f64.powi(power)).collect(),
        };
        let mut best: Option<(f64, f64)> = None;
        for penalty in penalties {
            let of_part = |(rows, own): (&Vec<usize>, &Normal)| -> Option<f64> {
                let rest = whole.plus(own, -1.0);
                let coefficients = rest.factor(&grid, penalty)?.solved(&rest.right);
                Some(rows.iter().map(|row| (sample.response[*row] - grid.value(sample, *row, &coefficients)).powi(2)).sum())
            };
            let squares: Option<f64> = rows.iter().zip(&each).map(of_part).sum();
            let Some(square) = squares.filter(|square| square.is_finite()) else { continue };
            let rmse = (square / sample.rows() as f64).sqrt();
            if best.is_none_or(|(_, least)| rmse < least) {
                best = Some((penalty, rmse));
            }
        }
        best
    }

    /// The errors on parts of the rows, with cells, penalty and coefficients found again without them, and the number of parts.
    pub(crate) fn left_out(&self, sample: &Sample) -> Option<Vec<Judged>> {
        let part_of = split::parts(&sample.groups, PARTS, 3);
        let parts = part_of.iter().max().map_or(0, |most| most + 1);
        if parts < 2 {
            return None;
        }
        let round = |part: usize| {
            let (rest, out) = (sample.chosen(|row| part_of[row] != part), sample.chosen(|row| part_of[row] == part));
            let (fitted, _) = self.run(&rest)?;
            let (design, coefficients) = design_of(self.surface, self.inputs, &fitted.spline);
            let (range, mean) = (self.surface.output_range, rest.mean());
            Some(out.observed(|rows| {
                Judged::of(&design, &coefficients, range, crate::statistics::Observations { weights: &[], ..rows }, mean)
            }))
        };
        (0..parts).map(round).collect()
    }
}

/// The fewest rows for a spline of so many inputs: the coefficients of one cell, so that each part leaves enough.
pub(crate) fn least_rows(inputs: usize) -> usize {
    2 * 4usize.pow(inputs.min(MOST_SPLINE_INPUTS) as u32)
}

/// The design of a spline: one column for each coefficient, and the coefficients in this order.
pub(crate) fn design_of(surface: &Surface, inputs: &[Input], spline: &Spline) -> (Design, Vec<f64>) {
    let counts = spline.counts();
    let mut terms: Vec<Vec<u32>> = vec![vec![]];
    for count in counts {
        terms = terms.iter().flat_map(|begun| (0..count as u32).map(|k| [&begun[..], &[k]].concat())).collect();
    }
    let surface = Surface { spline: Some(spline.clone()), terms: vec![], ..surface.clone() };
    (Design::new(&surface, inputs, terms), spline.coefficients.clone())
}

/// The basis functions of a spline without coefficients.
struct Grid<'a> {
    degree: u32,
    cells: &'a [u32],
    ranges: Vec<[f64; 2]>,
    counts: Vec<usize>,
    strides: Vec<usize>,
    size: usize,
    /// The largest distance of two coefficients that an equation relates.
    band: usize,
}

impl<'a> Grid<'a> {
    fn new(degree: u32, cells: &'a [u32], inputs: &[Input]) -> Self {
        let shape = Spline { degree, cells: cells.to_vec(), coefficients: vec![] };
        let (counts, strides) = (shape.counts(), shape.strides());
        let of_rows: usize = strides.iter().map(|stride| degree as usize * stride).sum();
        let of_penalty = strides.iter().max().map_or(0, |stride| 2 * stride);
        let size: usize = counts.iter().product();
        let band = of_rows.max(of_penalty).min(size.saturating_sub(1));
        Grid { degree, cells, ranges: inputs.iter().map(|input| input.range).collect(), counts, strides, size, band }
    }

    /// The places of the coefficients that act at a row, with their weights; and the row's cell.
    fn active(&self, sample: &Sample, row: usize) -> (Vec<(usize, f64)>, usize) {
        let mut active = vec![(0usize, 1.0f64)];
        let mut place = 0;
        for k in 0..self.cells.len() {
            let (first, weights) = basis::spline_weights(self.degree, self.cells[k], self.ranges[k], sample.columns[k][row]);
            place = place * self.cells[k] as usize + first;
            let stride = self.strides[k];
            let times = |(at, product): &(usize, f64)| -> Vec<(usize, f64)> {
                weights.iter().enumerate().map(|(i, weight)| (at + (first + i) * stride, product * weight)).collect()
            };
            active = active.iter().flat_map(times).collect();
        }
        (active, place)
    }

    fn value(&self, sample: &Sample, row: usize, coefficients: &[f64]) -> f64 {
        self.active(sample, row).0.iter().map(|(place, weight)| weight * coefficients[*place]).sum()
    }

    fn empty_cells(&self, sample: &Sample) -> usize {
        let count: usize = self.cells.iter().map(|cells| *cells as usize).product();
        let mut is_empty = vec![true; count];
        (0..sample.rows()).for_each(|row| is_empty[self.active(sample, row).1] = false);
        is_empty.iter().filter(|is_empty| **is_empty).count()
    }

    /// The normal equations of some rows.
    fn normal(&self, sample: &Sample, rows: &[usize]) -> Normal {
        let width = self.band + 1;
        let mut normal = Normal {
            rows: rows.len(),
            size: self.size,
            band: self.band,
            matrix: vec![0.0; self.size * width],
            right: vec![0.0; self.size],
        };
        for row in rows {
            let weight = sample.weights.get(*row).copied().unwrap_or(1.0);
            let (active, _) = self.active(sample, *row);
            for (i, a) in &active {
                normal.right[*i] += weight * a * sample.response[*row];
                for (j, b) in active.iter().filter(|(j, _)| j <= i) {
                    normal.matrix[i * width + self.band + j - i] += weight * a * b;
                }
            }
        }
        normal
    }

    /// Calls `add` with the three places of each second difference.
    fn second_differences(&self, mut add: impl FnMut([usize; 3])) {
        for (k, stride) in self.strides.iter().enumerate() {
            for place in 0..self.size {
                let along = place / stride % self.counts[k];
                if along >= 2 {
                    add([place, place - stride, place - 2 * stride]);
                }
            }
        }
    }
}

/// Normal equations: the lower band of the matrix row by row, the diagonal last.
#[derive(Clone)]
struct Normal {
    rows: usize,
    size: usize,
    band: usize,
    matrix: Vec<f64>,
    right: Vec<f64>,
}

/// A pivot below this share of the largest diagonal entry may be a rounding error: up to 100 products of a band, each with 2^-53.
const LEAST_PIVOT: f64 = 1e-13;

/// The weights of a second difference.
const SECOND: [f64; 3] = [1.0, -2.0, 1.0];

impl Normal {
    fn plus(&self, other: &Normal, factor: f64) -> Normal {
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + factor * b).collect();
        let rows = if factor > 0.0 { self.rows + other.rows } else { self.rows - other.rows };
        Normal { rows, matrix: sum(&self.matrix, &other.matrix), right: sum(&self.right, &other.right), ..*self }
    }

    fn at(&self, i: usize, j: usize) -> usize {
        i * (self.band + 1) + self.band + j - i
    }

    /// The penalty's factor before the squares.
    fn scale(&self, penalty: f64) -> f64 {
        penalty * self.rows as f64 / self.size as f64
    }

    /// Cholesky's factor with a penalty; `None` if the matrix is not positive definite.
    fn factor(&self, grid: &Grid<'_>, penalty: f64) -> Option<Factor> {
        let scale = self.scale(penalty);
        let mut l = self.matrix.clone();
        grid.second_differences(|places| {
            for (i, a) in places.iter().zip(SECOND) {
                for (j, b) in places.iter().zip(SECOND).filter(|(j, _)| *j <= i) {
                    l[self.at(*i, *j)] += scale * a * b;
                }
            }
        });
        let largest = (0..self.size).map(|i| l[self.at(i, i)]).fold(0.0, f64::max);
        for i in 0..self.size {
            let first = i.saturating_sub(self.band);
            for j in first..=i {
                let from = first.max(j.saturating_sub(self.band));
                let sum: f64 = {
                    let row_i = &l[self.at(i, from)..self.at(i, j)];
                    let row_j = &l[self.at(j, from)..self.at(j, j)];
                    row_i.iter().zip(row_j).map(|(a, b)| a * b).sum()
                };
                let left = l[self.at(i, j)] - sum;
                l[self.at(i, j)] = if i > j {
                    left / l[self.at(j, j)]
                } else if left > LEAST_PIVOT * largest {
                    left.sqrt()
                } else {
                    return None;
                };
            }
        }
        Some(Factor { l: Normal { matrix: l, ..self.clone() } })
    }

    /// The right side minus the matrix times the coefficients.
    fn residual(&self, grid: &Grid<'_>, penalty: f64, coefficients: &[f64]) -> Vec<f64> {
        let scale = self.scale(penalty);
        let mut residual = self.right.clone();
        for i in 0..self.size {
            for j in i.saturating_sub(self.band)..=i {
                let entry = self.matrix[self.at(i, j)];
                residual[i] -= entry * coefficients[j];
                if j < i {
                    residual[j] -= entry * coefficients[i];
                }
            }
        }
        grid.second_differences(|places| {
            let difference: f64 = places.iter().zip(SECOND).map(|(place, weight)| weight * coefficients[*place]).sum();
            places.iter().zip(SECOND).for_each(|(place, weight)| residual[*place] -= scale * weight * difference);
        });
        residual
    }
}

struct Factor {
    l: Normal,
}

impl Factor {
    fn solved(&self, right: &[f64]) -> Vec<f64> {
        let l = &self.l;
        let mut x = right.to_vec();
        for i in 0..l.size {
            let first = i.saturating_sub(l.band);
            let sum: f64 = (first..i).map(|j| l.matrix[l.at(i, j)] * x[j]).sum();
            x[i] = (x[i] - sum) / l.matrix[l.at(i, i)];
        }
        for i in (0..l.size).rev() {
            x[i] /= l.matrix[l.at(i, i)];
            for j in i.saturating_sub(l.band)..i {
                x[j] -= l.matrix[l.at(i, j)] * x[i];
            }
        }
        x
    }

    /// The solution after two steps of iterative refinement.
    fn refined(&self, normal: &Normal, grid: &Grid<'_>, penalty: f64) -> Vec<f64> {
        let mut x = self.solved(&normal.right);
        for _ in 0..2 {
            let step = self.solved(&normal.residual(grid, penalty, &x));
            x.iter_mut().zip(step).for_each(|(x, step)| *x += step);
        }
        x
    }

    /// The trace of (N + P)^-1 N.
    fn effective(&self, normal: &Normal) -> f64 {
        let mut trace = 0.0;
        for column in 0..normal.size {
            let mut right = vec![0.0; normal.size];
            for (row, entry) in right.iter_mut().enumerate() {
                let (i, j) = (row.max(column), row.min(column));
                if i - j <= normal.band {
                    *entry = normal.matrix[normal.at(i, j)];
                }
            }
            trace += self.solved(&right)[column];
        }
        trace
    }
}

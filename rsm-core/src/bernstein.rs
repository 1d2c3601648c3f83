//! Encloses the range of a polynomial over a box.
//!
//! In: terms and a box of their variables. Out: an interval that contains every value there. The polynomial is expressed in the Bernstein basis of
//! the box: its values are between the smallest and the largest coefficient (convex hull property; Cargo and Shisha 1966), and the coefficients at
//! the corners are values themselves. The cell with the worst bound is halved until the enclosure reaches a corner value, or the budget is used up.
//! All arithmetic is interval arithmetic, so rounding errors are included.
//!
//! A [`Measure`] of several polynomials is bounded in the same way: a function that is concave in their values is, over a cell, at least its smallest
//! value at their joint coefficients.

mod edge;

use std::collections::BinaryHeap;

use crate::interval::Interval;
use crate::model::HalfSpace;
use edge::Edge;

/// The budget of coefficients: 2 * 10^7 interval operations take about a tenth of a second.
const BUDGET: usize = 20_000_000;

/// The search ends if the excess of the enclosure is below this share of the spread of values,
const TIGHT_ENOUGH: f64 = 1e-9;

/// or below this share of their magnitude: a few thousand times the outward rounding (2^-52 per operation), so that it is reachable.
const ROUNDING: f64 = 1e-12;

/// A term: powers of the variables and a coefficient.
#[derive(Debug, Clone)]
pub struct Monomial {
    /// One power for each variable.
    pub powers: Vec<u32>,
    /// An enclosure of the coefficient.
    pub coefficient: Interval,
}

/// An enclosure of a polynomial's values over a box, and the points of the smallest and the largest computed value.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Extent {
    /// Contains every value.
    pub range: Interval,
    /// The point of the smallest computed value, as a share of each side: 0 at its low end, 1 at its high end.
    pub least_at: Vec<f64>,
    /// The point of the largest computed value.
    pub greatest_at: Vec<f64>,
}

/// The extent of the polynomial for variables in `sides`.
#[must_use]
pub(crate) fn extent(terms: &[Monomial], sides: &[Interval]) -> Extent {
    let root = Cell::new(&[terms], sides);
    let (low, least_at) = lower_bound(&root);
    let (high, greatest_at) = lower_bound(&root.negated());
    Extent { range: Interval { low, high: -high }, least_at, greatest_at }
}

/// The enclosure from the Bernstein coefficients alone for variables in `sides`, without dividing the box.
#[must_use]
pub fn hull(terms: &[Monomial], sides: &[Interval]) -> Interval {
    Cell::new(&[terms], sides).bounds()
}

/// A concave function of the values of some polynomials, to be minimised. Their values at a point are a mean of their joint Bernstein coefficients,
/// with weights that are not negative and sum to 1, so the function there is at least its smallest value at these coefficients.
pub trait Measure {
    /// A lower bound of the function for all values in these intervals, one for each polynomial. If it is at least `than`, any number between `than`
    /// and it may be returned.
    fn low(&self, values: &[Interval], than: f64) -> f64;
    /// An upper bound of the function at some values in these intervals.
    fn high(&self, values: &[Interval]) -> f64;
}

/// The value of one polynomial.
struct Value;

impl Measure for Value {
    fn low(&self, values: &[Interval], _than: f64) -> f64 {
        values[0].low
    }
    fn high(&self, values: &[Interval]) -> f64 {
        values[0].high
    }
}

/// Bernstein coefficients of polynomials over one cell of the box, as a row-major tensor; the last axis is the polynomial.
#[derive(Debug, Clone)]
struct Cell {
    degrees: Vec<usize>,
    polynomials: usize,
    coefficients: Vec<Interval>,
    /// The part of each side in the cell, as shares of the box. Halving is exact down to 2^-52.
    spans: Vec<[f64; 2]>,
    /// Whether a part of it may be outside the searched region.
    is_partly: bool,
}

/// A cell in the queue of a branch and bound: the one with the smallest lower bound comes first.
pub(crate) struct Queued<C> {
    pub(crate) bound: f64,
    pub(crate) cell: C,
}

impl<C> PartialEq for Queued<C> {
    // mutant `body to true`: `Ord` requires it, a heap never calls it.
    // mutant `body to false`: likewise.
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl<C> Eq for Queued<C> {}
impl<C> PartialOrd for Queued<C> {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl<C> Ord for Queued<C> {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        other.bound.total_cmp(&self.bound)
    }
}

/// A lower bound of the values in the cell, and the point of the smallest computed value: branch and bound, until the best bound is near a computed
/// value at a corner.
fn lower_bound(root: &Cell) -> (f64, Vec<f64>) {
    // mutant `1.0 doubled`: all cells are inside, so the finest size is not used.
    // mutant `1.0 to 0.0`: likewise.
    let everywhere = Search { place: &|_| Place::Inside, spaces: &[], finest: 1.0, enough: f64::INFINITY };
    let found = search_within(root, &Value, &[], &everywhere, BUDGET).0;
    (found.bound, found.at)
}

/// The position of a cell relative to the region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// No point of it is in the region.
    Outside,
    /// Some points may be in the region.
    Partly,
    /// All points are in the region.
    Inside,
}

/// The region and the accuracy of a search for the smallest value.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// The position of a cell, given as shares of the sides. A point is a cell of width 0.
    pub place: &'a dyn Fn(&[[f64; 2]]) -> Place,
    /// Half-spaces of the variables that contain the region. They improve the bounds of cells that its edge cuts.
    pub spaces: &'a [HalfSpace],
    /// A cell that is no wider than this share of each side counts as inside unless it is outside.
    pub finest: f64,
    /// The search may end if the smallest value is at least this, or is proved to be well below it. Infinite: find the smallest value.
    pub enough: f64,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Least {
    /// A lower bound of all values in the region; infinite if the region is empty.
    pub bound: f64,
    /// The smallest computed value, rounded up; infinite if no corner was in the region.
    pub seen: f64,
    /// The point of that value, as a share of each side.
    pub at: Vec<f64>,
}

/// The smallest value of the polynomial over a region of the box.
#[must_use]
pub fn least(terms: &[Monomial], sides: &[Interval], wanted: &Search<'_>) -> Least {
    least_for(1, terms, sides, wanted)
}

/// The same with so many times the usual work.
#[must_use]
pub fn least_for(times: usize, terms: &[Monomial], sides: &[Interval], wanted: &Search<'_>) -> Least {
    search_within(&Cell::new(&[terms], sides), &Value, &Edge::all(wanted.spaces, sides), wanted, times * BUDGET).0
}

/// The smallest measure of some polynomials over a region of the box.
#[must_use]
pub fn least_measure(polynomials: &[Vec<Monomial>], sides: &[Interval], measure: &impl Measure, wanted: &Search<'_>) -> Least {
    let polynomials: Vec<&[Monomial]> = polynomials.iter().map(Vec::as_slice).collect();
    search_within(&Cell::new(&polynomials, sides), measure, &Edge::all(wanted.spaces, sides), wanted, BUDGET).0
}

/// Branch and bound; also returns the work done.
fn search_within(root: &Cell, measure: &impl Measure, edges: &[Edge], wanted: &Search<'_>, budget: usize) -> (Least, usize) {
    let whole = root.bounds();
    let dimensions = root.degrees.len();
    let mut best = Least { bound: f64::INFINITY, seen: f64::INFINITY, at: vec![0.5; dimensions] };
    let Some(root) = root.clone().placed(wanted) else { return (best, 0) };
    root.look(measure, wanted, &mut best);
    let tolerance = (TIGHT_ENOUGH * (whole.high - whole.low)).max(ROUNDING * whole.magnitude());
    let mut queue = BinaryHeap::from([Queued { bound: root.low(measure, edges, wanted.enough).0, cell: root }]);
    let mut work = 0;
    // The smallest bound of the cells that are good enough. Only this is kept, because with several polynomials of four variables a cell takes 40 kB.
    let mut settled = f64::INFINITY;
    while let Some(Queued { bound, cell }) = queue.pop() {
        best.bound = bound;
        let missing = wanted.enough - best.seen;
        let is_known = bound >= wanted.enough || (missing.is_finite() && best.seen - bound <= missing * DEEP_ENOUGH);
        if is_known || best.seen - bound <= tolerance || work > budget || !bound.is_finite() {
            return (best, work);
        }
        // A side along which the polynomial is linear need not be divided.
        let may_be_cut = |k: &usize| cell.is_partly || cell.degrees[*k] > 1;
        let Some(axis) = (0..dimensions).filter(may_be_cut).reduce(|k, other| cell.better_cut(k, other)) else {
            return (best, work);
        };
        let length = cell.degrees.iter().max().expect("a cell that is cut has a side") + 1;
        work += 4 * cell.coefficients.len() * length;
        let (left, right) = cell.halved(axis);
        for half in [left, right] {
            let Some(half) = half.placed(wanted) else { continue };
            half.look(measure, wanted, &mut best);
            // A half is a part of the whole, so its bound is not worse.
            let (own, of_edges) = half.low(measure, edges, wanted.enough);
            work += of_edges;
            let bound = own.max(bound);
            // mutant `>= to >`: a cell that is kept is processed last, with the same result.
            if bound >= wanted.enough {
                settled = settled.min(bound);
                continue;
            }
            queue.push(Queued { bound, cell: half });
        }
    }
    // Every cell was good enough or left out.
    best.bound = settled;
    (best, work)
}

/// The search may end at a value below `enough` if the smallest value is at most this share lower.
const DEEP_ENOUGH: f64 = 0.25;

impl Cell {
    /// From the power basis to the Bernstein basis over the box, one variable at a time.
    fn new(polynomials: &[&[Monomial]], sides: &[Interval]) -> Self {
        let (dimensions, count) = (sides.len(), polynomials.len());
        let degree_of = |k: usize| polynomials.iter().copied().flatten().map(|term| term.powers[k] as usize).max().unwrap_or(0);
        let degrees: Vec<usize> = (0..dimensions).map(degree_of).collect();
        let size = degrees.iter().map(|degree| degree + 1).product::<usize>() * count;
        let spans = vec![[0.0, 1.0]; dimensions];
        let coefficients = vec![Interval::point(0.0); size];
        let mut cell = Cell { coefficients, degrees, polynomials: count, spans, is_partly: false };
        for (which, terms) in polynomials.iter().enumerate() {
            for term in *terms {
                let place = (0..dimensions).fold(0, |index, k| index * (cell.degrees[k] + 1) + term.powers[k] as usize);
                let entry = &mut cell.coefficients[place * count + which];
                *entry = *entry + term.coefficient;
            }
        }
        for (axis, side) in sides.iter().enumerate() {
            cell.each_line(axis, |line| to_bernstein(line, *side));
        }
        cell
    }

    /// Calls `change` with every line of coefficients along an axis.
    fn each_line(&mut self, axis: usize, mut change: impl FnMut(&mut [Interval])) {
        let length = self.degrees[axis] + 1;
        let stride = self.stride(axis);
        let mut line = vec![Interval::point(0.0); length];
        for start in 0..self.coefficients.len() {
            if (start / stride).is_multiple_of(length) {
                for (k, entry) in line.iter_mut().enumerate() {
                    *entry = self.coefficients[start + k * stride];
                }
                change(&mut line);
                for (k, entry) in line.iter().enumerate() {
                    self.coefficients[start + k * stride] = *entry;
                }
            }
        }
    }

    /// The distance from a coefficient to the next one along an axis.
    fn stride(&self, axis: usize) -> usize {
        self.degrees[axis + 1..].iter().map(|degree| degree + 1).product::<usize>() * self.polynomials
    }

    /// A lower bound of the measure in the part of the cell that is in the region, and the work for half-spaces.
    fn low(&self, measure: &impl Measure, edges: &[Edge], enough: f64) -> (f64, usize) {
        let each = || self.coefficients.chunks(self.polynomials);
        let whole = each().fold(f64::INFINITY, |least, values| measure.low(values, least).min(least));
        if !self.is_partly || edges.is_empty() || whole >= enough {
            return (whole, 0);
        }
        let lows: Vec<f64> = each().map(|values| measure.low(values, f64::INFINITY)).collect();
        let (raised, work) = edge::raised(&lows, edges, &self.degrees, &self.spans);
        // A plain multiplication takes a tenth of an interval operation.
        (raised.max(whole), work / 10)
    }

    /// Contains every value of every polynomial.
    fn bounds(&self) -> Interval {
        self.coefficients.iter().copied().reduce(Interval::hull).expect("a polynomial has a coefficient")
    }

    fn width(&self, axis: usize) -> f64 {
        self.spans[axis][1] - self.spans[axis][0]
    }

    /// Which of two sides to halve, the first of equal ones. For a cell at the region's edge: the longer one. Otherwise the one with the larger
    /// second differences of the coefficients. A fixed rotation of sides would be wrong: one cell could always get the same side, and its bound would
    /// not improve.
    fn better_cut(&self, one: usize, other: usize) -> usize {
        let [one_size, other_size] = [one, other].map(|axis| ((!self.is_partly).then(|| self.bend(axis)), self.width(axis)));
        if other_size > one_size { other } else { one }
    }

    /// The largest second difference of the coefficients along an axis.
    fn bend(&self, axis: usize) -> f64 {
        let stride = self.stride(axis);
        let is_inner = |k: &usize| (1..self.degrees[axis]).contains(&(k / stride % (self.degrees[axis] + 1)));
        let low = |k: usize| self.coefficients[k].low;
        let second = |k: usize| (low(k - stride) - 2.0 * low(k) + low(k + stride)).abs();
        // mutant `0 up`: the first coefficient is at a corner, which is not inside.
        (0..self.coefficients.len()).filter(is_inner).map(second).fold(0.0, f64::max)
    }

    /// The cell with its position relative to the region; `None` if it is outside.
    fn placed(mut self, wanted: &Search<'_>) -> Option<Self> {
        let place = (wanted.place)(&self.spans);
        let is_fine = (0..self.spans.len()).all(|k| self.width(k) <= wanted.finest);
        self.is_partly = place == Place::Partly && !is_fine;
        (place != Place::Outside).then_some(self)
    }

    /// Evaluates the corners in the region.
    fn look(&self, measure: &impl Measure, wanted: &Search<'_>, best: &mut Least) {
        let mut corners = vec![(0usize, 0usize)];
        for (k, degree) in self.degrees.iter().enumerate() {
            let low_and_high = |(index, ends): &(usize, usize)| {
                let first = index * (degree + 1);
                [(first, *ends), (first + degree, ends | 1 << k)]
            };
            corners = corners.iter().flat_map(low_and_high).collect();
        }
        for (index, ends) in corners {
            let values = &self.coefficients[index * self.polynomials..][..self.polynomials];
            // A corner whose lower bound is not below the best value is skipped: for an eigenvalue a bound is cheaper than the value.
            if measure.low(values, best.seen) >= best.seen {
                continue;
            }
            let value = measure.high(values);
            if value < best.seen {
                let at: Vec<f64> = self.spans.iter().enumerate().map(|(k, span)| span[ends >> k & 1]).collect();
                let as_cell: Vec<[f64; 2]> = at.iter().map(|share| [*share, *share]).collect();
                if !self.is_partly || (wanted.place)(&as_cell) != Place::Outside {
                    (best.seen, best.at) = (value, at);
                }
            }
        }
    }

    fn negated(&self) -> Cell {
        let coefficients = self.coefficients.iter().map(|entry| -*entry).collect();
        Cell { coefficients, ..self.clone() }
    }

    /// De Casteljau at the middle of an axis: the coefficients over both halves.
    fn halved(&self, axis: usize) -> (Cell, Cell) {
        let (mut left, mut right) = (self.clone(), self.clone());
        let [low, high] = self.spans[axis];
        let middle = (low + high) / 2.0;
        (left.spans[axis], right.spans[axis]) = ([low, middle], [middle, high]);
        left.each_line(axis, to_lower_half);
        right.each_line(axis, |line| {
            line.reverse();
            to_lower_half(line);
            line.reverse();
        });
        (left, right)
    }
}

/// The coefficients of a line over its lower half.
fn to_lower_half(line: &mut [Interval]) {
    for first in 1..line.len() {
        for k in (first..line.len()).rev() {
            line[k] = (line[k - 1] + line[k]).halved();
        }
    }
}

/// One line of the power basis in x to the Bernstein basis over x in [low, high]: first x = low + (high - low) t by repeated synthetic
/// division, then b_i = sum_{j <= i} C(i, j)/C(n, j) a_j.
fn to_bernstein(line: &mut [Interval], side: Interval) {
    let n = line.len() - 1;
    let shift = Interval::point(side.low);
    for first in 0..n {
        for k in (first..n).rev() {
            line[k] = line[k] + line[k + 1] * shift;
        }
    }
    let width = Interval::point(side.high) - Interval::point(side.low);
    let mut scale = Interval::point(1.0);
    for entry in line.iter_mut() {
        *entry = *entry * scale;
        scale = scale * width;
    }
    // C(n, j) is exact in f64 for n <= 20; the quotient is enclosed by its two neighbours.
    let mut binomial = 1.0;
    for (j, entry) in line.iter_mut().enumerate() {
        if j > 0 {
            binomial = binomial * (n + 1 - j) as f64 / j as f64;
        }
        let inverse: f64 = 1.0 / binomial;
        let inverse =
            if binomial == 1.0 { Interval::point(1.0) } else { Interval::new(inverse.next_down(), inverse.next_up()) };
        *entry = *entry * inverse;
    }
    // sum_j C(i, j) c_j by Pascal's triangle: n rounds of adding the neighbour.
    for first in 1..=n {
        for k in (first..=n).rev() {
            line[k] = line[k] + line[k - 1];
        }
    }
}

#[cfg(test)]
mod tests;

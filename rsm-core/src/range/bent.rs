//! The range of a surface with sigmoids. It is not a polynomial on any piece of its box, so the box is divided until linear enclosures are accurate
//! enough.
//!
//! In: a surface, its factors, a piece between knots. Out: an enclosure of the values there, and the points of the extremes. In a cell every factor
//! is c + b t + d: t runs over [-1, 1] with its input, the line is the chord, and d is the deviation from it. d is zero for a main variable or a
//! hinge. For a sigmoid over a cell of width h it is at most h^2/8 times the largest second derivative, with one sign on each side of its centre. The
//! product is a polynomial in the t with intervals as coefficients, enclosed by its Bernstein coefficients (convex hull property). The cell with the
//! worst bound is halved until the bound is near a computed value. The excess falls with the square of the cell width.

use std::cell::RefCell;
use std::collections::{BTreeMap, BinaryHeap, HashMap};
use std::f64::consts::TAU;

use crate::basis::{Factor, Shape};
use crate::bernstein::{self, Monomial, Queued};
use crate::elementary::{self, Function};
use crate::interval::Interval;
use crate::model::Surface;
use crate::number::exact;
use crate::pieces::Piece;

use super::Extent;

/// The largest number of cells for each bound: about 0.1 s for 40 terms of three inputs.
const CELLS: usize = 6000;

/// The approximate limit of interval operations for each bound, as for polynomials (`bernstein.rs`). A surface with expensive cells gets fewer than
/// [`CELLS`].
const OPERATIONS: usize = 30_000_000;

/// The largest number of Bernstein coefficients for each monomial. With more, in many inputs, most coefficients belong to no monomial, and more cells
/// are better than better bounds in each.
const COEFFICIENTS_EACH: usize = 8;

/// A bound is accurate enough if its excess is below this share of the spread of values.
const TIGHT_ENOUGH: f64 = 1e-5;

/// The line c + b t + d. `c` includes d and all rounding errors.
#[derive(Clone, Copy)]
struct Line {
    c: Interval,
    b: Interval,
}

/// The extent over a piece.
pub(super) fn extent(surface: &Surface, factors: &[Factor], piece: &Piece) -> Extent {
    let places = Places::new(surface, factors, piece.cell.len());
    let values = Values { surface, factors, piece, places, known: RefCell::default() };
    let (whole, _) = values.over(&piece.cell);
    let tolerance = TIGHT_ENOUGH * whole.width();
    let (low, least_at) = values.least(1.0, tolerance);
    let (high, greatest_at) = values.least(-1.0, tolerance);
    Extent { range: Interval { low: low.max(whole.low), high: (-high).min(whole.high) }, least_at, greatest_at }
}

struct Values<'a> {
    surface: &'a Surface,
    factors: &'a [Factor],
    piece: &'a Piece,
    places: Places,
    /// Enclosures of factors at ends of cells, shared by neighbouring cells.
    known: RefCell<HashMap<(usize, u64), Interval>>,
}

impl Values<'_> {
    /// A lower bound of the value times `sign`, and the point of the smallest computed value. Branch and bound.
    fn least(&self, sign: f64, tolerance: f64) -> (f64, Vec<f64>) {
        let signed = |values: Interval| if sign < 0.0 { -values } else { values };
        let start = self.piece.cell.clone();
        let mut at = middle(&start);
        let mut seen = sign * self.at(&at);
        let (whole, mut operations) = self.over(&start);
        let mut queue = BinaryHeap::from([Queued { bound: signed(whole).low, cell: start }]);
        for _ in 0..CELLS {
            let Some(worst) = queue.peek() else { break };
            if operations > OPERATIONS || seen - worst.bound <= tolerance || !worst.bound.is_finite() {
                break;
            }
            let Queued { bound, cell } = queue.pop().expect("it was looked at");
            let Some(halves) = self.halved(&cell) else {
                // No number is between its ends, so it cannot be improved.
                return (bound, at);
            };
            for half in halves {
                for point in
                    [middle(&half), half.iter().map(|side| side[0]).collect(), half.iter().map(|side| side[1]).collect()]
                {
                    let value = sign * self.at(&point);
                    if value < seen {
                        (seen, at) = (value, point);
                    }
                }
                let (values, taken) = self.over(&half);
                operations += taken;
                // A half is a part of the whole, so its bound is not worse.
                let bound = signed(values).low.max(bound);
                queue.push(Queued { bound, cell: half });
            }
        }
        (queue.peek().map_or(seen, |worst| worst.bound), at)
    }

    /// The two halves of a cell, divided across the side along which the surface deviates most from its chords.
    fn halved(&self, cell: &[[f64; 2]]) -> Option<[Vec<[f64; 2]>; 2]> {
        let share = |k: usize| {
            let [low, high] = self.piece.cell[k];
            (cell[k][1] - cell[k][0]) / (high - low)
        };
        // For a sigmoid, relative to its width.
        let weight = |k: usize| {
            let of_sigmoid = |factor: &Factor| match factor.shape {
                Shape::Sigmoid { width, .. } if factor.input == k => (self.piece.cell[k][1] - self.piece.cell[k][0]) / width,
                Shape::Wave { period, order, .. } if factor.input == k => {
                    (self.piece.cell[k][1] - self.piece.cell[k][0]) / period * f64::from(order)
                }
                _ => 0.0,
            };
            share(k) * self.factors.iter().map(of_sigmoid).fold(1.0, f64::max)
        };
        let axis = (0..cell.len()).max_by(|a, b| weight(*a).total_cmp(&weight(*b)))?;
        let [low, high] = cell[axis];
        let half = low / 2.0 + high / 2.0;
        if !(low < half && half < high) {
            return None;
        }
        let with = |side: [f64; 2]| {
            let mut cell = cell.to_vec();
            cell[axis] = side;
            cell
        };
        Some([with([low, half]), with([half, high])])
    }

    /// The approximate value at a point. Only the order of the search depends on it.
    fn at(&self, point: &[f64]) -> f64 {
        let values: Vec<f64> = self.factors.iter().map(|factor| factor.value(point[factor.input])).collect();
        let product =
            |powers: &[u32]| values.iter().zip(powers).map(|(value, power)| value.powi(*power as i32)).product::<f64>();
        self.surface.terms.iter().map(|term| term.coefficient * product(&term.powers)).sum()
    }

    /// An enclosure of the values in a cell, and the approximate number of interval operations.
    fn over(&self, cell: &[[f64; 2]]) -> (Interval, usize) {
        let lines: Vec<Option<Line>> = (0..self.factors.len()).map(|k| self.line(k, cell[self.factors[k].input])).collect();
        let places = &self.places;
        let mut sums: BTreeMap<usize, Interval> = BTreeMap::new();
        let mut operations = 0;
        'terms: for term in self.surface.terms.iter().filter(|term| term.coefficient != 0.0) {
            // Indices in the tensor of coefficients, with the contributions of the term.
            let mut own = vec![(0, Interval::point(term.coefficient))];
            for (k, stride) in places.strides.iter().enumerate() {
                let mut along = vec![Interval::point(1.0)];
                for ((factor, line), power) in self.factors.iter().zip(&lines).zip(&term.powers) {
                    if factor.input != k || *power == 0 {
                        continue;
                    }
                    // A hinge that is 0 here.
                    let Some(line) = line else { continue 'terms };
                    (0..*power).for_each(|_| times(&mut along, *line));
                }
                if let [_] = along[..] {
                    continue;
                }
                let product = |(place, a): &(usize, Interval)| -> Vec<(usize, Interval)> {
                    along.iter().enumerate().map(|(degree, b)| (place + degree * stride, *a * *b)).collect()
                };
                own = own.iter().flat_map(product).collect();
            }
            operations += own.len();
            for (place, value) in own {
                let sum = sums.entry(place).or_insert(Interval::point(0.0));
                *sum = *sum + value;
            }
        }
        let whole = Interval::new(-1.0, 1.0);
        if places.size > COEFFICIENTS_EACH * sums.len() {
            let sum = sums.iter().fold(Interval::point(0.0), |sum, (place, value)| {
                // A square is not negative.
                let is_even = places.powers(*place).all(|power| power % 2 == 0);
                let range =
                    if *place == 0 { Interval::point(1.0) } else { Interval::new(if is_even { 0.0 } else { -1.0 }, 1.0) };
                sum + *value * range
            });
            return (sum, 2 * operations + sums.len());
        }
        let monomial =
            |(place, coefficient): (usize, Interval)| Monomial { powers: places.powers(place).collect(), coefficient };
        let monomials: Vec<Monomial> = sums.into_iter().map(monomial).collect();
        // Each axis in turn: for each line of coefficients, half the square of their number.
        let of_hull = places.size * places.degrees.iter().map(|degree| degree + 1).sum::<usize>();
        (bernstein::hull(&monomials, &vec![whole; cell.len()]), 2 * operations + of_hull)
    }

    /// A factor over a side; `None` if it is a hinge that is 0 there.
    fn line(&self, which: usize, [low, high]: [f64; 2]) -> Option<Line> {
        let factor = &self.factors[which];
        if let Shape::Hinge { .. } = factor.shape {
            // A piece is between knots: a hinge that is positive in the middle is positive everywhere.
            let [low, high] = self.piece.cell[factor.input];
            if factor.value(low / 2.0 + high / 2.0) <= 0.0 {
                return None;
            }
        }
        if let Shape::Wave { .. } = factor.shape {
            return Some(wave(factor, [low, high]));
        }
        let [start, end] = [low, high].map(|at| {
            let mut known = self.known.borrow_mut();
            *known.entry((which, at.to_bits())).or_insert_with(|| Interval::around(&factor.value(exact(at))))
        });
        let chord = Line { c: (start + end).halved(), b: (end - start).halved() };
        let Shape::Sigmoid { at, width, .. } = factor.shape else { return Some(chord) };
        // Rounded outward by 10^-12, more than the rounding error of these few operations.
        let [from, to] = [(low - at) / width, (high - at) / width];
        let span = (high - low) / width * (1.0 + 1e-12);
        let away = (span * span / 8.0 * steepest_bend(from, to)).min((end - start).magnitude()) * (1.0 + 1e-12);
        // Above its centre it is concave and lies above the chord; below its centre it lies below the chord.
        let below = if low >= at { 0.0 } else { away };
        let above = if high <= at { 0.0 } else { away };
        Some(Line { c: chord.c + Interval::new(-below, above), ..chord })
    }
}

/// Cosine or sine over a side: the chord of the function, whose second derivative is known. The formulas of a wave deviate from it by less than
/// 10^-15 (order + 1); the rounding errors of the argument, at most pi order, and of the function are smaller.
fn wave(factor: &Factor, [low, high]: [f64; 2]) -> Line {
    let Shape::Wave { low: bottom, high: top, period, order, is_sine } = factor.shape else { panic!("it is a wave") };
    let order = f64::from(order);
    let off = 1e-14 * (order + 10.0);
    let (turns, function) = (TAU * order / period, if is_sine { Function::Sin } else { Function::Cos });
    let [start, end] = [low, high].map(|at| {
        let value = elementary::range::value(function, &[turns * (at - (bottom / 2.0 + top / 2.0))]);
        Interval::new(value - off, value + off)
    });
    let span = turns * (high - low) * (1.0 + 1e-12);
    let away = span * span / 8.0 * (1.0 + 1e-12);
    if away >= 1.0 {
        return Line { c: Interval::new(-1.0 - off, 1.0 + off), b: Interval::point(0.0) };
    }
    let away = away + off;
    Line { c: (start + end).halved() + Interval::new(-away, away), b: (end - start).halved() }
}

/// The largest |second derivative| of s (1 + |s|)/(1 + |s| + s^2) between two s: 6 p/(1 + p)^3 with p = |s| (1 + |s|), largest at p = 1/2. p is
/// rounded outward.
fn steepest_bend(from: f64, to: f64) -> f64 {
    let p = |s: f64| s.abs() * (1.0 + s.abs());
    let (near, far) =
        if from <= 0.0 && to >= 0.0 { (0.0, p(from).max(p(to))) } else { (p(from).min(p(to)), p(from).max(p(to))) };
    let (near, far) = (near * (1.0 - 1e-12), far * (1.0 + 1e-12));
    let p = if near >= 0.5 { near } else { far.min(0.5) };
    6.0 * p / ((1.0 + p) * (1.0 + p) * (1.0 + p)) * (1.0 + 1e-12)
}

/// The layout of the coefficients of a polynomial in the t, with one axis for each input; the first input changes slowest.
struct Places {
    /// The highest power of each t.
    degrees: Vec<usize>,
    /// The distance from one power of a t to the next.
    strides: Vec<usize>,
    /// The number of coefficients.
    size: usize,
}

impl Places {
    fn new(surface: &Surface, factors: &[Factor], inputs: usize) -> Places {
        let degree = |k: usize, powers: &[u32]| {
            let of = factors.iter().zip(powers).filter(|(factor, _)| factor.input == k);
            of.map(|(_, power)| *power as usize).sum::<usize>()
        };
        let terms = || surface.terms.iter().filter(|term| term.coefficient != 0.0);
        let degrees: Vec<usize> = (0..inputs).map(|k| terms().map(|term| degree(k, &term.powers)).max().unwrap_or(0)).collect();
        let strides = (0..inputs).map(|k| degrees[k + 1..].iter().map(|degree| degree + 1).product()).collect();
        let size = degrees.iter().map(|degree| degree + 1).product();
        Places { degrees, strides, size }
    }

    /// The power of each t at an index.
    fn powers(&self, place: usize) -> impl Iterator<Item = u32> + '_ {
        self.degrees.iter().zip(&self.strides).map(move |(degree, stride)| (place / stride % (degree + 1)) as u32)
    }
}

/// A polynomial in t times a line: one degree more.
fn times(polynomial: &mut Vec<Interval>, line: Line) {
    polynomial.push(Interval::point(0.0));
    for k in (0..polynomial.len()).rev() {
        let from_below = if k == 0 { Interval::point(0.0) } else { polynomial[k - 1] * line.b };
        polynomial[k] = polynomial[k] * line.c + from_below;
    }
}

fn middle(cell: &[[f64; 2]]) -> Vec<f64> {
    cell.iter().map(|[low, high]| low / 2.0 + high / 2.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bend_is_nowhere_steeper_than_its_bound() {
        let value = |s: f64| Shape::step(s, 1.0);
        let h = 1e-3;
        for from in (-60..60).map(|k| f64::from(k) / 10.0) {
            for span in [0.05, 0.3, 1.0, 4.0] {
                let bound = steepest_bend(from, from + span);
                let mut greatest = 0.0f64;
                for k in 1..100 {
                    let s = from + span * f64::from(k) / 100.0;
                    let second = (value(s + h) - 2.0 * value(s) + value(s - h)) / (h * h);
                    greatest = greatest.max(second.abs());
                }
                // The difference quotient errs by some h (at the centre the third derivative is -6) and by its rounding.
                assert!(greatest <= bound + 7.0 * h, "{from} {span}: {greatest} {bound}");
                assert!(bound <= greatest + 0.2 * span + 7.0 * h, "{from} {span}: {greatest} {bound}");
            }
        }
    }
}

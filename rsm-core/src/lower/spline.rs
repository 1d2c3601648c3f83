//! Lowers a tensor spline: its cell by arithmetic, its active coefficients by index.
//!
//! In: a spline and the clamped arguments. Out: the register of its value. For an input with n cells, with the argument xi in [low, high]:
//!
//! ```text
//! s = (xi - low) n/(high - low) - 1/2      k = the integer nearest to s: the cell      w = s - k, from -1/2 to 1/2
//! u = w + 1/2      v = 1/2 - w
//! degree 1         c_k + u (c_(k+1) - c_k)
//! degree 3         v^3 c_k + (4 - 3 u^2 (1 + v)) c_(k+1) + (4 - 3 v^2 (1 + u)) c_(k+2) + u^3 c_(k+3), with coefficients that are divided by 6
//! ```
//!
//! Of two inputs, the coefficient c is itself such a sum along the other input, and so on. The cost does not depend on the number of cells.
//!
//! The ideal s ends at n - 1/2. A computed s may be above it, and of two nearest integers the even one is taken: the cell n is then read. So the
//! table has one more coefficient along each input, which continues the last piece: the value is the same in both cells. No clamp of k is
//! necessary. Where a computed s is on the other side of the border between two cells, the pieces differ by their jump in the derivative of order
//! `degree`: [`Seam`] gives its size to the rounding analysis.

use std::sync::Arc;

use num_traits::Signed as _;

use crate::model::{Input, Spline};
use crate::number::{Precision, Rational, exact, integer};
use crate::tape::{Constant, Op, Reg, Seam, Table, TapeBuilder};

use super::variables::Variables;

/// The weights of the active coefficients along one input, and the cell.
struct Along {
    /// s, the operand of the nearest integer.
    argument: Reg,
    cell: Reg,
    weights: Weights,
}

enum Weights {
    /// u.
    Linear(Reg),
    /// The four weights, times 6.
    Cubic([Reg; 4]),
}

/// The value of the spline.
pub(super) fn lower(tape: &mut TapeBuilder, variables: &mut Variables<'_>, spline: &Spline, inputs: &[Input]) -> Reg {
    let each: Vec<Along> = inputs.iter().enumerate().map(|(k, input)| along(tape, variables, spline, k, input)).collect();
    let extended = Extended::of(spline);
    let table = Arc::new(extended.table(tape.precision(), spline));
    // The last input changes fastest, so its stride is 1.
    let index = each.iter().zip(&extended.strides).map(|(along, stride)| (along.cell, *stride));
    let index = index.map(|(cell, stride)| tape.times(cell, integer(stride as i64))).collect::<Vec<Reg>>();
    let index = index.into_iter().reduce(|sum, product| tape.add(sum, product)).expect("a surface has an input");
    let source = Source { each: &each, strides: &extended.strides, table: &table, index };
    let result = source.value(tape, 0, 0);
    for (along, size) in each.iter().zip(jumps(spline, &extended)) {
        tape.add_seam(Seam { result, argument: along.argument, power: spline.degree, size });
    }
    result
}

fn along(tape: &mut TapeBuilder, variables: &mut Variables<'_>, spline: &Spline, k: usize, input: &Input) -> Along {
    let seen = variables.seen(tape, k);
    let [low, high] = input.range.map(exact);
    let half = integer(1) / integer(2);
    // Not one difference from low + half a cell: xi - low is never negative, so no cell below 0 is read.
    let low_end = tape.constant(low.clone());
    let above = tape.subtract(seen, low_end);
    let in_cells = tape.times(above, integer(i64::from(spline.cells[k])) / (high - low));
    let half = tape.constant(half);
    let argument = tape.subtract(in_cells, half);
    let cell = tape.push(Op::Nearest(argument));
    let w = tape.subtract(argument, cell);
    let u = tape.add(w, half);
    if spline.degree == 1 {
        return Along { argument, cell, weights: Weights::Linear(u) };
    }
    let v = tape.subtract(half, w);
    let [one, three, four] = [1, 3, 4].map(|number| tape.constant(integer(number)));
    let (uu, vv) = (tape.multiply(u, u), tape.multiply(v, v));
    let mut inner = |square: Reg, other: Reg| {
        let sum = tape.add(one, other);
        let scaled = tape.multiply(square, three);
        let taken = tape.multiply(scaled, sum);
        tape.subtract(four, taken)
    };
    let (second, third) = (inner(uu, v), inner(vv, u));
    let (first, fourth) = (tape.multiply(vv, v), tape.multiply(uu, u));
    Along { argument, cell, weights: Weights::Cubic([first, second, third, fourth]) }
}

/// What the recursion over the inputs reads.
struct Source<'a> {
    each: &'a [Along],
    strides: &'a [usize],
    table: &'a Arc<Table>,
    index: Reg,
}

impl Source<'_> {
    /// The sum over the active coefficients of the inputs from `k` on, at an offset from the first active coefficient.
    fn value(&self, tape: &mut TapeBuilder, k: usize, offset: usize) -> Reg {
        let Some(along) = self.each.get(k) else {
            return tape.push(Op::Load { table: self.table.clone(), index: self.index, offset: offset as u32 });
        };
        let at = |tape: &mut TapeBuilder, i: usize| self.value(tape, k + 1, offset + i * self.strides[k]);
        match along.weights {
            Weights::Linear(u) => {
                let (low, high) = (at(tape, 0), at(tape, 1));
                let rise = tape.subtract(high, low);
                let part = tape.multiply(u, rise);
                tape.add(low, part)
            }
            Weights::Cubic(weights) => {
                let product = |tape: &mut TapeBuilder, i: usize| {
                    let value = at(tape, i);
                    tape.multiply(weights[i], value)
                };
                let [a, b] = [0, 3].map(|i| product(tape, i));
                let outer = tape.add(a, b);
                let [a, b] = [1, 2].map(|i| product(tape, i));
                let inner = tape.add(a, b);
                tape.add(outer, inner)
            }
        }
    }
}

/// The coefficients with one more along each input: it continues the polynomial of the last piece.
pub(super) struct Extended {
    counts: Vec<usize>,
    pub(super) strides: Vec<usize>,
    coefficients: Vec<Rational>,
}

impl Extended {
    pub(super) fn of(spline: &Spline) -> Extended {
        let mut coefficients: Vec<Rational> = spline.coefficients.iter().map(|it| exact(*it)).collect();
        let mut counts = spline.counts();
        for k in 0..counts.len() {
            let inner: usize = counts[k + 1..].iter().product();
            let block = counts[k] * inner;
            let mut longer = Vec::with_capacity(coefficients.len() + coefficients.len() / counts[k]);
            for old in coefficients.chunks(block) {
                longer.extend_from_slice(old);
                for i in 0..inner {
                    let back = |steps: usize| &old[(counts[k] - steps) * inner + i];
                    longer.push(match spline.degree {
                        // The difference of order degree + 1 is 0.
                        1 => integer(2) * back(1) - back(2),
                        _ => integer(4) * back(1) - integer(6) * back(2) + integer(4) * back(3) - back(4),
                    });
                }
            }
            coefficients = longer;
            counts[k] += 1;
        }
        let strides = (0..counts.len()).map(|k| counts[k + 1..].iter().product()).collect();
        Extended { counts, strides, coefficients }
    }

    fn table(&self, precision: Precision, spline: &Spline) -> Table {
        // Weights of degree 3 are 6 times too large, for each input.
        let divisor =
            (0..spline.cells.len()).fold(integer(1), |product, _| product * integer(if spline.degree == 1 { 1 } else { 6 }));
        let constant = |coefficient: &Rational| {
            let exact = coefficient / &divisor;
            Constant { value: precision.round(&exact), exact }
        };
        let last: usize = spline.cells.iter().zip(&self.strides).map(|(cells, stride)| *cells as usize * stride).sum();
        let reach: usize = self.strides.iter().map(|stride| spline.degree as usize * stride).sum();
        let mask = (last + 1).next_power_of_two() - 1;
        Table::new(self.coefficients.iter().map(constant).collect(), mask as u32, reach as u32)
    }

    /// The largest magnitude of the differences, given inputs and the order along each.
    fn largest_difference(&self, orders: &[(usize, usize)]) -> Rational {
        let mut differences = self.coefficients.clone();
        let mut counts = self.counts.clone();
        for (k, order) in orders {
            for _ in 0..*order {
                differences = differences_along(&differences, &counts, *k);
                counts[*k] -= 1;
            }
        }
        differences.iter().map(|it| it.abs()).max().unwrap_or_else(|| integer(0))
    }
}

fn differences_along(values: &[Rational], counts: &[usize], k: usize) -> Vec<Rational> {
    let inner: usize = counts[k + 1..].iter().product();
    let block = counts[k] * inner;
    let of_block = |old: &[Rational]| -> Vec<Rational> { (0..block - inner).map(|i| &old[i + inner] - &old[i]).collect() };
    values.chunks(block).flat_map(of_block).collect()
}

/// For each input the factor of a seam: the largest jump of the derivative of order `degree` divided by its factorial.
///
/// In the neighbour's cell the weights of the other inputs are still a partition of 1, but a piece that is continued beyond its border by the error
/// of s has weights of both signs. Doubling the factor covers this: an error of s is at most a tenth of a cell, where their magnitudes sum up to
/// less than 2.
fn jumps(spline: &Spline, extended: &Extended) -> Vec<f64> {
    let factorial = integer(if spline.degree == 1 { 1 } else { 6 });
    let order = spline.degree as usize + 1;
    let of_input = |k: usize| Precision::F64.round_up(&(extended.largest_difference(&[(k, order)]) * integer(2) / &factorial));
    (0..spline.cells.len()).map(of_input).collect()
}

/// For each derivative, and for each input whose cell may differ, the power and the factor of the seam.
///
/// A derivative with respect to s has one power less; one with respect to another input is that of a spline of first differences along it.
pub(super) fn jumps_of_derivatives(spline: &Spline, ranges: &[[f64; 2]]) -> Vec<Vec<(u32, f64)>> {
    let extended = Extended::of(spline);
    let (degree, order) = (spline.degree, spline.degree as usize + 1);
    let factorial = |n: u32| integer((1..=i64::from(n)).product());
    let of_pair = |by: usize, cell: usize| {
        let [low, high] = ranges[by].map(exact);
        let slope = integer(i64::from(spline.cells[by])) / (high - low);
        // As above, twice for the weights of the other inputs; twice again for those of the first differences beyond their border.
        let (power, largest) = if by == cell {
            (degree - 1, extended.largest_difference(&[(cell, order)]) * integer(2))
        } else {
            (degree, extended.largest_difference(&[(cell, order), (by, 1)]) * integer(4))
        };
        (power, Precision::F64.round_up(&(largest * slope / factorial(power))))
    };
    (0..ranges.len()).map(|by| (0..ranges.len()).map(|cell| of_pair(by, cell)).collect()).collect()
}

//! Bounds the rounding error of a tape, with a proof over a whole box.
//!
//! In: a tape and the box of its arguments. Out: a bound of |tape - ideal| over every argument of the tape's type in the box. The ideal is the same
//! tape with exact constants and without rounding: the true polynomial, with the same saturation (tests against the exact reference check this).
//! Running error analysis after Wilkinson (1963), with ranges from interval arithmetic. The box is divided into cells, because narrower ranges give
//! smaller bounds; the result is the largest bound of a cell.
//!
//! Each register has the range of the computed values and a bound of |computed - ideal|. The range of a computed value needs no outward rounding:
//! rounding is monotone, so the computed result is between the rounded results at the ends of the operands' ranges.

use std::cmp::Ordering;
use std::sync::Arc;

use num_traits::Signed;

use crate::elementary::{self, Computed};
use crate::interval::Interval;
use crate::number::{Precision, Rational, exact, power_of_two};
use crate::tape::{Extremum, Op, Reg, Table, Tape};
use crate::values;

/// The largest number of cells of the box. 4096 cells with 1000 operations take about 40 ms.
const CELLS: usize = 4096;

/// A bound of |tape - ideal| over all arguments of the tape's type in the box. Infinite if there is none: the tape may overflow, or divide by a range
/// that contains zero.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{lower, number::Precision, rounding};
///
/// let bound = |precision| rounding::error_bound(&lower::surface(&checked, 0, precision), &[[0.0, 30.0]]);
/// assert!(bound(Precision::F64) < 1e-13 && bound(Precision::F32) < 1e-4);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn error_bound(tape: &Tape, ranges: &[[f64; 2]]) -> f64 {
    worst_over_cells(tape, ranges, &[tape.output()])[0]
}

/// The bound of every result of a tape, in the order of its `outputs`, as [`error_bound`] gives it for one.
#[must_use]
pub(crate) fn error_bounds(tape: &Tape, ranges: &[[f64; 2]]) -> Vec<f64> {
    let outputs: Vec<Reg> = tape.outputs.iter().map(|output| output.reg).collect();
    worst_over_cells(tape, ranges, &outputs)
}

/// The largest bound of each register over the cells of the box.
fn worst_over_cells(tape: &Tape, ranges: &[[f64; 2]], registers: &[Reg]) -> Vec<f64> {
    let per_side = cells_per_side(ranges.len(), tape.ops.len());
    let parts = |range: &[f64; 2]| (0..per_side).map(|k| side(tape.precision, *range, k, per_side)).collect();
    let parts: Vec<Vec<Option<Side>>> = ranges.iter().map(parts).collect();
    let mut analysis = Analysis::new(tape);
    let mut worst = vec![0.0f64; registers.len()];
    let mut cell = vec![0usize; ranges.len()];
    loop {
        let sides: Option<Vec<Side>> = parts.iter().zip(&cell).map(|(parts, k)| parts[*k]).collect();
        // A cell without any number of the type (a narrow range in f32) has no arguments.
        if let Some(sides) = sides {
            analysis.run(&sides);
            worst.iter_mut().zip(registers).for_each(|(worst, reg)| *worst = worst.max(analysis.of(*reg).error));
            if worst.iter().all(|worst| worst.is_infinite()) {
                return worst;
            }
        }
        let Some(next) = cell.iter().position(|k| *k + 1 < per_side) else { return worst };
        cell[next] += 1;
        cell[..next].fill(0);
    }
}

/// The number of cells per side within the budget: a power of two, at most 2^8; fewer for long tapes.
fn cells_per_side(dimensions: usize, operations: usize) -> usize {
    // mutant `1000 down`: with 4100 cells instead of 4096 the result is the same, because only powers of two count.
    let budget = CELLS * 1000 / operations.max(1000);
    // If the number of cells overflows, it is above the budget.
    let fits = |halvings: &u32| {
        let cells = (1usize << halvings).checked_pow(dimensions as u32);
        cells.is_some_and(|cells| cells <= budget)
    };
    1 << (1..=8).take_while(fits).count()
}

/// The range of one argument in a cell: numbers of the tape's type.
type Side = [f64; 2];

/// The k-th of n parts of a range, with its ends rounded inward to the type. Neighbours share a bound, so no number between is lost: if the shared
/// bound is not a number of the type, no number of the type is on it.
fn side(precision: Precision, [low, high]: [f64; 2], k: usize, n: usize) -> Option<Side> {
    let bound = |j: usize| {
        if j == 0 {
            low
        } else if j == n {
            high
        } else {
            let share = j as f64 / n as f64;
            low * (1.0 - share) + high * share
        }
    };
    let low = precision.round_up(&exact(bound(k)));
    let high = precision.round_down(&exact(bound(k + 1)));
    (low <= high).then_some([low, high])
}

/// The information about a register in one cell.
#[derive(Debug, Clone, Copy)]
struct Known {
    low: f64,
    high: f64,
    /// An upper bound of |computed - ideal|.
    error: f64,
}

impl Known {
    fn magnitude(self) -> f64 {
        magnitude(self.low, self.high)
    }

    /// k, if the register can only be 2^k or only -2^k.
    fn exponent_of_two(self) -> Option<i64> {
        // A subnormal power of two is excluded; it needs no special rule.
        let is_power = self.low.is_normal() && self.low.to_bits() << 12 == 0;
        (self.low == self.high && is_power).then(|| floor_log2(self.low))
    }

    /// No information.
    const NOTHING: Known = Known { low: f64::NEG_INFINITY, high: f64::INFINITY, error: f64::INFINITY };
}

struct Analysis<'t> {
    tape: &'t Tape,
    known: Vec<Known>,
}

impl<'t> Analysis<'t> {
    fn new(tape: &'t Tape) -> Self {
        let of_constant = |op: &Op| match op {
            Op::Constant(constant) => {
                let distance = (exact(constant.value) - &constant.exact).abs();
                Known { low: constant.value, high: constant.value, error: Precision::F64.round_up(&distance) }
            }
            _ => Known::NOTHING,
        };
        Analysis { tape, known: tape.ops.iter().map(of_constant).collect() }
    }

    fn run(&mut self, sides: &[Side]) {
        let mut rows = self.tape.computed.iter().peekable();
        for (reg, op) in self.tape.iter() {
            let known = match *op {
                // Already known.
                Op::Constant(_) => continue,
                Op::Input(port) => {
                    let [low, high] = sides[port.0 as usize];
                    Known { low, high, error: 0.0 }
                }
                // A state depends on all earlier steps, so a single step gives no information about it.
                Op::State(_) => Known::NOTHING,
                Op::Negate(a) => {
                    let a = self.of(a);
                    Known { low: -a.high, high: -a.low, error: a.error }
                }
                Op::Absolute(a) => absolute(self.of(a)),
                Op::Exponent(a) => self.exponent(self.of(a)),
                Op::PowerOfTwo(a) => self.power_of_two(self.of(a)),
                // By convention the ideal takes the piece that the tape takes: `seams` has the difference.
                Op::Nearest(a) => {
                    let a = self.of(a);
                    let found = values::nearest(Interval { low: a.low, high: a.high }, self.tape.precision);
                    Known {
                        low: found.low,
                        high: found.high,
                        error: if found.magnitude().is_finite() { 0.0 } else { f64::INFINITY },
                    }
                }
                Op::Load { ref table, index, offset } => self.load(table, self.of(index), offset),
                Op::Subtract(a, b) if *self.tape.op(b) == Op::Nearest(a) && self.of(a).magnitude() <= values::FEW => {
                    let whole = self.of(b);
                    let known = self.of(a);
                    let interval = |it: Known| Interval { low: it.low, high: it.high };
                    let rest = values::remainder(interval(known), interval(whole));
                    Known { low: rest.low, high: rest.high, error: known.error }
                }
                Op::Add(a, b) => self.sum(a, b, false),
                Op::Subtract(a, b) => self.sum(a, b, true),
                Op::Multiply(a, b) => self.product(self.of(a), self.of(b), a == b),
                Op::Divide(a, b) => self.quotient(self.of(a), self.of(b)),
                // Only `Select` reads it, and it uses the operands of the comparison.
                Op::Less(..) => Known::NOTHING,
                Op::Select { condition, then, otherwise } => self.select(reg, condition, then, otherwise),
            };
            // For an elementary function, the proof about the function is better than an analysis of its operations.
            let known = match rows.next_if(|row| row.result == reg) {
                Some(row) => self.computed(row),
                None => known,
            };
            let known = self.over_seams(reg, known);
            let largest = self.tape.precision.largest();
            // False for a NaN.
            let is_known = known.low >= -largest && known.high <= largest && known.error.is_finite();
            self.known[reg.0 as usize] = if is_known { known } else { Known::NOTHING };
        }
    }

    /// An elementary function: its slope multiplies the errors of the arguments, and the proved error of its operations is added. The ideal is the
    /// exact function.
    fn computed(&self, row: &Computed) -> Known {
        let arguments: Vec<Known> = row.arguments.iter().map(|argument| self.of(*argument)).collect();
        let computed: Vec<Interval> = arguments.iter().map(|a| Interval { low: a.low, high: a.high }).collect();
        // All numbers between an argument and its ideal.
        let wide = arguments.iter().map(|a| Interval {
            low: if a.error == 0.0 { a.low } else { difference_down(a.low, a.error) },
            high: sum_up(a.high, a.error),
        });
        let wide: Vec<Interval> = wide.collect();
        let range = elementary::range::over(row.function, &computed);
        if !range.magnitude().is_finite() || !elementary::range::over(row.function, &wide).magnitude().is_finite() {
            return Known::NOTHING;
        }
        let unit = product_up(2.0 * self.half_ulp(range.magnitude()), row.function.error_in_units());
        let slopes = elementary::range::slopes(row.function, &wide);
        let propagated = arguments.iter().zip(slopes).map(|(a, slope)| product_up(slope, a.error));
        Known { low: range.low - unit, high: range.high + unit, error: propagated.fold(unit, sum_up) }
    }

    /// The entries that the index can reach.
    fn load(&self, table: &Arc<Table>, index: Known, offset: u32) -> Known {
        // An index is made of integers, which are exact: an error of less than 1/2 is none.
        if index.error >= 0.5 {
            return Known::NOTHING;
        }
        let found = values::load(table, Interval { low: index.low, high: index.high }, offset);
        found.map_or(Known::NOTHING, |found| Known { low: found.values.low, high: found.values.high, error: found.error })
    }

    /// The error where the ideal takes another piece: see [`crate::tape::Seam`].
    fn over_seams(&self, reg: Reg, known: Known) -> Known {
        let own = self.tape.seams.iter().filter(|seam| seam.result == reg);
        let added = own.map(|seam| {
            let distance = self.of(seam.argument).error;
            if distance == 0.0 {
                return 0.0;
            }
            // A seam's size holds for the borders that are as near as this.
            if distance.is_nan() || distance > 0.1 {
                return f64::INFINITY;
            }
            (0..seam.power).fold(seam.size, |product, _| product_up(product, distance))
        });
        Known { error: added.fold(known.error, sum_up), ..known }
    }

    /// The tape and the ideal may have different exponents if the operand has an error.
    fn exponent(&self, a: Known) -> Known {
        if a.error > 0.0 || !a.magnitude().is_finite() {
            return Known::NOTHING;
        }
        let range = Interval { low: a.low, high: a.high }.exponent(self.tape.precision);
        Known { low: range.low, high: range.high, error: 0.0 }
    }

    /// An operand without error is an integer, because the code that writes this operation ensures it.
    fn power_of_two(&self, a: Known) -> Known {
        match (Interval { low: a.low, high: a.high }.power_of_two(self.tape.precision), a.error) {
            (Some(range), 0.0) => Known { low: range.low, high: range.high, error: 0.0 },
            _ => Known::NOTHING,
        }
    }

    fn of(&self, reg: Reg) -> Known {
        self.known[reg.0 as usize]
    }

    /// An endpoint as the tape would compute it: f64 operations on numbers of the type, rounded to the type. For f32 this double rounding changes
    /// nothing for +, -, * and /, because 53 >= 2*24 + 2 bits (Figueroa 1995).
    fn rounded(&self, value: f64) -> f64 {
        match self.tape.precision {
            Precision::F64 => value,
            Precision::F32 => f64::from(value as f32),
        }
    }

    fn sum(&self, left: Reg, right: Reg, subtract: bool) -> Known {
        let (a, b) = (self.of(left), self.of(right));
        // For a number, not for a NaN or an infinity.
        if subtract && left == right && a.magnitude().is_finite() {
            return Known { low: 0.0, high: 0.0, error: 0.0 };
        }
        let (b_low, b_high) = if subtract { (-b.high, -b.low) } else { (b.low, b.high) };
        let (low, high) = (self.rounded(a.low + b_low), self.rounded(a.high + b_high));
        let rounding = if is_exact_difference(a, b_low, b_high) { 0.0 } else { self.half_ulp(magnitude(low, high)) };
        Known { low, high, error: sum_up(sum_up(a.error, b.error), rounding) }
    }

    fn product(&self, a: Known, b: Known, square: bool) -> Known {
        let products = [a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high];
        let mut low = self.rounded(products.into_iter().fold(f64::INFINITY, f64::min));
        let high = self.rounded(products.into_iter().fold(f64::NEG_INFINITY, f64::max));
        if square {
            low = low.max(0.0);
        }
        // a b - A B = a (b - B) + B (a - A), |B| <= |b| + error of b
        let from_b = product_up(a.magnitude(), b.error);
        let from_a = product_up(sum_up(b.magnitude(), b.error), a.error);
        let rounding = match (a.exponent_of_two(), b.exponent_of_two()) {
            (_, Some(exponent)) | (Some(exponent), None) => self.rounding_of_shift(exponent, low, high),
            (None, None) => self.half_ulp(magnitude(low, high)),
        };
        Known { low, high, error: sum_up(sum_up(from_b, from_a), rounding) }
    }

    fn quotient(&self, a: Known, b: Known) -> Known {
        // Not positive if the divisor may be zero; NaN if nothing is known about it.
        let ideal_nearest = difference_down(b.low.max(-b.high), b.error);
        // mutant `<= to <`: a quotient by zero is not finite, so nothing is known about it either.
        if ideal_nearest.is_nan() || ideal_nearest <= 0.0 {
            return Known::NOTHING;
        }
        let quotients = [a.low / b.low, a.low / b.high, a.high / b.low, a.high / b.high];
        let low = self.rounded(quotients.into_iter().fold(f64::INFINITY, f64::min));
        let high = self.rounded(quotients.into_iter().fold(f64::NEG_INFINITY, f64::max));
        // a/b - A/B = (a - A)/B + (a/b) (B - b)/B
        let rounding = match b.exponent_of_two() {
            Some(exponent) => self.rounding_of_shift(-exponent, low, high),
            None => self.half_ulp(magnitude(low, high)),
        };
        let largest = sum_up(magnitude(low, high), rounding);
        let propagated = quotient_up(sum_up(a.error, product_up(largest, b.error)), ideal_nearest);
        Known { low, high, error: sum_up(propagated, rounding) }
    }

    fn select(&self, reg: Reg, condition: Reg, then: Reg, otherwise: Reg) -> Known {
        match self.tape.extremum(reg) {
            Some(Extremum::AtLeast { value, bound }) => {
                at_least(self.of(value), self.of(bound), self.is_rounded(bound, Ordering::Greater))
            }
            Some(Extremum::AtMost { value, bound }) => {
                let inward = self.is_rounded(bound, Ordering::Less);
                negated(at_least(negated(self.of(value)), negated(self.of(bound)), inward))
            }
            None => {
                let Op::Less(left, right) = *self.tape.op(condition) else { return Known::NOTHING };
                let is_certain = self.is_certain(left, right);
                let (left, right) = (self.of(left), self.of(right));
                let (a, b) = (self.of(then), self.of(otherwise));
                // If the tape and the ideal may select differently, nothing is known.
                if !is_certain {
                    Known::NOTHING
                } else if left.high < right.low {
                    a
                } else if left.low >= right.high {
                    b
                } else {
                    Known { low: a.low.min(b.low), high: a.high.max(b.high), error: a.error.max(b.error) }
                }
            }
        }
    }

    /// Whether the comparison always has the same result on the tape and in the ideal. That is so in three cases: both operands are exact; one is
    /// exact and the other is a bound that was rounded away from it, because no number of the type is between the bound and its exact value; or the
    /// operands are the difference of exact numbers and zero, because the sign of a rounded difference is right.
    fn is_certain(&self, left: Reg, right: Reg) -> bool {
        let is_exact = |reg: Reg| self.of(reg).error == 0.0;
        let is_zero = |reg: Reg| self.of(reg).magnitude() == 0.0 && is_exact(reg);
        let is_next = |reg: Reg, round: fn(Precision, &Rational) -> f64| matches!(self.tape.op(reg), Op::Constant(constant) if round(self.tape.precision, &constant.exact) == constant.value);
        let has_exact_sign = |reg: Reg| matches!(*self.tape.op(reg), Op::Subtract(a, b) if is_exact(a) && is_exact(b));
        (is_exact(left) && is_exact(right))
            || (is_exact(left) && is_next(right, Precision::round_up))
            || (is_exact(right) && is_next(left, Precision::round_down))
            || (has_exact_sign(left) && is_zero(right))
            || (has_exact_sign(right) && is_zero(left))
    }

    /// Whether a register holds a constant that is exact or was rounded in the given direction.
    fn is_rounded(&self, reg: Reg, direction: Ordering) -> bool {
        match self.tape.op(reg) {
            Op::Constant(constant) => {
                let order = exact(constant.value).cmp(&constant.exact);
                order == Ordering::Equal || order == direction
            }
            _ => false,
        }
    }

    /// The rounding error of a number times 2^exponent, with the result in [low, high]. Only the exponent changes, so there is none, unless the
    /// result may be subnormal: then low bits are lost. (An overflow is handled elsewhere.) A result equal to the smallest normal number may have
    /// been rounded up to it.
    fn rounding_of_shift(&self, exponent: i64, low: f64, high: f64) -> f64 {
        let smallest_normal =
            power_of_two(self.tape.precision.smallest_exponent() + self.tape.precision.significand_bits() - 1);
        let is_normal = low > smallest_normal || high < -smallest_normal;
        if exponent >= 0 || is_normal { 0.0 } else { self.half_ulp(0.0) }
    }

    /// The rounding error of a result of at most this magnitude: half a unit in its last place. Valid for subnormal results too.
    fn half_ulp(&self, magnitude: f64) -> f64 {
        if !magnitude.is_finite() {
            return f64::INFINITY;
        }
        let exponent = floor_log2(magnitude);
        let ulp = (exponent - self.tape.precision.significand_bits() + 1).max(self.tape.precision.smallest_exponent());
        // Half of the smallest subnormal f64 is not an f64; the smallest subnormal itself is a valid bound.
        power_of_two((ulp - 1).max(-1074))
    }
}

/// The largest magnitude in [low, high].
fn magnitude(low: f64, high: f64) -> f64 {
    (-low).max(high)
}

/// floor(log2 |x|) for a normal x; for 0 (of either sign) and subnormals one less than the smallest of these.
fn floor_log2(value: f64) -> i64 {
    (value.abs().to_bits() >> 52) as i64 - 1023
}

/// Sterbenz: a - b is exact if b/2 <= a <= 2 b, both with the same sign. `b` is given negated. Its sign need not be tested: if b < 0, no a is between
/// b/2 and 2 b, and 0 - 0 is exact.
fn is_exact_difference(a: Known, minus_b_low: f64, minus_b_high: f64) -> bool {
    let (b_low, b_high) = (-minus_b_high, -minus_b_low);
    let within = |a_low: f64, a_high: f64, b_low: f64, b_high: f64| a_low >= b_high / 2.0 && a_high <= 2.0 * b_low;
    within(a.low, a.high, b_low, b_high) || within(-a.high, -a.low, -b_high, -b_low)
}

fn negated(a: Known) -> Known {
    Known { low: -a.high, high: -a.low, error: a.error }
}

fn absolute(a: Known) -> Known {
    // Neither end is positive if the range contains 0.
    let nearest = a.low.max(-a.high);
    Known { low: nearest.max(0.0), high: a.magnitude(), error: a.error }
}

/// The error of a maximum is at most the larger of the two errors. If an exact value is never below a bound that was rounded upward, it is not below
/// the ideal bound either, and both maxima are the value itself. (So a clamp to the box adds no error for an argument in the box.)
fn at_least(value: Known, bound: Known, bound_rounded_upward: bool) -> Known {
    let (low, high) = (value.low.max(bound.low), value.high.max(bound.high));
    let is_value = value.error == 0.0 && value.low >= bound.high && bound_rounded_upward;
    Known { low, high, error: if is_value { 0.0 } else { value.error.max(bound.error) } }
}

// Upper bounds of exact results for operands that are not negative. All errors are added, multiplied and divided with these functions, so the
// rounding of the bound itself is included. A zero operand gives an exact zero.

fn sum_up(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { a + b } else { (a + b).next_up() }
}

/// NaN for zero times infinity, because nothing is known about such a product.
fn product_up(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { a * b } else { (a * b).next_up() }
}

/// A lower bound.
fn difference_down(a: f64, b: f64) -> f64 {
    if b == 0.0 { a } else { (a - b).next_down() }
}

/// `b` is positive.
fn quotient_up(a: f64, b: f64) -> f64 {
    if a == 0.0 { 0.0 } else { (a / b).next_up() }
}

#[cfg(test)]
mod tests;

//! Bounds the rounding error of a tape, as a theorem over a whole box.
//!
//! In: a tape and the box of its arguments. Out: a bound of |tape - ideal| over every argument of the tape's type in the box, where the
//! ideal is the same tape with exact constants and no rounding (which is the true polynomial, saturated alike: the exact
//! reference tests that identity). Running error analysis after Wilkinson (1963), with ranges from interval arithmetic; the box is cut into
//! cells and the largest bound of a cell is the answer, since narrower ranges give smaller bounds.
//!
//! Per register: the range of the computed values, and a bound of |computed - ideal|. The range of a computed value needs no outward
//! rounding: rounding is monotone, so the computed result lies between the rounded results at the ends of the operands' ranges.

use std::cmp::Ordering;

use num_traits::Signed;

use crate::elementary::{self, Computed};
use crate::interval::Interval;
use crate::number::{Precision, Rational, exact, power_of_two};
use crate::tape::{Extremum, Op, Reg, Tape};

/// How many cells the box is cut into, at most. 4096 cells of 1000 operations take some 40 ms.
const CELLS: usize = 4096;

/// A bound of |tape - ideal| over all arguments of the tape's type in the box; infinite when none can be given (the tape may overflow, or
/// divide by a range that holds zero).
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
        // A cell without any number of the type (a narrow range in f32) holds no argument.
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

/// As many cells per side as stay within the budget, a power of two, at most 2^8; fewer for long tapes.
fn cells_per_side(dimensions: usize, operations: usize) -> usize {
    // mutant `1000 down`: 4100 cells are no more than 4096, since powers of two are counted.
    let budget = CELLS * 1000 / operations.max(1000);
    // More cells than a number can count are more than the budget.
    let fits = |halvings: &u32| {
        let cells = (1usize << halvings).checked_pow(dimensions as u32);
        cells.is_some_and(|cells| cells <= budget)
    };
    1 << (1..=8).take_while(fits).count()
}

/// The range of one argument in a cell: numbers of the tape's type.
type Side = [f64; 2];

/// The k-th of n parts of a range, its ends rounded inward to the type. Neighbours share their bound, so no number between is lost:
/// a shared bound that is no number of the type has none of the type on it.
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

/// What is known of a register in one cell.
#[derive(Debug, Clone, Copy)]
struct Known {
    low: f64,
    high: f64,
    /// |computed - ideal| is at most this.
    error: f64,
}

impl Known {
    fn magnitude(self) -> f64 {
        magnitude(self.low, self.high)
    }

    /// k, where the register holds nothing but 2^k or nothing but -2^k.
    fn exponent_of_two(self) -> Option<i64> {
        // A subnormal power of two is none here: it needs no rule of its own.
        let is_power = self.low.is_normal() && self.low.to_bits() << 12 == 0;
        (self.low == self.high && is_power).then(|| floor_log2(self.low))
    }

    /// Range and error unknown.
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
                // Known from the beginning.
                Op::Constant(_) => continue,
                Op::Input(port) => {
                    let [low, high] = sides[port.0 as usize];
                    Known { low, high, error: 0.0 }
                }
                // What a state holds depends on all steps before: nothing is known of one step alone.
                Op::State(_) => Known::NOTHING,
                Op::Negate(a) => {
                    let a = self.of(a);
                    Known { low: -a.high, high: -a.low, error: a.error }
                }
                Op::Absolute(a) => absolute(self.of(a)),
                Op::Exponent(a) => self.exponent(self.of(a)),
                Op::PowerOfTwo(a) => self.power_of_two(self.of(a)),
                Op::Add(a, b) => self.sum(a, b, false),
                Op::Subtract(a, b) => self.sum(a, b, true),
                Op::Multiply(a, b) => self.product(self.of(a), self.of(b), a == b),
                Op::Divide(a, b) => self.quotient(self.of(a), self.of(b)),
                // Only `Select` reads it, and looks at the operands itself.
                Op::Less(..) => Known::NOTHING,
                Op::Select { condition, then, otherwise } => self.select(reg, condition, then, otherwise),
            };
            // What its rows compute is known better than they tell: they choose, and keep what rounding loses.
            let known = match rows.next_if(|row| row.result == reg) {
                Some(row) => self.computed(row),
                None => known,
            };
            let largest = self.tape.precision.largest();
            // Not so for a NaN.
            let is_known = known.low >= -largest && known.high <= largest && known.error.is_finite();
            self.known[reg.0 as usize] = if is_known { known } else { Known::NOTHING };
        }
    }

    /// An elementary function: the slope carries the errors of its arguments, and the rows err by what is proved of them. The ideal is
    /// the function itself.
    fn computed(&self, row: &Computed) -> Known {
        let arguments: Vec<Known> = row.arguments.iter().map(|argument| self.of(*argument)).collect();
        let computed: Vec<Interval> = arguments.iter().map(|a| Interval { low: a.low, high: a.high }).collect();
        // Between an argument and its ideal.
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

    /// Tape and ideal may have different exponents where the operand has an error.
    fn exponent(&self, a: Known) -> Known {
        if a.error > 0.0 || !a.magnitude().is_finite() {
            return Known::NOTHING;
        }
        let range = Interval { low: a.low, high: a.high }.exponent(self.tape.precision);
        Known { low: range.low, high: range.high, error: 0.0 }
    }

    /// An operand without error is a whole number: who writes the operation makes it one.
    fn power_of_two(&self, a: Known) -> Known {
        match (Interval { low: a.low, high: a.high }.power_of_two(self.tape.precision), a.error) {
            (Some(range), 0.0) => Known { low: range.low, high: range.high, error: 0.0 },
            _ => Known::NOTHING,
        }
    }

    fn of(&self, reg: Reg) -> Known {
        self.known[reg.0 as usize]
    }

    /// An endpoint as the tape would compute it: operations of f64 on numbers of the type, rounded to the type. For f32 the f64 result
    /// is innocent double rounding: 53 >= 2*24 + 2 bits (Figueroa 1995), for +, -, * and /.
    fn rounded(&self, value: f64) -> f64 {
        match self.tape.precision {
            Precision::F64 => value,
            Precision::F32 => f64::from(value as f32),
        }
    }

    fn sum(&self, left: Reg, right: Reg, subtract: bool) -> Known {
        let (a, b) = (self.of(left), self.of(right));
        // Of a number, not of a NaN or an infinity.
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
        // Not positive where the divisor may be zero, NaN where nothing is known of it.
        let ideal_nearest = difference_down(b.low.max(-b.high), b.error);
        // mutant `<= to <`: a quotient by zero is not finite, and nothing is known of it either.
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
                // Where tape and ideal may choose differently nothing is known.
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

    /// Whether the tape and its ideal always compare alike. So they do where both operands are exact. So they do for an exact number beside a bound
    /// that was rounded away from it: no number of the type lies between the bound and what it stands for. And the sign of a difference
    /// of exact numbers is right however it is rounded.
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
    /// result may be subnormal: then bits are shifted out at its end. (An overflow is no number, and not asked here.) What is computed as
    /// the smallest normal number may have been rounded up to it.
    fn rounding_of_shift(&self, exponent: i64, low: f64, high: f64) -> f64 {
        let smallest_normal =
            power_of_two(self.tape.precision.smallest_exponent() + self.tape.precision.significand_bits() - 1);
        let is_normal = low > smallest_normal || high < -smallest_normal;
        if exponent >= 0 || is_normal { 0.0 } else { self.half_ulp(0.0) }
    }

    /// The rounding error of a result of at most this magnitude: half a unit in its last place. Holds for subnormal results too.
    fn half_ulp(&self, magnitude: f64) -> f64 {
        if !magnitude.is_finite() {
            return f64::INFINITY;
        }
        let exponent = floor_log2(magnitude);
        let ulp = (exponent - self.tape.precision.significand_bits() + 1).max(self.tape.precision.smallest_exponent());
        // Half of the smallest subnormal of f64 is no f64: one whole is a bound all the same.
        power_of_two((ulp - 1).max(-1074))
    }
}

/// The largest magnitude in [low, high].
fn magnitude(low: f64, high: f64) -> f64 {
    (-low).max(high)
}

/// floor(log2 |x|) of a normal x; one less than the smallest of these for 0 (of either sign) and subnormals.
fn floor_log2(value: f64) -> i64 {
    (value.abs().to_bits() >> 52) as i64 - 1023
}

/// Sterbenz: a - b is exact when b/2 <= a <= 2 b, both of one sign. `b` comes negated. That it is positive need not be asked: if b < 0, no a is
/// at least b/2 and at most 2 b, and 0 - 0 is exact.
fn is_exact_difference(a: Known, minus_b_low: f64, minus_b_high: f64) -> bool {
    let (b_low, b_high) = (-minus_b_high, -minus_b_low);
    let within = |a_low: f64, a_high: f64, b_low: f64, b_high: f64| a_low >= b_high / 2.0 && a_high <= 2.0 * b_low;
    within(a.low, a.high, b_low, b_high) || within(-a.high, -a.low, -b_high, -b_low)
}

fn negated(a: Known) -> Known {
    Known { low: -a.high, high: -a.low, error: a.error }
}

fn absolute(a: Known) -> Known {
    // Neither end is positive where the range holds 0.
    let nearest = a.low.max(-a.high);
    Known { low: nearest.max(0.0), high: a.magnitude(), error: a.error }
}

/// The maximum moves by no more than the larger of two moves. An exact value that is never below a bound which was rounded upward
/// is not below the ideal bound either: both maxima are the value itself. (So a clamp to the box costs an argument in the box nothing.)
fn at_least(value: Known, bound: Known, bound_rounded_upward: bool) -> Known {
    let (low, high) = (value.low.max(bound.low), value.high.max(bound.high));
    let is_value = value.error == 0.0 && value.low >= bound.high && bound_rounded_upward;
    Known { low, high, error: if is_value { 0.0 } else { value.error.max(bound.error) } }
}

// Bounds of the exact results for operands that are not negative. Errors are summed, multiplied and divided by these alone, so
// what the bound itself rounds is in the bound. A zero is exact: what loses nothing is charged nothing.

fn sum_up(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { a + b } else { (a + b).next_up() }
}

/// NaN for zero times infinity: nothing is known of such a product.
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

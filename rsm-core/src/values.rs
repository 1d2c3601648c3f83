//! The range of the values that a tape computes, including rounding, over a cell of arguments.
//!
//! In: a tape and bounds of its arguments. Out: an interval that contains every result of the emitted evaluator in the cell. Rounding is monotone, so
//! the results at the ends of the operands' ranges, rounded as on the tape, are the ends of the range of a result. If the cell is a point, they are
//! the bits of the evaluator. The certificate's range is about the true polynomial; this one is about the computed numbers, and it does not search.
//! Its excess is proportional to the width of the cell, so a caller who needs a tighter range divides the cell.

use crate::elementary::{self, Function};
use crate::interval::Interval;
use crate::number::Precision;
use crate::scalar::Scalar as _;
use crate::tape::{Extremum, Op, Reg, Table, Tape};

/// The ranges of a tape's registers, kept so that repeated evaluation allocates nothing.
#[derive(Debug, Clone)]
pub struct Values<'t> {
    tape: &'t Tape,
    extrema: Vec<Option<Extremum>>,
    ranges: Vec<Interval>,
}

/// No information.
const ANYTHING: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };

impl<'t> Values<'t> {
    /// For a tape without states.
    #[must_use]
    pub fn new(tape: &'t Tape) -> Self {
        let extrema = (0..tape.ops.len()).map(|k| tape.extremum(Reg(k as u32))).collect();
        Values { tape, extrema, ranges: vec![ANYTHING; tape.ops.len()] }
    }

    /// The range of all values that the tape computes for arguments of its type between these bounds. The bounds must be numbers of the type.
    /// Arguments beyond the range of an input are clamped or extrapolated like in the evaluator. The result is unbounded if nothing is certain: if a
    /// bound is NaN, if an operation may give an infinity or a NaN, or if a selection is not a minimum or maximum.
    ///
    /// # Panics
    /// If the number of bounds differs from the number of arguments.
    #[must_use]
    pub fn over(&mut self, cell: &[Interval]) -> Interval {
        assert_eq!(cell.len(), self.tape.inputs.len(), "one pair of bounds an argument");
        let mut rows = self.tape.computed.iter().peekable();
        for (k, op) in self.tape.ops.iter().enumerate() {
            let of = |reg: Reg| self.ranges[reg.0 as usize];
            let found = match *op {
                Op::Constant(ref constant) => Interval::point(constant.value),
                Op::Input(port) => cell[port.0 as usize],
                Op::State(_) | Op::Less(..) => ANYTHING,
                Op::Negate(a) => -of(a),
                Op::Absolute(a) => absolute(of(a)),
                Op::Exponent(a) => of(a).exponent(self.tape.precision),
                Op::PowerOfTwo(a) => of(a).power_of_two(self.tape.precision).unwrap_or(ANYTHING),
                Op::Nearest(a) => nearest(of(a), self.tape.precision),
                Op::Load { ref table, index, offset } => load(table, of(index), offset).map_or(ANYTHING, |found| found.values),
                // What is left of a number without its nearest integer.
                Op::Subtract(a, b) if *self.tape.op(b) == Op::Nearest(a) && of(a).magnitude() <= FEW => remainder(of(a), of(b)),
                Op::Add(a, b) => self.rounded(of(a).low + of(b).low, of(a).high + of(b).high),
                // For numbers, not for an infinity or a NaN.
                Op::Subtract(a, b) if a == b && of(a).magnitude().is_finite() => Interval::point(0.0),
                Op::Subtract(a, b) => self.rounded(of(a).low - of(b).high, of(a).high - of(b).low),
                Op::Multiply(a, b) if a == b => self.square(of(a)),
                Op::Multiply(a, b) => self.of_ends(of(a), of(b), |x, y| x * y),
                Op::Divide(_, b) if of(b).low <= 0.0 && of(b).high >= 0.0 => ANYTHING,
                Op::Divide(a, b) => self.of_ends(of(a), of(b), |x, y| x / y),
                Op::Select { condition, then, otherwise } => match self.extrema[k] {
                    Some(Extremum::AtLeast { value, bound }) => {
                        let (value, bound) = (of(value), of(bound));
                        Interval { low: value.low.max(bound.low), high: value.high.max(bound.high) }
                    }
                    Some(Extremum::AtMost { value, bound }) => {
                        let (value, bound) = (of(value), of(bound));
                        Interval { low: value.low.min(bound.low), high: value.high.min(bound.high) }
                    }
                    None => match *self.tape.op(condition) {
                        Op::Less(left, right) if of(left).high < of(right).low => of(then),
                        Op::Less(left, right) if of(left).low >= of(right).high => of(otherwise),
                        _ => of(then).hull(of(otherwise)),
                    },
                },
            };
            // The rows of an elementary function give its value to one unit in the last place.
            let found = match rows.next_if(|row| row.result == Reg(k as u32)) {
                Some(row) => {
                    let arguments: Vec<Interval> = row.arguments.iter().map(|reg| self.ranges[reg.0 as usize]).collect();
                    let range = elementary::range::over(row.function, &arguments);
                    let is_exact = row.function == Function::Floor;
                    if is_exact { range } else { Interval { low: range.low.next_down(), high: range.high.next_up() } }
                }
                None => found,
            };
            // An infinite end may come from overflow, and a later operation may then give NaN.
            let is_known = found.low.is_finite() && found.high.is_finite();
            self.ranges[k] = if is_known { found } else { ANYTHING };
        }
        self.of(self.tape.output())
    }

    /// The range of a register in the last cell of [`Values::over`]: another result.
    #[must_use]
    pub fn of(&self, reg: Reg) -> Interval {
        self.ranges[reg.0 as usize]
    }

    /// Ends as the tape would compute them: f64 operations on numbers of the type, rounded to the type. For f32 this double rounding changes nothing
    /// for +, -, * and /, because 53 >= 2 * 24 + 2 bits (Figueroa 1995).
    fn rounded(&self, low: f64, high: f64) -> Interval {
        if low.is_nan() || high.is_nan() {
            return ANYTHING;
        }
        match self.tape.precision {
            Precision::F64 => Interval { low, high },
            Precision::F32 => Interval { low: f64::from(low as f32), high: f64::from(high as f32) },
        }
    }

    fn of_ends(&self, a: Interval, b: Interval, operation: impl Fn(f64, f64) -> f64) -> Interval {
        let each = [operation(a.low, b.low), operation(a.low, b.high), operation(a.high, b.low), operation(a.high, b.high)];
        if each.iter().any(|value| value.is_nan()) {
            return ANYTHING;
        }
        let low = each.into_iter().fold(f64::INFINITY, f64::min);
        self.rounded(low, each.into_iter().fold(f64::NEG_INFINITY, f64::max))
    }

    fn square(&self, a: Interval) -> Interval {
        let magnitude = absolute(a);
        self.rounded(magnitude.low * magnitude.low, magnitude.high * magnitude.high)
    }
}

/// The largest magnitude of which a nearest integer is proved: below it both precisions have numbers with fractional digits.
pub(crate) const FEW: f64 = (1u32 << 21) as f64;

/// The nearest integers of an interval.
pub(crate) fn nearest(a: Interval, precision: Precision) -> Interval {
    if a.magnitude().is_nan() || a.magnitude() > FEW {
        return ANYTHING;
    }
    let of = |end: f64| match precision {
        Precision::F64 => end.to_nearest_whole(),
        Precision::F32 => f64::from((end as f32).to_nearest_whole()),
    };
    Interval { low: of(a.low), high: of(a.high) }
}

/// a - nearest(a) is exact: it is a multiple of the last digit of a, and at most 1/2.
pub(crate) fn remainder(a: Interval, nearest: Interval) -> Interval {
    let (low, high) = ((a.low - nearest.high).max(-0.5), (a.high - nearest.low).min(0.5));
    // Both ends of an interval of one integer are exact; others are limited by 1/2, or rounded outward.
    if nearest.low == nearest.high {
        Interval { low, high }
    } else {
        Interval { low: low.next_down().max(-0.5), high: high.next_up().min(0.5) }
    }
}

/// The entries of a table that are read for indices in an interval, and their largest rounding error; `None` if an index may be outside.
pub(crate) struct Loaded {
    pub(crate) values: Interval,
    pub(crate) error: f64,
}

pub(crate) fn load(table: &Table, index: Interval, offset: u32) -> Option<Loaded> {
    if !(index.low >= 0.0 && index.high <= f64::from(table.mask)) {
        return None;
    }
    let (first, last) = (index.low as u32 + offset, index.high as u32 + offset);
    let mut found = Loaded { values: Interval { low: f64::INFINITY, high: f64::NEG_INFINITY }, error: 0.0 };
    for place in first as usize..=last as usize {
        let value = table.entries[place].value;
        found.values = Interval { low: found.values.low.min(value), high: found.values.high.max(value) };
        found.error = found.error.max(table.error(place));
    }
    Some(found)
}

fn absolute(a: Interval) -> Interval {
    if a.low >= 0.0 {
        a
    } else if a.high <= 0.0 {
        -a
    } else {
        Interval { low: 0.0, high: a.magnitude() }
    }
}

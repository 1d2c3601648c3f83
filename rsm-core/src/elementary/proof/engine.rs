//! Bounds the rounding errors of a tape, including compensated sums.
//!
//! In: a tape, ranges of its arguments (a cell), and known properties of some registers. Out: for each register the range of its ideal (the result of
//! exact arithmetic), and a bound of |computed - ideal|. Each rounding is a symbol with a bound. A register has a factor of each symbol, as an
//! interval. Where the tape computes the error of a rounding (sums of Knuth and Dekker, products of Dekker, splits of Veltkamp), the register holds
//! the negated symbol itself; when it is added back, it cancels. These sequences are recognised by their operations, and used only if the condition
//! of the theorem holds in the whole cell.

use std::collections::HashMap;

use super::span::{Span, exponent, span};
use crate::tape::{Op, Reg, Tape};

/// Rounding errors below this are replaced by it; it is far below everything that is compared.
const LEAST: f64 = 1e-250;

/// A grid without information.
const FINEST: i32 = -1074;

/// The information about a register in a cell.
#[derive(Debug, Clone)]
pub(super) struct Value {
    /// The range of the exact result.
    pub ideal: Span,
    /// The range of the computed result.
    pub range: Span,
    /// The factor of each rounding, by its number.
    noise: Vec<(u32, Span)>,
    /// A bound of the errors without a symbol.
    rest: f64,
    /// The result is an integer multiple of 2^grid.
    grid: i32,
}

impl Value {
    fn constant(value: f64) -> Self {
        let bits = value.to_bits();
        let grid = if value == 0.0 {
            1023
        } else {
            exponent(value) - 52 + (((bits & ((1 << 52) - 1)) | (1 << 52)).trailing_zeros() as i32)
        };
        Value { ideal: Span::point(value), range: Span::point(value), noise: Vec::new(), rest: 0.0, grid }
    }

    /// Any number of the type in a range, without error.
    fn any(range: Span) -> Self {
        let grid = if range.least() > 0.0 { exponent(range.least()) - 52 } else { FINEST };
        Value { ideal: range, range, noise: Vec::new(), rest: 0.0, grid }
    }
}

/// Known properties of a register.
#[derive(Debug, Clone)]
pub(super) enum Pin {
    /// It is this number.
    Constant(f64),
    /// It is an exact number in a range.
    Any(Span),
    /// A pair whose sum is a number in `ideal` up to `off`. The error of the first is at most `error`, and the second has the same error with
    /// opposite sign.
    High {
        ideal: Span,
        error: f64,
    },
    Low {
        of: Reg,
        off: f64,
    },
}

/// A tape in a cell.
pub(super) struct Run<'t> {
    tape: &'t Tape,
    values: Vec<Option<Value>>,
    /// The bound of each rounding.
    sizes: Vec<f64>,
    /// The rounding of a register's own operation.
    own: Vec<Option<u32>>,
}

/// A comparison with different outcomes inside the cell.
#[derive(Debug)]
pub(super) struct Undecided(Reg);

/// The bound of an error, without the last rounding.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    /// |computed - ideal| without the last rounding.
    pub besides: f64,
    /// The range of the exact result.
    pub ideal: Span,
    /// Whether the last operation rounds.
    pub rounds: bool,
}

/// The results of a tape in a cell, for all possible outcomes of its comparisons.
pub(super) fn outcomes(tape: &Tape, arguments: &[Span], pins: &HashMap<Reg, Pin>, output: Reg) -> Vec<Found> {
    let mut found = Vec::new();
    let mut open = vec![HashMap::new()];
    while let Some(decided) = open.pop() {
        match Run::new(tape, arguments, pins, &decided, output) {
            Ok(run) => found.push(run.found(output)),
            Err(Undecided(condition)) => {
                assert!(decided.len() < 6, "too many comparisons are open in one cell");
                for outcome in [true, false] {
                    let mut next = decided.clone();
                    next.insert(condition, outcome);
                    open.push(next);
                }
            }
        }
    }
    found
}

impl<'t> Run<'t> {
    /// Evaluates the registers that an output needs.
    fn new(
        tape: &'t Tape,
        arguments: &[Span],
        pins: &HashMap<Reg, Pin>,
        decided: &HashMap<Reg, bool>,
        output: Reg,
    ) -> Result<Self, Undecided> {
        let count = tape.ops.len();
        let mut run = Run { tape, values: vec![None; count], sizes: Vec::new(), own: vec![None; count] };
        run.evaluate(output, arguments, pins, decided)?;
        Ok(run)
    }

    fn evaluate(
        &mut self,
        reg: Reg,
        arguments: &[Span],
        pins: &HashMap<Reg, Pin>,
        decided: &HashMap<Reg, bool>,
    ) -> Result<(), Undecided> {
        if self.values[reg.0 as usize].is_some() {
            return Ok(());
        }
        let tape = self.tape;
        let value = match (pins.get(&reg), tape.op(reg)) {
            (Some(Pin::Constant(value)), _) => Value::constant(*value),
            (Some(Pin::Any(range)), _) => Value::any(*range),
            (Some(Pin::High { ideal, error }), _) => {
                let symbol = self.symbol(*error, reg);
                let noise = vec![(symbol, Span::point(1.0))];
                Value { ideal: *ideal, range: ideal.widened(*error), noise, rest: 0.0, grid: FINEST }
            }
            (Some(Pin::Low { of, off }), _) => {
                self.evaluate(*of, arguments, pins, decided)?;
                let value = self.lost(*of, FINEST);
                Value { rest: *off, range: value.range.widened(*off), ..value }
            }
            (None, Op::Input(port)) => Value::any(arguments[port.0 as usize]),
            (None, Op::Constant(constant)) => Value::constant(constant.value),
            (None, Op::Select { condition, then, otherwise }) => {
                let Op::Less(a, b) = *tape.op(*condition) else { unreachable!("a select reads a comparison") };
                self.evaluate(a, arguments, pins, decided)?;
                self.evaluate(b, arguments, pins, decided)?;
                let (a, b) = (self.of(a).range, self.of(b).range);
                let taken = match decided.get(condition) {
                    Some(outcome) => *outcome,
                    None if a.high < b.low => true,
                    None if a.low >= b.high => false,
                    None => return Err(Undecided(*condition)),
                };
                let from = if taken { *then } else { *otherwise };
                self.evaluate(from, arguments, pins, decided)?;
                self.own[reg.0 as usize] = self.own[from.0 as usize];
                self.of(from).clone()
            }
            (None, op) => {
                for operand in op.operands() {
                    self.evaluate(operand, arguments, pins, decided)?;
                }
                self.compute(reg, op)
            }
        };
        self.values[reg.0 as usize] = Some(value);
        Ok(())
    }

    fn of(&self, reg: Reg) -> &Value {
        self.values[reg.0 as usize].as_ref().expect("operands come first")
    }

    fn symbol(&mut self, size: f64, reg: Reg) -> u32 {
        self.sizes.push(size.max(LEAST));
        let symbol = self.sizes.len() as u32 - 1;
        self.own[reg.0 as usize] = Some(symbol);
        symbol
    }

    /// The exact rounding error of a register, negated; zero if it was not rounded.
    fn lost(&self, reg: Reg, grid: i32) -> Value {
        match self.own[reg.0 as usize] {
            None => Value::constant(0.0),
            Some(symbol) => {
                let size = self.sizes[symbol as usize];
                let noise = vec![(symbol, Span::point(-1.0))];
                Value { ideal: Span::ZERO, range: span(-size, size), noise, rest: 0.0, grid }
            }
        }
    }

    fn error(&self, value: &Value) -> f64 {
        let sum = value.noise.iter().fold(value.rest, |sum, (symbol, share)| {
            (sum + (share.largest() * self.sizes[*symbol as usize]).next_up()).next_up()
        });
        if value.noise.is_empty() { value.rest } else { sum }
    }

    fn compute(&mut self, reg: Reg, op: &Op) -> Value {
        if let Some(value) = self.compensation(reg, op) {
            return value;
        }
        match *op {
            Op::Negate(a) => {
                self.own[reg.0 as usize] = self.own[a.0 as usize];
                negated(self.of(a))
            }
            Op::Absolute(a) => {
                let a_value = self.of(a).clone();
                if a_value.range.low >= 0.0 {
                    self.own[reg.0 as usize] = self.own[a.0 as usize];
                    a_value
                } else if a_value.range.high <= 0.0 {
                    self.own[reg.0 as usize] = self.own[a.0 as usize];
                    negated(&a_value)
                } else {
                    let magnitude = |it: Span| span(it.least(), it.largest());
                    let rest = self.error(&a_value);
                    Value { ideal: magnitude(a_value.ideal), range: magnitude(a_value.range), noise: vec![], rest, ..a_value }
                }
            }
            Op::Add(a, b) => self.sum(reg, a, b, false),
            Op::Subtract(a, b) => self.sum(reg, a, b, true),
            Op::Multiply(a, b) => self.product(reg, a, b),
            Op::Divide(a, b) => self.quotient(reg, a, b),
            Op::Exponent(a) => {
                let range = self.of(a).range;
                assert!(range.least() > 0.0 && exponent(range.low) == exponent(range.high), "an exponent that is not pinned");
                Value::constant(f64::from(exponent(range.low)))
            }
            Op::PowerOfTwo(a) => {
                let range = self.of(a).range;
                assert!(range.low == range.high, "an exponent that is not pinned: {range:?}");
                Value::constant(2f64.powi(range.low as i32))
            }
            // Used only by a select.
            Op::Less(..) => Value::constant(0.0),
            Op::Constant(_) | Op::Input(_) | Op::State(_) | Op::Select { .. } | Op::Nearest(_) | Op::Load { .. } => {
                unreachable!("no state, no table, and the others before")
            }
        }
    }

    /// The sequences that compute a rounding error, and integers.
    fn compensation(&mut self, reg: Reg, op: &Op) -> Option<Value> {
        let tape = self.tape;
        let at = |reg: Reg| tape.op(reg);
        match *op {
            Op::Subtract(x, y) => {
                // The integer nearest to a value.
                if let (Op::Add(_, lift), Op::Constant(constant)) = (at(x), at(y))
                    && *lift == y
                    && constant.value == 1.5 * 2f64.powi(52)
                {
                    let range = self.of(x).range;
                    assert!(range.low == range.high, "a whole number that is not pinned: {range:?}");
                    return Some(Value::constant(range.low - constant.value));
                }
                // h = a + b, t = h - a, l = b - t (Dekker: |a| >= |b|).
                if let Op::Subtract(h, a) = *at(y)
                    && let Op::Add(first, second) = *at(h)
                    && (first, second) == (a, x)
                {
                    self.is_larger(a, x);
                    return Some(self.lost(h, self.of(a).grid.min(self.of(x).grid)));
                }
                // h = a - b, t = a - h, l = t - b (the same).
                if let Op::Subtract(a, h) = *at(x)
                    && let Op::Subtract(first, second) = *at(h)
                    && (first, second) == (a, y)
                {
                    self.is_larger(a, y);
                    return Some(self.lost(h, self.of(a).grid.min(self.of(y).grid)));
                }
                // h = a - b, p = h - a, r = h - p, l = (a - r) - (b + p) (Moller and Knuth: always).
                if let (Op::Subtract(a, r), Op::Add(b, p)) = (at(x), at(y))
                    && let (Op::Subtract(h, q), Op::Subtract(g, s)) = (at(*r), at(*p))
                    && (q, g, s) == (p, h, a)
                    && *at(*h) == Op::Subtract(*a, *b)
                {
                    return Some(self.lost(*h, self.of(*a).grid.min(self.of(*b).grid)));
                }
                // q = n/d, h = q d, n - h: the exact error of both roundings, because h is near n (Sterbenz).
                if let Op::Multiply(q, d) = *at(y)
                    && *at(q) == Op::Divide(x, d)
                {
                    let d = self.of(d).range;
                    let (of_q, of_h) = (self.own[q.0 as usize], self.own[y.0 as usize]);
                    let mut noise: Vec<(u32, Span)> = of_q.map(|symbol| (symbol, d.negated())).into_iter().collect();
                    noise.extend(of_h.map(|symbol| (symbol, Span::point(-1.0))));
                    let mut value = Value { ideal: Span::ZERO, range: Span::ZERO, noise, rest: 0.0, grid: FINEST };
                    value.range = Span::ZERO.widened(self.error(&value));
                    return Some(value);
                }
                // Veltkamp's split: large = 134217729 a, high = large - (large - a), low = a - high.
                if let Some(a) = split(tape, reg) {
                    let (value, largest) = (self.of(a).clone(), self.of(a).range.largest());
                    let symbol = self.symbol(2f64.powi(exponent(largest) - 26), reg);
                    let mut noise = value.noise;
                    noise.push((symbol, Span::point(1.0)));
                    let least = value.range.least();
                    let grid = if least > 0.0 { exponent(least) - 25 } else { FINEST };
                    let range = value.range.widened(self.sizes[symbol as usize]);
                    return Some(Value { ideal: value.ideal, range, noise, rest: value.rest, grid });
                }
                if let Some(a) = split(tape, y)
                    && a == x
                {
                    return Some(self.lost(y, self.of(a).grid));
                }
                None
            }
            Op::Add(x, y) => {
                // h = a + b, p = h - a, r = h - p, l = (a - r) + (b - p) (always).
                if let (Op::Subtract(a, r), Op::Subtract(b, p)) = (at(x), at(y))
                    && let (Op::Subtract(h, q), Op::Subtract(g, s)) = (at(*r), at(*p))
                    && (q, g, s) == (p, h, a)
                    && *at(*h) == Op::Add(*a, *b)
                {
                    return Some(self.lost(*h, self.of(*a).grid.min(self.of(*b).grid)));
                }
                // h = a b, l = (((a' b' - h) + a' b'') + a'' b') + a'' b'' (Dekker: no underflow).
                let Op::Add(rest, c2) = *at(x) else { return None };
                let Op::Add(rest, c1) = *at(rest) else { return None };
                let Op::Subtract(largest, h) = *at(rest) else { return None };
                let (Op::Multiply(a, b), Op::Multiply(ah, bh)) = (at(h), at(largest)) else { return None };
                let (Op::Multiply(p, bl), Op::Multiply(al, q), Op::Multiply(r, s)) = (at(c1), at(c2), at(y)) else {
                    return None;
                };
                let is_low = |low: Reg, of: Reg, high: Reg| *at(low) == Op::Subtract(of, high);
                let is_product = split(tape, *ah) == Some(*a)
                    && split(tape, *bh) == Some(*b)
                    && is_low(*al, *a, *ah)
                    && is_low(*bl, *b, *bh)
                    && (p, q, r, s) == (ah, bh, al, bl);
                if !is_product {
                    return None;
                }
                let mut value = self.lost(h, FINEST);
                // If the product may be so small that its parts underflow, a few of the smallest numbers are added.
                if self.of(h).range.least() < 2f64.powi(-900) {
                    value.rest = LEAST;
                    value.range = value.range.widened(LEAST);
                }
                Some(value)
            }
            _ => None,
        }
    }

    /// Dekker's sum requires |a| >= |b|, a = 0, or an a that is an integer multiple of b's unit in the last place (S. Boldo and others, "On the
    /// robustness of the 2Sum and Fast2Sum algorithms", 2017). Then b and the error are such multiples too, and none of them has more than 53 bits.
    fn is_larger(&self, a: Reg, b: Reg) {
        let (a, b) = (self.of(a), self.of(b));
        let largest = b.range.largest();
        let is_on_grid = largest < f64::MIN_POSITIVE || a.grid >= exponent(largest) - 52;
        assert!(a.range.least() >= largest || a.range == Span::ZERO || is_on_grid, "{a:?} is not larger than {b:?}");
    }

    /// A rounded value. `range` is that of the rounded number, from the operation at the ends of its operands' ranges, which is right because
    /// rounding is monotone. On a grid that the type can represent there is no rounding error.
    fn rounded(&mut self, reg: Reg, mut value: Value, range: Span, is_exact: bool) -> Value {
        value.range = value.ideal.widened(self.error(&value)).both(range);
        let largest = value.range.largest();
        let fits = value.grid > FINEST && largest < 2f64.powi((value.grid + 53).clamp(-1022, 1023));
        if !(is_exact || largest == 0.0 || fits) {
            let size = if largest < f64::MIN_POSITIVE { LEAST } else { 2f64.powi((exponent(largest) - 53).max(-1000)) };
            let symbol = self.symbol(size, reg);
            value.noise.push((symbol, Span::point(1.0)));
        }
        if value.range.least() >= f64::MIN_POSITIVE {
            value.grid = value.grid.max(exponent(value.range.least()) - 52);
        }
        value
    }

    fn sum(&mut self, reg: Reg, a: Reg, b: Reg, is_minus: bool) -> Value {
        let is_doubled = a == b;
        let (a, b) = (self.of(a).clone(), self.of(b).clone());
        let b = if is_minus { negated(&b) } else { b };
        let noise = merged(&a.noise, &b.noise, |a, b| a.plus(b), |a| a, |b| b);
        let rest = up(a.rest + b.rest);
        let value = Value { ideal: a.ideal.plus(b.ideal), range: Span::ZERO, noise, rest, grid: a.grid.min(b.grid) };
        let range = span(a.range.low + b.range.low, a.range.high + b.range.high);
        let c = b.range.negated();
        let sterbenz = |a: Span, c: Span| c.low > 0.0 && a.low >= c.high / 2.0 && a.high <= 2.0 * c.low;
        let is_exact = is_doubled && !is_minus
            || sterbenz(a.range, c)
            || sterbenz(a.range.negated(), c.negated())
            || a.range == Span::ZERO
            || b.range == Span::ZERO;
        self.rounded(reg, value, range, is_exact)
    }

    fn product(&mut self, reg: Reg, a: Reg, b: Reg) -> Value {
        let is_square = a == b;
        let (a, b) = (self.of(a).clone(), self.of(b).clone());
        let noise = merged(
            &a.noise,
            &b.noise,
            |x, y| x.times(b.ideal).plus(y.times(a.ideal)),
            |x| x.times(b.ideal),
            |y| y.times(a.ideal),
        );
        let (of_a, of_b) = (self.error(&a), self.error(&b));
        let rest = up(up(up(a.rest * b.ideal.largest()) + up(b.rest * a.ideal.largest())) + up(of_a * of_b));
        let rest = if a.rest == 0.0 && b.rest == 0.0 && (of_a == 0.0 || of_b == 0.0) { 0.0 } else { rest };
        let ideal = if is_square { a.ideal.square() } else { a.ideal.times(b.ideal) };
        let grid = (a.grid + b.grid).clamp(FINEST, 1023);
        let is_power =
            |it: &Value| it.range.low == it.range.high && it.range.low.is_normal() && it.range.low.to_bits() << 12 == 0;
        let mut exact = a.range.corners(b.range, |a, b| a * b);
        if is_square {
            exact.low = exact.low.max(0.0);
        }
        let value = Value { ideal, range: Span::ZERO, noise, rest, grid };
        self.rounded(reg, value, exact, is_power(&a) || is_power(&b))
    }

    fn quotient(&mut self, reg: Reg, a: Reg, b: Reg) -> Value {
        let (a, b) = (self.of(a).clone(), self.of(b).clone());
        // a/b - A/B = (e_a - (A/B) e_b)/(B + e_b), of first order (e_a - (A/B) e_b)/B.
        let ideal = a.ideal.over(b.ideal);
        let (by_a, by_b) = (Span::point(1.0).over(b.ideal), ideal.negated().over(b.ideal));
        let noise = merged(&a.noise, &b.noise, |x, y| x.times(by_a).plus(y.times(by_b)), |x| x.times(by_a), |y| y.times(by_b));
        let (of_a, of_b) = (self.error(&a), self.error(&b));
        let least = b.ideal.least() - of_b;
        assert!(least > 0.0);
        let first = up(up(of_a + up(ideal.largest() * of_b)) / least);
        let second = if of_b == 0.0 { 0.0 } else { up(up(first * of_b) / b.ideal.least()) };
        let direct = up(up(a.rest * by_a.largest()) + up(b.rest * by_b.largest()));
        let rest = if a.rest == 0.0 && b.rest == 0.0 { second } else { up(second + direct) };
        let exact = a.range.corners(b.range, |a, b| a / b);
        let value = Value { ideal, range: Span::ZERO, noise, rest, grid: FINEST };
        let is_one = b.range == Span::point(1.0);
        let value = if is_one { Value { grid: a.grid, ..value } } else { value };
        self.rounded(reg, value, exact, is_one || a.range == Span::ZERO)
    }

    fn found(&self, reg: Reg) -> Found {
        let value = self.of(reg);
        // The last rounding is that of the last operation that is no selection, sign or power of two.
        let mut last = reg;
        while self.own[last.0 as usize].is_none() {
            last = match *self.tape.op(last) {
                Op::Multiply(a, b) if self.of(b).range.low == self.of(b).range.high => a,
                Op::Multiply(a, b) if self.of(a).range.low == self.of(a).range.high => b,
                Op::Add(a, b) if a == b => a,
                _ => break,
            };
        }
        let last = self.own[last.0 as usize];
        let others = value.noise.iter().filter(|(symbol, _)| Some(*symbol) != last);
        let besides =
            others.fold(value.rest, |sum, (symbol, share)| up(sum + up(share.largest() * self.sizes[*symbol as usize])));
        Found { besides, ideal: value.ideal, rounds: last.is_some() }
    }
}

fn up(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.next_up() }
}

fn negated(value: &Value) -> Value {
    Value {
        ideal: value.ideal.negated(),
        range: value.range.negated(),
        noise: value.noise.iter().map(|(symbol, share)| (*symbol, share.negated())).collect(),
        ..value.clone()
    }
}

/// The number of which a register holds the upper part, after Veltkamp.
fn split(tape: &Tape, high: Reg) -> Option<Reg> {
    let Op::Subtract(large, rest) = *tape.op(high) else { return None };
    let Op::Subtract(again, a) = *tape.op(rest) else { return None };
    let Op::Multiply(number, factor) = *tape.op(large) else { return None };
    let is_factor = matches!(tape.op(factor), Op::Constant(constant) if constant.value == 134_217_729.0);
    (again == large && number == a && is_factor).then_some(a)
}

/// Merges two lists of symbols.
fn merged(
    a: &[(u32, Span)],
    b: &[(u32, Span)],
    both: impl Fn(Span, Span) -> Span,
    of_a: impl Fn(Span) -> Span,
    of_b: impl Fn(Span) -> Span,
) -> Vec<(u32, Span)> {
    let (mut i, mut k) = (0, 0);
    let mut all = Vec::with_capacity(a.len() + b.len() + 1);
    while i < a.len() || k < b.len() {
        match (a.get(i), b.get(k)) {
            (Some(x), Some(y)) if x.0 == y.0 => {
                all.push((x.0, both(x.1, y.1)));
                (i, k) = (i + 1, k + 1);
            }
            (Some(x), Some(y)) if x.0 < y.0 => {
                all.push((x.0, of_a(x.1)));
                i += 1;
            }
            (Some(x), None) => {
                all.push((x.0, of_a(x.1)));
                i += 1;
            }
            (_, Some(y)) => {
                all.push((y.0, of_b(y.1)));
                k += 1;
            }
            (None, None) => unreachable!("one of them has more"),
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elementary::pair::{Pair, constant, quick_sum};
    use crate::number::Precision;
    use crate::tape::TapeBuilder;

    /// 1 + x in two numbers, to which x^2 is added. `keeps`: whether the rounding error of the first sum is added too.
    fn besides(keeps: bool, x: Span) -> f64 {
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let input = tape.input(0);
        let one = constant(&mut tape, 1.0);
        let Pair { high, low } = quick_sum(&mut tape, one, input);
        let square = tape.multiply(input, input);
        let rest = if keeps { tape.add(low, square) } else { square };
        let result = tape.add(high, rest);
        let tape = tape.finish("sum", vec!["x".to_string()], result);
        outcomes(&tape, &[x], &HashMap::new(), tape.output())[0].besides
    }

    #[test]
    fn what_a_sum_has_lost_cancels_where_it_is_added_again() {
        let x = span(2f64.powi(-10), 2f64.powi(-9).next_down());
        let half_unit = 2f64.powi(-53);
        assert!((half_unit..half_unit * 1.01).contains(&besides(false, x)), "{}", besides(false, x));
        // Half units of the square, up to 2^-18, and of its sum with the rounding error of 2^-53.
        assert!(besides(true, x) <= 2.01 * 2f64.powi(-18 - 53), "{}", besides(true, x));
    }

    #[test]
    #[should_panic(expected = "is not larger")]
    fn a_sum_of_dekker_is_not_believed_where_its_first_number_may_be_smaller() {
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let input = tape.input(0);
        let three = constant(&mut tape, 3.0);
        let low = quick_sum(&mut tape, input, three).low;
        let tape = tape.finish("lost", vec!["x".to_string()], low);
        outcomes(&tape, &[span(0.1, 0.2)], &HashMap::new(), tape.output());
    }
}

//! Taylor series of the solution of differential equations, from the tape of their rates.
//!
//! In: the tape of the rates, and the meaning of each of its inputs. Out: tapes that compute the terms of the series order by order. The term of
//! order k of a state x is x^(k)(t) h^k/k!, so the state at a share s of the step is the sum of s^k times the terms. Each operation has an exact
//! recurrence (R. E. Moore, "Interval Analysis", 1966, chapter 11; A. Griewank, A. Walther, "Evaluating Derivatives", 2008, tables 13.1 and 13.2), so
//! nothing is differentiated symbolically, and no step is rejected: the terms give the possible step length.
//!
//! A selection keeps its condition from the start of the step. `Exponent` and `PowerOfTwo` outside of elementary functions are piecewise constant and
//! count as constant.
//!
//! Numbers are passed from one tape to the next in slots of an array. The caller assigns the slots of its own numbers.

mod functions;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::elementary::Computed;
use crate::number::{exact, integer};
use crate::tape::{Op, Reg, Tape, TapeBuilder};

/// The index of a number in the array.
pub type Slot = u32;

/// The meaning of an input of the rates, with its slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Argument {
    /// It is constant in a step.
    Held(Slot),
    /// The time.
    Time(Slot),
    /// A state; the index of the result that is its rate.
    State(Slot, usize),
}

/// Some orders of the series.
#[derive(Debug, Clone)]
pub struct Part {
    /// The tape that computes them.
    pub tape: Tape,
    /// The slot of each argument of the tape.
    pub arguments: Vec<Slot>,
    /// The slot of each result of the tape.
    pub results: Vec<Slot>,
    /// For each order, the slot of the first state's term; those of the other states follow, in the order of the rates. The highest order is last.
    pub terms: Vec<Slot>,
    /// The highest order.
    pub order: usize,
}

/// The coefficient of a value in one order; absent if it is structurally zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Coefficient {
    /// A register on the tape of this part.
    Here(Reg),
    /// A slot written by an earlier part.
    Before(Slot),
}

/// A value: a register of the rates, or a helper of a function.
type Value = u32;

/// Writes the series part by part.
#[derive(Debug)]
pub struct Series {
    rates: Tape,
    arguments: Vec<Argument>,
    step: Slot,
    states: Vec<usize>,
    /// Values of which every order is needed later.
    is_kept: Vec<bool>,
    /// The coefficient of each value and order.
    coefficients: HashMap<(Value, usize), Coefficient, FixedState>,
    /// Helpers of functions, by the result of the function and a name.
    helpers: HashMap<(Reg, &'static str), Value>,
    values: Value,
    next: Slot,
    order: usize,
    sum: Slot,
    /// The sum of all terms so far, without order 0.
    carried: Option<Slot>,
    terms: Vec<Slot>,
    /// The needed registers of the rates; from order 1 on without those inside functions.
    needed: Vec<bool>,
}

/// The state of writing one part.
struct Writing<'s> {
    series: &'s mut Series,
    builder: TapeBuilder,
    arguments: Vec<Slot>,
    ports: HashMap<Slot, Reg, FixedState>,
}

impl Series {
    /// A series of the rates. The step length is in slot `step`; slots from `free` on may be used. The first results of the series are the states
    /// after the whole step: see [`Series::end`].
    ///
    /// # Panics
    /// If the tape has states, or if the number of arguments is not the number of inputs.
    #[must_use]
    pub fn new(rates: &Tape, arguments: &[Argument], step: Slot, free: Slot) -> Series {
        assert!(rates.states.is_empty(), "rates are a function of their inputs");
        assert_eq!(rates.inputs.len(), arguments.len(), "one answer an input");
        let mut states: Vec<usize> = vec![usize::MAX; rates.outputs.len()];
        for (port, argument) in arguments.iter().enumerate() {
            if let Argument::State(_, rate) = argument {
                states[*rate] = port;
            }
        }
        assert!(states.iter().all(|port| *port != usize::MAX), "every rate is that of a state");
        let mut series = Series {
            is_kept: vec![false; rates.ops.len()],
            values: rates.ops.len() as Value,
            rates: rates.clone(),
            arguments: arguments.to_vec(),
            step,
            coefficients: HashMap::default(),
            helpers: HashMap::new(),
            next: free + states.len() as Slot,
            order: 0,
            sum: free,
            carried: None,
            terms: Vec::new(),
            needed: Vec::new(),
            states,
        };
        series.needed = series.needed();
        series.keep();
        series
    }

    /// The slot of the first state after the whole step, from the orders computed last; the other states follow.
    #[must_use]
    pub fn end(&self) -> Slot {
        self.sum
    }

    /// The first free slot after all parts written so far.
    #[must_use]
    pub fn free(&self) -> Slot {
        self.next
    }

    /// The tape of the next orders of the rates; the terms of the states go one order further.
    pub fn part(&mut self, orders: usize) -> Part {
        let mut writing = Writing {
            builder: TapeBuilder::sharing(self.rates.precision),
            series: self,
            arguments: Vec::new(),
            ports: HashMap::default(),
        };
        let (first, count) = (writing.series.order, writing.series.states.len());
        let mut terms: Vec<Vec<Option<Reg>>> = Vec::new();
        for order in first..first + orders {
            writing.order(order);
            terms.push(writing.terms(order));
        }
        let mut results: Vec<(Reg, Slot)> = Vec::new();
        let mut places = Vec::new();
        for list in &terms {
            let begin = writing.series.next;
            writing.series.next += count as Slot;
            places.push(begin);
            for (state, term) in list.iter().enumerate() {
                let term = term.unwrap_or_else(|| writing.builder.constant(integer(0)));
                results.push((term, begin + state as Slot));
            }
        }
        writing.sums(&terms, &mut results);
        for ((place, list), order) in places.iter().zip(&terms).zip(first..) {
            for (state, term) in list.iter().enumerate() {
                let value = writing.series.state_value(state);
                if let (Some(value), Some(_)) = (value, term) {
                    writing.series.coefficients.insert((value, order + 1), Coefficient::Before(place + state as Slot));
                }
            }
            writing.series.terms.push(*place);
        }
        writing.leave(&mut results);
        writing.series.order = first + orders;
        let Writing { series, builder, arguments, .. } = writing;
        let names = (0..arguments.len()).map(|k| format!("slot {}", arguments[k])).collect();
        let named: Vec<(String, Reg)> = results.iter().map(|(reg, slot)| (format!("slot {slot}"), *reg)).collect();
        Part {
            tape: builder.finish_with_results(format!("{}_series", series.rates.name), names, named, [] as [(String, Reg); 0]),
            arguments,
            results: results.iter().map(|it| it.1).collect(),
            terms: series.terms.clone(),
            order: series.order,
        }
    }

    /// The register of the rates that reads a state.
    fn state_value(&self, state: usize) -> Option<Value> {
        let port = self.states[state] as u32;
        self.rates.ops.iter().position(|op| matches!(op, Op::Input(found) if found.0 == port)).map(|place| place as Value)
    }

    /// The registers that the results need; a function counts as one operation.
    fn needed(&self) -> Vec<bool> {
        let mut needed = vec![false; self.rates.ops.len()];
        self.rates.outputs.iter().for_each(|output| needed[output.reg.0 as usize] = true);
        for k in (0..needed.len()).rev().collect::<Vec<_>>() {
            if needed[k] {
                let operands =
                    self.row(Reg(k as u32)).map_or_else(|| self.rates.ops[k].operands(), |row| row.arguments.clone());
                operands.iter().for_each(|operand| needed[operand.0 as usize] = true);
            }
        }
        needed
    }

    fn row(&self, reg: Reg) -> Option<Computed> {
        let place = self.rates.computed.binary_search_by_key(&reg, |row| row.result).ok()?;
        self.rates.computed.get(place).cloned()
    }

    /// Marks the values that products, quotients, functions and comparisons need again in every later order.
    fn keep(&mut self) {
        for k in (0..self.rates.ops.len()).filter(|k| self.needed[*k]) {
            let reg = Reg(k as u32);
            let mut keep: Vec<Reg> = Vec::new();
            match (self.row(reg), &self.rates.ops[k]) {
                (Some(row), _) => keep.extend(row.arguments.iter().chain([&reg])),
                (None, Op::Multiply(a, b)) => keep.extend([*a, *b]),
                (None, Op::Divide(_, b)) => keep.extend([reg, *b]),
                (None, Op::Less(a, b)) => keep.extend([*a, *b]),
                (None, Op::Absolute(a)) => keep.push(*a),
                _ => {}
            }
            keep.iter().for_each(|reg| self.is_kept[reg.0 as usize] = true);
        }
    }

    fn helper(&mut self, row: Reg, name: &'static str) -> Value {
        let next = self.values;
        let value = *self.helpers.entry((row, name)).or_insert(next);
        if value == next {
            self.values += 1;
            self.is_kept.push(true);
        }
        value
    }
}

impl Writing<'_> {
    fn slot(&mut self, slot: Slot) -> Reg {
        if let Some(reg) = self.ports.get(&slot) {
            return *reg;
        }
        let reg = self.builder.input(self.arguments.len() as u32);
        self.arguments.push(slot);
        self.ports.insert(slot, reg);
        reg
    }

    /// A coefficient; `None` if it is structurally zero.
    fn get(&mut self, value: Value, order: usize) -> Option<Reg> {
        if order == 0
            && let Some(Op::Constant(constant)) = self.series.rates.ops.get(value as usize)
        {
            let (value, exact) = (constant.value, constant.exact.clone());
            return Some(self.builder.rounded_constant(value, exact));
        }
        match *self.series.coefficients.get(&(value, order))? {
            Coefficient::Here(reg) => Some(reg),
            Coefficient::Before(slot) => Some(self.slot(slot)),
        }
    }

    fn set(&mut self, value: Value, order: usize, reg: Option<Reg>) {
        if let Some(reg) = reg {
            self.series.coefficients.insert((value, order), Coefficient::Here(reg));
        }
    }

    /// Writes one order of all values.
    fn order(&mut self, order: usize) {
        for k in 0..self.series.rates.ops.len() {
            let reg = Reg(k as u32);
            if order > 0 && !self.series.needed[k] {
                continue;
            }
            let found = if order == 0 { self.value(reg) } else { self.coefficient(reg, order) };
            if found.is_some() {
                self.set(reg.0, order, found);
            }
        }
        if order == 0 {
            for row in self.series.rates.computed.clone() {
                if self.series.needed[row.result.0 as usize] {
                    self.mark(&row);
                    self.first_helpers(&row);
                }
            }
        }
    }

    /// Records which operations are a function, so that a tangent of this part differentiates the function as a whole.
    fn mark(&mut self, row: &Computed) {
        let arguments: Option<Vec<Reg>> = row.arguments.iter().map(|reg| self.get(reg.0, 0)).collect();
        if let (Some(arguments), Some(result)) = (arguments, self.get(row.result.0, 0)) {
            self.builder.mark(Computed { function: row.function, arguments, result });
        }
    }

    /// Order 0: the operation itself.
    fn value(&mut self, reg: Reg) -> Option<Reg> {
        let op = self.series.rates.op(reg).clone();
        Some(match op {
            Op::Constant(constant) => self.builder.rounded_constant(constant.value, constant.exact),
            Op::Input(port) => match self.series.arguments[port.0 as usize] {
                Argument::Held(slot) | Argument::Time(slot) | Argument::State(slot, _) => self.slot(slot),
            },
            other => {
                let op = other.with_operands(|operand| self.get(operand.0, 0).expect("an earlier value"));
                self.builder.push(op)
            }
        })
    }

    fn coefficient(&mut self, reg: Reg, k: usize) -> Option<Reg> {
        if let Some(row) = self.series.row(reg) {
            return self.function(&row, k);
        }
        match self.series.rates.op(reg).clone() {
            Op::Constant(_) | Op::State(_) | Op::Less(..) | Op::Exponent(_) | Op::PowerOfTwo(_) => None,
            // The piece of a spline is that of the start of the step.
            Op::Nearest(_) | Op::Load { .. } => None,
            Op::Input(port) => match self.series.arguments[port.0 as usize] {
                Argument::Time(_) if k == 1 => Some(self.slot(self.series.step)),
                // For a state it was written with its rate.
                Argument::State(..) => self.get(reg.0, k),
                _ => None,
            },
            Op::Negate(a) => self.get(a.0, k).map(|a| self.builder.negate(a)),
            Op::Absolute(a) => {
                let of_a = self.get(a.0, k)?;
                let (zero, first) = (self.builder.constant(integer(0)), self.get(a.0, 0)?);
                let opposite = self.builder.negate(of_a);
                Some(self.builder.select_less(first, zero, opposite, of_a))
            }
            Op::Add(a, b) => {
                let (a, b) = (self.get(a.0, k), self.get(b.0, k));
                self.sum(a, b)
            }
            Op::Subtract(a, b) => {
                let (a, b) = (self.get(a.0, k), self.get(b.0, k));
                self.difference(a, b)
            }
            Op::Multiply(a, b) => self.product(a.0, b.0, k),
            Op::Divide(a, b) => {
                // a = z b: z_k = (a_k - sum over j from 1 of b_j z_(k-j))/b_0
                let taken = self.products(b.0, reg.0, 1, k, k);
                let of_a = self.get(a.0, k);
                let numerator = self.difference(of_a, taken)?;
                let divisor = self.get(b.0, 0)?;
                Some(self.builder.divide(numerator, divisor))
            }
            Op::Select { condition, then, otherwise } => {
                let Op::Less(left, right) = *self.series.rates.op(condition) else { return None };
                let (then, otherwise) = (self.get(then.0, k), self.get(otherwise.0, k));
                if then.is_none() && otherwise.is_none() {
                    return None;
                }
                let zero = self.builder.constant(integer(0));
                let (left, right) = (self.get(left.0, 0)?, self.get(right.0, 0)?);
                Some(self.builder.select_less(left, right, then.unwrap_or(zero), otherwise.unwrap_or(zero)))
            }
        }
    }

    fn sum(&mut self, a: Option<Reg>, b: Option<Reg>) -> Option<Reg> {
        match (a, b) {
            (Some(a), Some(b)) => Some(self.builder.add(a, b)),
            (one, other) => one.or(other),
        }
    }

    fn difference(&mut self, a: Option<Reg>, b: Option<Reg>) -> Option<Reg> {
        match (a, b) {
            (Some(a), Some(b)) => Some(self.builder.subtract(a, b)),
            (None, Some(b)) => Some(self.builder.negate(b)),
            (a, None) => a,
        }
    }

    fn times(&mut self, a: Option<Reg>, number: f64) -> Option<Reg> {
        let a = a?;
        Some(self.builder.times(a, exact(number)))
    }

    /// The coefficient k of a product.
    fn product(&mut self, a: Value, b: Value, k: usize) -> Option<Reg> {
        if a != b {
            return self.products(a, b, 0, k, k);
        }
        let mut twice = None;
        for j in (1..k.div_ceil(2)).chain(std::iter::once(0)).filter(|j| 2 * j < k) {
            let term = self.term(a, j, b, k - j);
            twice = self.sum(twice, term);
        }
        let twice = self.times(twice, 2.0);
        let middle = if k.is_multiple_of(2) { self.term(a, k / 2, b, k / 2) } else { None };
        self.sum(middle, twice)
    }

    fn term(&mut self, a: Value, i: usize, b: Value, j: usize) -> Option<Reg> {
        let (a, b) = (self.get(a, i)?, self.get(b, j)?);
        Some(self.builder.multiply(a, b))
    }

    /// The sum over j of a_j b_(k-j). The terms with the newest coefficients come last, so that the others are ready before.
    fn products(&mut self, a: Value, b: Value, from: usize, to: usize, k: usize) -> Option<Reg> {
        let mut sum = None;
        let inner = (from..=to).filter(|j| *j > 0 && *j < k);
        let outer = (from..=to).filter(|j| *j == 0 || *j == k);
        for j in inner.chain(outer).collect::<Vec<_>>() {
            let term = self.term(a, j, b, k - j);
            sum = self.sum(sum, term);
        }
        sum
    }

    /// The next terms of the states from one order of the rates: h F_k/(k + 1).
    fn terms(&mut self, order: usize) -> Vec<Option<Reg>> {
        let step = self.slot(self.series.step);
        let share = if order == 0 { step } else { self.builder.times(step, exact(1.0 / (order + 1) as f64)) };
        let rates: Vec<Reg> = self.series.rates.outputs.iter().map(|output| output.reg).collect();
        rates
            .iter()
            .enumerate()
            .map(|(state, rate)| {
                let rate = self.get(rate.0, order)?;
                let term = self.builder.multiply(rate, share);
                if let Some(value) = self.series.state_value(state) {
                    self.set(value, order + 1, Some(term));
                }
                Some(term)
            })
            .collect()
    }

    /// The states after the whole step: the sum of the terms in the order in which they are ready, then plus the state.
    fn sums(&mut self, terms: &[Vec<Option<Reg>>], results: &mut Vec<(Reg, Slot)>) {
        let count = self.series.states.len();
        let before = self.series.carried;
        let carry = self.series.next;
        self.series.next += count as Slot;
        for state in 0..count {
            let mut sum = before.map(|slot| self.slot(slot + state as Slot));
            for list in terms {
                sum = self.sum(sum, list[state]);
            }
            let Argument::State(slot, _) = self.series.arguments[self.series.states[state]] else { unreachable!("a state") };
            let begin = self.slot(slot);
            let moved = sum.unwrap_or_else(|| self.builder.constant(integer(0)));
            let end = self.builder.add(begin, moved);
            results.push((moved, carry + state as Slot));
            results.push((end, self.series.sum + state as Slot));
        }
        self.series.carried = Some(carry);
    }

    /// Writes the values that later orders need to slots.
    fn leave(&mut self, results: &mut Vec<(Reg, Slot)>) {
        let mut here: Vec<((Value, usize), Reg)> = Vec::new();
        for (key, coefficient) in &self.series.coefficients {
            if let Coefficient::Here(reg) = coefficient {
                here.push((*key, *reg));
            }
        }
        here.sort_unstable();
        for (key, reg) in here {
            let is_kept =
                self.series.is_kept[key.0 as usize] && !matches!(self.builder.op(reg), Op::Constant(_) | Op::Less(..));
            let own = match self.builder.op(reg) {
                // It is already in a slot.
                Op::Input(port) => Some(self.arguments[port.0 as usize]),
                _ => None,
            };
            let slot = match own {
                Some(slot) => slot,
                None if is_kept => {
                    let slot = self.series.next;
                    self.series.next += 1;
                    results.push((reg, slot));
                    slot
                }
                None => {
                    self.series.coefficients.remove(&key);
                    continue;
                }
            };
            self.series.coefficients.insert(key, Coefficient::Before(slot));
        }
    }
}

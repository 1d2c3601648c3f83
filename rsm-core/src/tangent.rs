//! Tangents: the derivatives of a tape, as a tape.
//!
//! In: a tape, and the inputs and states with respect to which it is differentiated. Out: a tape with the values and their derivatives. Forward mode
//! (R. E. Wengert, "A simple automatic derivative evaluation program", 1964): every operation is differentiated exactly by its rule. Zeros and ones
//! are not written, constants are multiplied as rationals and rounded once, and common expressions of two derivatives are on the tape once.
//!
//! A selection keeps its condition: the derivative is that of the selected side, also at a border. An elementary function is differentiated as a
//! function, not operation by operation. `Exponent` and `PowerOfTwo` outside of such functions, `Nearest` and
//! `Load` are piecewise constant: their derivative is 0.

use crate::elementary::{self, Computed, Function};
use crate::number::{Rational, integer};
use crate::tape::{Op, Reg, Tape, TapeBuilder};

/// A variable of differentiation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    /// An input, by its index in the tape's `inputs`.
    Input(usize),
    /// A state, by its index in the tape's `states`.
    State(usize),
}

/// The tape of all results of a tape and their derivatives.
///
/// Its inputs are those of the tape, then its states by name; it has no states itself. Its results are those of the tape, then the next values of its
/// states, `next NAME`; then the derivatives of each of these with respect to each variable, `d RESULT / d VARIABLE`, result by result.
///
/// # Panics
/// If the tape has no such variable.
///
/// ```
/// use rsm_core::number::Precision;
/// use rsm_core::run::Interpreter;
/// use rsm_core::tangent::{Variable, tangent};
/// use rsm_core::tape::TapeBuilder;
///
/// let mut tape = TapeBuilder::sharing(Precision::F64);
/// let (x, y) = (tape.input(0), tape.input(1));
/// let square = tape.multiply(x, x);
/// let product = tape.multiply(square, y);
/// let tape = tape.finish("z", vec!["x".to_string(), "y".to_string()], product);
///
/// let tangent = tangent(&tape, &[Variable::Input(0), Variable::Input(1)]);
/// assert_eq!(tangent.outputs[1].name, "d z / d x");
/// let mut found = [0.0; 3];
/// Interpreter::<f64>::new(&tangent).eval_all(&[3.0, 5.0], &mut found);
/// assert_eq!(found, [45.0, 30.0, 9.0]); // x^2 y, 2 x y, x^2
/// ```
#[must_use]
pub fn tangent(tape: &Tape, variables: &[Variable]) -> Tape {
    let mut builder = TapeBuilder::sharing(tape.precision);
    let inputs: Vec<Reg> = (0..tape.inputs.len() as u32).map(|port| builder.input(port)).collect();
    let states: Vec<Reg> = (0..tape.states.len() as u32).map(|state| builder.input(tape.inputs.len() as u32 + state)).collect();
    let written = write(&mut builder, tape, &inputs, &states, variables);
    let named = |variable: &Variable| match *variable {
        Variable::Input(place) => tape.inputs[place].clone(),
        Variable::State(place) => tape.states[place].name.clone(),
    };
    let own = tape.outputs.iter().map(|output| output.name.clone());
    let results: Vec<String> = own.chain(tape.states.iter().map(|state| format!("next {}", state.name))).collect();
    let mut outputs: Vec<(String, Reg)> = results.iter().cloned().zip(written.values.iter().copied()).collect();
    for (result, derivatives) in results.iter().zip(&written.derivatives) {
        let names = variables.iter().map(|variable| format!("d {result} / d {}", named(variable)));
        outputs.extend(names.zip(derivatives.iter().copied()));
    }
    let names = tape.inputs.iter().cloned().chain(tape.states.iter().map(|state| state.name.clone())).collect();
    builder.finish_with_results(format!("{}_tangent", tape.name), names, outputs, [] as [(String, Reg); 0])
}

/// The registers of a tape and its derivatives on another tape.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// The results, then the next values of the states.
    pub values: Vec<Reg>,
    /// For each of these, the derivative with respect to each variable.
    pub derivatives: Vec<Vec<Reg>>,
}

/// Writes a tape and its derivatives to another tape, with its inputs and states replaced by registers of that one.
///
/// # Panics
/// If the number of registers is not that of inputs or states, if the precision differs, or if the tape has no such variable.
pub fn write(builder: &mut TapeBuilder, tape: &Tape, inputs: &[Reg], states: &[Reg], variables: &[Variable]) -> Written {
    assert_eq!(tape.states.len(), states.len(), "one register a state");
    for variable in variables {
        let is_known = match *variable {
            Variable::Input(place) => place < tape.inputs.len(),
            Variable::State(place) => place < tape.states.len(),
        };
        assert!(is_known, "{variable:?} is not of the tape");
    }
    let places = builder.transcribe(tape, inputs, states);
    let wanted = wanted(tape);
    let results: Vec<Reg> = tape.results().collect();
    let mut derivatives = vec![Vec::with_capacity(variables.len()); results.len()];
    for variable in variables {
        let mut forward = Forward { tape, builder, places: &places, slopes: vec![Slope::ZERO; tape.ops.len()] };
        forward.run(&Direction::Of(*variable), &wanted);
        for (list, result) in derivatives.iter_mut().zip(&results) {
            let slope = forward.slopes[result.0 as usize].clone();
            list.push(forward.register(&slope));
        }
    }
    Written { values: results.iter().map(|reg| places[reg.0 as usize]).collect(), derivatives }
}

/// The tape of the directional derivatives of all results, along a direction that is given at run time.
///
/// Its inputs are those of the tape, then one for each input in `moving`: the component of the direction. All other components are zero. Its results
/// are the derivatives along the direction, `d RESULT`. One tape serves for all directions, and many directions can run in the lanes of one pass.
///
/// # Panics
/// If the tape has states, or lacks such an input.
///
/// ```
/// use rsm_core::number::Precision;
/// use rsm_core::run::Interpreter;
/// use rsm_core::tangent;
/// use rsm_core::tape::TapeBuilder;
///
/// let mut tape = TapeBuilder::sharing(Precision::F64);
/// let (x, y) = (tape.input(0), tape.input(1));
/// let square = tape.multiply(x, x);
/// let product = tape.multiply(square, y);
/// let tape = tape.finish("z", vec!["x".to_string(), "y".to_string()], product);
///
/// let along = tangent::along(&tape, &[0, 1]);
/// assert_eq!(along.inputs, ["x", "y", "d x", "d y"]);
/// let moved = Interpreter::<f64>::new(&along).eval(&[3.0, 5.0, 1.0, -2.0]);
/// assert_eq!(moved, 2.0 * 3.0 * 5.0 - 2.0 * 9.0); // 2 x y dx + x^2 dy
/// ```
#[must_use]
pub fn along(tape: &Tape, moving: &[usize]) -> Tape {
    assert!(tape.states.is_empty(), "only a function of its inputs has a derivative along a direction");
    let mut builder = TapeBuilder::sharing(tape.precision);
    let count = tape.inputs.len();
    let inputs: Vec<Reg> = (0..count as u32).map(|port| builder.input(port)).collect();
    let mut speeds = vec![None; count];
    for (k, port) in moving.iter().enumerate() {
        assert!(*port < count, "input {port} is not of the tape");
        speeds[*port] = Some(builder.input((count + k) as u32));
    }
    let places = builder.transcribe(tape, &inputs, &[]);
    let mut forward = Forward { tape, builder: &mut builder, places: &places, slopes: vec![Slope::ZERO; tape.ops.len()] };
    forward.run(&Direction::Along(&speeds), &wanted(tape));
    let slopes: Vec<Slope> = tape.outputs.iter().map(|output| forward.slopes[output.reg.0 as usize].clone()).collect();
    let outputs: Vec<(String, Reg)> = tape
        .outputs
        .iter()
        .zip(&slopes)
        .map(|(output, slope)| (format!("d {}", output.name), forward.register(slope)))
        .collect();
    let names = tape.inputs.iter().cloned().chain(moving.iter().map(|port| format!("d {}", tape.inputs[*port])));
    builder.finish_with_results(format!("{}_along", tape.name), names.collect(), outputs, [] as [(String, Reg); 0])
}

/// The direction of differentiation in one pass.
enum Direction<'a> {
    /// One variable.
    Of(Variable),
    /// For each input, the register of its component; `None` if it is zero.
    Along(&'a [Option<Reg>]),
}

impl Direction<'_> {
    fn of_input(&self, port: usize) -> Slope {
        match self {
            Direction::Of(variable) => Slope::number(integer(i64::from(*variable == Variable::Input(port)))),
            Direction::Along(speeds) => speeds[port].map_or(Slope::ZERO, |reg| Slope::of(Factor::Register(reg))),
        }
    }

    fn of_state(&self, state: usize) -> Slope {
        match self {
            Direction::Of(variable) => Slope::number(integer(i64::from(*variable == Variable::State(state)))),
            Direction::Along(_) => Slope::ZERO,
        }
    }
}

/// The function whose result is in a register.
fn row_at(tape: &Tape, reg: Reg) -> Option<&Computed> {
    let place = tape.computed.binary_search_by_key(&reg, |row| row.result).ok()?;
    tape.computed.get(place)
}

/// The registers whose derivatives are needed. Inside an elementary function none is.
fn wanted(tape: &Tape) -> Vec<bool> {
    let mut wanted = vec![false; tape.ops.len()];
    tape.results().for_each(|reg| wanted[reg.0 as usize] = true);
    for (reg, op) in tape.iter().collect::<Vec<_>>().into_iter().rev() {
        if wanted[reg.0 as usize] {
            let operands = match (row_at(tape, reg), op) {
                (Some(row), _) => row.arguments.clone(),
                // A condition has no derivative.
                (None, Op::Select { then, otherwise, .. }) => vec![*then, *otherwise],
                (None, Op::Less(..)) => vec![],
                (None, other) => other.operands(),
            };
            operands.iter().for_each(|operand| wanted[operand.0 as usize] = true);
        }
    }
    wanted
}

/// A derivative: a constant or a register.
#[derive(Debug, Clone, PartialEq)]
enum Factor {
    Number(Rational),
    Register(Reg),
}

/// A factor, and conditions under which the derivative is 0 instead. This is the derivative of a clamp; it is written only at the end.
#[derive(Debug, Clone, PartialEq)]
struct Slope {
    factor: Option<Factor>,
    zero_where: Vec<(Reg, bool)>,
}

impl Slope {
    const ZERO: Slope = Slope { factor: None, zero_where: Vec::new() };

    fn of(factor: Factor) -> Slope {
        Slope { factor: Some(factor), zero_where: vec![] }
    }

    fn number(value: Rational) -> Slope {
        if value == integer(0) { Slope::ZERO } else { Slope::of(Factor::Number(value)) }
    }

    fn is_zero(&self) -> bool {
        self.factor.is_none()
    }
}

struct Forward<'a> {
    tape: &'a Tape,
    builder: &'a mut TapeBuilder,
    /// The new register of each of the tape's registers.
    places: &'a [Reg],
    slopes: Vec<Slope>,
}

impl Forward<'_> {
    fn run(&mut self, direction: &Direction<'_>, wanted: &[bool]) {
        for (reg, op) in self.tape.iter().filter(|(reg, _)| wanted[reg.0 as usize]) {
            let slope = match (row_at(self.tape, reg), op) {
                (Some(row), _) => self.computed(row),
                (None, op) => self.operation(reg, op, direction),
            };
            self.slopes[reg.0 as usize] = slope;
        }
    }

    fn operation(&mut self, reg: Reg, op: &Op, direction: &Direction<'_>) -> Slope {
        let slope = |it: &Self, reg: Reg| it.slopes[reg.0 as usize].clone();
        let place = |it: &Self, reg: Reg| it.places[reg.0 as usize];
        match *op {
            Op::Constant(_) | Op::Less(..) | Op::Exponent(_) | Op::PowerOfTwo(_) | Op::Nearest(_) | Op::Load { .. } => {
                Slope::ZERO
            }
            Op::Input(port) => direction.of_input(port.0 as usize),
            Op::State(state) => direction.of_state(state.0 as usize),
            Op::Negate(a) => self.negated(slope(self, a)),
            Op::Absolute(a) => {
                let of_a = slope(self, a);
                if of_a.is_zero() {
                    return of_a;
                }
                let zero = self.builder.constant(integer(0));
                let condition = self.builder.push(Op::Less(place(self, a), zero));
                let opposite = self.negated(of_a.clone());
                self.chosen(condition, &opposite, &of_a)
            }
            Op::Add(a, b) => self.sum(slope(self, a), slope(self, b)),
            Op::Subtract(a, b) => {
                let of_b = slope(self, b);
                self.difference(slope(self, a), of_b)
            }
            Op::Multiply(a, b) if a == b => {
                let of_a = self.times_number(slope(self, a), &integer(2));
                self.times(of_a, a)
            }
            Op::Multiply(a, b) => {
                let (of_a, of_b) = (slope(self, a), slope(self, b));
                let (left, right) = (self.times(of_a, b), self.times(of_b, a));
                self.sum(left, right)
            }
            Op::Divide(a, b) => {
                // (a' - (a/b) b')/b
                let (of_a, of_b) = (slope(self, a), slope(self, b));
                let taken = self.times(of_b, reg);
                let numerator = self.difference(of_a, taken);
                self.over(numerator, place(self, b))
            }
            Op::Select { condition, then, otherwise } => {
                self.chosen(place(self, condition), &slope(self, then), &slope(self, otherwise))
            }
        }
    }

    /// The chain rule for an elementary function.
    fn computed(&mut self, row: &Computed) -> Slope {
        let slope = |it: &Self, k: usize| it.slopes[row.arguments[k].0 as usize].clone();
        let inner = slope(self, 0);
        if row.function != Function::Atan2 && inner.is_zero() {
            return inner;
        }
        let x = self.places[row.arguments[0].0 as usize];
        let y = self.places[row.result.0 as usize];
        let one = |it: &mut Self| it.builder.constant(integer(1));
        let function = |it: &mut Self, function: Function, of: Reg| elementary::write(it.builder, function, &[of]);
        match row.function {
            Function::Floor => Slope::ZERO,
            Function::Exp => self.scaled(inner, y),
            Function::Sqrt => {
                let half = self.times_number(inner, &(integer(1) / integer(2)));
                self.over(half, y)
            }
            Function::Log => self.over(inner, x),
            Function::Log10 => {
                let scaled = self.times_number(inner, &elementary::inverse_log_of_ten());
                self.over(scaled, x)
            }
            Function::Sin => {
                let cosine = function(self, Function::Cos, x);
                self.scaled(inner, cosine)
            }
            Function::Cos => {
                let sine = function(self, Function::Sin, x);
                let opposite = self.negated(inner);
                self.scaled(opposite, sine)
            }
            Function::Tan => {
                // 1 + tan^2
                let square = self.builder.multiply(y, y);
                let one = one(self);
                let slope = self.builder.add(one, square);
                self.scaled(inner, slope)
            }
            Function::Asin | Function::Acos => {
                // 1/sqrt((1 - x)(1 + x)), for acos its opposite
                let one = one(self);
                let (below, above) = (self.builder.subtract(one, x), self.builder.add(one, x));
                let square = self.builder.multiply(below, above);
                let root = function(self, Function::Sqrt, square);
                let inner = if row.function == Function::Acos { self.negated(inner) } else { inner };
                self.over(inner, root)
            }
            Function::Atan => {
                let square = self.builder.multiply(x, x);
                let one = one(self);
                let denominator = self.builder.add(one, square);
                self.over(inner, denominator)
            }
            Function::Sinh | Function::Cosh => {
                let other = if row.function == Function::Sinh { Function::Cosh } else { Function::Sinh };
                let other = function(self, other, x);
                self.scaled(inner, other)
            }
            Function::Tanh => {
                // (1 - tanh)(1 + tanh)
                let one = one(self);
                let (below, above) = (self.builder.subtract(one, y), self.builder.add(one, y));
                let slope = self.builder.multiply(below, above);
                self.scaled(inner, slope)
            }
            Function::Atan2 => {
                // of (y, x): (x y' - y x')/(x^2 + y^2)
                let (of_y, of_x) = (inner, slope(self, 1));
                if of_y.is_zero() && of_x.is_zero() {
                    return Slope::ZERO;
                }
                let (y, x) = (x, self.places[row.arguments[1].0 as usize]);
                let (left, right) = (self.scaled(of_y, x), self.scaled(of_x, y));
                let numerator = self.difference(left, right);
                let (x_square, y_square) = (self.builder.multiply(x, x), self.builder.multiply(y, y));
                let denominator = self.builder.add(x_square, y_square);
                self.over(numerator, denominator)
            }
        }
    }

    /// The slope as a register.
    fn register(&mut self, slope: &Slope) -> Reg {
        let mut value = match &slope.factor {
            None => return self.builder.constant(integer(0)),
            Some(factor) => self.factor(factor),
        };
        for (condition, is_zero_if) in slope.zero_where.iter().rev() {
            let zero = self.builder.constant(integer(0));
            let (then, otherwise) = if *is_zero_if { (zero, value) } else { (value, zero) };
            value = self.builder.push(Op::Select { condition: *condition, then, otherwise });
        }
        value
    }

    fn factor(&mut self, factor: &Factor) -> Reg {
        match factor {
            Factor::Number(number) => self.builder.constant(number.clone()),
            Factor::Register(reg) => *reg,
        }
    }

    /// Two slopes with the same zero conditions, as factors and these conditions. Slopes with different conditions are written out first.
    fn aligned(&mut self, a: &Slope, b: &Slope) -> (Factor, Factor, Vec<(Reg, bool)>) {
        if a.zero_where == b.zero_where
            && let (Some(left), Some(right)) = (&a.factor, &b.factor)
        {
            return (left.clone(), right.clone(), a.zero_where.clone());
        }
        let (left, right) = (self.register(a), self.register(b));
        (Factor::Register(left), Factor::Register(right), vec![])
    }

    fn negated(&mut self, a: Slope) -> Slope {
        let factor = a.factor.map(|factor| match factor {
            Factor::Number(number) => Factor::Number(-number),
            Factor::Register(reg) => Factor::Register(self.builder.negate(reg)),
        });
        Slope { factor, zero_where: a.zero_where }
    }

    fn sum(&mut self, a: Slope, b: Slope) -> Slope {
        if a.is_zero() {
            return b;
        }
        if b.is_zero() {
            return a;
        }
        let (left, right, zero_where) = self.aligned(&a, &b);
        let factor = match (&left, &right) {
            (Factor::Number(a), Factor::Number(b)) => Factor::Number(a + b),
            _ => {
                let (a, b) = (self.factor(&left), self.factor(&right));
                Factor::Register(self.builder.add(a, b))
            }
        };
        Slope { zero_where, ..normal(factor) }
    }

    fn difference(&mut self, a: Slope, b: Slope) -> Slope {
        if b.is_zero() {
            return a;
        }
        if a.is_zero() {
            return self.negated(b);
        }
        let (left, right, zero_where) = self.aligned(&a, &b);
        let factor = match (&left, &right) {
            (Factor::Number(a), Factor::Number(b)) => Factor::Number(a - b),
            _ => {
                let (a, b) = (self.factor(&left), self.factor(&right));
                Factor::Register(self.builder.subtract(a, b))
            }
        };
        Slope { zero_where, ..normal(factor) }
    }

    /// Multiplies by a register of the differentiated tape; a constant is multiplied as its exact number.
    fn times(&mut self, a: Slope, value: Reg) -> Slope {
        match self.tape.op(value) {
            Op::Constant(constant) => self.times_number(a, &constant.exact),
            _ => self.scaled(a, self.places[value.0 as usize]),
        }
    }

    /// Multiplies by a register of the builder's tape.
    fn scaled(&mut self, a: Slope, value: Reg) -> Slope {
        let factor = a.factor.map(|factor| match factor {
            Factor::Number(number) => Factor::Register(self.builder.times(value, number)),
            Factor::Register(reg) => Factor::Register(self.builder.multiply(reg, value)),
        });
        Slope { factor, zero_where: a.zero_where }
    }

    fn times_number(&mut self, a: Slope, value: &Rational) -> Slope {
        if *value == integer(0) {
            return Slope::ZERO;
        }
        let factor = a.factor.map(|factor| match factor {
            Factor::Number(number) => Factor::Number(number * value),
            Factor::Register(reg) => Factor::Register(self.builder.times(reg, value.clone())),
        });
        Slope { factor, zero_where: a.zero_where }
    }

    /// Divides by a register of the builder's tape.
    fn over(&mut self, a: Slope, divisor: Reg) -> Slope {
        let Some(factor) = a.factor else { return Slope::ZERO };
        let constant = match self.builder.op(divisor) {
            Op::Constant(constant) if constant.exact != integer(0) => Some(constant.exact.clone()),
            _ => None,
        };
        let factor = match (factor, constant) {
            (Factor::Number(number), Some(constant)) => Factor::Number(number / constant),
            (factor, _) => {
                let numerator = self.factor(&factor);
                Factor::Register(self.builder.divide(numerator, divisor))
            }
        };
        Slope { factor: Some(factor), zero_where: a.zero_where }
    }

    fn chosen(&mut self, condition: Reg, then: &Slope, otherwise: &Slope) -> Slope {
        if then == otherwise {
            return then.clone();
        }
        let zero_where = |slope: &Slope, is_zero_if: bool| {
            let mut places = vec![(condition, is_zero_if)];
            places.extend(slope.zero_where.iter().copied());
            Slope { factor: slope.factor.clone(), zero_where: places }
        };
        if then.is_zero() {
            return zero_where(otherwise, true);
        }
        if otherwise.is_zero() {
            return zero_where(then, false);
        }
        let (left, right, places) = self.aligned(then, otherwise);
        let (then, otherwise) = (self.factor(&left), self.factor(&right));
        let factor = Factor::Register(self.builder.push(Op::Select { condition, then, otherwise }));
        Slope { factor: Some(factor), zero_where: places }
    }
}

/// A constant factor of 0 becomes no factor.
fn normal(factor: Factor) -> Slope {
    match factor {
        Factor::Number(number) => Slope::number(number),
        Factor::Register(_) => Slope::of(factor),
    }
}

#[cfg(test)]
mod tests;

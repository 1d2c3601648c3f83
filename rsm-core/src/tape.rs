//! The tape: one straight line of operations, each exactly defined by IEEE 754.
//!
//! Once lowering has written a tape, the tape is the meaning of the surface in that precision: the interpreter executes it, every
//! emitter prints it, and the certificate bounds its rounding error. There is no branch, loop, call or allocation in it. A fused
//! multiply-add is not among the operations, so no back end may fuse. A tape of a compensator also has states: numbers that it reads, and
//! writes when all operations are done, so that a step sees what the step before left.

use std::fmt;

use crate::number::{Precision, Rational, integer};

/// The result of one operation: operation `n` of the tape writes register `n`, once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Reg(pub u32);

/// An argument of the evaluator, counted from 0 in the order of the surface's `inputs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Port(pub u32);

/// A number that a tape keeps from step to step, counted from 0; 0.0 before the first step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct State(pub u32);

/// A constant: the value the tape computes with, and the real number that it stands for.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// A number of the tape's precision (an f32 tape holds f32 values here), never NaN or infinite.
    pub value: f64,
    /// The number before rounding. The certificate charges the difference.
    pub exact: Rational,
}

/// One operation. Operands are registers of earlier operations.
#[derive(Debug, Clone, PartialEq)]
pub enum Op {
    /// A constant.
    Constant(Constant),
    /// An argument of the evaluator.
    Input(Port),
    /// A state, as the step before left it.
    State(State),
    /// `-a`, flips the sign of zero and NaN too.
    Negate(Reg),
    /// `|a|`, clears the sign bit.
    Absolute(Reg),
    /// `a + b`.
    Add(Reg, Reg),
    /// `a - b`.
    Subtract(Reg, Reg),
    /// `a * b`.
    Multiply(Reg, Reg),
    /// `a / b`.
    Divide(Reg, Reg),
    /// `a < b`: true or false, false when either is NaN. Only `Select` reads it.
    Less(Reg, Reg),
    /// `then` if the `Less` in `condition` was true, else `otherwise`. Moves bits, rounds nothing.
    Select {
        /// A register written by `Less`.
        condition: Reg,
        /// The value when true.
        then: Reg,
        /// The value when false, and when the comparison met a NaN.
        otherwise: Reg,
    },
}

/// A select that is really a maximum or a minimum of the two numbers that its condition compares.
///
/// Printers give it the machine's own instruction, and the certificate knows that it moves errors without enlarging them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extremum {
    /// `bound` if `value < bound`, else `value`: NaN in `value` passes, and `value` wins a tie (so -0 against +0 stays -0).
    AtLeast {
        /// The number that is kept from falling.
        value: Reg,
        /// What it is not to fall below.
        bound: Reg,
    },
    /// `bound` if `bound < value`, else `value`: NaN in `value` passes, and `value` wins a tie.
    AtMost {
        /// The number that is kept from rising.
        value: Reg,
        /// What it is not to rise above.
        bound: Reg,
    },
}

/// A lowered surface or compensator in one precision.
#[derive(Debug, Clone, PartialEq)]
pub struct Tape {
    /// The name of the surface, of the support test or of the compensator.
    pub name: String,
    /// The scalar type of every register.
    pub precision: Precision,
    /// The names of the arguments, in order.
    pub inputs: Vec<String>,
    /// The operations, in order of execution.
    pub ops: Vec<Op>,
    /// The register that holds the result.
    pub output: Reg,
    /// The register of each state's next value, written when all operations are done. Empty: the tape is a function of its arguments.
    pub next_states: Vec<Reg>,
    /// The terms of the model behind constants, in the order of the registers. For a reader: they change no result.
    pub notes: Vec<(Reg, Note)>,
}

/// The term of a model from which a constant is made: scales of variables are folded into it.
#[derive(Debug, Clone, PartialEq)]
pub struct Note {
    /// Its name, as [`crate::model::Surface::term_name`] gives it.
    pub term: String,
    /// Its coefficient in the model file.
    pub coefficient: f64,
    /// The unit of the response.
    pub unit: String,
}

impl Tape {
    /// The operation that writes a register.
    #[must_use]
    pub fn op(&self, reg: Reg) -> &Op {
        &self.ops[reg.0 as usize]
    }

    /// The operations with their registers.
    pub fn iter(&self) -> impl Iterator<Item = (Reg, &Op)> {
        self.ops.iter().enumerate().map(|(k, op)| (Reg(k as u32), op))
    }

    /// The registers that matter when the tape has been executed: the result, then the next states.
    pub fn results(&self) -> impl Iterator<Item = Reg> {
        std::iter::once(self.output).chain(self.next_states.iter().copied())
    }

    /// Whether the select in a register is a maximum or a minimum.
    #[must_use]
    pub fn extremum(&self, reg: Reg) -> Option<Extremum> {
        let Op::Select { condition, then, otherwise } = *self.op(reg) else { return None };
        let Op::Less(left, right) = *self.op(condition) else { return None };
        if (left, right) == (otherwise, then) {
            Some(Extremum::AtLeast { value: otherwise, bound: then })
        } else if (left, right) == (then, otherwise) {
            Some(Extremum::AtMost { value: otherwise, bound: then })
        } else {
            None
        }
    }

    /// How many operations compute something: constants, inputs and states are not counted.
    ///
    /// ```
    /// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
    /// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
    /// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
    /// // A line from 5 N at rest to 65 N at 30 m/s.
    /// use rsm_core::{lower, number::Precision};
    ///
    /// let tape = lower::surface(&checked, 0, Precision::F64);
    /// assert!(tape.depth() <= tape.operation_count());
    /// println!("{tape}"); // a line an operation, with the registers of the emitted code
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn operation_count(&self) -> usize {
        self.ops.iter().filter(|op| !matches!(op, Op::Constant(_) | Op::Input(_) | Op::State(_))).count()
    }

    /// The length of the longest chain of dependent operations up to the result or a next state, constants, inputs and states not counted.
    #[must_use]
    pub fn depth(&self) -> usize {
        let depth = depths(&self.ops);
        self.results().map(|reg| depth[reg.0 as usize]).max().unwrap_or_default()
    }
}

/// The length of the longest chain of dependent operations up to each register.
fn depths(ops: &[Op]) -> Vec<usize> {
    let mut depths: Vec<usize> = Vec::with_capacity(ops.len());
    for op in ops {
        let deepest = op.operands().iter().map(|operand| depths[operand.0 as usize]).max();
        depths.push(deepest.map_or(0, |below| below + 1));
    }
    depths
}

impl Op {
    /// The registers that the operation reads, in order.
    #[must_use]
    pub fn operands(&self) -> Vec<Reg> {
        match *self {
            Op::Constant(_) | Op::Input(_) | Op::State(_) => vec![],
            Op::Negate(a) | Op::Absolute(a) => vec![a],
            Op::Add(a, b) | Op::Subtract(a, b) | Op::Multiply(a, b) | Op::Divide(a, b) | Op::Less(a, b) => vec![a, b],
            Op::Select { condition, then, otherwise } => vec![condition, then, otherwise],
        }
    }
}

impl fmt::Display for Reg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "r{}", self.0)
    }
}

/// The text listing. Registers carry the same numbers here, in Rust and in C.
impl fmt::Display for Tape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "tape {}({}) {}", self.name, self.inputs.join(", "), self.precision.name())?;
        for (reg, op) in self.iter() {
            write!(f, "  {:<4} = ", reg.to_string())?;
            match op {
                Op::Constant(constant) => match self.precision {
                    Precision::F64 => writeln!(f, "constant {}", crate::number::decimal(constant.value))?,
                    Precision::F32 => writeln!(f, "constant {}", crate::number::decimal_f32(constant.value))?,
                },
                Op::Input(port) => writeln!(f, "input {}", self.inputs[port.0 as usize])?,
                Op::State(state) => writeln!(f, "state s{}", state.0)?,
                Op::Negate(a) => writeln!(f, "negate {a}")?,
                Op::Absolute(a) => writeln!(f, "absolute {a}")?,
                Op::Add(a, b) => writeln!(f, "add {a} {b}")?,
                Op::Subtract(a, b) => writeln!(f, "subtract {a} {b}")?,
                Op::Multiply(a, b) => writeln!(f, "multiply {a} {b}")?,
                Op::Divide(a, b) => writeln!(f, "divide {a} {b}")?,
                Op::Less(a, b) => writeln!(f, "less {a} {b}")?,
                Op::Select { condition, then, otherwise } => writeln!(f, "select {condition} {then} {otherwise}")?,
            }
        }
        for (k, next) in self.next_states.iter().enumerate() {
            writeln!(f, "  s{k}   := {next}")?;
        }
        writeln!(f, "  return {}", self.output)
    }
}

/// Writes a tape operation by operation.
#[derive(Debug)]
pub struct TapeBuilder {
    precision: Precision,
    ops: Vec<Op>,
    shares: bool,
    notes: Vec<(Reg, Note)>,
}

impl TapeBuilder {
    /// An empty tape.
    #[must_use]
    pub fn new(precision: Precision) -> Self {
        TapeBuilder { precision, ops: Vec::new(), shares: false, notes: Vec::new() }
    }

    /// An empty tape on which an operation that stands there already is not written again: several surfaces of the same inputs, and a
    /// surface that is used twice.
    #[must_use]
    pub fn sharing(precision: Precision) -> Self {
        TapeBuilder { shares: true, ..TapeBuilder::new(precision) }
    }

    /// The precision of the tape.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The length of the longest chain of dependent operations up to a register, counted as [`Tape::depth`] counts.
    #[must_use]
    pub fn depth_of(&self, reg: Reg) -> usize {
        depths(&self.ops[..=reg.0 as usize])[reg.0 as usize]
    }

    /// Appends an operation, or finds it where the tape shares.
    pub fn push(&mut self, op: Op) -> Reg {
        debug_assert!(op.operands().iter().all(|operand| (operand.0 as usize) < self.ops.len()), "operands come first");
        if self.shares
            && let Some(known) = self.known(&op)
        {
            return known;
        }
        self.ops.push(op);
        Reg(self.ops.len() as u32 - 1)
    }

    /// The register of an operation that stands on the tape already.
    fn known(&self, op: &Op) -> Option<Reg> {
        self.ops.iter().position(|other| other == op).map(|place| Reg(place as u32))
    }

    /// A constant, rounded here, once, to the precision of the tape.
    pub fn constant(&mut self, exact: Rational) -> Reg {
        let value = self.precision.round(&exact);
        self.rounded_constant(value, exact)
    }

    /// A constant whose rounding was decided elsewhere (a bound that is rounded into the box).
    pub fn rounded_constant(&mut self, value: f64, exact: Rational) -> Reg {
        let constant = Op::Constant(Constant { value, exact });
        self.known(&constant).unwrap_or_else(|| self.push(constant))
    }

    /// Says of a constant from which term of the model it is made. Nothing is said where it was not written (a factor of 1).
    pub fn note(&mut self, exact: &Rational, note: Note) {
        let constant = Op::Constant(Constant { value: self.precision.round(exact), exact: exact.clone() });
        let Some(place) = self.known(&constant) else { return };
        let entry = (place, note);
        // A surface may be taken into a compensator more than once.
        if !self.notes.contains(&entry) {
            self.notes.push(entry);
        }
    }

    /// A register times a constant. Nothing is written for 1, and for -1 a change of the sign: both are exact.
    pub fn times(&mut self, value: Reg, factor: Rational) -> Reg {
        if factor == integer(1) {
            return value;
        }
        if factor == integer(-1) {
            return self.push(Op::Negate(value));
        }
        let factor = self.constant(factor);
        self.push(Op::Multiply(value, factor))
    }

    /// `bound` if `value < bound`, else `value`.
    pub fn at_least(&mut self, value: Reg, bound: Reg) -> Reg {
        let condition = self.push(Op::Less(value, bound));
        self.push(Op::Select { condition, then: bound, otherwise: value })
    }

    /// `bound` if `bound < value`, else `value`.
    pub fn at_most(&mut self, value: Reg, bound: Reg) -> Reg {
        let condition = self.push(Op::Less(bound, value));
        self.push(Op::Select { condition, then: bound, otherwise: value })
    }

    /// The finished tape.
    #[must_use]
    pub fn finish(self, name: impl Into<String>, inputs: Vec<String>, output: Reg) -> Tape {
        let mut notes = self.notes;
        notes.sort_by_key(|(reg, _)| *reg);
        Tape { name: name.into(), precision: self.precision, inputs, ops: self.ops, output, next_states: vec![], notes }
    }

    /// The finished tape of something that keeps states.
    #[must_use]
    pub fn finish_with_states(self, name: impl Into<String>, inputs: Vec<String>, output: Reg, next_states: Vec<Reg>) -> Tape {
        Tape { next_states, ..self.finish(name, inputs, output) }
    }
}

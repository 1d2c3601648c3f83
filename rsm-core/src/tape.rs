//! The tape: a straight-line program whose operations are exactly defined by IEEE 754.
//!
//! After lowering, the tape defines the surface in that precision: the interpreter executes it, every emitter prints it, and the certificate bounds
//! its rounding error. It has no branch, loop, call or allocation. A fused multiply-add is not an operation of the tape, so no back end may fuse. A
//! tape of a compensator also has states: numbers that it reads, and that it writes after all operations, so that a step sees the values of the step
//! before.

mod builder;
mod fold;

use std::fmt;
use std::sync::Arc;

use num_traits::Signed as _;

use crate::function::Function;
use crate::number::{Precision, Rational, exact};

pub use builder::TapeBuilder;

/// The result of one operation: operation `n` of the tape writes register `n`, once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Reg(pub u32);

/// An argument of the evaluator, counted from 0 in the order of the surface's `inputs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Port(pub u32);

/// A number that a tape keeps between steps, counted from 0; 0.0 before the first step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct State(pub u32);

/// A constant: the value that the tape uses, and the real number that it represents.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// A number of the tape's precision (an f32 tape holds f32 values here), never NaN or infinite.
    pub value: f64,
    /// The number before rounding. The certificate includes the difference.
    pub exact: Rational,
}

/// Numbers of a tape that are read by index: the coefficients of a spline.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The entries. Their number is a power of two plus the largest offset of a load, so that no index is outside.
    pub entries: Vec<Constant>,
    /// A power of two minus 1, which an index is masked with.
    pub mask: u32,
    /// Upper bounds of the rounding errors of the entries.
    errors: Vec<f64>,
}

impl Table {
    /// A table of entries with the rounding errors of its constants. Zeros are appended up to `mask` + 1 + `reach` entries, where `reach` is the
    /// largest offset.
    ///
    /// # Panics
    /// If the mask is not a power of two minus 1.
    #[must_use]
    pub fn new(entries: Vec<Constant>, mask: u32, reach: u32) -> Self {
        assert!((mask + 1).is_power_of_two(), "a mask is a power of two minus 1");
        let mut entries = entries;
        let length = entries.len().max((mask + 1 + reach) as usize);
        entries.resize(length, Constant { value: 0.0, exact: exact(0.0) });
        let error = |entry: &Constant| Precision::F64.round_up(&(exact(entry.value) - &entry.exact).abs());
        let errors = entries.iter().map(error).collect();
        Table { entries, mask, errors }
    }

    /// The entry for an index that may have any bits.
    #[must_use]
    pub fn at(&self, whole: u32, offset: u32) -> f64 {
        self.entries[((whole & self.mask) + offset) as usize].value
    }

    /// The upper bound of an entry's rounding error.
    #[must_use]
    pub(crate) fn error(&self, place: usize) -> f64 {
        self.errors[place]
    }
}

/// Where a tape may select another piece of a continuous function than the exact ideal, because its argument is rounded: the nearest integer of the
/// argument is then another one. Both pieces agree at the border up to a derivative, so the results differ by at most size error^power.
#[derive(Debug, Clone, PartialEq)]
pub struct Seam {
    /// The register of the function's value.
    pub result: Reg,
    /// The operand of [`Op::Nearest`].
    pub argument: Reg,
    /// The power of the argument's error.
    pub power: u32,
    /// The factor before that power, rounded up.
    pub size: f64,
}

/// A sequence of operations that computes a function: the function, its arguments and its result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Computed {
    /// The function.
    pub function: Function,
    /// The registers of its arguments.
    pub arguments: Vec<Reg>,
    /// The register of its result.
    pub result: Reg,
}

/// One operation. Operands are registers of earlier operations.
#[derive(Debug, Clone, PartialEq)]
pub enum Op {
    /// A constant.
    Constant(Constant),
    /// An argument of the evaluator.
    Input(Port),
    /// A state, with its value after the last step.
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
    /// The exponent of `a` as a number: floor(log2 |a|) for a normal number. For zero and subnormal numbers it is one below the smallest (-1023, in
    /// f32 -127); for an infinity and NaN one above the largest (1024, in f32 128).
    Exponent(Reg),
    /// 2^a for an integer `a` from -1022 to 1023, in f32 from -126 to 127: `a` is moved to the exponent field. Any other `a` gives unspecified bits,
    /// which for NaN differ between machines. The code that uses this operation must clamp `a` first and pass NaN separately.
    PowerOfTwo(Reg),
    /// The integer nearest to `a`, of two equally near the even one, for magnitudes up to 2^51, in f32 2^22: (a + m) - m with m = 1.5 2^52, in f32
    /// 1.5 2^23.
    Nearest(Reg),
    /// An entry of a table: number `offset` plus the integer in `index`. The index is masked, so that any other `index`, NaN too, reads some entry.
    Load {
        /// The numbers.
        table: Arc<Table>,
        /// An integer from 0 to the mask of the table.
        index: Reg,
        /// Added after masking.
        offset: u32,
    },
    /// `a < b`: true or false, false when either is NaN. Only `Select` reads it.
    Less(Reg, Reg),
    /// `then` if the `Less` in `condition` was true, else `otherwise`. Moves bits, rounds nothing.
    Select {
        /// A register written by `Less`.
        condition: Reg,
        /// The value when true.
        then: Reg,
        /// The value when false, and if an operand of the comparison is NaN.
        otherwise: Reg,
    },
}

/// A select that is a maximum or a minimum of the two numbers that its condition compares.
///
/// Printers use the machine's own instruction, and the certificate uses that it does not increase errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extremum {
    /// `bound` if `value < bound`, else `value`: NaN in `value` passes, and `value` wins a tie (so -0 against +0 stays -0).
    AtLeast {
        /// The value that is limited.
        value: Reg,
        /// Its lower limit.
        bound: Reg,
    },
    /// `bound` if `bound < value`, else `value`: NaN in `value` passes, and `value` wins a tie.
    AtMost {
        /// The value that is limited.
        value: Reg,
        /// Its upper limit.
        bound: Reg,
    },
}

/// A result or a next state of the tape, with its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// The name of the result or the state.
    pub name: String,
    /// The register that holds the result, or the next value of the state.
    pub reg: Reg,
}

/// A straight-line program in one precision: a lowered surface or compensator, or a program that another crate wrote with a [`TapeBuilder`].
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
    /// The results, at least one, in order. A single one has the name of the tape.
    pub outputs: Vec<Named>,
    /// The states in order, each with the register of its next value, which is written after all operations. Empty if the tape has no states.
    pub states: Vec<Named>,
    /// The model terms of constants, in the order of the registers. For readers only: they change no result.
    pub notes: Vec<(Reg, Note)>,
    /// The sequences of operations that compute elementary functions, in the order of their results.
    pub computed: Vec<Computed>,
    /// The borders between pieces of splines.
    pub seams: Vec<Seam>,
}

/// The model term of a constant. Scales of variables are folded into the constant.
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

    /// The register of the first result.
    #[must_use]
    pub fn output(&self) -> Reg {
        self.outputs[0].reg
    }

    /// The registers of the results, then those of the next states.
    pub fn results(&self) -> impl Iterator<Item = Reg> {
        self.outputs.iter().chain(&self.states).map(|named| named.reg)
    }

    /// Whether the select in a register is a maximum or a minimum.
    #[must_use]
    pub(crate) fn extremum(&self, reg: Reg) -> Option<Extremum> {
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

    /// The tables that are read, each once, in the order of their first load.
    #[must_use]
    pub fn tables(&self) -> Vec<&Arc<Table>> {
        let mut tables: Vec<&Arc<Table>> = Vec::new();
        for op in &self.ops {
            if let Op::Load { table, .. } = op
                && !tables.iter().any(|it| Arc::ptr_eq(it, table) || *it == table)
            {
                tables.push(table);
            }
        }
        tables
    }

    /// The number of operations without constants, inputs and states.
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

    /// The length of the longest chain of dependent operations up to the result or a next state, without constants, inputs and states.
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
            Op::Negate(a) | Op::Absolute(a) | Op::Exponent(a) | Op::PowerOfTwo(a) | Op::Nearest(a) => vec![a],
            Op::Load { index, .. } => vec![index],
            Op::Add(a, b) | Op::Subtract(a, b) | Op::Multiply(a, b) | Op::Divide(a, b) | Op::Less(a, b) => vec![a, b],
            Op::Select { condition, then, otherwise } => vec![condition, then, otherwise],
        }
    }

    /// The same operation with other registers, asked for in the order of the operands.
    #[must_use]
    pub fn with_operands(&self, mut place: impl FnMut(Reg) -> Reg) -> Op {
        match *self {
            Op::Constant(_) | Op::Input(_) | Op::State(_) => self.clone(),
            Op::Negate(a) => Op::Negate(place(a)),
            Op::Absolute(a) => Op::Absolute(place(a)),
            Op::Exponent(a) => Op::Exponent(place(a)),
            Op::PowerOfTwo(a) => Op::PowerOfTwo(place(a)),
            Op::Nearest(a) => Op::Nearest(place(a)),
            Op::Load { ref table, index, offset } => Op::Load { table: table.clone(), index: place(index), offset },
            Op::Add(a, b) => Op::Add(place(a), place(b)),
            Op::Subtract(a, b) => Op::Subtract(place(a), place(b)),
            Op::Multiply(a, b) => Op::Multiply(place(a), place(b)),
            Op::Divide(a, b) => Op::Divide(place(a), place(b)),
            Op::Less(a, b) => Op::Less(place(a), place(b)),
            Op::Select { condition, then, otherwise } => {
                Op::Select { condition: place(condition), then: place(then), otherwise: place(otherwise) }
            }
        }
    }
}

impl fmt::Display for Reg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "r{}", self.0)
    }
}

/// The text listing. Registers have the same numbers here, in Rust and in C.
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
                Op::Exponent(a) => writeln!(f, "exponent {a}")?,
                Op::PowerOfTwo(a) => writeln!(f, "power-of-two {a}")?,
                Op::Nearest(a) => writeln!(f, "nearest {a}")?,
                Op::Load { table, index, offset } => {
                    let place = self.tables().iter().position(|it| *it == table).unwrap_or_default();
                    writeln!(f, "load t{place} {index} {offset}")?;
                }
                Op::Add(a, b) => writeln!(f, "add {a} {b}")?,
                Op::Subtract(a, b) => writeln!(f, "subtract {a} {b}")?,
                Op::Multiply(a, b) => writeln!(f, "multiply {a} {b}")?,
                Op::Divide(a, b) => writeln!(f, "divide {a} {b}")?,
                Op::Less(a, b) => writeln!(f, "less {a} {b}")?,
                Op::Select { condition, then, otherwise } => writeln!(f, "select {condition} {then} {otherwise}")?,
            }
        }
        for (k, table) in self.tables().iter().enumerate() {
            let entries: Vec<String> = table.entries.iter().map(|entry| crate::number::decimal(entry.value)).collect();
            writeln!(f, "  t{k}   = {}", entries.join(" "))?;
        }
        for (k, next) in self.states.iter().enumerate() {
            writeln!(f, "  s{k}   := {}", next.reg)?;
        }
        if let [only] = self.outputs.as_slice() {
            return writeln!(f, "  return {}", only.reg);
        }
        self.outputs.iter().try_for_each(|output| writeln!(f, "  return {} = {}", output.name, output.reg))
    }
}

//! Writes a tape operation by operation.
//!
//! In: operations, in order. Out: a [`Tape`]. The tape computes what is pushed. Nothing is simplified, except a factor of 1 or -1 in
//! [`TapeBuilder::times`]. A sharing builder reuses an operation that is already on the tape.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::number::{Precision, Rational, integer};

use super::{Computed, Constant, Named, Note, Op, Port, Reg, Seam, State, Tape};

/// Writes a tape operation by operation: of a surface, or of any computation that needs the same bits on every machine.
///
/// ```
/// use rsm_core::number::{Precision, exact};
/// use rsm_core::run::Interpreter;
/// use rsm_core::tape::TapeBuilder;
///
/// // A mass on a spring: the rates of position and speed. `sharing` writes an operation once, however often it is asked for.
/// let mut tape = TapeBuilder::sharing(Precision::F64);
/// let (position, speed, force) = (tape.input(0), tape.input(1), tape.input(2));
/// let stiffness = tape.constant(exact(40.0)); // N/m
/// let mass = tape.constant(exact(2.0)); // kg
/// let pull = tape.multiply(stiffness, position);
/// let balance = tape.subtract(force, pull);
/// let acceleration = tape.divide(balance, mass);
///
/// let names = ["position", "speed", "force"].map(str::to_string).to_vec();
/// let tape = tape.finish_with_results("rates", names, [("position_rate", speed), ("speed_rate", acceleration)], [] as [(&str, _); 0]);
/// let mut rates = [0.0; 2];
/// Interpreter::<f64>::new(&tape).eval_all(&[0.5, 3.0, 24.0], &mut rates);
/// assert_eq!(rates, [3.0, 2.0]); // m/s, m/s^2
/// ```
#[derive(Debug)]
pub struct TapeBuilder {
    precision: Precision,
    ops: Vec<Op>,
    shares: bool,
    /// The registers of constants and, on a sharing tape, of all other operations.
    places: HashMap<Key, Reg, FixedState>,
    notes: Vec<(Reg, Note)>,
    computed: Vec<Computed>,
    seams: Vec<Seam>,
}

/// The identity of an operation.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Key {
    /// The bits of the value, and how many constants with these bits and another number before rounding came first.
    Constant(u64, u32),
    /// The address of the table, the index and the offset.
    Load(usize, u32, u32),
    /// The kind of the operation, and its operands, port or state; 0 for those that it has not.
    Other(std::mem::Discriminant<Op>, [u32; 3]),
}

impl Key {
    /// The key of an operation; of a constant, as the first with its bits.
    fn of(op: &Op) -> Key {
        let numbers = match *op {
            // -0 and +0 with the same rational are one constant.
            Op::Constant(ref constant) => return Key::Constant((constant.value + 0.0).to_bits(), 0),
            Op::Input(port) => [port.0, 0, 0],
            Op::State(state) => [state.0, 0, 0],
            // One table is one allocation: two equal tables only lose the sharing of their loads.
            Op::Load { ref table, index, offset } => {
                return Key::Load(std::sync::Arc::as_ptr(table) as usize, index.0, offset);
            }
            Op::Negate(a) | Op::Absolute(a) | Op::Exponent(a) | Op::PowerOfTwo(a) | Op::Nearest(a) => [a.0, 0, 0],
            Op::Add(a, b) | Op::Subtract(a, b) | Op::Multiply(a, b) | Op::Divide(a, b) | Op::Less(a, b) => [a.0, b.0, 0],
            Op::Select { condition, then, otherwise } => [condition.0, then.0, otherwise.0],
        };
        Key::Other(std::mem::discriminant(op), numbers)
    }
}

/// Whether an operation is a constant with this number before rounding. Rationals are kept reduced, so equal ones have equal parts.
fn is_constant(op: &Op, exact: &Rational) -> bool {
    matches!(op, Op::Constant(it) if it.exact.numer() == exact.numer() && it.exact.denom() == exact.denom())
}

impl TapeBuilder {
    /// An empty tape.
    #[must_use]
    pub fn new(precision: Precision) -> Self {
        TapeBuilder {
            precision,
            ops: Vec::new(),
            shares: false,
            places: HashMap::default(),
            notes: Vec::new(),
            computed: Vec::new(),
            seams: Vec::new(),
        }
    }

    /// An empty tape that reuses existing operations, for several surfaces of the same inputs or a surface that is used twice.
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
    pub(crate) fn depth_of(&self, reg: Reg) -> usize {
        super::depths(&self.ops[..=reg.0 as usize])[reg.0 as usize]
    }

    /// The operation that writes a register.
    ///
    /// # Panics
    /// If the tape has no such register yet.
    #[must_use]
    pub fn op(&self, reg: Reg) -> &Op {
        &self.ops[reg.0 as usize]
    }

    /// The number of operations on the tape, constants and inputs included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ops.len()
    }

    /// Whether the tape is still empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ops.is_empty()
    }

    /// Appends an operation, or finds it on a sharing tape. Operands are registers of this builder.
    pub fn push(&mut self, op: Op) -> Reg {
        debug_assert!(op.operands().iter().all(|operand| (operand.0 as usize) < self.ops.len()), "operands come first");
        let next = Reg(self.ops.len() as u32);
        if self.shares || matches!(op, Op::Constant(_)) {
            match self.place(&op) {
                Ok(place) if self.shares => return place,
                Ok(_) => {}
                Err(key) => {
                    self.places.insert(key, next);
                }
            }
        }
        self.ops.push(op);
        next
    }

    /// The register of an operation that is already on the tape, or the key for a new one.
    fn place(&self, op: &Op) -> Result<Reg, Key> {
        let mut key = Key::of(op);
        while let Some(&place) = self.places.get(&key) {
            match (op, &mut key) {
                (Op::Constant(constant), Key::Constant(_, earlier)) if !is_constant(self.op(place), &constant.exact) => {
                    *earlier += 1;
                }
                _ => return Ok(place),
            }
        }
        Err(key)
    }

    /// The register of a constant that is already on the tape.
    fn known(&self, constant: &Op) -> Option<Reg> {
        self.place(constant).ok()
    }

    /// A constant, rounded here, once, to the precision of the tape.
    pub fn constant(&mut self, exact: Rational) -> Reg {
        let value = self.precision.round(&exact);
        self.rounded_constant(value, exact)
    }

    /// A constant whose rounding was decided elsewhere (a bound that is rounded into the box).
    pub(crate) fn rounded_constant(&mut self, value: f64, exact: Rational) -> Reg {
        let constant = Op::Constant(Constant { value, exact });
        self.known(&constant).unwrap_or_else(|| self.push(constant))
    }

    /// Records the model term of a constant. Has no effect if the constant was not written (a factor of 1).
    pub fn note(&mut self, exact: &Rational, note: Note) {
        let constant = Op::Constant(Constant { value: self.precision.round(exact), exact: exact.clone() });
        if let Some(place) = self.known(&constant) {
            self.add_note(place, note);
        }
    }

    /// The same term may be recorded more than once, because a surface may be used more than once.
    pub(super) fn add_note(&mut self, place: Reg, note: Note) {
        let entry = (place, note);
        if !self.notes.contains(&entry) {
            self.notes.push(entry);
        }
    }

    /// Records that a sequence of operations computes an elementary function.
    pub(crate) fn mark(&mut self, computed: Computed) {
        if !self.computed.contains(&computed) {
            self.computed.push(computed);
        }
    }

    /// Records where a tape may select another piece than the ideal.
    pub(crate) fn add_seam(&mut self, seam: Seam) {
        if !self.seams.contains(&seam) {
            self.seams.push(seam);
        }
    }

    /// The seams so far.
    pub(crate) fn seams(&self) -> &[Seam] {
        &self.seams
    }

    /// An argument, counted from 0 in the order in which `finish` names them.
    pub fn input(&mut self, port: u32) -> Reg {
        self.push(Op::Input(Port(port)))
    }

    /// A state, with its value after the last step, counted from 0 in the order in which [`TapeBuilder::finish_with_results`] names them.
    pub fn state(&mut self, state: u32) -> Reg {
        self.push(Op::State(State(state)))
    }

    /// `-a`.
    pub fn negate(&mut self, a: Reg) -> Reg {
        self.push(Op::Negate(a))
    }

    /// `|a|`.
    pub fn absolute(&mut self, a: Reg) -> Reg {
        self.push(Op::Absolute(a))
    }

    /// `a + b`.
    pub fn add(&mut self, a: Reg, b: Reg) -> Reg {
        self.push(Op::Add(a, b))
    }

    /// `a - b`.
    pub fn subtract(&mut self, a: Reg, b: Reg) -> Reg {
        self.push(Op::Subtract(a, b))
    }

    /// `a * b`.
    pub fn multiply(&mut self, a: Reg, b: Reg) -> Reg {
        self.push(Op::Multiply(a, b))
    }

    /// `a / b`.
    pub fn divide(&mut self, a: Reg, b: Reg) -> Reg {
        self.push(Op::Divide(a, b))
    }

    /// `then` where `left < right`, else `otherwise`, also where either of the two compared is NaN.
    pub fn select_less(&mut self, left: Reg, right: Reg, then: Reg, otherwise: Reg) -> Reg {
        let condition = self.push(Op::Less(left, right));
        self.push(Op::Select { condition, then, otherwise })
    }

    /// A register times a constant. The factor 1 writes nothing, and -1 writes a negation: both are exact.
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
        self.select_less(value, bound, bound, value)
    }

    /// `bound` if `bound < value`, else `value`.
    pub fn at_most(&mut self, value: Reg, bound: Reg) -> Reg {
        self.select_less(bound, value, bound, value)
    }

    /// Writes the operations of a finished tape to this one, with its inputs replaced by registers of this one. Returns the registers of its results.
    /// Use: a surface inside the equations of a plant.
    ///
    /// # Panics
    /// If the precision differs, if the number of arguments is not the number of inputs, or if the tape has states.
    ///
    /// ```
    /// # use rsm_core::{number::Precision, run::Interpreter, tape::TapeBuilder};
    /// let mut square = TapeBuilder::new(Precision::F64);
    /// let x = square.input(0);
    /// let y = square.multiply(x, x);
    /// let square = square.finish("square", vec!["x".to_string()], y);
    ///
    /// let mut fourth = TapeBuilder::sharing(Precision::F64);
    /// let x = fourth.input(0);
    /// let once = fourth.inline(&square, &[x]);
    /// let twice = fourth.inline(&square, &once);
    /// let fourth = fourth.finish("fourth", vec!["x".to_string()], twice[0]);
    /// assert_eq!(Interpreter::<f64>::new(&fourth).eval(&[3.0]), 81.0);
    /// ```
    pub fn inline(&mut self, tape: &Tape, arguments: &[Reg]) -> Vec<Reg> {
        assert!(tape.states.is_empty(), "only a function of its arguments can stand inside another tape");
        let places = self.transcribe(tape, arguments, &[]);
        tape.outputs.iter().map(|output| places[output.reg.0 as usize]).collect()
    }

    /// Writes the operations of a finished tape to this one, with its inputs and states replaced by registers of this one. Returns the new register
    /// of each of its registers.
    pub(crate) fn transcribe(&mut self, tape: &Tape, arguments: &[Reg], states: &[Reg]) -> Vec<Reg> {
        assert_eq!(tape.precision, self.precision, "a tape has one precision");
        assert_eq!(arguments.len(), tape.inputs.len(), "one argument an input");
        let mut places: Vec<Reg> = Vec::with_capacity(tape.ops.len());
        for op in &tape.ops {
            let place = match op {
                Op::Input(port) => arguments[port.0 as usize],
                Op::State(state) => states[state.0 as usize],
                Op::Constant(constant) => self.rounded_constant(constant.value, constant.exact.clone()),
                other => self.push(other.with_operands(|reg| places[reg.0 as usize])),
            };
            places.push(place);
        }
        for (reg, note) in &tape.notes {
            self.add_note(places[reg.0 as usize], note.clone());
        }
        for row in &tape.computed {
            let place = |reg: &Reg| places[reg.0 as usize];
            let arguments = row.arguments.iter().map(place).collect();
            self.mark(Computed { function: row.function, arguments, result: place(&row.result) });
        }
        for seam in &tape.seams {
            let place = |reg: Reg| places[reg.0 as usize];
            self.add_seam(Seam { result: place(seam.result), argument: place(seam.argument), ..seam.clone() });
        }
        places
    }

    /// The finished tape of a function with one result.
    #[must_use]
    pub fn finish(self, name: impl Into<String>, inputs: Vec<String>, output: Reg) -> Tape {
        let name = name.into();
        self.finish_with_results(name.clone(), inputs, [(name, output)], [] as [(String, Reg); 0])
    }

    /// The finished tape with states and one result. The states are named s0, s1, ...
    #[must_use]
    pub(crate) fn finish_with_states(
        self,
        name: impl Into<String>,
        inputs: Vec<String>,
        output: Reg,
        next_states: Vec<Reg>,
    ) -> Tape {
        let name = name.into();
        let states = next_states.into_iter().enumerate().map(|(k, reg)| (format!("s{k}"), reg));
        self.finish_with_results(name.clone(), inputs, [(name, output)], states)
    }

    /// The finished tape with its results and states by name, both in order. Each state has the register of its next value.
    ///
    /// # Panics
    /// If there is no result, or if an operation reads an input or a state that is not named here.
    #[must_use]
    pub fn finish_with_results(
        self,
        name: impl Into<String>,
        inputs: Vec<String>,
        outputs: impl IntoIterator<Item = (impl Into<String>, Reg)>,
        states: impl IntoIterator<Item = (impl Into<String>, Reg)>,
    ) -> Tape {
        let outputs = outputs.into_iter().map(|(name, reg)| Named { name: name.into(), reg }).collect();
        let states = states.into_iter().map(|(name, reg)| Named { name: name.into(), reg }).collect();
        self.finished(name.into(), inputs, outputs, states)
    }

    fn finished(self, name: String, inputs: Vec<String>, outputs: Vec<Named>, states: Vec<Named>) -> Tape {
        assert!(!outputs.is_empty(), "a tape has a result");
        for op in &self.ops {
            match op {
                Op::Input(port) => assert!((port.0 as usize) < inputs.len(), "input {} has no name", port.0),
                Op::State(state) => assert!((state.0 as usize) < states.len(), "state {} has no next value", state.0),
                _ => {}
            }
        }
        let mut notes = self.notes;
        notes.sort_by_key(|(reg, _)| *reg);
        let mut computed = self.computed;
        computed.sort_by_key(|row| row.result);
        let mut seams = self.seams;
        seams.sort_by_key(|seam| seam.result);
        Tape { name, precision: self.precision, inputs, ops: self.ops, outputs, states, notes, computed, seams }
    }
}

#[cfg(test)]
mod tests;

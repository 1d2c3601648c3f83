//! The interpreter: executes a tape in its own precision.
//!
//! In: a tape and the arguments, step by step for a compensator. Out: the result, with the same bits as every emitted evaluator. An f32 tape is
//! executed in f32, not in f64 with a final rounding.

pub use crate::scalar::Scalar;
use crate::tape::{Op, Reg, Tape};

/// An interpreter with its registers, so that repeated evaluation does not allocate.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{lower, number::Precision, run::Interpreter};
///
/// let tape = lower::surface(&checked, 0, Precision::F32);
/// let mut drag = Interpreter::<f32>::new(&tape);
/// assert_eq!(drag.eval(&[30.0]), 65.0);
/// assert_eq!(drag.eval(&[99.0]), 65.0); // clamped to 30 m/s
/// assert!(drag.eval(&[f32::NAN]).is_nan());
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[derive(Debug, Clone)]
pub struct Interpreter<'t, T> {
    tape: &'t Tape,
    registers: Vec<T>,
    flags: Vec<bool>,
    states: Vec<T>,
}

impl<'t, T: Scalar> Interpreter<'t, T> {
    /// An interpreter of a tape.
    ///
    /// # Panics
    /// If the tape has another precision.
    #[must_use]
    pub fn new(tape: &'t Tape) -> Self {
        assert_eq!(tape.precision, T::PRECISION, "a tape is executed in the precision it was lowered for");
        let size = tape.ops.len();
        let zero = T::from_constant(0.0);
        let states = vec![zero; tape.states.len()];
        Interpreter { tape, registers: vec![zero; size], flags: vec![false; size], states }
    }

    /// The value of the surface; for a tape with several results, the first. `arguments` are in the order of the surface's inputs, in their units.
    ///
    /// # Panics
    /// If the number of arguments is not that of the tape, or if the tape has states: then use [`Interpreter::step`].
    pub fn eval(&mut self, arguments: &[T]) -> T {
        assert!(self.tape.states.is_empty(), "a tape with states is executed step by step");
        self.execute(arguments)
    }

    /// All results of a tape without states, in the order of its `outputs`.
    ///
    /// # Panics
    /// As [`Interpreter::eval`], and if the length of `results` is not the number of results.
    pub fn eval_all(&mut self, arguments: &[T], results: &mut [T]) {
        self.eval(arguments);
        assert_eq!(results.len(), self.tape.outputs.len(), "one place a result");
        results.iter_mut().zip(self.results()).for_each(|(place, result)| *place = result);
    }

    /// All results of the last evaluation or step, in the order of the tape's `outputs`.
    pub fn results(&self) -> impl Iterator<Item = T> {
        self.tape.outputs.iter().map(|output| self.registers[output.reg.0 as usize])
    }

    /// Executes one step and updates the states. Returns the first result. A tape without states is only evaluated.
    ///
    /// # Panics
    /// If the number of arguments is not that of the tape.
    pub fn step(&mut self, arguments: &[T]) -> T {
        let result = self.execute(arguments);
        for (state, next) in self.states.iter_mut().zip(&self.tape.states) {
            *state = self.registers[next.reg.0 as usize];
        }
        result
    }

    /// The states after the last step.
    #[must_use]
    pub fn states(&self) -> &[T] {
        &self.states
    }

    /// The result of each comparison in the last execution, by its register; false for other registers.
    pub(crate) fn flags(&self) -> &[bool] {
        &self.flags
    }

    /// Sets the states.
    ///
    /// # Panics
    /// If their number is not that of the tape.
    pub fn set_states(&mut self, states: &[T]) {
        self.states.copy_from_slice(states);
    }

    fn execute(&mut self, arguments: &[T]) -> T {
        assert_eq!(arguments.len(), self.tape.inputs.len(), "one argument an input");
        for (k, op) in self.tape.ops.iter().enumerate() {
            let r = |reg: Reg| self.registers[reg.0 as usize];
            let value = match *op {
                Op::Constant(ref constant) => T::from_constant(constant.value),
                Op::Input(port) => arguments[port.0 as usize],
                Op::State(state) => self.states[state.0 as usize],
                Op::Negate(a) => -r(a),
                Op::Absolute(a) => r(a).absolute(),
                Op::Exponent(a) => r(a).exponent(),
                Op::PowerOfTwo(a) => r(a).power_of_two(),
                Op::Nearest(a) => r(a).to_nearest_whole(),
                Op::Load { ref table, index, offset } => T::from_constant(table.at(r(index).whole(), offset)),
                Op::Add(a, b) => r(a) + r(b),
                Op::Subtract(a, b) => r(a) - r(b),
                Op::Multiply(a, b) => r(a) * r(b),
                Op::Divide(a, b) => r(a) / r(b),
                Op::Less(a, b) => {
                    self.flags[k] = r(a) < r(b);
                    continue;
                }
                Op::Select { condition, then, otherwise } => {
                    if self.flags[condition.0 as usize] {
                        r(then)
                    } else {
                        r(otherwise)
                    }
                }
            };
            self.registers[k] = value;
        }
        self.registers[self.tape.output().0 as usize]
    }
}

//! Simplifies a tape: computes constants, and removes operations whose result is not used.
//!
//! In: a tape. Out: a tape with the same results for the same arguments, bit for bit (all NaNs count as equal). Only exact simplifications are made:
//! an operation on constants whose result is a number, a product with 1, a quotient by 1, a difference from 0, a double negation, a selection with a
//! known condition, and a comparison of a selection between constants.

use crate::number::{Precision, exact};
use crate::scalar::Scalar;

use super::{Computed, Op, Reg, Tape, TapeBuilder};

/// Registers of the new tape.
struct Folding {
    tape: TapeBuilder,
}

impl Folding {
    /// The value of a constant.
    fn value(&self, reg: Reg) -> Option<f64> {
        match self.tape.op(reg) {
            Op::Constant(constant) => Some(constant.value),
            _ => None,
        }
    }

    /// The register of a computed number, if it can be a constant. -0 has no constant of its own on a tape.
    fn number(&mut self, value: f64) -> Option<Reg> {
        let is_plain = value.is_finite() && !(value == 0.0 && value.is_sign_negative());
        is_plain.then(|| self.tape.rounded_constant(value, exact(value)))
    }

    fn is(&self, reg: Reg, value: f64) -> bool {
        self.value(reg).is_some_and(|it| it.to_bits() == value.to_bits())
    }

    fn write(&mut self, op: &Op) -> Reg {
        let values: Option<Vec<f64>> = op.operands().iter().map(|reg| self.value(*reg)).collect();
        if let Some(values) = values
            && let Some(value) = computed(op, &values, self.tape.precision())
            && let Some(reg) = self.number(value)
        {
            return reg;
        }
        match *op {
            Op::Multiply(a, b) if self.is(b, 1.0) => a,
            Op::Multiply(a, b) if self.is(a, 1.0) => b,
            Op::Divide(a, b) if self.is(b, 1.0) => a,
            Op::Subtract(a, b) if self.is(b, 0.0) => a,
            Op::Negate(a) => match *self.tape.op(a) {
                Op::Negate(inner) => inner,
                _ => self.tape.push(op.clone()),
            },
            Op::Select { condition, then, otherwise } => self.select(condition, then, otherwise),
            _ => self.tape.push(op.clone()),
        }
    }

    fn select(&mut self, condition: Reg, then: Reg, otherwise: Reg) -> Reg {
        if then == otherwise {
            return then;
        }
        let Op::Less(left, right) = *self.tape.op(condition) else {
            return self.tape.push(Op::Select { condition, then, otherwise });
        };
        if let (Some(left), Some(right)) = (self.value(left), self.value(right)) {
            return if left < right { then } else { otherwise };
        }
        // A condition that was converted to a number is compared with a number: the first comparison decides.
        let between = |folding: &Self, reg: Reg| match *folding.tape.op(reg) {
            Op::Select { condition, then, otherwise } => Some((condition, folding.value(then)?, folding.value(otherwise)?)),
            _ => None,
        };
        let inner = match (self.value(left), self.value(right)) {
            (Some(left), None) => between(self, right).map(|(condition, a, b)| (condition, left < a, left < b)),
            (None, Some(right)) => between(self, left).map(|(condition, a, b)| (condition, a < right, b < right)),
            _ => None,
        };
        match inner {
            None => self.tape.push(Op::Select { condition, then, otherwise }),
            Some((_, true, true)) => then,
            Some((_, false, false)) => otherwise,
            Some((condition, true, false)) => self.select(condition, then, otherwise),
            Some((condition, false, true)) => self.select(condition, otherwise, then),
        }
    }
}

/// The result of an operation on numbers, in the precision of the tape.
fn computed(op: &Op, values: &[f64], precision: Precision) -> Option<f64> {
    match precision {
        Precision::F64 => of_numbers::<f64>(op, values).map(|it| f64::from_bits(it.bits())),
        Precision::F32 => of_numbers::<f32>(op, values).map(|it| f64::from(f32::from_bits(it.bits() as u32))),
    }
}

fn of_numbers<T: Scalar>(op: &Op, values: &[f64]) -> Option<T> {
    let of = |k: usize| T::from_constant(values[k]);
    Some(match op {
        Op::Negate(_) => -of(0),
        Op::Absolute(_) => of(0).absolute(),
        Op::Exponent(_) => of(0).exponent(),
        Op::PowerOfTwo(_) => of(0).power_of_two(),
        Op::Nearest(_) => of(0).to_nearest_whole(),
        Op::Load { table, offset, .. } => T::from_constant(table.at(of(0).whole(), *offset)),
        Op::Add(..) => of(0) + of(1),
        Op::Subtract(..) => of(0) - of(1),
        Op::Multiply(..) => of(0) * of(1),
        Op::Divide(..) => of(0) / of(1),
        Op::Constant(_) | Op::Input(_) | Op::State(_) | Op::Less(..) | Op::Select { .. } => return None,
    })
}

/// The registers on which the results depend.
fn live(tape: &Tape) -> Vec<bool> {
    let mut live = vec![false; tape.ops.len()];
    tape.results().for_each(|reg| live[reg.0 as usize] = true);
    for k in (0..tape.ops.len()).rev() {
        if live[k] {
            tape.ops[k].operands().iter().for_each(|operand| live[operand.0 as usize] = true);
        }
    }
    live
}

/// Writes the live operations of a tape to a new one, with `write`.
fn rewritten(tape: &Tape, folding: &mut Folding, write: impl Fn(&mut Folding, &Op) -> Reg) -> Vec<Option<Reg>> {
    let mut places: Vec<Option<Reg>> = Vec::with_capacity(tape.ops.len());
    for (op, is_live) in tape.ops.iter().zip(live(tape)) {
        let place = is_live.then(|| match op {
            Op::Constant(constant) => folding.tape.rounded_constant(constant.value, constant.exact.clone()),
            op => write(folding, &op.with_operands(|reg| places[reg.0 as usize].expect("what a live operation reads is live"))),
        });
        places.push(place);
    }
    places
}

impl Tape {
    /// The same tape with constants computed and unused operations removed. It gives the same bits for the same arguments.
    ///
    /// ```
    /// use rsm_core::{number::{Precision, exact}, run::Interpreter, tape::TapeBuilder};
    ///
    /// // Parameters of a plant are constants of its tape: 3/1.5*speed is one product.
    /// let mut tape = TapeBuilder::new(Precision::F64);
    /// let (stiffness, mass) = (tape.constant(exact(3.0)), tape.constant(exact(1.5)));
    /// let speed = tape.input(0);
    /// let ratio = tape.divide(stiffness, mass);
    /// let rate = tape.multiply(ratio, speed);
    /// let tape = tape.finish("rate", vec!["speed".to_string()], rate);
    /// let folded = tape.folded();
    /// assert_eq!((tape.operation_count(), folded.operation_count()), (2, 1));
    /// assert_eq!(Interpreter::<f64>::new(&folded).eval(&[4.0]), 8.0);
    /// ```
    #[must_use]
    pub fn folded(&self) -> Tape {
        let copied = |folding: &mut Folding, op: &Op| folding.tape.push(op.clone());
        let first = self.passed(Folding::write);
        // Removes operations that folding made unused.
        first.passed(copied)
    }

    fn passed(&self, write: impl Fn(&mut Folding, &Op) -> Reg) -> Tape {
        let mut folding = Folding { tape: TapeBuilder::sharing(self.precision) };
        let places = rewritten(self, &mut folding, write);
        let of = |reg: Reg| places[reg.0 as usize];
        let mut tape = folding.tape;
        for (reg, note) in &self.notes {
            if let (Some(place), Op::Constant(_)) = (of(*reg), self.op(*reg)) {
                tape.add_note(place, note.clone());
            }
        }
        for row in &self.computed {
            let arguments: Option<Vec<Reg>> = row.arguments.iter().map(|reg| of(*reg)).collect();
            if let (Some(arguments), Some(result)) = (arguments, of(row.result))
                && !matches!(tape.op(result), Op::Constant(_))
            {
                tape.mark(Computed { function: row.function, arguments, result });
            }
        }
        let named = |list: &[super::Named]| -> Vec<(String, Reg)> {
            list.iter().map(|it| (it.name.clone(), of(it.reg).expect("a result is live"))).collect()
        };
        for seam in &self.seams {
            if let (Some(result), Some(argument)) = (of(seam.result), of(seam.argument)) {
                tape.add_seam(super::Seam { result, argument, ..seam.clone() });
            }
        }
        tape.finish_with_results(self.name.clone(), self.inputs.clone(), named(&self.outputs), named(&self.states))
    }
}

#[cfg(test)]
mod tests {
    use crate::elementary::{self, Function};
    use crate::number::{Precision, exact};
    use crate::run::Interpreter;
    use crate::tape::{Op, Reg, Tape, TapeBuilder};

    struct Random(u64);

    impl Random {
        fn below(&mut self, count: usize) -> usize {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 20) as usize % count
        }
    }

    /// Random operations over two inputs, a state and constants to which the rules apply.
    fn random(seed: u64) -> Tape {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        let mut tape = TapeBuilder::new(Precision::F64);
        let mut all: Vec<Reg> = vec![tape.input(0), tape.input(1), tape.state(0)];
        all.extend([0.0, 1.0, 0.5, -3.0, 1e300, 1e-300].map(|it| tape.constant(exact(it))));
        for _ in 0..60 {
            let mut any = || all[random.below(all.len())];
            let (a, b, c, d) = (any(), any(), any(), any());
            all.push(match random.below(9) {
                0 => tape.negate(a),
                1 => tape.absolute(a),
                2 => tape.add(a, b),
                3 => tape.subtract(a, b),
                4 | 5 => tape.multiply(a, b),
                6 => tape.divide(a, b),
                7 => tape.push(Op::Exponent(a)),
                _ => tape.select_less(a, b, c, d),
            });
        }
        let result = *all.last().unwrap();
        let names = ["x", "y"].map(str::to_string).to_vec();
        tape.finish_with_results("random", names, [("random", result)], [("s", all[all.len() - 2])])
    }

    fn bits(tape: &Tape, arguments: &[f64]) -> Vec<u64> {
        let mut interpreter = Interpreter::<f64>::new(tape);
        interpreter.set_states(&[0.75]);
        interpreter.step(arguments);
        let values = interpreter.results().chain(interpreter.states().iter().copied());
        // All NaNs count as equal.
        values.map(|it| if it.is_nan() { u64::MAX } else { it.to_bits() }).collect()
    }

    #[test]
    fn a_folded_tape_has_the_same_bits() {
        let mut shorter = 0;
        for seed in 1..2000 {
            let tape = random(seed);
            let folded = tape.folded();
            for x in [1.7, -0.0, 0.0, f64::NAN, f64::INFINITY, -1e-310] {
                for y in [0.3, -1e308, -0.0, f64::NEG_INFINITY] {
                    assert_eq!(bits(&tape, &[x, y]), bits(&folded, &[x, y]), "seed {seed} at {x} {y}\n{tape}\n{folded}");
                }
            }
            assert!(folded.ops.len() <= tape.ops.len());
            assert_eq!(folded.folded(), folded, "once is enough, seed {seed}");
            shorter += tape.operation_count() - folded.operation_count();
        }
        // More operations were removed than the unused ones.
        assert!(shorter > 20_000, "{shorter}");
    }

    #[test]
    fn a_function_of_a_constant_is_a_constant() {
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let angle = tape.constant(exact(0.3));
        let sine = elementary::write(&mut tape, Function::Sin, &[angle]);
        let x = tape.input(0);
        let y = tape.multiply(x, sine);
        let tape = tape.finish("y", vec!["x".to_string()], y);
        let folded = tape.folded();
        assert_eq!(folded.operation_count(), 1);
        assert_eq!(bits_of(&folded), bits_of(&tape));
        assert!(folded.computed.is_empty());
        fn bits_of(tape: &Tape) -> u64 {
            Interpreter::<f64>::new(tape).eval(&[3.0]).to_bits()
        }
    }

    #[test]
    fn a_choice_by_a_choice_is_one() {
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let (x, y) = (tape.input(0), tape.input(1));
        let [one, zero, half] = [1.0, 0.0, 0.5].map(|it| tape.constant(exact(it)));
        let truth = tape.select_less(x, y, one, zero);
        let chosen = tape.select_less(half, truth, x, y);
        let tape = tape.finish("smaller", vec!["x".to_string(), "y".to_string()], chosen);
        let folded = tape.folded();
        assert_eq!((tape.operation_count(), folded.operation_count()), (4, 2));
    }
}

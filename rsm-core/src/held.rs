//! Splits a tape in two: operations that depend only on held (constant) inputs are computed once for many evaluations.
//!
//! In: a tape, and which of its inputs are held. Out: [`Divided`]: the tape of the held part, and the tape of the rest, which takes its results as
//! further inputs. Together they give the bits of the original tape. [`turned`] first replaces a division by a held number by a product with its
//! reciprocal; that may change the last bit.

use crate::elementary::Computed;
use crate::number::integer;
use crate::tape::{Op, Reg, Tape, TapeBuilder};

/// A tape in two parts.
#[derive(Debug, Clone)]
pub struct Divided {
    /// Computes from all inputs of the tape the values that the rest needs; `None` if it needs none.
    pub held: Option<Tape>,
    /// The rest: its inputs are those of the tape, then the results of `held`.
    pub rest: Tape,
}

/// Which registers depend only on held inputs and constants.
#[must_use]
pub fn of_held(tape: &Tape, is_held: &[bool]) -> Vec<bool> {
    let mut held: Vec<bool> = Vec::with_capacity(tape.ops.len());
    for op in &tape.ops {
        held.push(match op {
            Op::Input(port) => is_held[port.0 as usize],
            Op::State(_) => false,
            other => other.operands().iter().all(|operand| held[operand.0 as usize]),
        });
    }
    held
}

/// The tape with every division by a held number replaced by a product with its reciprocal, unless the dividend is held too.
#[must_use]
pub fn turned(tape: &Tape, is_held: &[bool]) -> Tape {
    let held = of_held(tape, is_held);
    // Elementary functions are not changed inside, because the proof is for their operations as they are.
    let own = outside_of_rows(tape);
    rewritten(tape, |builder, reg, op, places| match *op {
        Op::Divide(a, b) if own[reg.0 as usize] && held[b.0 as usize] && !held[a.0 as usize] => {
            let one = builder.constant(integer(1));
            let reciprocal = builder.divide(one, places[b.0 as usize]);
            Some(builder.multiply(places[a.0 as usize], reciprocal))
        }
        _ => None,
    })
}

/// The registers that are not inside an elementary function.
fn outside_of_rows(tape: &Tape) -> Vec<bool> {
    let mut own = vec![false; tape.ops.len()];
    tape.results().for_each(|reg| own[reg.0 as usize] = true);
    for k in (0..tape.ops.len()).rev() {
        if !own[k] {
            continue;
        }
        let row = tape.computed.iter().find(|row| row.result.0 as usize == k);
        let operands = row.map_or_else(|| tape.ops[k].operands(), |row| row.arguments.clone());
        operands.iter().for_each(|operand| own[operand.0 as usize] = true);
    }
    own
}

fn rewritten(tape: &Tape, mut other: impl FnMut(&mut TapeBuilder, Reg, &Op, &[Reg]) -> Option<Reg>) -> Tape {
    let mut builder = TapeBuilder::sharing(tape.precision);
    let mut places: Vec<Reg> = Vec::with_capacity(tape.ops.len());
    for (reg, op) in tape.iter() {
        let place = other(&mut builder, reg, op, &places);
        let place = place.unwrap_or_else(|| builder.push(op.with_operands(|operand| places[operand.0 as usize])));
        places.push(place);
    }
    for row in &tape.computed {
        let place = |reg: &Reg| places[reg.0 as usize];
        builder.mark(Computed {
            function: row.function,
            arguments: row.arguments.iter().map(place).collect(),
            result: place(&row.result),
        });
    }
    let outputs: Vec<(String, Reg)> =
        tape.outputs.iter().map(|output| (output.name.clone(), places[output.reg.0 as usize])).collect();
    builder.finish_with_results(tape.name.clone(), tape.inputs.clone(), outputs, [] as [(String, Reg); 0])
}

/// Splits a tape.
///
/// # Panics
/// If the tape has states, or if the length of `is_held` is not the number of inputs.
///
/// ```
/// use rsm_core::{held, number::Precision, run::Interpreter, tape::TapeBuilder};
///
/// // v/(r c) - i r, with r and c held.
/// let mut tape = TapeBuilder::sharing(Precision::F64);
/// let [v, i, r, c] = [0, 1, 2, 3].map(|port| tape.input(port));
/// let product = tape.multiply(r, c);
/// let (left, right) = (tape.divide(v, product), tape.multiply(i, r));
/// let result = tape.subtract(left, right);
/// let tape = tape.finish("x", ["v", "i", "r", "c"].map(str::to_string).to_vec(), result);
///
/// let divided = held::divided(&tape, &[false, false, true, true]);
/// let once = Interpreter::<f64>::new(&divided.held.unwrap()).eval(&[f64::NAN, f64::NAN, 2.0, 4.0]);
/// assert_eq!(once, 8.0); // r c
/// let found = Interpreter::<f64>::new(&divided.rest).eval(&[40.0, 1.0, 2.0, 4.0, once]);
/// assert_eq!(found, 3.0);
/// ```
#[must_use]
pub fn divided(tape: &Tape, is_held: &[bool]) -> Divided {
    assert!(tape.states.is_empty(), "only a function of its inputs is divided");
    assert_eq!(is_held.len(), tape.inputs.len(), "one answer an input");
    let held = of_held(tape, is_held);
    let mut once = TapeBuilder::sharing(tape.precision);
    let inputs: Vec<Reg> = (0..tape.inputs.len() as u32).map(|port| once.input(port)).collect();
    let once_places = once.transcribe(tape, &inputs, &[]);
    let mut parts = Parts {
        tape,
        held: &held,
        rest: TapeBuilder::sharing(tape.precision),
        places: vec![None; tape.ops.len()],
        carried: Vec::new(),
    };
    let rows: Vec<&Computed> = tape.computed.iter().filter(|row| !held[row.result.0 as usize]).collect();
    // Unused operations are not written.
    let mut needed: Vec<bool> = vec![false; tape.ops.len()];
    tape.results().for_each(|reg| needed[reg.0 as usize] = true);
    rows.iter().for_each(|row| row.arguments.iter().for_each(|reg| needed[reg.0 as usize] |= needed[row.result.0 as usize]));
    for k in (0..tape.ops.len()).rev() {
        if needed[k] && !held[k] {
            tape.ops[k].operands().iter().for_each(|operand| needed[operand.0 as usize] = true);
        }
        if needed[k]
            && let Some(row) = rows.iter().find(|row| row.result.0 as usize == k)
        {
            row.arguments.iter().for_each(|reg| needed[reg.0 as usize] = true);
        }
    }
    for (reg, _) in tape.iter().filter(|(reg, _)| needed[reg.0 as usize] && !held[reg.0 as usize]) {
        parts.place(reg);
    }
    for row in rows.iter().filter(|row| needed[row.result.0 as usize]) {
        let arguments = row.arguments.iter().map(|reg| parts.place(*reg)).collect();
        let result = parts.place(row.result);
        parts.rest.mark(Computed { function: row.function, arguments, result });
    }
    let outputs: Vec<(String, Reg)> =
        tape.outputs.iter().map(|output| (output.name.clone(), parts.place(output.reg))).collect();
    let Parts { rest, carried, .. } = parts;
    let names = (0..carried.len()).map(|k| format!("held {k}"));
    let all: Vec<String> = tape.inputs.iter().cloned().chain(names).collect();
    let results: Vec<(String, Reg)> =
        carried.iter().enumerate().map(|(k, reg)| (format!("held {k}"), once_places[reg.0 as usize])).collect();
    let once = (!carried.is_empty()).then(|| {
        once.finish_with_results(format!("{}_held", tape.name), tape.inputs.clone(), results, [] as [(String, Reg); 0])
    });
    Divided { held: once, rest: rest.finish_with_results(tape.name.clone(), all, outputs, [] as [(String, Reg); 0]) }
}

struct Parts<'t> {
    tape: &'t Tape,
    held: &'t [bool],
    rest: TapeBuilder,
    /// The register on the tape of the rest, of each register of the tape.
    places: Vec<Option<Reg>>,
    /// The registers that the rest takes from the held part.
    carried: Vec<Reg>,
}

impl Parts<'_> {
    /// The register on the tape of the rest.
    fn place(&mut self, reg: Reg) -> Reg {
        if let Some(place) = self.places[reg.0 as usize] {
            return place;
        }
        let op = self.tape.op(reg);
        let place = match op {
            Op::Constant(constant) => self.rest.rounded_constant(constant.value, constant.exact.clone()),
            Op::Input(port) => self.rest.input(port.0),
            // A comparison is not a number and cannot be passed.
            _ if self.held[reg.0 as usize] && !matches!(op, Op::Less(..)) => {
                self.carried.push(reg);
                self.rest.input((self.tape.inputs.len() + self.carried.len() - 1) as u32)
            }
            _ => {
                let op = op.with_operands(|operand| self.place(operand));
                self.rest.push(op)
            }
        };
        self.places[reg.0 as usize] = Some(place);
        place
    }
}

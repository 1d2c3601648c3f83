//! The operations of a tape, one after another, on every lane.

use rsm_core::run::Scalar;
use rsm_core::tape::{Op, Reg, Tape};

use super::Slot;

/// The operations that the results need, in order, with their slots.
#[derive(Debug)]
pub(crate) struct Interpreted {
    pub(super) ops: Vec<Op>,
    /// For each argument: its slot.
    pub(super) arguments: Vec<Slot>,
    /// Registers of the results, with their slots.
    pub(super) results: Vec<(Reg, Slot)>,
}

impl Interpreted {
    pub(super) fn new(tape: &Tape, arguments: &[Slot], results: &[Slot]) -> Self {
        let mut needed = vec![false; tape.ops.len()];
        tape.outputs.iter().for_each(|output| needed[output.reg.0 as usize] = true);
        for k in (0..tape.ops.len()).rev() {
            if needed[k] {
                tape.ops[k].operands().iter().for_each(|operand| needed[operand.0 as usize] = true);
            }
        }
        let mut places = vec![Reg(0); tape.ops.len()];
        let mut ops = Vec::new();
        for (k, op) in tape.ops.iter().enumerate().filter(|(k, _)| needed[*k]) {
            places[k] = Reg(ops.len() as u32);
            ops.push(op.with_operands(|operand| places[operand.0 as usize]));
        }
        let results = tape.outputs.iter().zip(results).map(|(output, slot)| (places[output.reg.0 as usize], *slot)).collect();
        Interpreted { ops, arguments: arguments.to_vec(), results }
    }

    /// The smallest permitted length of the array.
    pub(super) fn slots(&self) -> usize {
        let used = self.ops.iter().filter_map(|op| match op {
            Op::Input(port) => Some(self.arguments[port.0 as usize]),
            _ => None,
        });
        used.chain(self.results.iter().map(|it| it.1)).max().map_or(0, |last| last as usize + 1)
    }

    pub(super) fn run<const L: usize>(&self, slots: &mut [[f64; L]], registers: &mut Vec<[f64; L]>) {
        if registers.len() < self.ops.len() {
            registers.resize(self.ops.len(), [0.0; L]);
        }
        for (k, op) in self.ops.iter().enumerate() {
            let r = |reg: Reg| registers[reg.0 as usize];
            let one = |a: Reg, act: fn(f64) -> f64| r(a).map(act);
            let two = |a: Reg, b: Reg, act: fn(f64, f64) -> f64| {
                let (a, b) = (r(a), r(b));
                std::array::from_fn(|lane| act(a[lane], b[lane]))
            };
            registers[k] = match *op {
                Op::Constant(ref constant) => [constant.value; L],
                Op::Input(port) => slots[self.arguments[port.0 as usize] as usize],
                Op::State(_) => unreachable!("a tape without states"),
                Op::Negate(a) => one(a, |a| -a),
                Op::Absolute(a) => one(a, f64::abs),
                Op::Exponent(a) => one(a, Scalar::exponent),
                Op::PowerOfTwo(a) => one(a, Scalar::power_of_two),
                Op::Nearest(a) => one(a, Scalar::to_nearest_whole),
                Op::Load { ref table, index, offset } => r(index).map(|index| table.at(index.whole(), offset)),
                Op::Add(a, b) => two(a, b, |a, b| a + b),
                Op::Subtract(a, b) => two(a, b, |a, b| a - b),
                Op::Multiply(a, b) => two(a, b, |a, b| a * b),
                Op::Divide(a, b) => two(a, b, |a, b| a / b),
                Op::Less(a, b) => two(a, b, |a, b| f64::from(u8::from(a < b))),
                Op::Select { condition, then, otherwise } => {
                    let (condition, then, otherwise) = (r(condition), r(then), r(otherwise));
                    std::array::from_fn(|lane| if condition[lane] != 0.0 { then[lane] } else { otherwise[lane] })
                }
            };
        }
        for (reg, slot) in &self.results {
            slots[*slot as usize] = registers[reg.0 as usize];
        }
    }
}

//! Finds the operations of a tape that must be hidden from a C compiler: products that it could fuse into sums, and quotients that it could replace
//! by products.

use crate::tape::{Op, Reg, Tape};

/// How registers are used, found in one pass from the end of a tape.
pub(super) struct Reads {
    feeds_sum: Vec<bool>,
    pub(super) is_result: Vec<bool>,
    /// States that are not written by a selection.
    is_computed: Vec<bool>,
}

impl Reads {
    pub(super) fn of(tape: &Tape) -> Reads {
        let size = tape.ops.len();
        let mut reads = Reads { feeds_sum: vec![false; size], is_result: vec![false; size], is_computed: vec![false; size] };
        tape.results().for_each(|reg| reads.is_result[reg.0 as usize] = true);
        for (k, op) in tape.ops.iter().enumerate().rev() {
            match *op {
                Op::Add(a, b) | Op::Subtract(a, b) => {
                    reads.feeds_sum[a.0 as usize] = true;
                    reads.feeds_sum[b.0 as usize] = true;
                }
                // Its code contains a sum.
                Op::PowerOfTwo(a) | Op::Nearest(a) | Op::Load { index: a, .. } => reads.feeds_sum[a.0 as usize] = true,
                // A compiler may treat the magnitude of a square as the square itself.
                Op::Negate(a) | Op::Absolute(a) => {
                    reads.feeds_sum[a.0 as usize] |= reads.feeds_sum[k];
                    reads.is_result[a.0 as usize] |= reads.is_result[k];
                }
                Op::State(state) => {
                    let next = tape.op(tape.states[state.0 as usize].reg);
                    reads.is_computed[k] = !matches!(next, Op::Select { .. });
                }
                _ => {}
            }
        }
        reads
    }

    /// Whether a sum or a difference uses the register, directly or through a sign.
    pub(super) fn feeds_sum(&self, reg: Reg) -> bool {
        self.feeds_sum[reg.0 as usize]
    }

    /// Whether a product must be hidden from its uses: only a sum can be fused with it. The caller may add to a result.
    pub(super) fn is_kept(&self, product: Reg) -> bool {
        self.feeds_sum(product) || self.is_result[product.0 as usize]
    }

    /// The same for a state. If a selection wrote it, there is no product that could be fused.
    pub(super) fn is_kept_state(&self, state: Reg) -> bool {
        self.feeds_sum(state) && self.is_computed[state.0 as usize]
    }
}

/// Whether a divisor is a constant power of two, well inside the exponent range of both precisions. Multiplication by its reciprocal then gives the
/// same bits and is faster.
pub(super) fn has_exact_reciprocal(tape: &Tape, divisor: Reg) -> bool {
    // From 2^-100 to 2^100; the exponents of f32 end at 2^-126 and 2^127.
    const LIMIT: f64 = (1_u128 << 100) as f64;
    let Op::Constant(ref constant) = *tape.op(divisor) else { return false };
    let magnitude = constant.value.abs();
    let mantissa = magnitude.to_bits() & ((1 << (f64::MANTISSA_DIGITS - 1)) - 1);
    mantissa == 0 && (1.0 / LIMIT..=LIMIT).contains(&magnitude)
}

//! Tapes as code that runs on an array of slots, for one lane or for [`WIDE`] lanes at once.
//!
//! ```text
//! tape + where its arguments and results stand --Code::new--> machine code (x86-64 with AVX2) or the interpreter --run--> slots
//! ```
//!
//! In: a tape without states. Out: [`Code`], which reads arguments from slots and writes results to slots. A slot holds one number a lane, side by
//! side. Both ways of running give the same bits, and a lane's bits do not depend on its neighbours: every operation acts on each lane alone.

mod interpreted;
#[cfg(target_arch = "x86_64")]
mod native;
#[cfg(target_arch = "x86_64")]
mod registers;
#[cfg(test)]
mod tests;

use rsm_core::tape::{Op, Tape};

use interpreted::Interpreted;

/// Lanes in one slot of a wide array: what a register of AVX holds.
pub const WIDE: usize = 4;

/// Loops over numbers that stand side by side. `run` and all that it calls have the attribute `inline(always)`: only what is inlined becomes vector instructions.
pub(crate) trait Work {
    /// What it finds.
    type Found;
    fn run(self) -> Self::Found;
}

/// Runs loops with the registers of AVX2, where this machine has them. The bits are the same: each number has its own operations, in the same order, and none are fused.
#[inline]
pub(crate) fn vectorised<W: Work>(work: W) -> W::Found {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        return native::with_avx2(work);
    }
    work.run()
}

/// Where a number stands in an array of slots.
pub type Slot = u32;

/// A tape with the places of its arguments and results.
#[derive(Debug)]
pub struct Code {
    interpreted: Interpreted,
    #[cfg(target_arch = "x86_64")]
    native: Option<native::Native>,
    /// Slots that an array needs at least.
    slots: usize,
}

/// How a tape runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// As machine code where this machine can, else by the interpreter.
    Fastest,
    /// By the interpreter: what machine code is compared with.
    Interpreted,
}

impl Code {
    /// The code of a tape, for arrays of one lane or of [`WIDE`] lanes. Argument k stands in slot `arguments[k]`, result k goes to slot `results[k]`.
    ///
    /// # Panics
    /// When the tape keeps states or is not in f64, when a result would go where an argument stands, or when lanes are neither 1 nor [`WIDE`].
    #[must_use]
    pub fn new(tape: &Tape, arguments: &[Slot], results: &[Slot], lanes: usize, way: Way) -> Code {
        assert!(tape.states.is_empty(), "a tape with states is executed step by step");
        assert!(lanes == 1 || lanes == WIDE, "one lane or {WIDE}");
        assert_eq!(arguments.len(), tape.inputs.len(), "one slot an argument");
        assert_eq!(results.len(), tape.outputs.len(), "one slot a result");
        let used = |slot: &Slot| tape.ops.iter().any(|op| matches!(op, Op::Input(port) if arguments[port.0 as usize] == *slot));
        assert!(!results.iter().any(used), "a result goes where no argument stands");
        let interpreted = Interpreted::new(tape, arguments, results);
        #[cfg(target_arch = "x86_64")]
        {
            let native = (way == Way::Fastest).then(|| native::Native::new(&interpreted, lanes)).flatten();
            Code { native, slots: interpreted.slots(), interpreted }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = way;
            Code { slots: interpreted.slots(), interpreted }
        }
    }

    /// Slots that an array needs at least.
    #[must_use]
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// Whether it runs as machine code.
    #[must_use]
    pub fn is_native(&self) -> bool {
        #[cfg(target_arch = "x86_64")]
        {
            self.native.is_some()
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            false
        }
    }

    /// Computes the results from the arguments. What lies between is kept in `spare`.
    ///
    /// # Panics
    /// When the array is too short, or has other lanes than the code was made for.
    #[inline]
    pub fn run<const L: usize>(&self, slots: &mut [[f64; L]], spare: &mut Vec<[f64; L]>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(native) = &self.native {
            native.run(slots, spare);
            return;
        }
        self.interpreted.run(slots, spare);
    }
}

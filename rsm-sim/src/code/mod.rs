//! Tapes as code that works on an array of slots, for one lane or for [`WIDE`] lanes at once.
//!
//! ```text
//! tape + slots of its arguments and results --Code::new--> machine code (x86-64 with AVX2) or the interpreter --run--> slots
//! ```
//!
//! In: a tape without states. Out: [`Code`], which reads arguments from slots and writes results to slots. A slot contains one number for each lane.
//! Both ways of execution give the same bits. The bits of a lane do not depend on the other lanes, because every operation acts on each lane
//! separately.

mod interpreted;
#[cfg(target_arch = "x86_64")]
mod native;
#[cfg(target_arch = "x86_64")]
mod registers;
#[cfg(test)]
mod tests;

use rsm_core::tape::{Op, Tape};
use rsm_core::vector::with_eight;
pub(crate) use rsm_core::vector::{Work, has_eight, vectorised};

use interpreted::Interpreted;

/// The number of lanes in one slot of a wide array: the numbers in one AVX register.
pub const WIDE: usize = 4;

/// Runs loops over lanes: with more than one lane as [`vectorised`].
#[inline(always)]
pub(crate) fn over_lanes<const L: usize, W: Work>(work: W) -> W::Found {
    if L > 1 { vectorised(work) } else { work.run() }
}

/// Runs loops over four or eight lanes: over eight with the registers of AVX-512, over fewer as [`vectorised`]. So a loop is compiled for the
/// registers that run it, not for each set of instructions with each number of lanes. The bits are the same.
///
/// # Panics
/// For eight lanes on a machine without such registers ([`has_eight`]).
#[inline]
pub(crate) fn by_registers<const L: usize, W: Work>(work: W) -> W::Found {
    if const { L > WIDE } { with_eight(work) } else { vectorised(work) }
}

/// The index of a number in an array of slots.
pub type Slot = u32;

/// The number of attempts to get memory at a suitable address. Neighbouring pieces of memory differ by 16 bytes, so the second attempt usually has
/// one.
const ATTEMPTS: usize = 8;

/// Makes an array of slots longer, filled with 0. Its address is a multiple of the length of a slot, if the allocator has such memory: a register
/// that lies in two cache lines takes two accesses. Nothing but the speed depends on it.
pub(crate) fn lengthen<const L: usize>(slots: &mut Vec<[f64; L]>, length: usize) {
    if slots.len() >= length {
        return;
    }
    // Memory at other addresses is kept until the end, so that the allocator does not give it again.
    let mut tried: Vec<Vec<[f64; L]>> = Vec::with_capacity(ATTEMPTS);
    for _ in 0..ATTEMPTS {
        let memory: Vec<[f64; L]> = Vec::with_capacity(length);
        let is_suitable = (memory.as_ptr() as usize).is_multiple_of(size_of::<[f64; L]>());
        tried.push(memory);
        if is_suitable {
            break;
        }
    }
    let mut memory = tried.pop().unwrap_or_default();
    memory.extend_from_slice(slots);
    memory.resize(length, [0.0; L]);
    *slots = memory;
}

/// A part of a program.
#[derive(Debug)]
pub(crate) enum Piece {
    /// A tape.
    Tape(Interpreted),
    /// Writes a number of another array to all lanes of a slot: pairs of the index there and the slot.
    Spread(Vec<(usize, usize)>),
    /// Copies slots: pairs of the slot that is read and the slot that is written.
    Copy(Vec<(usize, usize)>),
}

impl Piece {
    /// A tape. Argument k is read from slot `arguments[k]`; result k is written to slot `results[k]`.
    ///
    /// # Panics
    /// If the tape has states, if there is not one slot for each argument and result, or if a result has the same slot as an argument.
    pub(crate) fn tape(tape: &Tape, arguments: &[Slot], results: &[Slot]) -> Piece {
        assert!(tape.states.is_empty(), "a tape with states is executed step by step");
        assert_eq!(arguments.len(), tape.inputs.len(), "one slot an argument");
        assert_eq!(results.len(), tape.outputs.len(), "one slot a result");
        let used = |slot: &Slot| tape.ops.iter().any(|op| matches!(op, Op::Input(port) if arguments[port.0 as usize] == *slot));
        assert!(!results.iter().any(used), "a result goes where no argument stands");
        Piece::Tape(Interpreted::new(tape, arguments, results))
    }

    /// The smallest permitted length of the array of slots, and of the other array.
    fn lengths(&self) -> (usize, usize) {
        let after =
            |places: &[(usize, usize)], of: fn(&(usize, usize)) -> usize| places.iter().map(of).max().map_or(0, |it| it + 1);
        match self {
            Piece::Tape(tape) => (tape.slots(), 0),
            Piece::Spread(places) => (after(places, |it| it.1), after(places, |it| it.0)),
            Piece::Copy(places) => (after(places, |it| it.0.max(it.1)), 0),
        }
    }

    fn run<const L: usize>(&self, numbers: &[f64], slots: &mut [[f64; L]], spare: &mut Vec<[f64; L]>) {
        match self {
            Piece::Tape(tape) => tape.run(slots, spare),
            Piece::Spread(places) => places.iter().for_each(|(from, to)| slots[*to] = [numbers[*from]; L]),
            Piece::Copy(places) => places.iter().for_each(|(from, to)| slots[*to] = slots[*from]),
        }
    }
}

/// A program: one tape, or some pieces one after another.
#[derive(Debug)]
pub struct Code {
    pieces: Vec<Piece>,
    #[cfg(target_arch = "x86_64")]
    native: Option<native::Native>,
    /// The smallest permitted length of the array of slots, and of the other array.
    lengths: (usize, usize),
}

/// The way a tape is executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// As machine code if this machine supports it, else by the interpreter.
    Fastest,
    /// By the interpreter. Machine code is compared with it.
    Interpreted,
}

impl Code {
    /// The code of a tape, for arrays of one lane or of [`WIDE`] lanes. Argument k is read from slot `arguments[k]`; result k is written to slot
    /// `results[k]`.
    ///
    /// # Panics
    /// If the tape has states or is not in f64, if a result has the same slot as an argument, or if `lanes` is neither 1 nor [`WIDE`].
    #[must_use]
    pub fn new(tape: &Tape, arguments: &[Slot], results: &[Slot], lanes: usize, way: Way) -> Code {
        Code::of(vec![Piece::tape(tape, arguments, results)], lanes, way)
    }

    /// The code of some pieces.
    ///
    /// # Panics
    /// If `lanes` is neither 1 nor [`WIDE`].
    pub(crate) fn of(pieces: Vec<Piece>, lanes: usize, way: Way) -> Code {
        assert!(lanes == 1 || lanes == WIDE, "one lane or {WIDE}");
        let longest = |a: (usize, usize), b: (usize, usize)| (a.0.max(b.0), a.1.max(b.1));
        let lengths = pieces.iter().map(Piece::lengths).fold((0, 0), longest);
        #[cfg(target_arch = "x86_64")]
        {
            let native = (way == Way::Fastest).then(|| native::Native::new(&pieces, lengths, lanes)).flatten();
            Code { native, lengths, pieces }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = way;
            Code { lengths, pieces }
        }
    }

    /// The smallest permitted length of the array.
    #[must_use]
    pub fn slots(&self) -> usize {
        self.lengths.0
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

    /// Computes the results from the arguments. Intermediate values are stored in `spare`.
    ///
    /// # Panics
    /// If the array is too short, or has a different number of lanes than the code.
    #[inline]
    pub fn run<const L: usize>(&self, slots: &mut [[f64; L]], spare: &mut Vec<[f64; L]>) {
        self.run_with(&[], slots, spare);
    }

    /// Runs pieces that read numbers of another array.
    ///
    /// # Panics
    /// If an array is too short, or `slots` has a different number of lanes than the code.
    #[inline]
    pub(crate) fn run_with<const L: usize>(&self, numbers: &[f64], slots: &mut [[f64; L]], spare: &mut Vec<[f64; L]>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(native) = &self.native {
            native.run(numbers, slots, spare);
            return;
        }
        self.interpret(numbers, slots, spare);
    }

    /// Apart from the machine code, whose call then needs to save no registers.
    #[cold]
    #[inline(never)]
    fn interpret<const L: usize>(&self, numbers: &[f64], slots: &mut [[f64; L]], spare: &mut Vec<[f64; L]>) {
        assert!(slots.len() >= self.lengths.0 && numbers.len() >= self.lengths.1, "an array is of another shape than the code");
        self.pieces.iter().for_each(|piece| piece.run(numbers, slots, spare));
    }
}

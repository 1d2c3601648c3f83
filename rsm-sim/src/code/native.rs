//! Machine code for x86-64 with AVX2.
//!
//! In: pieces of a program, with their slots. Out: a function of the slots' address, in separate memory. Each operation of a tape becomes one
//! instruction of IEEE 754 double precision (`Exponent` four, `PowerOfTwo` two), so the bits are those of the interpreter. Encodings: Intel 64 and
//! IA-32 Architectures Software Developer's Manual, volume 2, sections 2.3 and 4. The function has no call and no branch, and accesses only the
//! slots, the array of other numbers, its constants and the memory for spilled values.
#![allow(unsafe_code)] // Machine code is called through a pointer, which is not possible in safe code.

use std::collections::HashMap;

use memmap2::{Mmap, MmapMut};
use rsm_core::tape::{Op, Reg};

use super::interpreted::Interpreted;
use super::registers::{Memory, Move, Registers};
use super::{Piece, Slot, WIDE, lengthen};

/// 2^52: from here to 2^53 the last bit of a number has the value 1.
const WHOLE: f64 = 4_503_599_627_370_496.0;
/// The bias of exponents.
const BIAS: f64 = 1023.0;

/// The signature of the machine code: the addresses of the slots, of the constants, of the places for spilled values, and of the other array.
type Function = extern "sysv64" fn(*mut f64, *const f64, *mut f64, *const f64);

/// A function in executable memory.
#[derive(Debug)]
pub(super) struct Native {
    /// Keeps the code in memory as long as it can be called.
    _memory: Mmap,
    function: Function,
    constants: Vec<f64>,
    /// The smallest permitted length of the array of slots, and of the other array.
    lengths: (usize, usize),
    spills: usize,
    lanes: usize,
}

/// The base registers of addresses: the arguments of a call.
const SLOTS: u8 = 7;
const CONSTANTS: u8 = 6;
const SPILLS: u8 = 2;
const NUMBERS: u8 = 1;

#[derive(Clone, Copy)]
enum Operand {
    Register(u8),
    Memory(Memory),
}

/// The instructions, each with its opcode; packed forms have the prefix 66, scalar forms F2.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Instruction {
    Add = 0x58,
    Multiply = 0x59,
    Subtract = 0x5c,
    Divide = 0x5e,
    Smaller = 0x5d,
    Larger = 0x5f,
    And = 0x54,
    Xor = 0x57,
    Or = 0xeb,
}

struct Assembler {
    code: Vec<u8>,
    wide: bool,
    constants: Vec<u64>,
    places: HashMap<u64, u32>,
}

impl Assembler {
    fn constant(&mut self, bits: u64) -> Memory {
        let next = self.constants.len() as u32;
        let place = *self.places.entry(bits).or_insert(next);
        if place == next {
            self.constants.push(bits);
        }
        Memory::Constant(place)
    }

    /// A VEX prefix of two bytes, or of three where the operands need it, the opcode, and its operands, with a short displacement if it fits. Short
    /// code matters: the programs of a row fill the cache of instructions. `map`: 1 for 0F, 2 for 0F38, 3 for 0F3A. `prefix`: 1 for 66, 3 for F2.
    fn vex(&mut self, map: u8, prefix: u8, opcode: u8, reg: u8, vvvv: u8, rm: Operand) {
        let base = match rm {
            Operand::Register(register) => register,
            Operand::Memory(_) => 0,
        };
        let length = u8::from(self.wide);
        let (high, rest) = (((reg >> 3) ^ 1) << 7, ((vvvv ^ 15) << 3) | (length << 2) | prefix);
        if map == 1 && base < 8 {
            self.code.extend([0xc5, high | rest]);
        } else {
            self.code.extend([0xc4, high | (1 << 6) | (((base >> 3) ^ 1) << 5) | map, rest]);
        }
        self.code.push(opcode);
        match rm {
            Operand::Register(register) => self.code.push(0xc0 | ((reg & 7) << 3) | (register & 7)),
            Operand::Memory(memory) => {
                let size = if self.wide { 8 * WIDE as u32 } else { 8 };
                let (base, displacement) = match memory {
                    Memory::Slot(slot) => (SLOTS, slot * size),
                    Memory::Constant(place) => (CONSTANTS, place * size),
                    Memory::Spilled(place) => (SPILLS, place * size),
                    Memory::Number(place) => (NUMBERS, place * 8),
                };
                let operands = ((reg & 7) << 3) | base;
                match i8::try_from(displacement) {
                    Ok(short) => self.code.extend([0x40 | operands, short as u8]),
                    Err(_) => {
                        self.code.push(0x80 | operands);
                        self.code.extend(displacement.to_le_bytes());
                    }
                }
            }
        }
    }

    fn load(&mut self, register: u8, memory: Memory) {
        let prefix = if self.wide { 1 } else { 3 };
        self.vex(1, prefix, 0x10, register, 0, Operand::Memory(memory));
    }

    fn store(&mut self, register: u8, memory: Memory) {
        let prefix = if self.wide { 1 } else { 3 };
        self.vex(1, prefix, 0x11, register, 0, Operand::Memory(memory));
    }

    /// Loads a number into every lane of a register.
    fn load_everywhere(&mut self, register: u8, memory: Memory) {
        if self.wide {
            self.vex(2, 1, 0x19, register, 0, Operand::Memory(memory));
        } else {
            self.load(register, memory);
        }
    }

    fn arithmetic(&mut self, instruction: Instruction, to: u8, a: u8, b: Operand) {
        let bitwise = matches!(instruction, Instruction::And | Instruction::Xor | Instruction::Or);
        let prefix = if self.wide || bitwise { 1 } else { 3 };
        self.vex(1, prefix, instruction as u8, to, a, b);
    }

    /// Shifts the bits of each number to the left (`/6`) or to the right (`/2`).
    fn shift(&mut self, left: bool, to: u8, from: u8, by: u8) {
        self.vex(1, 1, 0x73, if left { 6 } else { 2 }, to, Operand::Register(from));
        self.code.push(by);
    }
}

/// A selection of the smaller or larger of two numbers, which is one instruction: it gives the first number if that is smaller (larger), else the
/// second, also if one of them is NaN.
#[derive(Clone, Copy)]
struct Extreme {
    instruction: Instruction,
    first: Reg,
    second: Reg,
}

/// Finds the selection `a < b ? a : b` or `b < a ? a : b`.
fn extreme(ops: &[Op], op: &Op) -> Option<Extreme> {
    let Op::Select { condition, then, otherwise } = *op else { return None };
    let Op::Less(left, right) = ops[condition.0 as usize] else { return None };
    let instruction = match (then, otherwise) {
        it if it == (left, right) => Instruction::Smaller,
        it if it == (right, left) => Instruction::Larger,
        _ => return None,
    };
    Some(Extreme { instruction, first: then, second: otherwise })
}

/// Compiles the operations of a tape, one by one.
struct Compiler<'a> {
    source: &'a Interpreted,
    extremes: Vec<Option<Extreme>>,
    assembler: Assembler,
    registers: Registers,
    /// Slots to which a register of the tape is written.
    results: HashMap<u32, Vec<Slot>>,
}

impl Native {
    /// The code; `None` if the machine has no AVX2, or gives no executable memory, or if a piece has no machine code. `lengths`: the smallest
    /// permitted length of the array of slots, and of the other array.
    pub(super) fn new(pieces: &[Piece], lengths: (usize, usize), lanes: usize) -> Option<Native> {
        if !std::arch::is_x86_feature_detected!("avx2") {
            return None;
        }
        let mut assembler = Assembler { code: Vec::new(), wide: lanes == WIDE, constants: Vec::new(), places: HashMap::new() };
        let mut spills = 0;
        for piece in pieces {
            match piece {
                Piece::Tape(source) => {
                    let compiled = Compiler::run(source, assembler)?;
                    assembler = compiled.assembler;
                    spills = spills.max(compiled.registers.spills());
                }
                // The numbers of a copy go through the same register: the machine renames it.
                Piece::Spread(places) => places.iter().for_each(|(from, to)| {
                    assembler.load_everywhere(0, Memory::Number(*from as u32));
                    assembler.store(0, Memory::Slot(*to as Slot));
                }),
                Piece::Copy(places) => places.iter().for_each(|(from, to)| {
                    assembler.load(0, Memory::Slot(*from as Slot));
                    assembler.store(0, Memory::Slot(*to as Slot));
                }),
            }
        }
        if assembler.wide {
            assembler.code.extend([0xc5, 0xf8, 0x77]); // vzeroupper
        }
        assembler.code.push(0xc3); // ret
        let mut memory = MmapMut::map_anon(assembler.code.len()).ok()?;
        memory.copy_from_slice(&assembler.code);
        let memory = memory.make_exec().ok()?;
        // SAFETY: the memory contains a complete function with this signature and calling convention. It lives as long as the pointer, because both
        // are in one value.
        let function = unsafe { std::mem::transmute::<*const u8, Function>(memory.as_ptr()) };
        let constants = assembler.constants.iter().flat_map(|bits| std::iter::repeat_n(f64::from_bits(*bits), lanes));
        // A bitwise instruction reads two numbers, and only the first is used. This padding keeps the second one inside the array.
        let constants = constants.chain([0.0]).collect();
        Some(Native { _memory: memory, function, constants, lengths, spills, lanes })
    }

    #[inline]
    pub(super) fn run<const L: usize>(&self, numbers: &[f64], slots: &mut [[f64; L]], spare: &mut Vec<[f64; L]>) {
        let fits = L == self.lanes && slots.len() >= self.lengths.0 && numbers.len() >= self.lengths.1;
        assert!(fits, "an array is of another shape than the code");
        if spare.len() < self.spills {
            more_spills(spare, self.spills);
        }
        // The machine code needs no bounds checks: it accesses only slots below `self.lengths.0` and places below `self.spills`, each with `L`
        // numbers, the other array below `self.lengths.1`, and its constants.
        (self.function)(slots.as_mut_ptr().cast(), self.constants.as_ptr(), spare.as_mut_ptr().cast(), numbers.as_ptr());
    }
}

/// Apart from the usual way, which then needs to save no registers.
#[cold]
#[inline(never)]
fn more_spills<const L: usize>(spare: &mut Vec<[f64; L]>, count: usize) {
    lengthen(spare, count);
}

impl<'a> Compiler<'a> {
    /// Compiles a tape; `None` if it has an operation without machine code.
    fn run(source: &'a Interpreted, assembler: Assembler) -> Option<Compiler<'a>> {
        // There is no instruction for the tables of a spline.
        if source.ops.iter().any(|op| matches!(op, Op::Nearest(_) | Op::Load { .. })) {
            return None;
        }
        let extremes: Vec<Option<Extreme>> = source.ops.iter().map(|op| extreme(&source.ops, op)).collect();
        let mut readers = vec![Vec::new(); source.ops.len()];
        for (k, op) in source.ops.iter().enumerate() {
            let operands = extremes[k].map_or_else(|| op.operands(), |it| vec![it.first, it.second]);
            for operand in operands {
                readers[operand.0 as usize].push(k as u32);
            }
        }
        let mut results: HashMap<u32, Vec<Slot>> = HashMap::new();
        for (reg, slot) in &source.results {
            results.entry(reg.0).or_default().push(*slot);
        }
        let mut compiler = Compiler { source, extremes, assembler, registers: Registers::new(readers), results };
        for (k, op) in source.ops.iter().enumerate() {
            compiler.registers.begin();
            compiler.operation(k as u32, op);
        }
        Some(compiler)
    }

    fn operation(&mut self, k: u32, op: &Op) {
        if let Some(Extreme { instruction, first, second }) = self.extremes[k as usize] {
            self.binary(k, first, second, instruction);
            return;
        }
        match *op {
            Op::Constant(ref constant) => {
                let memory = self.assembler.constant(constant.value.to_bits());
                self.registers.set_memory(k, memory);
                self.copied(k);
            }
            Op::Input(port) => {
                self.registers.set_memory(k, Memory::Slot(self.source.arguments[port.0 as usize]));
                self.copied(k);
            }
            Op::State(_) | Op::Nearest(_) | Op::Load { .. } => unreachable!("a tape without states and tables"),
            Op::Negate(a) => self.with_bits(k, a, Instruction::Xor, 1 << 63),
            Op::Absolute(a) => self.with_bits(k, a, Instruction::And, !(1 << 63)),
            Op::Exponent(a) => {
                // Puts the exponent into the low bits of a number of at least 2^52. Then a subtraction removes the 2^52 and the bias.
                let (to, from) = self.unary(k, a);
                self.assembler.shift(true, to, from, 1);
                self.assembler.shift(false, to, to, 53);
                let or = self.assembler.constant(WHOLE.to_bits());
                self.assembler.arithmetic(Instruction::Or, to, to, Operand::Memory(or));
                let bias = self.assembler.constant((WHOLE + BIAS).to_bits());
                self.assembler.arithmetic(Instruction::Subtract, to, to, Operand::Memory(bias));
                self.finish(k, to);
            }
            Op::PowerOfTwo(a) => {
                let (to, from) = self.unary(k, a);
                let biased = self.assembler.constant((1.5 * WHOLE + BIAS).to_bits());
                self.assembler.arithmetic(Instruction::Add, to, from, Operand::Memory(biased));
                self.assembler.shift(true, to, to, 52);
                self.finish(k, to);
            }
            Op::Add(a, b) => self.binary(k, a, b, Instruction::Add),
            Op::Subtract(a, b) => self.binary(k, a, b, Instruction::Subtract),
            Op::Multiply(a, b) => self.binary(k, a, b, Instruction::Multiply),
            Op::Divide(a, b) => self.binary(k, a, b, Instruction::Divide),
            // No operation reads it.
            Op::Less(..) if !self.registers.is_read(k) && !self.results.contains_key(&k) => {}
            Op::Less(a, b) => {
                let (to, a, b) = self.operands(k, a, b);
                let prefix = if self.assembler.wide { 1 } else { 3 };
                self.assembler.vex(1, prefix, 0xc2, to, a, b);
                self.assembler.code.push(0x11); // less, ordered, quiet
                self.finish(k, to);
            }
            Op::Select { condition, then, otherwise } => {
                let keep = [condition.0, then.0, otherwise.0];
                let mask = self.registers.load(condition.0, &keep);
                let otherwise_in = self.registers.load(otherwise.0, &keep);
                let then_in = self.registers.load(then.0, &keep);
                self.moves();
                keep.iter().for_each(|value| self.registers.read(*value, k));
                let to = self.registers.take(k, &keep);
                self.moves();
                self.assembler.vex(3, 1, 0x4b, to, otherwise_in, Operand::Register(then_in));
                self.assembler.code.push(mask << 4);
                self.finish(k, to);
            }
        }
    }

    fn moves(&mut self) {
        for step in std::mem::take(&mut self.registers.moves) {
            match step {
                Move::Store(register, place) => self.assembler.store(register, Memory::Spilled(place)),
                Move::Load(register, memory) => self.assembler.load(register, memory),
            }
        }
    }

    /// The register of a new value and that of its operand.
    fn unary(&mut self, k: u32, a: Reg) -> (u8, u8) {
        let from = self.registers.load(a.0, &[a.0]);
        self.moves();
        self.registers.read(a.0, k);
        let to = self.registers.take(k, &[a.0]);
        self.moves();
        (to, from)
    }

    fn with_bits(&mut self, k: u32, a: Reg, instruction: Instruction, bits: u64) {
        let (to, from) = self.unary(k, a);
        let memory = self.assembler.constant(bits);
        self.assembler.arithmetic(instruction, to, from, Operand::Memory(memory));
        self.finish(k, to);
    }

    /// The register of a new value, the register of its first operand, and its second operand.
    fn operands(&mut self, k: u32, a: Reg, b: Reg) -> (u8, u8, Operand) {
        let keep = [a.0, b.0];
        let first = self.registers.load(a.0, &keep);
        let second = match (self.registers.register(b.0), self.registers.memory(b.0)) {
            (None, Some(memory)) => Operand::Memory(memory),
            _ => Operand::Register(self.registers.load(b.0, &keep)),
        };
        self.moves();
        keep.iter().for_each(|value| self.registers.read(*value, k));
        let to = self.registers.take(k, &keep);
        self.moves();
        (to, first, second)
    }

    fn binary(&mut self, k: u32, a: Reg, b: Reg, instruction: Instruction) {
        // The order may change which of two NaNs is the result, but no other bit. The first operand is in a register: if none of them is, the one
        // that is needed again first is loaded, and the other one is read from memory.
        let commutes = matches!(instruction, Instruction::Add | Instruction::Multiply);
        let is_sooner = || self.registers.reader_after(b.0, k) < self.registers.reader_after(a.0, k);
        let swaps =
            commutes && self.registers.register(a.0).is_none() && (self.registers.register(b.0).is_some() || is_sooner());
        let (a, b) = if swaps { (b, a) } else { (a, b) };
        let (to, a, b) = self.operands(k, a, b);
        self.assembler.arithmetic(instruction, to, a, b);
        self.finish(k, to);
    }

    /// Stores a result, and releases a value that no later operation reads.
    fn finish(&mut self, k: u32, register: u8) {
        if let Some(slots) = self.results.get(&k) {
            for slot in slots.clone() {
                self.assembler.store(register, Memory::Slot(slot));
                self.registers.set_memory(k, Memory::Slot(slot));
            }
        }
        if !self.registers.is_read(k) {
            self.registers.read(k, k);
        }
    }

    /// A result that is a constant or an argument.
    fn copied(&mut self, k: u32) {
        let Some(slots) = self.results.get(&k).cloned() else { return };
        let register = self.registers.load(k, &[k]);
        self.moves();
        slots.iter().for_each(|slot| self.assembler.store(register, Memory::Slot(*slot)));
        if !self.registers.is_read(k) {
            self.registers.read(k, k);
        }
    }
}

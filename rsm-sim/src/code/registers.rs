//! The assignment of values to machine registers, for a sequence of operations without branches.
//!
//! In: for each value, the operations that read it. Out: places, requested one operation at a time. If no register is free, the value whose next use
//! is latest is moved to memory (L. A. Belady, "A study of replacement algorithms", 1966).

use super::Slot;

/// The number of registers of the machine.
const COUNT: usize = 16;

/// A number in memory: in a slot, a constant, a spilled value, or a number of the other array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Memory {
    Slot(Slot),
    Constant(u32),
    Spilled(u32),
    Number(u32),
}

/// A move that must be executed before a value can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Move {
    Store(u8, u32),
    Load(u8, Memory),
}

#[derive(Debug, Clone, Default)]
struct Value {
    register: Option<u8>,
    memory: Option<Memory>,
    /// Operations that read it, in reverse order: the next one is the last entry.
    readers: Vec<u32>,
}

/// The places of all values.
pub(super) struct Registers {
    values: Vec<Value>,
    held: [Option<u32>; COUNT],
    /// Places for spilled values: their number, the free ones, and those that the current operation still reads.
    spills: u32,
    spare: Vec<u32>,
    left: Vec<u32>,
    pub moves: Vec<Move>,
}

impl Registers {
    /// `readers`: for each value, the operations that read it, in order.
    pub(super) fn new(readers: Vec<Vec<u32>>) -> Self {
        let values = readers.into_iter().map(|mut readers| {
            readers.reverse();
            Value { readers, ..Value::default() }
        });
        Registers {
            values: values.collect(),
            held: [None; COUNT],
            spills: 0,
            spare: Vec::new(),
            left: Vec::new(),
            moves: Vec::new(),
        }
    }

    /// The number of places for spilled values.
    pub(super) fn spills(&self) -> usize {
        self.spills as usize
    }

    /// Must be called before each operation.
    pub(super) fn begin(&mut self) {
        self.spare.append(&mut self.left);
    }

    /// Sets the place of a value in memory.
    pub(super) fn set_memory(&mut self, value: u32, memory: Memory) {
        self.values[value as usize].memory = Some(memory);
    }

    pub(super) fn register(&self, value: u32) -> Option<u8> {
        self.values[value as usize].register
    }

    pub(super) fn memory(&self, value: u32) -> Option<Memory> {
        self.values[value as usize].memory
    }

    pub(super) fn is_read(&self, value: u32) -> bool {
        !self.values[value as usize].readers.is_empty()
    }

    /// The next operation after this one that reads a value; the largest number if there is none.
    pub(super) fn reader_after(&self, value: u32, operation: u32) -> u32 {
        self.values[value as usize].readers.iter().rev().copied().find(|it| *it > operation).unwrap_or(u32::MAX)
    }

    /// Returns a register with the value. Loading it does not displace the values in `keep`.
    pub(super) fn load(&mut self, value: u32, keep: &[u32]) -> u8 {
        if let Some(register) = self.values[value as usize].register {
            return register;
        }
        let memory = self.values[value as usize].memory.expect("a value is in a register or in memory");
        let register = self.free(keep);
        self.moves.push(Move::Load(register, memory));
        self.put(value, register);
        register
    }

    /// Records that an operation has read a value.
    pub(super) fn read(&mut self, value: u32, operation: u32) {
        let found = &mut self.values[value as usize];
        while found.readers.last().is_some_and(|next| *next <= operation) {
            found.readers.pop();
        }
        if found.readers.is_empty() {
            if let Some(register) = found.register.take() {
                self.held[register as usize] = None;
            }
            if let Some(Memory::Spilled(place)) = found.memory
                && !self.left.contains(&place)
            {
                self.left.push(place);
            }
        }
    }

    /// A register for a new value.
    pub(super) fn take(&mut self, value: u32, keep: &[u32]) -> u8 {
        let register = self.free(keep);
        self.put(value, register);
        register
    }

    /// Returns a free register, and spills a value if there is none.
    fn free(&mut self, keep: &[u32]) -> u8 {
        if let Some(free) = self.held.iter().position(Option::is_none) {
            return free as u8;
        }
        let next = |value: u32| self.values[value as usize].readers.last().copied().unwrap_or(u32::MAX);
        let is_kept = |value: &u32| keep.contains(value);
        // If several values have the same next use, the first register is chosen, so the choice is the same in every run.
        let (register, value) = (0..COUNT)
            .filter_map(|register| self.held[register].map(|value| (register, value)))
            .filter(|(_, value)| !is_kept(value))
            .max_by_key(|(register, value)| (next(*value), std::cmp::Reverse(*register)))
            .expect("an operation has three operands at most");
        if self.values[value as usize].memory.is_none() {
            let place = self.spare.pop().unwrap_or_else(|| {
                self.spills += 1;
                self.spills - 1
            });
            self.moves.push(Move::Store(register as u8, place));
            self.values[value as usize].memory = Some(Memory::Spilled(place));
        }
        self.values[value as usize].register = None;
        self.held[register] = None;
        register as u8
    }

    fn put(&mut self, value: u32, register: u8) {
        self.held[register as usize] = Some(value);
        self.values[value as usize].register = Some(register);
    }
}

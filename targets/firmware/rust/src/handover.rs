//! Passes values between two interrupts of one processor, always as a consistent set: `../../handover.h` in Rust.
//!
//! In: a value, from one writer. Out: the newest complete value, for one reader. There are two slots, and an index that is written last. Never waits
//! and never masks interrupts.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicUsize, Ordering};

/// Two slots and the index of the newest one.
#[derive(Debug)]
pub struct Handover<T> {
    slots: [UnsafeCell<T>; 2],
    newest: AtomicUsize,
}

// SAFETY: the callers of `put` and `take` ensure that there is one of each, and that no two `put` begin during one `take`. So no slot is written
// while it is read.
unsafe impl<T: Copy + Send> Sync for Handover<T> {}

impl<T: Copy> Handover<T> {
    /// Both slots hold `value`.
    pub const fn new(value: T) -> Self {
        Handover { slots: [UnsafeCell::new(value), UnsafeCell::new(value)], newest: AtomicUsize::new(0) }
    }

    /// Makes `value` the newest one.
    ///
    /// # Safety
    /// There is one writer, and it does not begin twice during one reading.
    pub unsafe fn put(&self, value: T) {
        let next = self.newest.load(Ordering::Relaxed) ^ 1;
        // SAFETY: the index is that of the other slot, so the reader uses that one.
        unsafe { *self.slots[next & 1].get() = value };
        self.newest.store(next, Ordering::Release);
    }

    /// The newest value.
    ///
    /// # Safety
    /// There is one reader, and the writer does not begin twice during one reading.
    pub unsafe fn take(&self) -> T {
        let newest = self.newest.load(Ordering::Acquire);
        // SAFETY: the writer writes the other slot, and changes the index only after that.
        unsafe { *self.slots[newest & 1].get() }
    }
}

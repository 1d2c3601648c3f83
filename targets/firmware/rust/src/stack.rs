//! Bytes of stack that a call takes: the stack below is painted before the call, and searched for the lowest word without paint after it.

use core::arch::asm;
use core::ptr::read_volatile;

/// The content of the words below the stack pointer before the call.
const PAINT: u32 = 0xA5A5_A5A5;

/// The number of painted words. The largest call uses a seventh of them.
const WORDS: u32 = 1024;

/// Paints the words below the stack pointer. Returns the stack pointer.
///
/// All functions of this file are inlined. A function that is not inlined has a frame of its own, and the words below its frame are not those below
/// the caller's frame.
#[inline(always)]
#[must_use]
pub fn paint() -> usize {
    let top: usize;
    // SAFETY: the memory below the stack pointer is unused, and the stack has space for this many words.
    unsafe {
        asm!("mov {top}, sp", "mov {at}, sp", "2:", "str {paint}, [{at}, #-4]!", "subs {left}, {left}, #1", "bne 2b",
            top = out(reg) top, at = out(reg) _, left = inout(reg) WORDS => _, paint = in(reg) PAINT);
    }
    top
}

/// Bytes from the stack pointer that `paint` returned, down to the lowest word without paint.
#[inline(always)]
#[must_use]
pub fn used(top: usize) -> u32 {
    let mut left = WORDS;
    // SAFETY: these are the words that were painted.
    while left > 0 && unsafe { read_volatile((top - 4 * left as usize) as *const u32) } == PAINT {
        left -= 1;
    }
    4 * left
}

/// Bytes of stack of a call, below the caller's own frame.
#[inline(always)]
pub fn used_by(call: impl FnOnce()) -> u32 {
    let top = paint();
    call();
    used(top)
}

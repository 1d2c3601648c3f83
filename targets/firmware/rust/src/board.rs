//! Registers of the emulated board MPS2 with image AN386: `../../qemu/an386.h` in Rust, with its sources.

use core::ptr::{read_volatile, write_volatile};

/// Numbers of the timers' interrupts.
pub const TIMERS: [i16; 2] = [8, 9];

/// Ticks of a timer in a second.
pub const TICKS_A_SECOND: u32 = 25_000_000;

const TIMER: [usize; 2] = [0x4000_0000, 0x4000_1000];
const WATCHDOG: usize = 0x4000_8000;
const NVIC_ENABLE: usize = 0xE000_E100;
const NVIC_PRIORITY: usize = 0xE000_E400;
const FPCCR: usize = 0xE000_EF34;

fn write(address: usize, value: u32) {
    // SAFETY: the addresses in this file are registers of the board, 32 bits wide.
    unsafe { write_volatile(address as *mut u32, value) }
}

fn read(address: usize) -> u32 {
    // SAFETY: as above.
    unsafe { read_volatile(address as *const u32) }
}

/// Starts a timer whose interrupt has this priority (a smaller number is more urgent): the first time after `first` ticks, then every `ticks`.
pub fn start_timer(timer: usize, priority: u8, first: u32, ticks: u32) {
    let (base, number) = (TIMER[timer], TIMERS[timer]);
    write(base, 0);
    write(base + 8, ticks - 1);
    write(base + 4, first);
    write(base + 12, 1);
    // SAFETY: the register of the priority is a byte.
    unsafe { write_volatile((NVIC_PRIORITY + number as usize) as *mut u8, priority) };
    write(NVIC_ENABLE, 1 << number);
    write(base, 0b1001);
}

/// Stops a timer.
pub fn stop_timer(timer: usize) {
    write(TIMER[timer], 0);
}

/// Clears the timer's interrupt request.
pub fn clear_timer(timer: usize) {
    write(TIMER[timer] + 12, 1);
}

/// Whether the timer has a new interrupt request.
pub fn asks_again(timer: usize) -> bool {
    read(TIMER[timer] + 12) & 1 != 0
}

/// Ticks since `start_timer(timer, .., u32::MAX, u32::MAX)`.
pub fn elapsed(timer: usize) -> u32 {
    u32::MAX - read(TIMER[timer] + 4)
}

/// Starts a timer that only counts.
pub fn count_from_now(timer: usize) {
    write(TIMER[timer], 0);
    write(TIMER[timer] + 8, u32::MAX);
    write(TIMER[timer] + 4, u32::MAX);
    write(TIMER[timer], 1);
}

/// Starts the watchdog. Without a feed the first alarm comes after this many ticks, and the reset after the same time again.
pub fn start_watchdog(ticks: u32) {
    unlocked(|| {
        write(WATCHDOG, ticks);
        write(WATCHDOG + 8, 0b11);
    });
}

/// Restarts the count.
pub fn feed_watchdog() {
    unlocked(|| write(WATCHDOG + 0xC, 1));
}

/// Stops the watchdog: the run has ended.
pub fn stop_watchdog() {
    unlocked(|| write(WATCHDOG + 8, 0));
}

fn unlocked(change: impl Fn()) {
    write(WATCHDOG + 0xC00, 0x1ACC_E551);
    change();
    write(WATCHDOG + 0xC00, 0);
}

/// Floating-point context control.
pub fn fpccr() -> u32 {
    read(FPCCR)
}

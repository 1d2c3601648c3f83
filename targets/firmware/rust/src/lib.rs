//! The firmware in Rust: both loops as interrupts, like `../image.c` in C, and the registers of the emulated board.
//!
//! - [`handover`]: values between two interrupts, always consistent.
//! - [`image`]: the functions of the interrupts.
//! - [`board`]: registers of the emulated board MPS2 with image AN386.
//! - [`nominal`]: the motor and its drive.
//! - [`own`]: statics that one context owns.
//! - [`stack`]: bytes of stack that a call takes.
//!
//! `src/bin/board.rs` is the processor in the loop; `src/bin/count.rs` counts instructions; `src/bin/interrupted.rs` interrupts at every one;
//! `src/bin/hangs.rs` hangs, and is reset by the watchdog.
#![no_std]

pub mod board;
pub mod handover;
pub mod image;
pub mod nominal;
pub mod own;
pub mod stack;

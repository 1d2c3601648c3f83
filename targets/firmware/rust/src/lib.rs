//! The firmware in Rust: both loops as interrupts, as `../image.c` has them in C, and what the emulated board gives.
//!
//! - [`handover`]: values between two interrupts, without tearing.
//! - [`image`]: what the interrupts do.
//! - [`board`]: registers of the emulated board MPS2 with image AN386.
//! - [`nominal`]: the motor and its drive.
//!
//! `src/bin/board.rs` is the processor in the loop; `src/bin/count.rs` counts instructions.
#![no_std]

pub mod board;
pub mod handover;
pub mod image;
pub mod nominal;

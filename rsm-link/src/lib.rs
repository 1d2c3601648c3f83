//! The loops of both cases between processes and hosts.
//!
//! In: which side of which loop runs here, and where the other one is. Out: the table of what happened, a row a millisecond, and what became of the
//! link. Two ways:
//!
//! - [`federate`]: lock-step on HELICS. Simulated time advances when all sides are ready, so a run gives the same bits as one process.
//!   It is not real-time.
//! - [`stream`]: UDP datagrams in real time, for hardware in the loop. No side waits: values that arrive too late are missing, and are counted.
//!
//! ```text
//!   loops      the sides as functions: plant (sample -> command -> sample ...), step (sample -> command)
//!   federate   loops on helics                      scenario   roles, processes and hosts, as a file
//!   stream     loops on wire + play_out + UDP
//! ```
//!
//! This crate has no plant and no control step of its own: it calls the functions of the one-process simulation. It does not print or write files.

// What is public is what the command needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod federate;
pub mod helics;
pub mod loops;
mod peers;
pub mod play_out;
pub mod scenario;
pub mod stream;
pub mod wire;

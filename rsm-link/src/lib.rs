//! The loops of both cases between processes and hosts.
//!
//! In: which side of which loop runs here, and where the other one is. Out: the table of what happened, a row a millisecond, and what became of the link. Two ways:
//!
//! - [`federate`]: lock-step on HELICS. Time goes on when all sides are ready, so a run has the bits of one process, and takes as long as it takes.
//! - [`stream`]: UDP datagrams by the wall clock, as hardware in the loop wants it. Nobody waits: what does not come in time is missing, and is counted.
//!
//! ```text
//!   loops      the sides as functions: plant (sample -> command -> sample ...), step (sample -> command)
//!   federate   loops on helics                      scenario   who runs where, as a file
//!   stream     loops on wire + play_out + UDP
//! ```
//!
//! No mathematics of a plant or a step stands here: both ways call what the one-process simulation calls. Nothing here prints or writes files.

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

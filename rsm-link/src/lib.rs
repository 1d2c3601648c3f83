//! Runs the sides of both control loops in separate processes, on one host or several.
//!
//! In: the sides that run here, and the address of the other side. Out: a table with one row for each millisecond, and the state of the connection.
//! There are two ways:
//!
//! - [`federate`]: lock-step on HELICS. Simulated time advances when all sides are ready, so a run gives the same bits as one process. It is not
//!   real-time.
//! - [`stream`]: UDP datagrams in real time, for hardware in the loop. No side waits: values that arrive too late are missing and are counted.
//!
//! ```text
//!   loops      the sides as functions: plant (sample -> command -> sample ...), step (sample -> command)
//!   federate   loops on helics                      scenario   roles, processes and hosts, as a file
//!   stream     loops on wire + play_out + UDP
//! ```
//!
//! This crate has no plant and no control step of its own: it calls the functions of the one-process simulation. It does not print or write files.

// Only what the command uses is public.
#![cfg_attr(not(test), warn(unreachable_pub))]

pub mod federate;
pub mod helics;
pub mod loops;
mod peers;
pub mod play_out;
pub mod scenario;
pub mod stream;
pub mod wire;

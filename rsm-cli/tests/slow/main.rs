//! The tests of the command that take minutes: the demonstration, pages in a browser, loops between processes. `cargo xtask test` runs them, and
//! `cargo test -p rsm-cli --test slow`; `cargo test -p rsm-cli` leaves them out.

#[path = "../all/calls.rs"]
mod calls;
mod demo;
mod federation;
#[path = "../all/libhelics.rs"]
mod libhelics;
mod pages;
mod ports;
#[path = "../../../tests/src/skipped.rs"]
mod skipped;

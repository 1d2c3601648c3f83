//! The command rsm.

fn main() {}

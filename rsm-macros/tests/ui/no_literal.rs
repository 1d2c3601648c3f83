//! A name in place of a path.

rsm_macros::include_model!(two_inputs);

fn main() {}

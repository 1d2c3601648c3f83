//! A precision that there is not: the error stands under it.

rsm_macros::include_model!("models/two_inputs.toml", precision = "f16");

fn main() {}

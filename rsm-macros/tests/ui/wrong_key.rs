//! An option that there is not.

rsm_macros::include_model!("models/two_inputs.toml", accuracy = "f32");

fn main() {}

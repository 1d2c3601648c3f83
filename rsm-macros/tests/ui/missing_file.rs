//! A file that is not there.

rsm_macros::include_model!("models/nowhere.toml");

fn main() {}

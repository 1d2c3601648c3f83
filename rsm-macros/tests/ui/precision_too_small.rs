//! A model that the wanted precision cannot hold.

rsm_macros::include_model!("models/too_large.toml", precision = "f32");

fn main() {}

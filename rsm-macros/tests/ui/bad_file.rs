//! A file with several faults: all of them under the path, with the file's lines and columns.

rsm_macros::include_model!("models/three_faults.toml");

fn main() {}

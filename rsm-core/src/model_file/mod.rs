//! The model file: TOML text to a model and back, bit for bit.

mod read;
mod write;

pub use read::{
    Basis, HIGHEST_ORDER, HIGHEST_POWER, Located, MOST_CELLS, read, read_basis, read_cells, read_degree, read_format,
    read_transform,
};
pub use write::{quoted, write};

/// The format number that this version reads and writes.
pub const FORMAT: i64 = 1;

//! The tests that cross crates, in one binary.

mod bit_for_bit;

//! The tests of rsm-core, one binary.

mod compensator;
mod exact_products;
mod lowering;
mod rejected;
mod saturation;

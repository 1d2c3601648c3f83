//! The tests of rsm-core, one binary.

mod compensator;
mod emitted;
mod exact_products;
mod family;
mod lowering;
mod rejected;
mod saturation;

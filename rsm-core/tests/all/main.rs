//! The tests of rsm-core, one binary.

mod compensator;
mod elementary;
mod emitted;
mod exact_products;
mod family;
mod gradient;
mod lowering;
mod operations;
mod random;
mod recursive;
#[path = "../../../tests/src/refused.rs"]
mod refused;
mod rejected;
mod saturation;
mod spline;
mod transform;

//! The tests that cross crates, in one binary.

mod bit_for_bit;
mod book;
mod cycles;
mod documents;
mod effects;
mod effects_as_files;
mod elementary;
mod firmware;
mod gradients;
mod inlined;
mod layers;
mod library;
mod lowering;
mod manifests;
mod measured;
mod measured_motor;
mod names;
mod object_code;
mod plants_as_code;
mod recursive;
mod reference_step;
mod refuses;
mod stale;
mod warnings;

//! Tests of the fitter through its public interface, in one binary: each additional one would link everything again.

mod analysis;
mod autoregressive;
mod categories;
mod constrained;
mod constraint_family;
mod constraints;
mod data;
mod evaluation;
mod folders;
mod forms;
mod hinges;
mod honest;
mod in_memory;
mod ladder;
mod large;
mod missing;
mod nist;
mod optimal;
mod optimise;
mod partial;
mod plans;
mod real;
mod recursive;
#[path = "../../../tests/src/refused.rs"]
mod refused;
mod rejected;
mod robust;
mod selection;
mod serial;
mod splines;
mod splits;
mod support;
mod textbook;
mod transforms;
mod truth;
mod weights;

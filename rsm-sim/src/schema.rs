//! The nominal parameters of each plant (docs/book/src/reference/plants.md, section 2): name, unit and physical bounds.
//!
//! In: a kind. Out: lists for the reader, the writer and `parameter-error`. This file contains no value of a parameter.

use crate::kind::PlantKind;

pub use crate::quantity::{Bound, Nominal};

/// The parameters of a plant, in the order of docs/book/src/reference/plants.md. The choice of the velocity is separate.
#[must_use]
pub fn parameters(kind: PlantKind) -> &'static [Nominal] {
    &kind.0.parameters
}

/// The array and the index, from 1, of a parameter that is an element of an array: `gear_ratios[3]`.
#[must_use]
pub fn element(name: &str) -> Option<(&str, usize)> {
    let (array, place) = name.strip_suffix(']')?.split_once('[')?;
    Some((array, place.parse().ok()?))
}

/// The index of a parameter in [`parameters`].
#[must_use]
pub fn index(kind: PlantKind, name: &str) -> Option<usize> {
    parameters(kind).iter().position(|nominal| nominal.name == name)
}

//! The nominal parameters of each plant (docs/book/src/reference/plants.md, section 2): name, unit and physical bounds.
//!
//! In: nothing. Out: tables for the reader, the writer and `parameter-error`. This file contains no value of a parameter.

use crate::kind::PlantKind;

pub use crate::quantity::{Bound, Nominal};

const fn of(name: &'static str, unit: &'static str, bound: Bound) -> Nominal {
    Nominal { name, unit, bound, optional: false }
}

const fn optional(name: &'static str, unit: &'static str, bound: Bound) -> Nominal {
    Nominal { name, unit, bound, optional: true }
}

use Bound::{NotNegative, Positive};

const SERVO_AXIS: &[Nominal] = &[
    of("mass", "kg", Positive),
    of("force_gain", "N/V", Positive),
    of("viscous_friction", "N*s/m", NotNegative),
    of("command_limit", "V", Positive),
    optional("position_gain", "1/s", Positive),
    optional("velocity_gain", "V*s/m", Positive),
];

/// The parameters of a plant, in the order of docs/book/src/reference/plants.md. The choice of the velocity is separate.
#[must_use]
pub fn parameters(kind: PlantKind) -> &'static [Nominal] {
    match kind {
        PlantKind::ServoAxis => SERVO_AXIS,
        PlantKind::Equations(it) => &it.parameters,
    }
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

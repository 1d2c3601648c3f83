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

use Bound::{Any, Between, NotNegative, Positive};

const DRIVELINE: &[Nominal] = &[
    of("engine_inertia", "kg*m^2", Positive),
    of("transmission_inertia", "kg*m^2", Positive),
    of("final_drive_inertia", "kg*m^2", NotNegative),
    of("wheel_inertia", "kg*m^2", Positive),
    of("mass", "kg", Positive),
    of("wheel_radius", "m", Positive),
    of("final_drive_ratio", "1", Positive),
    of("clutch_stiffness", "N*m/rad", Positive),
    of("clutch_damping", "N*m*s/rad", NotNegative),
    of("driveshaft_stiffness", "N*m/rad", Positive),
    of("driveshaft_damping", "N*m*s/rad", NotNegative),
    of("transmission_damping", "N*m*s/rad", NotNegative),
    of("final_drive_damping", "N*m*s/rad", NotNegative),
    of("wheel_damping", "N*m*s/rad", NotNegative),
    of("rolling_resistance_1", "m/s^2", NotNegative),
    of("rolling_resistance_2", "m/s", NotNegative),
    of("drag_area", "m^2", NotNegative),
    of("air_density", "kg/m^3", NotNegative),
    // A slope steeper than vertical is not possible.
    of("grade", "rad", Between(-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2)),
    of("torque_0", "N*m", Any),
    of("torque_1", "N*m*s", Any),
    of("torque_2", "N*m*s^2", Any),
    of("torque_lag", "s", Positive),
    of("engine_friction_0", "N*m", NotNegative),
    of("engine_friction_1", "N*m*s", NotNegative),
];

const SERVO_AXIS: &[Nominal] = &[
    of("mass", "kg", Positive),
    of("force_gain", "N/V", Positive),
    of("viscous_friction", "N*s/m", NotNegative),
    of("command_limit", "V", Positive),
    optional("position_gain", "1/s", Positive),
    optional("velocity_gain", "V*s/m", Positive),
];

/// The entries of a driveline's array `gear_ratios`, numbered from 1, like the column `gear` of a record.
const GEAR_RATIOS: &[Nominal] = &[
    of("gear_ratios[1]", "1", Positive),
    of("gear_ratios[2]", "1", Positive),
    of("gear_ratios[3]", "1", Positive),
    of("gear_ratios[4]", "1", Positive),
    of("gear_ratios[5]", "1", Positive),
];

/// The parameters of a plant, in the order of docs/book/src/reference/plants.md. The gear ratios and the choice of the velocity are separate.
#[must_use]
pub fn parameters(kind: PlantKind) -> &'static [Nominal] {
    match kind {
        PlantKind::Driveline => DRIVELINE,
        PlantKind::ServoAxis => SERVO_AXIS,
        PlantKind::Equations(it) => &it.parameters,
    }
}

/// The entries of the array of gear ratios, first gear first; none for a plant without gears.
#[must_use]
pub fn gear_ratios(kind: PlantKind) -> &'static [Nominal] {
    if kind == PlantKind::Driveline { GEAR_RATIOS } else { &[] }
}

/// All names that a `parameter-error` can use: the parameters of a plant, and each of its gear ratios.
pub fn named(kind: PlantKind) -> impl Iterator<Item = &'static Nominal> {
    parameters(kind).iter().chain(gear_ratios(kind))
}

/// The index of a gear ratio in its array, from 0, by its name in a `parameter-error`.
#[must_use]
pub fn gear(kind: PlantKind, name: &str) -> Option<usize> {
    gear_ratios(kind).iter().position(|nominal| nominal.name == name)
}

/// The index of a parameter in [`parameters`].
#[must_use]
pub fn index(kind: PlantKind, name: &str) -> Option<usize> {
    parameters(kind).iter().position(|nominal| nominal.name == name)
}

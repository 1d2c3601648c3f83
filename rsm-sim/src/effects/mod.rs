//! The catalogue of effects (docs/book/src/reference/plants.md, section 3): one file for each effect, and a list of all.
//!
//! In: nothing. Out: descriptions, in the order of docs/book/src/reference/plants.md. A test compares the list with the files of this folder and with
//! the table of docs/book/src/reference/plants.md. It contains descriptions only, no effect with arguments.

pub mod angle_eccentricity;
pub mod angle_offset;
pub mod asymmetric_friction;
pub mod backlash;
pub mod brake_drag;
pub mod clutch_slip;
pub mod clutch_stiffening;
pub mod cogging_torque;
pub mod combustion_ripple;
pub mod constant_load;
pub mod coulomb_friction;
pub mod headwind;
pub mod input_delay;
pub mod input_gain;
pub mod inverter_dead_time;
pub mod load_drift;
pub mod magnetic_saturation;
pub mod parameter_error;
pub mod resistance_heating;
pub mod road_grade;
pub mod sensor_bias;
pub mod sensor_delay;
pub mod sensor_drift;
pub mod sensor_gain;
pub mod sensor_lag;
pub mod sensor_quantisation;
pub mod shaft_compliance;
pub mod stribeck_friction;
pub mod throttle_nonlinearity;
pub mod torque_ripple;
pub mod tyre_slip;
pub mod voltage_limit;
pub mod windage;

use crate::effect::{Description, Role};

/// All effects.
pub const ALL: &[&Description] = &[
    &parameter_error::DESCRIPTION,
    &coulomb_friction::DESCRIPTION,
    &asymmetric_friction::DESCRIPTION,
    &stribeck_friction::DESCRIPTION,
    &windage::DESCRIPTION,
    &constant_load::DESCRIPTION,
    &load_drift::DESCRIPTION,
    &cogging_torque::DESCRIPTION,
    &torque_ripple::DESCRIPTION,
    &magnetic_saturation::DESCRIPTION,
    &resistance_heating::DESCRIPTION,
    &inverter_dead_time::DESCRIPTION,
    &voltage_limit::DESCRIPTION,
    &angle_offset::DESCRIPTION,
    &angle_eccentricity::DESCRIPTION,
    &input_delay::DESCRIPTION,
    &input_gain::DESCRIPTION,
    &sensor_gain::DESCRIPTION,
    &sensor_bias::DESCRIPTION,
    &sensor_quantisation::DESCRIPTION,
    &sensor_drift::DESCRIPTION,
    &sensor_lag::DESCRIPTION,
    &sensor_delay::DESCRIPTION,
    &shaft_compliance::DESCRIPTION,
    &backlash::DESCRIPTION,
    &clutch_stiffening::DESCRIPTION,
    &clutch_slip::DESCRIPTION,
    &tyre_slip::DESCRIPTION,
    &road_grade::DESCRIPTION,
    &headwind::DESCRIPTION,
    &brake_drag::DESCRIPTION,
    &throttle_nonlinearity::DESCRIPTION,
    &combustion_ripple::DESCRIPTION,
];

/// The effect with this kind.
#[must_use]
pub fn of(kind: &str) -> Option<&'static Description> {
    ALL.iter().copied().find(|description| description.kind == kind)
}

/// The first effect with this role.
#[must_use]
pub fn with(role: Role) -> Option<&'static Description> {
    ALL.iter().copied().find(|description| description.declared.role == role)
}

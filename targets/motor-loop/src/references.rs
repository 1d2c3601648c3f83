//! The outer step, 1 kHz: from a torque demand to current references.
//!
//! In: torque demand, measured speed and bus voltage. Out: i_d, i_q and the voltage that the windings' resistance takes of them. The weakening current comes
//! from the response surface `weakening_current`, which stands in for the solution of the circle diagram; i_q is the demand over k_t, within what the
//! current circle leaves at the voltage limit, by the surface `limit_current`. Never controls currents: at 7500 rpm with 4 pole pairs a millisecond is half an electrical turn.

use branch_free::{BadSamples, magnitude, nothing, select, within};

use crate::circle::{LONGEST_LEG, other_leg};
use crate::drive::Drive;
use crate::motor;

/// One tick's measurements and demand.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Demand {
    /// Torque demand, in N m. Negative brakes a motor that turns forward.
    pub torque_nm: f32,
    /// Rotor speed, in mechanical rad/s. Negative turns backwards.
    pub speed_rad_s: f32,
    /// Voltage of the bus, in V.
    pub bus_voltage_v: f32,
}

/// What the inner step is to do.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct References {
    /// i_d, in A: never positive, it weakens the magnets' flux.
    pub i_d_a: f32,
    /// i_q, in A, with the sign of the torque demand.
    pub i_q_a: f32,
    /// r i_d, in V: fed forward, so that the integral part of the control need not wait for an error.
    pub resistive_d_v: f32,
    /// r i_q, in V.
    pub resistive_q_v: f32,
}

/// What the outer step remembers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceState {
    /// Those of the last good tick; no current before the first.
    pub last: References,
    /// Bad samples up to now.
    pub bad: BadSamples,
}

/// One tick. A sample that is not a number, or a bus without voltage, gives the references of the last good tick again, and is counted; how many are
/// too many is for the caller to say. `inline(never)` so that its object code stands under one name, where a test reads it.
///
/// The voltage circle (20) has the radius V/w_e: what a lower bus takes, a higher speed would take too. So the surfaces, measured at the
/// nominal bus voltage, are asked at the speed that has the circle of this bus.
#[inline(never)]
pub fn references(state: &mut ReferenceState, drive: &Drive, demand: &Demand) -> References {
    let Demand { torque_nm, speed_rad_s, bus_voltage_v } = *demand;
    let circle_speed = magnitude(speed_rad_s) * (drive.nominal_bus_v / bus_voltage_v);
    // The surfaces are of a motor that turns forwards; backwards is the same in a mirror. Torque against the speed brakes, and needs less weakening, since the
    // resistive drop helps: so it keeps its sign.
    let mirror = select(speed_rad_s, 0.0, -1.0, 1.0);
    let forwards = mirror * torque_nm;
    let limit = drive.current_limit_a;
    let most_weakening = LONGEST_LEG * limit;
    // What weakening a vector as long as the limit needs leaves this much for torque. The torque moves it by the resistive drop only, so that of the last
    // tick does: the demand may be far beyond what there is, and would ask for too much weakening.
    let last_nm = drive.newton_metres_per_ampere * (mirror * state.last.i_q_a);
    let at_limit = within(motor::limit_current_f32(last_nm, limit, circle_speed), 0.0, most_weakening) * drive.per_ampere;
    let most = limit * other_leg(at_limit * at_limit);
    let wanted = within(forwards * drive.amperes_per_newton_metre, -most, most);
    let weakening = motor::weakening_current_f32(drive.newton_metres_per_ampere * wanted, circle_speed);
    let i_d_a = -within(weakening, 0.0, most_weakening);
    // Weakening comes first: without it the torque would not be there either.
    let share = i_d_a * drive.per_ampere;
    let most_q = limit * other_leg(share * share);
    let i_q_a = mirror * within(wanted, -most_q, most_q);
    let resistive_d_v = drive.resistance_ohm * i_d_a;
    let resistive_q_v = drive.resistance_ohm * i_q_a;

    // The bounds above would hide an infinity, and a bound that is NaN binds nothing: so the samples and the bound themselves are in the sum. It is
    // 0 or NaN, and below the voltage of a bus that has one.
    let sum = nothing(torque_nm) + nothing(speed_rad_s) + nothing(bus_voltage_v) + nothing(circle_speed);
    let sum = sum + nothing(resistive_d_v) + nothing(resistive_q_v) + nothing(most) + nothing(most_q);
    let keep = |new: f32, old: f32| select(sum, bus_voltage_v, new, old);
    let next = References {
        i_d_a: keep(i_d_a, state.last.i_d_a),
        i_q_a: keep(i_q_a, state.last.i_q_a),
        resistive_d_v: keep(resistive_d_v, state.last.resistive_d_v),
        resistive_q_v: keep(resistive_q_v, state.last.resistive_q_v),
    };
    state.bad.count(sum < bus_voltage_v);
    state.last = next;
    next
}

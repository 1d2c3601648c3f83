//! The outer step, 1 kHz: from a torque demand to current references.
//!
//! In: torque demand, measured speed and bus voltage, and how much of the voltage the inner step takes. Out: i_d, i_q. The weakening current comes
//! from the response surface `weakening_current`, which replaces the solution of the circle diagram. i_q is the demand over k_t, limited by the
//! current circle at the voltage limit, which the surface `limit_current` gives. Never controls currents: at 7500 rpm with 4 pole pairs a millisecond
//! is half an electrical turn.
//!
//! The voltage circle (20) has the radius V/w_e: a lower bus voltage has the same effect as a higher speed. The surfaces were measured at the nominal
//! bus voltage. So they are evaluated at the speed that has the voltage circle of the present bus voltage, the circle speed. This is exact except for
//! the resistive drop, 3 % of the voltage, which the surfaces contain at the nominal voltage; their margin covers it.
//!
//! Outside the surfaces' support there are no data, and a polynomial is not valid. There the torque is reduced (folded back), the surfaces are
//! evaluated at the edge, and the weakening current grows along a straight line with the steepest slope that an ideal motor needs there. The
//! remaining error, and effects that the surfaces do not contain (a hot magnet, a wrong inductance), appear in the voltage: while the inner step
//! requests nearly all of it, a trim increases the weakening current.

use branch_free::{BadSamples, at_least, at_most, magnitude, reached, select, within};

use crate::circle::other_leg;
use crate::drive::Drive;
use crate::motor;
use crate::plausible::judge;

/// The fastest circle speed at which the surface has support at every torque within the limit; a test checks the support.
pub const FOLD_SPEED_RAD_S: f32 = 780.0;

/// The slowest speed of the surfaces: below it, they are evaluated at this speed. Together with [`FOLD_SPEED_RAD_S`] and [`LARGEST_TORQUE_NM`] it
/// keeps every argument in its range, so that the surfaces need no clamp; a test compares them with the ranges of the model.
pub const SLOWEST_RAD_S: f32 = 440.0;

/// The largest torque of the surfaces, either way. The torque at the largest current is below it: see [`Drive::newton_metres_per_ampere`].
pub const LARGEST_TORQUE_NM: f32 = 21.6;

/// 1/(the circle speed beyond the edge at which the torque is zero): 780 rad/s beyond. At 1170 rad/s, which is 785 on a bus of 180 V, half of the
/// edge's torque is left, two thirds of that of an ideal motor.
pub const FOLD_PER_RAD_S: f32 = 1.0 / 780.0;

/// From this share of the reachable voltage, squared, the trim increases the weakening current. References are within 0.95 of the voltage, 0.90
/// squared; the surface's worst error of 1.8 A adds 0.06.
pub const TRIM_FROM: f32 = 0.96;

/// The largest share that is used: a change of the references needs more voltage for milliseconds, and this must not increase the weakening.
pub const TRIM_MOST: f32 = 1.2;

/// The change of the trim in a tick, in A. At top speed an ampere is 0.036 of the share, so the loop of the trim has a time constant of 5 ms there:
/// slow compared with the current control (0.7 ms), fast compared with a sagging bus voltage.
pub const TRIM_A: f32 = 5.5;

/// One tick's measurements and demand.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Demand {
    /// Torque demand, in N m. A negative demand brakes a motor that turns forwards.
    pub torque_nm: f32,
    /// Rotor speed, in mechanical rad/s. Negative: backwards.
    pub speed_rad_s: f32,
    /// Voltage of the bus, in V.
    pub bus_voltage_v: f32,
    /// The share of the voltage that the inner step requests ([`crate::CurrentState::voltage_share`]); 0 if it is unknown.
    pub voltage_share: f32,
}

/// The references for the inner step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct References {
    /// i_d, in A: zero or negative; it weakens the magnets' flux.
    pub i_d_a: f32,
    /// i_q, in A, with the sign of the torque demand.
    pub i_q_a: f32,
}

/// The state of the outer step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceState {
    /// The references of the last tick; no current before the first.
    pub last: References,
    /// The last good demand, in N m.
    pub torque_nm: f32,
    /// The last good speed, in rad/s.
    pub speed_rad_s: f32,
    /// The last good bus voltage, in V.
    pub bus_voltage_v: f32,
    /// The trim that the voltage feedback adds to the weakening current, in A.
    pub trim_a: f32,
    /// Bad samples up to now.
    pub bad: BadSamples,
}

/// One tick. A sample that is not plausible ([`crate::Limits`]) is replaced by the last good one, and the tick counts as bad. From the tenth bad tick
/// in a row on, the torque reference is 0 (the safe state `coast`). The weakening current stays, so that the motor does not charge the bus. With the
/// first good tick the torque comes back. The inner step moves its references at a bounded rate, so there is no jump in either direction.
/// `inline(never)`, so that its object code has a name of its own, which a test reads.
#[inline(never)]
pub fn references(state: &mut ReferenceState, drive: &Drive, demand: &Demand) -> References {
    let limits = &drive.limits;
    let coast = reached(state.bad.in_a_row, limits.bad_in_a_row);
    let good_torque = select(magnitude(demand.torque_nm), limits.torque_nm, 1.0, 0.0);
    let torque_nm = select(0.0, good_torque, demand.torque_nm, state.torque_nm);
    // 1 before the first good sample of the bus.
    let fresh = select(0.0, state.bus_voltage_v, 0.0, 1.0);
    let speed = judge(&limits.speed(), demand.speed_rad_s, state.speed_rad_s, coast, fresh);
    let bus = judge(&limits.bus_v, demand.bus_voltage_v, state.bus_voltage_v, coast, fresh);
    // The square of a voltage: not below 0.
    let good_share = select(demand.voltage_share, 1e6, 1.0, 0.0);
    let voltage_share = select(0.0, good_share, at_most(demand.voltage_share, TRIM_MOST), TRIM_FROM);
    let all_good = (good_torque * good_share) * (speed.good * bus.good);

    let lowest_bus = limits.bus_v.middle - limits.bus_v.half;
    let circle_speed = magnitude(speed.value) * (drive.nominal_bus_v / at_least(bus.value, lowest_bus));
    let asked = at_most(circle_speed, FOLD_SPEED_RAD_S);
    let beyond = circle_speed - asked;
    let asked = at_least(asked, SLOWEST_RAD_S);
    let fold = at_least(1.0 - beyond * FOLD_PER_RAD_S, 0.0);
    let trim_a = at_least(state.trim_a + TRIM_A * (voltage_share - TRIM_FROM), 0.0);
    let trim_a = at_most(trim_a, drive.current_limit_a);
    // The surfaces are for a motor that turns forwards; backwards is symmetric. Torque against the speed brakes, and needs less weakening because the
    // resistive drop helps. So the sign of the torque relative to the speed is kept.
    let mirror = select(speed.value, 0.0, -1.0, 1.0);
    let forwards = mirror * (torque_nm * (1.0 - coast));
    let limit = drive.current_limit_a;
    // A current vector at the current limit needs this weakening current; the rest of the circle is for torque. The torque changes it only by the
    // resistive drop, so the torque of the last tick is used. The demand may be far beyond the available torque, and would give too much weakening.
    let last_nm = drive.newton_metres_per_ampere * (mirror * state.last.i_q_a);
    let at_limit =
        within(motor::limit_current_inside_f32(last_nm, asked, drive.limit_current_once_a), 0.0, drive.most_weakening_a)
            * drive.per_ampere;
    let most = fold * (limit * other_leg(at_limit * at_limit));
    let wanted = within(forwards * drive.amperes_per_newton_metre, -most, most);
    let surface = at_least(motor::weakening_current_inside_f32(drive.newton_metres_per_ampere * wanted, asked), 0.0);
    let weakening = surface + (beyond * drive.weakening_per_speed + trim_a);
    let i_d_a = -at_most(weakening, drive.most_weakening_a);
    // Weakening has priority: without it the torque is not possible either.
    let share = i_d_a * drive.per_ampere;
    let most_q = limit * other_leg(share * share);
    let i_q_a = mirror * within(wanted, -most_q, most_q);

    state.last = References { i_d_a, i_q_a };
    state.torque_nm = torque_nm;
    state.speed_rad_s = speed.value;
    state.bus_voltage_v = bus.value;
    state.trim_a = trim_a;
    state.bad.count(0.0 < all_good);
    state.last
}

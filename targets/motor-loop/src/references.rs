//! The outer step, 1 kHz: from a torque demand to current references.
//!
//! In: torque demand, measured speed and bus voltage, and how much of the voltage the inner step takes. Out: i_d, i_q. The weakening current comes
//! from the response surface `weakening_current`, which stands in for the solution of the circle diagram; i_q is the demand over k_t, within what the
//! current circle leaves at the voltage limit, by the surface `limit_current`. Never controls currents: at 7500 rpm with 4 pole pairs a millisecond is half an electrical turn.
//!
//! The voltage circle (20) has the radius V/w_e: what a lower bus takes, a higher speed would take too. So the surfaces, measured at the nominal bus voltage,
//! are asked at the speed that has the circle of this bus, `circle speed`. That is exact but for the resistive drop, 3 % of the voltage, which the surfaces have
//! at the nominal voltage; their margin covers it.
//!
//! Beyond the surfaces' support there are no data, and a polynomial means nothing. Three things then take over. The torque folds back, the surfaces are asked at
//! the edge, and the weakening current grows along a straight line, the steepest that an ideal motor needs there. What that still misses, and whatever else the
//! surfaces cannot know (a hot magnet, a wrong inductance), the voltage says: while the inner step wants nearly all of it, the weakening current is trimmed up.

use branch_free::{BadSamples, at_least, at_most, magnitude, reached, select, within};

use crate::circle::other_leg;
use crate::drive::Drive;
use crate::motor;
use crate::plausible::judge;

/// The fastest circle speed at which the surface has support at every torque within the limit; a test asks the support.
pub const FOLD_SPEED_RAD_S: f32 = 780.0;

/// The slowest speed of the surfaces: below, they are asked at it. With [`FOLD_SPEED_RAD_S`] and [`LARGEST_TORQUE_NM`] it keeps every argument in its range,
/// so that the surfaces need no clamp; a test asks the model for its ranges.
pub const SLOWEST_RAD_S: f32 = 440.0;

/// The largest torque of the surfaces, either way. That of the largest current is below: see [`Drive::newton_metres_per_ampere`].
pub const LARGEST_TORQUE_NM: f32 = 21.6;

/// 1/the circle speed, beyond the edge, at which no torque is left: 780 rad/s beyond. At 1170 rad/s, 785 on a bus of 180 V, half of the edge's torque is left, two
/// thirds of what an ideal motor has.
pub const FOLD_PER_RAD_S: f32 = 1.0 / 780.0;

/// From this share of the reachable voltage, squared, the weakening current is trimmed up. References are within 0.95 of the voltage, 0.90 squared; the surface's
/// worst error of 1.8 A is 0.06 more.
pub const TRIM_FROM: f32 = 0.96;

/// What is seen of the share, at most: moving the references takes voltage for milliseconds, and is no reason to weaken.
pub const TRIM_MOST: f32 = 1.2;

/// By how much the trim moves in a tick, in A. At top speed an ampere is 0.036 of the share, so its loop has a time constant of 5 ms there: slow
/// beside the current control (0.7 ms), fast beside a sagging bus.
pub const TRIM_A: f32 = 5.5;

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
    /// How much of the voltage the inner step wants ([`crate::CurrentState::voltage_share`]); 0 where nothing is known of it.
    pub voltage_share: f32,
}

/// What the inner step is to do.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct References {
    /// i_d, in A: never positive, it weakens the magnets' flux.
    pub i_d_a: f32,
    /// i_q, in A, with the sign of the torque demand.
    pub i_q_a: f32,
}

/// What the outer step remembers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceState {
    /// Those of the last tick; no current before the first.
    pub last: References,
    /// The last good demand, in N m.
    pub torque_nm: f32,
    /// The last good speed, in rad/s.
    pub speed_rad_s: f32,
    /// The last good bus voltage, in V.
    pub bus_voltage_v: f32,
    /// What the voltage adds to the weakening current, in A.
    pub trim_a: f32,
    /// Bad samples up to now.
    pub bad: BadSamples,
}

/// One tick. A sample that is not plausible ([`crate::Limits`]) is replaced by the last good one, and the tick counts as bad. From the tenth bad tick in a row on no
/// torque is asked for (the safe state `coast`): the weakening current stays, so that the motor gives nothing to the bus. The first good tick asks for torque
/// again; the inner step moves its references at a bounded rate, so neither way is a bump. `inline(never)` so that its object code stands under one name,
/// where a test reads it.
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
    // The surfaces are of a motor that turns forwards; backwards is the same in a mirror. Torque against the speed brakes, and needs less weakening, since the
    // resistive drop helps: so it keeps its sign.
    let mirror = select(speed.value, 0.0, -1.0, 1.0);
    let forwards = mirror * (torque_nm * (1.0 - coast));
    let limit = drive.current_limit_a;
    // What weakening a vector as long as the limit needs leaves this much for torque. The torque moves it by the resistive drop only, so that of the last
    // tick does: the demand may be far beyond what there is, and would ask for too much weakening.
    let last_nm = drive.newton_metres_per_ampere * (mirror * state.last.i_q_a);
    let at_limit =
        within(motor::limit_current_inside_f32(last_nm, asked, drive.limit_current_once_a), 0.0, drive.most_weakening_a)
            * drive.per_ampere;
    let most = fold * (limit * other_leg(at_limit * at_limit));
    let wanted = within(forwards * drive.amperes_per_newton_metre, -most, most);
    let surface = at_least(motor::weakening_current_inside_f32(drive.newton_metres_per_ampere * wanted, asked), 0.0);
    let weakening = surface + (beyond * drive.weakening_per_speed + trim_a);
    let i_d_a = -at_most(weakening, drive.most_weakening_a);
    // Weakening comes first: without it the torque would not be there either.
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

//! The inner step, once a PWM period: from references and measured phase currents to the duties of three legs.
//!
//! In: references of the outer step; phase currents, electrical angle, speed and bus voltage, sampled together. Out: duties that act in the next
//! period, and whether the bridge is closed in it. Uses only + - * /, comparisons and selects, so C has the same bits.
//!
//! ```text
//! samples --plausible?--> phase currents --Clarke, Park (19)--> i_d, i_q --PI, decoupling--> v_d, v_q --limit (20)--> --Park back, 1.5 T later--> three duties
//!             ^                                                    |
//!             +---- expected values of the next period, from the rotor's speed and the model of the winding (17), (18)
//! ```
//!
//! The angle is advanced by 1.5 T of rotation, from the sample to the middle of the period in which the duties act. Vectors are amplitude-invariant:
//! a vector of length I is three phases of peak I.
//!
//! **A bad sample is replaced, and the control continues.** Bus voltage and speed are replaced by the last good ones, the angle by the last one
//! advanced by the speed, the currents by a model of the winding under the commanded voltages. So the voltages stay right in the rotor's frame and
//! follow the references. Current samples are also compared with the model: a stuck sensor differs from it after a while.
//!
//! **The safe state is the open bridge** (`closed` = 0): all six switches off. It begins after the number of bad samples in a row that
//! [`crate::Limits`] gives, or immediately if the current exceeds the circle by 7 %, or will do so in the next period. The README of
//! `targets/firmware` gives the reasons against a short circuit, and the duties of the caller. The safe state ends after as many good samples in a
//! row as the limits give. The control then begins with the measured currents as its references and with zero integral parts, so there is no jump.

use branch_free::{BadSamples, at_least, at_most, magnitude, reached, select, within};

use crate::circle::{Direction, WHOLE};
use crate::drive::Drive;
use crate::plausible::judge;
use crate::references::References;

const ROOT_3: f32 = 1.732_050_8;
const HALF_ROOT_3: f32 = 0.866_025_4;
const PER_ROOT_3: f32 = 0.577_350_26;
const TWO_THIRDS: f32 = 0.666_666_7;

/// The weight of a good sample of angle or currents: the model is corrected by this share of the difference. It reduces noise to 0.3, and a stuck
/// sensor is still detected: an angle from 94 rad/s on, where the rotor moves by 0.15 of the limit in a period; 60 A from 60 rad/s on. A speed error
/// of 5 % turns the frame by 6 degrees at top speed.
const BELIEVED: f32 = 0.15;

/// The limit of the integral parts. They compensate errors of the constants; a fifth of the reachable voltage is 10 % of the flux linkage at top
/// speed and 10 % of the inductance at the limit.
const INTEGRAL_SHARE: f32 = 0.2;

/// Periods between the command that closes the bridge and the first sample whose period had it closed.
const PERIODS_TO_CLOSE: f32 = 1.0;

/// Good samples before the bridge closes for the first time, plus one.
const FIRST_WAIT: f32 = 11.0;

/// The samples at the start of a PWM period.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Measured {
    /// Phase currents a, b, c into the motor, in A. Their common part is removed.
    pub currents_a: [f32; 3],
    /// Electrical angle from the axis of phase a to the magnets' flux, in turns; best reduced to one turn, because its unit in the last place is then
    /// 6e-8.
    pub angle_turns: f32,
    /// Rotor speed, in mechanical rad/s.
    pub speed_rad_s: f32,
    /// Voltage of the bus, in V.
    pub bus_voltage_v: f32,
}

/// The command to the bridge for the next period.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Command {
    /// The shares of the period for which the upper switches of legs a, b and c are on, 0 to 1.
    pub duties: [f32; 3],
    /// 1; or 0, the safe state: all six switches must be off, for any duties.
    pub closed: f32,
}

/// The state of the inner step.
#[derive(Debug, Clone, PartialEq)]
pub struct CurrentState {
    /// The integral part of v_d, in V.
    pub integral_d_v: f32,
    /// The integral part of v_q, in V.
    pub integral_q_v: f32,
    /// The present references, which move towards those of the outer step, in A.
    pub reference_d_a: f32,
    /// See `reference_d_a`.
    pub reference_q_a: f32,
    /// The voltages that act in the period that begins, in V.
    pub v_d_v: f32,
    /// See `v_d_v`.
    pub v_q_v: f32,
    /// The expected currents at the next sample, in A.
    pub expected_d_a: f32,
    /// See `expected_d_a`.
    pub expected_q_a: f32,
    /// The expected angle at the next sample, in turns, -1/2 to 1/2.
    pub angle_turns: f32,
    /// The last good speed, in rad/s.
    pub speed_rad_s: f32,
    /// The last good bus voltage, in V.
    pub bus_voltage_v: f32,
    /// The number of good samples until the bridge closes, plus one; 0 in operation.
    pub waiting: f32,
    /// The square of the wanted voltage over the square of the reachable one; 0 while the bridge is open. The outer step trims the weakening current
    /// by it.
    pub voltage_share: f32,
    /// The command to the bridge for the next period.
    pub last: Command,
    /// Bad samples up to now.
    pub bad: BadSamples,
}

impl Default for CurrentState {
    /// The bridge is open. It closes after the number of good samples that ends a safe state.
    fn default() -> Self {
        CurrentState {
            integral_d_v: 0.0,
            integral_q_v: 0.0,
            reference_d_a: 0.0,
            reference_q_a: 0.0,
            v_d_v: 0.0,
            v_q_v: 0.0,
            expected_d_a: 0.0,
            expected_q_a: 0.0,
            angle_turns: 0.0,
            speed_rad_s: 0.0,
            bus_voltage_v: 0.0,
            waiting: FIRST_WAIT,
            voltage_share: 0.0,
            last: Command { duties: [0.5; 3], closed: 0.0 },
            bad: BadSamples::default(),
        }
    }
}

/// 1/sqrt(square), to 5e-6 of it, for a square from 1 to 1e30: a line through the exponent, then two steps of Newton's method, y (3 - square y^2)/2.
/// The first guess is within 3.5 % (Lomont, "Fast inverse square root", 2003, where the constant is derived).
#[inline(always)]
fn per_root(square: f32) -> f32 {
    let half = 0.5 * square;
    let guess = f32::from_bits(0x5F37_59DF - (square.to_bits() >> 1));
    let once = guess * (1.5 - half * (guess * guess));
    once * (1.5 - half * (once * once))
}

/// `turns` without its whole turns: -1/2 to 1/2.
#[inline(always)]
fn part_of_turn(turns: f32) -> f32 {
    turns - ((turns + WHOLE) - WHOLE)
}

/// One PWM period: computes the command to the bridge for the next one.
///
/// The axes are decoupled at the wanted currents, not at the measured ones, and a voltage beyond the reachable circle is scaled back to it. With both
/// rules there is exactly one equilibrium. Proof: with e = wanted - measured current, L/2 |e|^2 falls at the rate e (v - v_w) + r |e|^2, where v_w is
/// the voltage of the wanted current; the coupling of the axes only turns e, so it does not appear. v is the point of the circle nearest to v_w + K
/// e, and v_w is in the circle. So e (v - v_w) is never negative, a property of the nearest point in any convex set. With priority for one axis, or
/// with decoupling at the measured currents, there is no such proof, and a second equilibrium was found. The wanted currents must be inside the
/// limits. This is the task of the outer step. They move along straight lines, and a straight line between two points of a circle is inside.
///
/// `inline(never)` gives its object code a name of its own, which a test reads.
#[inline(never)]
pub fn currents(state: &mut CurrentState, drive: &Drive, references: &References, measured: &Measured) -> Command {
    let Measured { currents_a: [a, b, c], angle_turns, speed_rad_s, bus_voltage_v } = *measured;
    let limits = &drive.limits;
    // 1 while the expected angle and currents are out of date: the bridge was open in the period that ends here.
    let open = select(0.0, state.waiting, 1.0, 0.0);
    // 1 before the first good sample of the bus.
    let fresh = select(0.0, state.bus_voltage_v, 0.0, 1.0);
    let bus = judge(&limits.bus_v, bus_voltage_v, state.bus_voltage_v, open, fresh);
    let speed = judge(&limits.speed(), speed_rad_s, state.speed_rad_s, open, fresh);

    let off = part_of_turn(angle_turns - state.angle_turns);
    let angle_in_range = select(magnitude(angle_turns), limits.angle_turns, 1.0, 0.0);
    let angle_good = angle_in_range * select(magnitude(off), limits.angle_rate_turns, 1.0, fresh);
    // The weight of a bad sample is 0; while the bridge is open it is 1, so that the next sample is compared with it.
    let believed = select(0.0, angle_good, BELIEVED, open);
    let angle = state.angle_turns + believed * select(0.0, angle_in_range, off, 0.0);

    let alpha = (a - 0.5 * (b + c)) * TWO_THIRDS;
    let beta = (b - c) * PER_ROOT_3;
    let Direction { cos, sin } = Direction::of_turns(angle);
    let sampled_d = cos * alpha + sin * beta;
    let sampled_q = cos * beta - sin * alpha;
    let square = sampled_d * sampled_d + sampled_q * sampled_q;
    let small = select(square, limits.current_square_a2, 1.0, 0.0);
    let in_range = select(magnitude((a + b) + c), limits.current_sum_a, small, 0.0);
    let seen_d = select(0.0, in_range, sampled_d - state.expected_d_a, 0.0);
    let seen_q = select(0.0, in_range, sampled_q - state.expected_q_a, 0.0);
    let current_good = in_range * select(seen_d * seen_d + seen_q * seen_q, limits.current_rate_square_a2, 1.0, 0.0);
    let taken = at_least(current_good, open);
    let off_d = taken * seen_d;
    let off_q = taken * seen_q;
    let i_d = state.expected_d_a + off_d;
    let i_q = state.expected_q_a + off_q;

    // The expected next sample: the model's state is corrected by only a part of the difference from the samples, so that it does not follow a stuck
    // sensor.
    let believed = select(0.0, current_good, BELIEVED, open);
    let from_d = state.expected_d_a + believed * off_d;
    let from_q = state.expected_q_a + believed * off_q;
    let turned = drive.turned_per_speed * speed.value;
    let move_d = |d: f32, q: f32| drive.amperes_per_volt * (state.v_d_v - drive.resistance_ohm * d) + turned * q;
    let move_q = |d: f32, q: f32| {
        drive.amperes_per_volt * (state.v_q_v - drive.resistance_ohm * q) - turned * (d + drive.characteristic_current_a)
    };
    // From the currents in the middle of the period: a straight step of 0.3 rad would be 5 % too long.
    let half_d = from_d + 0.5 * move_d(from_d, from_q);
    let half_q = from_q + 0.5 * move_q(from_d, from_q);
    // With an open bridge the diodes hold the current constant in the rotor's frame, except for their ripple.
    let expected_d = from_d + select(0.0, open, 0.0, move_d(half_d, half_q));
    let expected_q = from_q + select(0.0, open, 0.0, move_q(half_d, half_q));

    let all_good = (bus.good * speed.good) * (angle_good * current_good);
    // Too high now, even if the sample does not agree with the model; or at the next sample, if the currents continue to move away from the model at
    // the same rate.
    let now = select(0.0, in_range, square, 0.0);
    let then_d = expected_d + seen_d;
    let then_q = expected_q + seen_q;
    let then = then_d * then_d + then_q * then_q;
    let tripped = select(limits.trip_square_a2, at_least(now, then), 1.0, 0.0);
    state.bad.count(0.0 < all_good);
    let too_many = reached(state.bad.in_a_row, limits.bad_in_a_row);
    let not_yet = (tripped + too_many) + (1.0 - all_good) * open;
    let waiting = select(0.0, not_yet, limits.good_in_a_row + PERIODS_TO_CLOSE, at_least(state.waiting - 1.0, 0.0));
    let closed = select(waiting, PERIODS_TO_CLOSE + 0.5, 1.0, 0.0);

    // The references move along a straight line to those of the outer step; if the bridge was open, they start from the measured currents.
    let to_d = references.i_d_a - state.reference_d_a;
    let to_q = references.i_q_a - state.reference_q_a;
    let farther = at_least(magnitude(to_d), magnitude(to_q));
    let part = drive.slew_a / at_least(farther, drive.slew_a);
    let step_d = select(0.0, open, 0.0, part * to_d);
    let step_q = select(0.0, open, 0.0, part * to_q);
    let wanted_d_a = select(0.0, open, i_d, state.reference_d_a + step_d);
    let wanted_q_a = select(0.0, open, i_q, state.reference_q_a + step_q);

    let per_bus_v = 1.0 / at_least(bus.value, limits.bus_v.middle - limits.bus_v.half);
    let radius_v = bus.value * PER_ROOT_3;
    let w_e = drive.pole_pairs * speed.value;
    let error_d = wanted_d_a - i_d;
    let error_q = wanted_q_a - i_q;
    // (17), (18) at the wanted currents: resistance, rotation and magnets, and the voltage that changes them.
    let model_d = (drive.resistance_ohm * wanted_d_a - w_e * (drive.inductance_h * wanted_q_a)) + drive.slew_v_per_a * step_d;
    let flux = drive.inductance_h * wanted_d_a + drive.flux_linkage_wb;
    let model_q = (drive.resistance_ohm * wanted_q_a + w_e * flux) + drive.slew_v_per_a * step_q;
    let wanted_d = (drive.gain_v_per_a * error_d + state.integral_d_v) + model_d;
    let wanted_q = (drive.gain_v_per_a * error_q + state.integral_q_v) + model_q;

    let per_radius = per_bus_v * ROOT_3;
    let share = (wanted_d * wanted_d + wanted_q * wanted_q) * (per_radius * per_radius);
    let scale = select(1.0, share, per_root(at_least(share, 1.0)), 1.0);
    let v_d = scale * wanted_d;
    let v_q = scale * wanted_q;
    // An error of the constants shows as the voltage (K + r + j w_e L) e. The integral approaches this voltage with the time constant of the winding
    // at every speed. A law without the rotation is five times as slow at top speed and approaches on a spiral, because the integrals of both axes
    // are coupled.
    let cross = w_e * drive.inductance_h;
    let missing_d = drive.gain_v_per_a * error_d - cross * error_q;
    let missing_q = drive.gain_v_per_a * error_q + cross * error_d;
    // At the voltage limit the errors contain no information about the constants, so the integral decays. Otherwise it would wind up, and would have
    // to decay when the references are back in the circle.
    let target_d = select(1.0, share, -state.integral_d_v, missing_d);
    let target_q = select(1.0, share, -state.integral_q_v, missing_q);
    let integral_d = state.integral_d_v + drive.integral_share * target_d;
    let integral_q = state.integral_q_v + drive.integral_share * target_q;
    let most = INTEGRAL_SHARE * radius_v;
    state.integral_d_v = select(0.0, open, 0.0, within(integral_d, -most, most));
    state.integral_q_v = select(0.0, open, 0.0, within(integral_q, -most, most));

    let Direction { cos, sin } = Direction::of_turns(angle + drive.advance_turns_s * speed.value);
    let v_alpha = cos * v_d - sin * v_q;
    let v_beta = sin * v_d + cos * v_q;
    let half = 0.5 * v_alpha;
    let side = HALF_ROOT_3 * v_beta;
    let v_a = v_alpha;
    let v_b = side - half;
    let v_c = -side - half;
    // Half the sum of the largest and the smallest phase is subtracted from all three. This centres them on the bus and makes V/sqrt 3 reachable
    // (zero sequence of space vector modulation).
    let highest = at_least(at_least(v_a, v_b), v_c);
    let lowest = at_most(at_most(v_a, v_b), v_c);
    let centre = 0.5 * (highest + lowest);
    // While both switches of a leg are off, its current flows through a diode: the leg loses dead time / T of the bus voltage, against the current.
    // The sign comes from the wanted currents of that period, because the sign of a bad or noisy sample is not reliable.
    let flow_alpha = cos * wanted_d_a - sin * wanted_q_a;
    let flow_beta = sin * wanted_d_a + cos * wanted_q_a;
    let flow_half = 0.5 * flow_alpha;
    let flow_side = HALF_ROOT_3 * flow_beta;
    let duty = |v: f32, current: f32| {
        let lost = drive.dead_time_share * within(current * drive.per_dead_time_ampere, -1.0, 1.0);
        // If constants are NaN, the voltage is 0.
        let duty = within(((v - centre) * per_bus_v + 0.5) + lost, 0.0, 1.0);
        select(duty, 2.0, duty, 0.5)
    };
    state.last.duties = [duty(v_a, flow_alpha), duty(v_b, flow_side - flow_half), duty(v_c, -flow_side - flow_half)];
    state.last.closed = closed;

    state.reference_d_a = wanted_d_a;
    state.reference_q_a = wanted_q_a;
    state.v_d_v = v_d;
    state.v_q_v = v_q;
    state.expected_d_a = expected_d;
    state.expected_q_a = expected_q;
    state.angle_turns = part_of_turn(angle + drive.turns_per_speed * speed.value);
    state.speed_rad_s = speed.value;
    state.bus_voltage_v = bus.value;
    state.waiting = waiting;
    state.voltage_share = select(0.0, open, 0.0, share);
    state.last
}

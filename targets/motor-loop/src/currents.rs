//! The inner step, once a PWM period: from references and measured phase currents to the duties of three legs.
//!
//! In: references of the outer step; phase currents, electrical angle, speed and bus voltage, sampled together. Out: duties that act in the next period.
//! Never more than + - * /, comparisons and selects: C has the same bits.
//!
//! ```text
//! phase currents --Clarke, Park (19)--> i_d, i_q --PI, decoupling--> v_d, v_q --limit (20)--> --Park back, 1.5 T later--> three duties
//! ```
//!
//! The angle is advanced by 1.5 T of rotation, from the sample to the middle of the period in which the duties act. A frame of amplitudes: a vector of
//! length I is three phases of peak I.

use branch_free::{BadSamples, at_least, at_most, nothing, select, within};

use crate::circle::{Direction, LONGEST_LEG, other_leg};
use crate::drive::Drive;
use crate::references::References;

const ROOT_3: f32 = 1.732_050_8;
const HALF_ROOT_3: f32 = 0.866_025_4;
const PER_ROOT_3: f32 = 0.577_350_26;
const TWO_THIRDS: f32 = 0.666_666_7;

/// What is sampled at the start of a PWM period.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Measured {
    /// Phase currents a, b, c into the motor, in A. A part that all three have in common is dropped.
    pub currents_a: [f32; 3],
    /// Electrical angle from the axis of phase a to the magnets' flux, in turns; best reduced to one, for then its unit in the last place is 6e-8.
    pub angle_turns: f32,
    /// Rotor speed, in mechanical rad/s.
    pub speed_rad_s: f32,
    /// Voltage of the bus, in V.
    pub bus_voltage_v: f32,
}

/// What the inner step remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct CurrentState {
    /// The integral part of v_d, in V.
    pub integral_d_v: f32,
    /// The integral part of v_q, in V.
    pub integral_q_v: f32,
    /// The duties of the last good sample.
    pub last: [f32; 3],
    /// Bad samples up to now.
    pub bad: BadSamples,
}

impl Default for CurrentState {
    fn default() -> Self {
        CurrentState { integral_d_v: 0.0, integral_q_v: 0.0, last: [0.5; 3], bad: BadSamples::default() }
    }
}

/// One PWM period: the shares of the next one for which the upper switches of legs a, b and c are on, 0 to 1.
///
/// The voltage limit takes v_d first and leaves v_q the rest of the circle of radius V/sqrt 3: at the limit it is i_d that keeps the back-EMF
/// down, and a control that lets it go loses i_q as well. v_d may have 0.949 of the radius, so that a third is always left for v_q. What the
/// limit took off goes back into the integrals, over the proportional gain (the conditioned controller of Hanus, 1987), so that they do
/// not wind up.
///
/// A sample that is not a number, or a bus without voltage, gives the duties of the last good sample again, and is counted.
/// `inline(never)` so that its object code stands under one name, where a test reads it.
#[inline(never)]
pub fn currents(state: &mut CurrentState, drive: &Drive, references: &References, measured: &Measured) -> [f32; 3] {
    let Measured { currents_a: [a, b, c], angle_turns, speed_rad_s, bus_voltage_v } = *measured;
    let alpha = (a - 0.5 * (b + c)) * TWO_THIRDS;
    let beta = (b - c) * PER_ROOT_3;
    let Direction { cos, sin } = Direction::of_turns(angle_turns);
    let i_d = cos * alpha + sin * beta;
    let i_q = cos * beta - sin * alpha;

    let per_bus_v = 1.0 / bus_voltage_v;
    let radius_v = bus_voltage_v * PER_ROOT_3;
    let w_e = drive.pole_pairs * speed_rad_s;
    let error_d = references.i_d_a - i_d;
    let error_q = references.i_q_a - i_q;
    // (17), (18): the voltages that the rotation of the frame and the magnets take, at the wanted currents. At the measured ones a drive that is switched on at a
    // speed whose back-EMF is beyond the bus latches: v_d then fights the very coupling by which a braking i_q would weaken the flux, and a
    // test of that case ends at -80 A.
    let rotation_d = -(w_e * (drive.inductance_h * references.i_q_a));
    let rotation_q = w_e * (drive.inductance_h * references.i_d_a + drive.flux_linkage_wb);
    let wanted_d = (drive.gain_v_per_a * error_d + state.integral_d_v) + (references.resistive_d_v + rotation_d);
    let wanted_q = (drive.gain_v_per_a * error_q + state.integral_q_v) + (references.resistive_q_v + rotation_q);

    let most_d = LONGEST_LEG * radius_v;
    let v_d = within(wanted_d, -most_d, most_d);
    let share = (v_d * per_bus_v) * ROOT_3;
    let most_q = radius_v * other_leg(share * share);
    let v_q = within(wanted_q, -most_q, most_q);
    let integral_d = state.integral_d_v + (drive.integral_gain_v_per_a * error_d + drive.tracking * (v_d - wanted_d));
    let integral_q = state.integral_q_v + (drive.integral_gain_v_per_a * error_q + drive.tracking * (v_q - wanted_q));

    let Direction { cos, sin } = Direction::of_turns(angle_turns + drive.advance_turns_s * speed_rad_s);
    let v_alpha = cos * v_d - sin * v_q;
    let v_beta = sin * v_d + cos * v_q;
    let half = 0.5 * v_alpha;
    let side = HALF_ROOT_3 * v_beta;
    let v_a = v_alpha;
    let v_b = side - half;
    let v_c = -side - half;
    // Half of the largest and the smallest phase, taken off all three, centres them on the bus: that is what reaches V/sqrt 3 (zero sequence of
    // space vector modulation).
    let highest = at_least(at_least(v_a, v_b), v_c);
    let lowest = at_most(at_most(v_a, v_b), v_c);
    let centre = 0.5 * (highest + lowest);
    let duty = |v: f32, current: f32| {
        // While both switches of a leg are off its current flows through a diode: the leg loses dead time / T of the bus, against the current.
        let lost = drive.dead_time_share * within(current * drive.per_dead_time_ampere, -1.0, 1.0);
        within(((v - centre) * per_bus_v + 0.5) + lost, 0.0, 1.0)
    };
    let duties = [duty(v_a, a), duty(v_b, b), duty(v_c, c)];

    // 0, or NaN where anything was not a number. Bounds hide infinities, so the samples themselves are in it.
    let sum = nothing(a) + nothing(b) + nothing(c) + nothing(angle_turns) + nothing(speed_rad_s);
    let sum = sum + nothing(bus_voltage_v) + nothing(per_bus_v) + nothing(integral_d) + nothing(integral_q);
    let sum = sum + nothing(duties[0]) + nothing(duties[1]) + nothing(duties[2]);
    // It is below the voltage of a bus that has one.
    let keep = |new: f32, old: f32| select(sum, bus_voltage_v, new, old);
    state.integral_d_v = keep(integral_d, state.integral_d_v);
    state.integral_q_v = keep(integral_q, state.integral_q_v);
    state.last = [keep(duties[0], state.last[0]), keep(duties[1], state.last[1]), keep(duties[2], state.last[2])];
    state.bad.count(sum < bus_voltage_v);
    state.last
}

//! What both steps know of the motor and its drive: constants, computed once outside the loop.
//!
//! In: the motor's nominal parameters, how its drive is tuned, what its sensors may say. Out: a [`Drive`]. Divisions stand here and not in the steps.

use core::f32::consts::TAU;

use crate::plausible::Band;
use crate::references::FOLD_SPEED_RAD_S;

/// The motor, nominal values (the parameters of a plant file).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// r, in ohm.
    pub phase_resistance_ohm: f32,
    /// L, in H.
    pub phase_inductance_h: f32,
    /// lambda, in Wb.
    pub flux_linkage_wb: f32,
    /// How many electrical turns a mechanical one has.
    pub pole_pairs: f32,
    /// The bus voltage at which the surface was measured, in V.
    pub bus_voltage_v: f32,
    /// I of (20), the longest current vector, in A.
    pub current_limit_a: f32,
}

/// How the drive is tuned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning {
    /// T, the period of the inner step, in s.
    pub pwm_period_s: f32,
    /// The bandwidth of the current control, in rad/s. The PI controller cancels the winding's time constant L/r: gain bandwidth L,
    /// integral gain bandwidth r. The loop has a dead time of 1.5 T, so a bandwidth up to 1/(6 T) leaves a phase margin of 75 degrees.
    pub bandwidth_rad_s: f32,
    /// Dead time of a leg, in s; 0 for none. Its loss of voltage is given back.
    pub dead_time_s: f32,
    /// The current, in A, from which on the loss of a leg's dead time is given back in full; in proportion below.
    pub dead_time_current_a: f32,
}

/// What counts as plausible, and how long the steps go on without. The table of a drive: a board with other sensors has another.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Limits {
    /// Bus voltage, in V; its rate a call.
    pub bus_v: Band,
    /// Mechanical speed, in rad/s; its rate a call.
    pub speed_rad_s: Band,
    /// The largest torque demand, in N m. A demand may step over its whole range.
    pub torque_nm: f32,
    /// The largest angle, in turns: the range of what comes from the encoder, not of the rotor.
    pub angle_turns: f32,
    /// How far the angle may be from where the last one and the speed put it, in turns.
    pub angle_rate_turns: f32,
    /// The largest sum of the three phase currents, in A: it is 0 but for errors of the sensors.
    pub current_sum_a: f32,
    /// Square of the longest current vector that the sensors can tell, in A^2.
    pub current_square_a2: f32,
    /// Square of how far the current vector may be from where the model of the winding puts it, in A^2.
    pub current_rate_square_a2: f32,
    /// Square of the current vector at which the bridge is opened at once, in A^2.
    pub trip_square_a2: f32,
    /// So many bad samples in a row open the bridge (inner step) and take the torque away (outer step).
    pub bad_in_a_row: f32,
    /// So many good samples in a row close the bridge again.
    pub good_in_a_row: f32,
}

impl Limits {
    /// The limits of a drive on a bus of two thirds to four thirds of the nominal voltage, and of its speed up to that of the surface and a quarter.
    ///
    /// - Bus: 150 to 360 V of 270. 50 V a call: at 60 A a capacitor of 1 mF moves by 6 V in a period; a noise of 5 % has 19 V between two samples.
    /// - Speed: 1000 rad/s of 785. 100 rad/s a call: far beyond what the shaft can do (2200 rad/s^2), and below what hurts (a tenth of the range for one
    ///   period is 24 V of back-EMF, 3 A).
    /// - Torque: twice what the current limit gives.
    /// - Angle: 4 turns; 0.04 turns, two and a half counts of an encoder with 256 counts and 4 pole pairs.
    /// - Currents: sum a fifth of the current limit, vector twice the limit. A quarter of the limit from the model: an inductance that is off by a quarter
    ///   makes 10 A of the 38 A that the largest voltage moves in a period.
    /// - The bridge opens at 1.07 of the limit: what the current control itself overshoots is below.
    /// - 10 in a row: within a millisecond a free rotor turns its speed by 2 rad/s and its angle by 0.001 turns from what was last known.
    #[must_use]
    pub fn of(motor: &Motor) -> Self {
        let Motor { current_limit_a: limit, bus_voltage_v: bus, pole_pairs, flux_linkage_wb, .. } = *motor;
        Limits {
            bus_v: Band { middle: bus * (17.0 / 18.0), half: bus * (7.0 / 18.0), rate: bus * (5.0 / 27.0) },
            speed_rad_s: Band { middle: 0.0, half: 1.25 * 800.0, rate: 100.0 },
            torque_nm: 2.0 * (1.5 * pole_pairs * flux_linkage_wb * limit),
            angle_turns: 4.0,
            angle_rate_turns: 0.04,
            current_sum_a: 0.2 * limit,
            current_square_a2: 4.0 * (limit * limit),
            current_rate_square_a2: 0.0625 * (limit * limit),
            trip_square_a2: 1.1449 * (limit * limit),
            bad_in_a_row: 10.0,
            good_in_a_row: 10.0,
        }
    }
}

/// Constants of the steps. Every field is a number in the units of its name; a C program holds the same struct.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Drive {
    /// k_t = 1.5 pole_pairs lambda (21).
    pub newton_metres_per_ampere: f32,
    /// 1/k_t.
    pub amperes_per_newton_metre: f32,
    /// I of (20).
    pub current_limit_a: f32,
    /// 1/I.
    pub per_ampere: f32,
    /// The bus voltage at which the surface was measured.
    pub nominal_bus_v: f32,
    /// How much weakening a speed beyond the surface takes, in A s/rad.
    pub weakening_per_speed: f32,
    /// r.
    pub resistance_ohm: f32,
    /// L.
    pub inductance_h: f32,
    /// lambda.
    pub flux_linkage_wb: f32,
    /// Pole pairs.
    pub pole_pairs: f32,
    /// T times the pole pairs, in electrical rad per mechanical rad/s.
    pub turned_per_speed: f32,
    /// Electrical turns in T per mechanical rad/s.
    pub turns_per_speed: f32,
    /// T/L, in A/V: what a volt moves in a period.
    pub amperes_per_volt: f32,
    /// lambda/L, in A: the current that takes the magnets' flux away.
    pub characteristic_current_a: f32,
    /// Proportional gain of the current control, in V/A.
    pub gain_v_per_a: f32,
    /// T r/L: the share of its way that the integral part goes in a period.
    pub integral_share: f32,
    /// How far the reference of the current control moves in a period, in A.
    pub slew_a: f32,
    /// 0.75 L/T, in V/A: what moving the current takes, less what the proportional part gives, which sees the references 1.5 periods ahead.
    pub slew_v_per_a: f32,
    /// Electrical turns in 1.5 T per mechanical rad/s: one period until the duties act, half of one until their middle.
    pub advance_turns_s: f32,
    /// Dead time over T.
    pub dead_time_share: f32,
    /// 1/the current from which on dead time is compensated in full.
    pub per_dead_time_ampere: f32,
    /// What is plausible.
    pub limits: Limits,
}

/// How fast the reference of the current control moves, as a share of the current limit a period: from full torque to full braking takes 40 periods. Faster, the
/// voltage at the limit no longer follows, and the current leaves the circle by what it lags.
const SLEW_SHARE: f32 = 0.05;

/// The steepest descent of what zero torque needs, (0.95 V/sqrt 3)/(pole pairs w^2 L) at the surface's edge, times this: at full torque the descent is half as steep again.
const STEEPER: f32 = 1.25;

impl Drive {
    /// The constants of a motor and a tuning, with [`Limits::of`] that motor. Parameters that are no physical ones (zero, negative, NaN) give constants
    /// with which every sample is bad: nothing is commanded, and the bridge stays open.
    #[must_use]
    pub fn new(motor: &Motor, tuning: &Tuning) -> Self {
        let Motor { phase_resistance_ohm: r, phase_inductance_h: l, flux_linkage_wb: lambda, pole_pairs, .. } = *motor;
        let Tuning { pwm_period_s: period, bandwidth_rad_s: bandwidth, .. } = *tuning;
        let positive = |value: f32| if value > 0.0 && value.is_finite() { value } else { f32::NAN };
        let mut limits = Limits::of(motor);
        // NaN where any of them is no physical one.
        let product = positive(r) * positive(l) * positive(lambda) * positive(pole_pairs) * positive(motor.bus_voltage_v);
        limits.bus_v.half = if (product * positive(motor.current_limit_a) * positive(period) * positive(bandwidth)).is_nan() {
            f32::NAN
        } else {
            limits.bus_v.half
        };
        let edge = FOLD_SPEED_RAD_S * FOLD_SPEED_RAD_S;
        Drive {
            newton_metres_per_ampere: positive(1.5 * pole_pairs * lambda),
            amperes_per_newton_metre: positive(1.0 / (1.5 * pole_pairs * lambda)),
            current_limit_a: positive(motor.current_limit_a),
            per_ampere: positive(1.0 / motor.current_limit_a),
            nominal_bus_v: positive(motor.bus_voltage_v),
            weakening_per_speed: positive(STEEPER * 0.95 * 0.577_350_26 * motor.bus_voltage_v / (pole_pairs * edge * l)),
            resistance_ohm: positive(r),
            inductance_h: positive(l),
            flux_linkage_wb: positive(lambda),
            pole_pairs: positive(pole_pairs),
            turned_per_speed: positive(period * pole_pairs),
            turns_per_speed: positive(period * pole_pairs / TAU),
            amperes_per_volt: positive(period / l),
            characteristic_current_a: positive(lambda / l),
            gain_v_per_a: positive(bandwidth * l),
            integral_share: positive(r * period / l),
            slew_a: positive(SLEW_SHARE * motor.current_limit_a),
            slew_v_per_a: positive(0.75 * l / period),
            advance_turns_s: positive(1.5 * period * pole_pairs / TAU),
            dead_time_share: if tuning.dead_time_s > 0.0 { tuning.dead_time_s / period } else { 0.0 },
            per_dead_time_ampere: positive(1.0 / tuning.dead_time_current_a),
            limits,
        }
    }
}

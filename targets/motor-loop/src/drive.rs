//! Constants of the motor and its drive for both steps, computed once outside the loop.
//!
//! In: the motor's nominal parameters, the tuning of its drive, the plausible ranges of its sensors. Out: a [`Drive`]. All divisions are made here,
//! so the steps need none.

use core::f32::consts::TAU;

use crate::circle::LONGEST_LEG;
use crate::motor;
use crate::plausible::Band;
use crate::references::{FOLD_SPEED_RAD_S, LARGEST_TORQUE_NM};

/// The motor, nominal values (the parameters of a plant file).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// r, in ohm.
    pub phase_resistance_ohm: f32,
    /// L, in H.
    pub phase_inductance_h: f32,
    /// lambda, in Wb.
    pub flux_linkage_wb: f32,
    /// Number of electrical turns in a mechanical turn.
    pub pole_pairs: f32,
    /// The bus voltage at which the surface was measured, in V.
    pub bus_voltage_v: f32,
    /// I of (20), the longest current vector, in A.
    pub current_limit_a: f32,
}

/// The tuning of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning {
    /// T, the period of the inner step, in s.
    pub pwm_period_s: f32,
    /// The bandwidth of the current control, in rad/s. The PI controller cancels the winding's time constant L/r: gain bandwidth L,
    /// integral gain bandwidth r. The loop has a dead time of 1.5 T, so a bandwidth up to 1/(6 T) leaves a phase margin of 75 degrees.
    pub bandwidth_rad_s: f32,
    /// Dead time of a leg, in s; 0 for none. Its voltage loss is compensated.
    pub dead_time_s: f32,
    /// The current, in A, from which on the dead time is compensated in full; below, in proportion.
    pub dead_time_current_a: f32,
}

/// The plausible samples, and the number of bad samples for which the steps continue. Each drive has its own table, because each board has its own
/// sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Limits {
    /// Bus voltage, in V, and its largest change in a call.
    pub bus_v: Band,
    /// The largest mechanical speed, either way, in rad/s.
    pub speed_rad_s: f32,
    /// Its largest change in a call, in rad/s.
    pub speed_rate_rad_s: f32,
    /// The largest torque demand, in N m. A demand may jump over its whole range.
    pub torque_nm: f32,
    /// The largest angle, in turns: the range of the encoder's value, not of the rotor.
    pub angle_turns: f32,
    /// The largest difference of the angle from the one predicted by the last angle and the speed, in turns.
    pub angle_rate_turns: f32,
    /// The largest sum of the three phase currents, in A. Without errors of the sensors it is 0.
    pub current_sum_a: f32,
    /// Square of the longest current vector that the sensors can measure, in A^2.
    pub current_square_a2: f32,
    /// Square of the largest difference of the current vector from the one predicted by the model of the winding, in A^2.
    pub current_rate_square_a2: f32,
    /// Square of the current vector at which the bridge is opened immediately, in A^2.
    pub trip_square_a2: f32,
    /// This many bad samples in a row open the bridge (inner step) and set the torque to 0 (outer step).
    pub bad_in_a_row: u32,
    /// This many good samples in a row close the bridge again.
    pub good_in_a_row: f32,
}

impl Limits {
    /// The plausible readings of the speed sensor.
    #[inline(always)]
    pub(crate) fn speed(&self) -> Band {
        Band { middle: 0.0, half: self.speed_rad_s, rate: self.speed_rate_rad_s }
    }

    /// The limits of a drive on a bus of two thirds to four thirds of the nominal voltage, and of a speed up to that of the surface plus a quarter.
    ///
    /// - Bus: 150 to 360 V of 270. 50 V a call: at 60 A a capacitor of 1 mF changes by 6 V in a period; noise of 5 % makes 19 V between two samples.
    /// - Speed: 1000 rad/s of 785. 100 rad/s a call: far more than the shaft can do (2200 rad/s^2), and small enough to do no harm (a tenth of the
    ///   range for one period is 24 V of back-EMF, 3 A).
    /// - Torque: twice the torque at the current limit.
    /// - Angle: 4 turns; 0.04 turns, two and a half counts of an encoder with 256 counts and 4 pole pairs.
    /// - Currents: sum a fifth of the current limit, vector twice the limit. A quarter of the limit from the model: an inductance with an error of a
    ///   quarter gives 10 A of the 38 A by which the largest voltage changes the current in a period.
    /// - The bridge opens at 1.07 of the limit: the overshoot of the current control is less.
    /// - 10 in a row: within a millisecond a free rotor changes its speed by 2 rad/s and its angle by 0.001 turns from the last known values.
    #[must_use]
    pub fn of(motor: &Motor) -> Self {
        let Motor { current_limit_a: limit, bus_voltage_v: bus, pole_pairs, flux_linkage_wb, .. } = *motor;
        Limits {
            bus_v: Band { middle: bus * (17.0 / 18.0), half: bus * (7.0 / 18.0), rate: bus * (5.0 / 27.0) },
            speed_rad_s: 1.25 * 800.0,
            speed_rate_rad_s: 100.0,
            torque_nm: 2.0 * (1.5 * pole_pairs * flux_linkage_wb * limit),
            angle_turns: 4.0,
            angle_rate_turns: 0.04,
            current_sum_a: 0.2 * limit,
            current_square_a2: 4.0 * (limit * limit),
            current_rate_square_a2: 0.0625 * (limit * limit),
            trip_square_a2: 1.1449 * (limit * limit),
            bad_in_a_row: 10,
            good_in_a_row: 10.0,
        }
    }
}

/// Constants of the steps. Every field is a number in the unit of its name; a C program has the same struct.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Drive {
    /// k_t = 1.5 pole_pairs lambda (21), but at most the value with which the current limit gives [`LARGEST_TORQUE_NM`]: the surfaces are evaluated
    /// at torques that are computed from currents, and these torques must be within the limit.
    pub newton_metres_per_ampere: f32,
    /// 1/k_t.
    pub amperes_per_newton_metre: f32,
    /// I of (20).
    pub current_limit_a: f32,
    /// 1/I.
    pub per_ampere: f32,
    /// The part of the surface `limit_current` that depends on the current limit, in A.
    pub limit_current_once_a: f32,
    /// The largest i_d: more would leave less than 0.32 of the circle for i_q.
    pub most_weakening_a: f32,
    /// The bus voltage at which the surface was measured.
    pub nominal_bus_v: f32,
    /// The additional weakening current for a speed beyond the surface, in A s/rad.
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
    /// T/L, in A/V: the change of current in a period for a volt.
    pub amperes_per_volt: f32,
    /// lambda/L, in A: the current that cancels the magnets' flux.
    pub characteristic_current_a: f32,
    /// Proportional gain of the current control, in V/A.
    pub gain_v_per_a: f32,
    /// T r/L: the share by which the integral part approaches its target in a period.
    pub integral_share: f32,
    /// The largest change of the current control's reference in a period, in A.
    pub slew_a: f32,
    /// 0.75 L/T, in V/A: the voltage that changes the current, minus the proportional part, which acts on the references 1.5 periods ahead.
    pub slew_v_per_a: f32,
    /// Electrical turns in 1.5 T per mechanical rad/s: one period until the duties act, half of one until their middle.
    pub advance_turns_s: f32,
    /// Dead time over T.
    pub dead_time_share: f32,
    /// 1/the current from which on dead time is compensated in full.
    pub per_dead_time_ampere: f32,
    /// The limits of plausible samples.
    pub limits: Limits,
}

/// The largest change of the current control's reference in a period, as a share of the current limit: from full torque to full braking takes 40
/// periods. With a faster change the voltage at the limit could not follow, and the current would leave the circle by its lag.
const SLEW_SHARE: f32 = 0.05;

/// A factor on the steepest decrease of the current for zero torque, (0.95 V/sqrt 3)/(pole pairs w^2 L) at the edge of the surface: at full torque
/// the decrease is half as steep again.
const STEEPER: f32 = 1.25;

impl Drive {
    /// Constants without a motor: every sample of the bus is bad, nothing is commanded, and all results of the steps are finite.
    const NONE: Drive = Drive {
        newton_metres_per_ampere: 0.0,
        amperes_per_newton_metre: 0.0,
        current_limit_a: 0.0,
        per_ampere: 0.0,
        limit_current_once_a: 0.0,
        most_weakening_a: 0.0,
        nominal_bus_v: 0.0,
        weakening_per_speed: 0.0,
        resistance_ohm: 0.0,
        inductance_h: 0.0,
        flux_linkage_wb: 0.0,
        pole_pairs: 0.0,
        turned_per_speed: 0.0,
        turns_per_speed: 0.0,
        amperes_per_volt: 0.0,
        characteristic_current_a: 0.0,
        gain_v_per_a: 0.0,
        integral_share: 0.0,
        slew_a: 1.0,
        slew_v_per_a: 0.0,
        advance_turns_s: 0.0,
        dead_time_share: 0.0,
        per_dead_time_ampere: 0.0,
        limits: Limits {
            // No distance is less than a negative number.
            bus_v: Band { middle: 0.0, half: -1.0, rate: 0.0 },
            speed_rad_s: 0.0,
            speed_rate_rad_s: 0.0,
            torque_nm: 0.0,
            angle_turns: 0.0,
            angle_rate_turns: 0.0,
            current_sum_a: 0.0,
            current_square_a2: 0.0,
            current_rate_square_a2: 0.0,
            trip_square_a2: 0.0,
            bad_in_a_row: 1,
            good_in_a_row: 1.0,
        },
    };

    /// The constants of a motor and a tuning, with the [`Limits::of`] that motor. Parameters without physical meaning (zero, negative, NaN) give
    /// constants with which every sample is bad: nothing is commanded, and the bridge stays open. The same holds if one of the constants is not a
    /// finite number.
    #[must_use]
    pub fn new(motor: &Motor, tuning: &Tuning) -> Self {
        let Motor { phase_resistance_ohm: r, phase_inductance_h: l, flux_linkage_wb: lambda, pole_pairs, .. } = *motor;
        let Tuning { pwm_period_s: period, bandwidth_rad_s: bandwidth, .. } = *tuning;
        let (limit, bus) = (motor.current_limit_a, motor.bus_voltage_v);
        let edge = FOLD_SPEED_RAD_S * FOLD_SPEED_RAD_S;
        let drive = Drive {
            newton_metres_per_ampere: (1.5 * pole_pairs * lambda).min(LARGEST_TORQUE_NM / limit),
            amperes_per_newton_metre: 1.0 / (1.5 * pole_pairs * lambda),
            current_limit_a: limit,
            per_ampere: 1.0 / limit,
            limit_current_once_a: motor::limit_current_once_f32(limit),
            most_weakening_a: LONGEST_LEG * limit,
            nominal_bus_v: bus,
            weakening_per_speed: STEEPER * 0.95 * 0.577_350_26 * bus / (pole_pairs * edge * l),
            resistance_ohm: r,
            inductance_h: l,
            flux_linkage_wb: lambda,
            pole_pairs,
            turned_per_speed: period * pole_pairs,
            turns_per_speed: period * pole_pairs / TAU,
            amperes_per_volt: period / l,
            characteristic_current_a: lambda / l,
            gain_v_per_a: bandwidth * l,
            integral_share: r * period / l,
            slew_a: SLEW_SHARE * limit,
            slew_v_per_a: 0.75 * l / period,
            advance_turns_s: 1.5 * period * pole_pairs / TAU,
            dead_time_share: if tuning.dead_time_s > 0.0 { tuning.dead_time_s / period } else { 0.0 },
            per_dead_time_ampere: 1.0 / tuning.dead_time_current_a,
            limits: Limits::of(motor),
        };
        if drive.is_of_a_motor() { drive } else { Drive::NONE }
    }

    /// Whether the constants are those of a possible motor and tuning.
    fn is_of_a_motor(&self) -> bool {
        let positive = [
            self.newton_metres_per_ampere,
            self.amperes_per_newton_metre,
            self.current_limit_a,
            self.per_ampere,
            self.most_weakening_a,
            self.nominal_bus_v,
            self.weakening_per_speed,
            self.resistance_ohm,
            self.inductance_h,
            self.flux_linkage_wb,
            self.pole_pairs,
            self.turned_per_speed,
            self.turns_per_speed,
            self.amperes_per_volt,
            self.characteristic_current_a,
            self.gain_v_per_a,
            self.integral_share,
            self.slew_a,
            self.slew_v_per_a,
            self.advance_turns_s,
            self.per_dead_time_ampere,
        ];
        // The part of the surface may have either sign, and a drive without dead time has a share of 0.
        positive.iter().all(|value| *value > 0.0 && value.is_finite())
            && self.limit_current_once_a.is_finite()
            && self.dead_time_share.is_finite()
    }
}

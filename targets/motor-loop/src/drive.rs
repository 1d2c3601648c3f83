//! What both steps know of the motor and its drive: constants, computed once outside the loop.
//!
//! In: the motor's nominal parameters and how its drive is tuned. Out: a [`Drive`]. Divisions stand here and not in the steps.

use core::f32::consts::TAU;

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
    /// r.
    pub resistance_ohm: f32,
    /// L.
    pub inductance_h: f32,
    /// lambda.
    pub flux_linkage_wb: f32,
    /// Pole pairs.
    pub pole_pairs: f32,
    /// Proportional gain of the current control, in V/A.
    pub gain_v_per_a: f32,
    /// Integral gain times T, in V/A: what a period adds.
    pub integral_gain_v_per_a: f32,
    /// Integral gain times T over the proportional gain: how much of what the limit took off goes back into the integral.
    pub tracking: f32,
    /// Electrical turns in 1.5 T per mechanical rad/s: one period until the duties act, half of one until their middle.
    pub advance_turns_s: f32,
    /// Dead time over T.
    pub dead_time_share: f32,
    /// 1/the current from which on dead time is compensated in full.
    pub per_dead_time_ampere: f32,
}

impl Drive {
    /// The constants of a motor and a tuning. Parameters that are no physical ones (zero, negative, NaN) give constants with which every sample is bad:
    /// nothing is commanded.
    #[must_use]
    pub fn new(motor: &Motor, tuning: &Tuning) -> Self {
        let Motor { phase_resistance_ohm: r, phase_inductance_h: l, flux_linkage_wb: lambda, pole_pairs, .. } = *motor;
        let Tuning { pwm_period_s: period, bandwidth_rad_s: bandwidth, .. } = *tuning;
        let positive = |value: f32| if value > 0.0 && value.is_finite() { value } else { f32::NAN };
        Drive {
            newton_metres_per_ampere: positive(1.5 * pole_pairs * lambda),
            amperes_per_newton_metre: positive(1.0 / (1.5 * pole_pairs * lambda)),
            current_limit_a: positive(motor.current_limit_a),
            per_ampere: positive(1.0 / motor.current_limit_a),
            nominal_bus_v: positive(motor.bus_voltage_v),
            resistance_ohm: positive(r),
            inductance_h: positive(l),
            flux_linkage_wb: positive(lambda),
            pole_pairs: positive(pole_pairs),
            gain_v_per_a: positive(bandwidth * l),
            integral_gain_v_per_a: positive(bandwidth * r * period),
            tracking: positive(r * period / l),
            advance_turns_s: positive(1.5 * period * pole_pairs / TAU),
            dead_time_share: if tuning.dead_time_s > 0.0 { tuning.dead_time_s / period } else { 0.0 },
            per_dead_time_ampere: positive(1.0 / tuning.dead_time_current_a),
        }
    }
}

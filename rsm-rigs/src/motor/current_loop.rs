//! Current control in the rotor frame at the PWM rate: feedback linearisation, PI, voltage limit, modulation.
//!
//! In: references and measured phase currents, angle, speed, bus voltage. Out: duties of the period after this one. Feedback linearisation
//! means that the terms of (17), (18) that couple the axes, and the back-EMF, are fed forward, so that each axis is L di/dt = v - r i for its PI.
//!
//! The voltage is held in the stator's frame for a period T, so in the rotor's it turns by w_e T, 18 degrees at 7500 rpm, 4 pole pairs and 10 kHz.
//! Two corrections follow, both to second order in w_e T. The mean of the turning vector is shorter than the vector by (w_e T)^2/24: the command is
//! that much longer. And its swing to both sides drives a ripple whose value at the sampling instants is not its mean: with v exp(-j w_e t) over L, i
//! at the ends of the period is the mean less j w_e T^2 v/(12 L). What is controlled, and makes torque, is the mean. Without the corrections a bench
//! finds the voltage limit up to 0.7 % beside the circle diagram.

use super::controller::{Known, Measured, References};
use super::park::{Angle, from_phases, to_phases};

/// From sample to the middle of the period in which its voltage acts, in periods: one for the computation, half for the hold.
const DELAY_PERIODS: f64 = 1.5;

/// Bandwidth times delay. The loop is then (bandwidth/s) exp(-s delay), and 1/4 is below the 1/e at which its step response begins to overshoot.
const BANDWIDTH_DELAY: f64 = 0.25;

/// The corner of the integral part, as a share of the bandwidth: it costs the phase margin atan(1/10) = 6 degrees.
const INTEGRAL_SHARE: f64 = 0.1;

/// Dead time is compensated in full above this current, in proportion below, in A: the sign of a phase current below its ripple and noise is
/// a guess, and a wrong guess counts twice.
const SIGN_WIDTH: f64 = 1.0;

/// The current control of one motor.
#[derive(Debug, Clone)]
pub struct CurrentLoop {
    known: Known,
    proportional: f64,
    /// Integral gain times the PWM period.
    integral_step: f64,
    /// What the integral parts hold, in V.
    integral: [f64; 2],
    last: Sample,
}

/// What the current control saw and did in its last period, in the rotor frame as the drive knows it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Measured i_d, i_q, in A: means over the period.
    pub current: [f64; 2],
    /// Commanded v_d, v_q, in V, before any compensation: what the motor is to get on average.
    pub voltage: [f64; 2],
}

impl CurrentLoop {
    /// Gains from the motor and the delay: proportional gain = bandwidth x L.
    #[must_use]
    pub fn new(known: Known) -> Self {
        let bandwidth = BANDWIDTH_DELAY / (DELAY_PERIODS * known.pwm_period);
        let proportional = bandwidth * known.inductance;
        let integral_step = proportional * INTEGRAL_SHARE * bandwidth * known.pwm_period;
        CurrentLoop { known, proportional, integral_step, integral: [0.0; 2], last: Sample::default() }
    }

    /// The last period as the drive saw it.
    #[must_use]
    pub fn last(&self) -> Sample {
        self.last
    }

    /// The duties of the next period.
    #[must_use]
    pub fn duties(&mut self, references: &References, measured: &Measured) -> [f64; 3] {
        let Known { inductance: l, flux_linkage: lambda, pole_pairs, pwm_period, .. } = self.known;
        let w_e = pole_pairs * measured.speed_rad_s;
        let [i_d, i_q] = Angle::new(measured.angle_rad).to_rotor(from_phases(measured.currents_a));
        let turned = w_e * pwm_period;
        let ripple = turned * pwm_period / (12.0 * l);
        let [v_d, v_q] = self.last.voltage;
        let [i_d, i_q] = [i_d - ripple * v_q, i_q + ripple * v_d];
        let error = [references.i_d_a - i_d, references.i_q_a - i_q];
        let forward = [-w_e * l * i_q, w_e * (l * i_d + lambda)];
        let wanted = [0, 1].map(|k| forward[k] + self.proportional * error[k] + self.integral[k]);
        // (20): what the modulator can make without distortion.
        let longer = 1.0 + turned * turned / 24.0;
        let limit = measured.bus_voltage_v / (3f64.sqrt() * longer);
        let length = wanted[0].hypot(wanted[1]);
        let scale = if length > limit { limit / length } else { 1.0 };
        let voltage = wanted.map(|v| scale * v);
        for k in [0, 1] {
            // Anti-windup: the integral follows the error that the limited voltage would have answered.
            let answered = error[k] + (voltage[k] - wanted[k]) / self.proportional;
            self.integral[k] += self.integral_step * answered;
        }
        self.last = Sample { current: [i_d, i_q], voltage };
        // The voltage acts in the middle of the next period, 1.5 periods after the sample. The rotor has then turned by 1.5 w_e T (27 degrees at
        // 7500 rpm, 4 pole pairs and 10 kHz): without the advance that much of v_q would land on the d axis.
        let angle = Angle::new(measured.angle_rad + DELAY_PERIODS * turned);
        let mut phases = to_phases(angle.to_stator(voltage.map(|v| longer * v)));
        self.compensate_dead_time(&mut phases, &angle, references, measured.bus_voltage_v);
        modulate(phases, measured.bus_voltage_v)
    }

    /// Adds what dead time will take: V_dc t_d/T against each phase current, by the currents that are wanted in that period.
    fn compensate_dead_time(&self, phases: &mut [f64; 3], angle: &Angle, references: &References, bus_voltage: f64) {
        let loss = bus_voltage * self.known.dead_time / self.known.pwm_period;
        let currents = to_phases(angle.to_stator([references.i_d_a, references.i_q_a]));
        for (phase, current) in phases.iter_mut().zip(currents) {
            *phase += loss * (current / SIGN_WIDTH).clamp(-1.0, 1.0);
        }
    }
}

/// Phase voltages to duties. Half the sum of the largest and the smallest is taken off all three: the motor does not see it, and the reach grows from
/// V_dc/2 to V_dc/sqrt 3, the whole inscribed circle of the hexagon.
#[must_use]
pub fn modulate(phases: [f64; 3], bus_voltage_v: f64) -> [f64; 3] {
    let [a, b, c] = phases;
    let middle = 0.5 * (a.max(b).max(c) + a.min(b).min(c));
    phases.map(|phase| ((phase - middle) / bus_voltage_v + 0.5).clamp(0.0, 1.0))
}

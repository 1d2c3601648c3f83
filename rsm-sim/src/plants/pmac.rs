//! Surface permanent-magnet AC motor in the rotor frame, (17), (18), (21).
//!
//! In: voltages in the record's frame and the load torque. Out: currents in the record's frame and the mechanical speed. A record without direct
//! quantities comes from a drive that controls i_d to 0 in its own frame; then the only electrical state is its i_q. The voltages of the record are
//! applied without the limits (20); the source of the record must observe them.

use super::{Plant, Rates};
use crate::effect::{Currents, FirstInstant, Machine, Motion, Scale, Split, Windings};
use crate::hooks::Hooks;
use crate::kind::StartValues;
use crate::parameters::Parameters;
use crate::record::Record;

/// The motor.
pub struct Pmac {
    resistance: f64,
    inductance: f64,
    flux_linkage: f64,
    pole_pairs: f64,
    inertia: f64,
    viscous_friction: f64,
    drive_inertia: f64,
    holds_i_d: bool,
}

impl Pmac {
    /// The motor with these parameters.
    #[must_use]
    pub fn new(parameters: &Parameters, hooks: &Hooks, holds_i_d: bool) -> Self {
        let inertia = parameters.number("inertia");
        Pmac {
            resistance: parameters.number("phase_resistance"),
            inductance: parameters.number("phase_inductance"),
            flux_linkage: parameters.number("flux_linkage"),
            pole_pairs: parameters.number("pole_pairs"),
            inertia,
            viscous_friction: parameters.number("viscous_friction"),
            drive_inertia: inertia * hooks.drive_share(),
            holds_i_d,
        }
    }

    fn motion(&self, x: &[f64]) -> Motion {
        Motion { position: x[3], speed: x[2], viscous_friction: self.viscous_friction }
    }
}

impl Plant for Pmac {
    const STATES: usize = 4;

    fn start(&self, hooks: &Hooks, outputs: &StartValues, record: &Record, _inputs: &[f64; 3], x: &mut [f64]) {
        let theta = record.start("angle").unwrap_or(0.0);
        let (sin, cos) = hooks.frame_angle(theta).sin_cos();
        if self.holds_i_d {
            (x[0], x[1]) = (0.0, outputs[1]);
        } else {
            (x[0], x[1]) = (cos * outputs[0] - sin * outputs[1], sin * outputs[0] + cos * outputs[1]);
        }
        (x[2], x[3]) = (outputs[2], theta);
        hooks.start(&FirstInstant { motion: self.motion(x), road_speed: 0.0, time: record.first_time() }, x);
    }

    fn evaluate(
        &self,
        hooks: &Hooks,
        held: Option<u32>,
        inputs: &[f64; 3],
        x: &[f64],
        dx: &mut [f64],
        outputs: &mut [f64; 3],
    ) -> u32 {
        let (speed, theta) = (x[2], x[3]);
        let delta = hooks.frame_angle(theta);
        let (sin, cos) = if delta == 0.0 { (0.0, 1.0) } else { delta.sin_cos() };
        let (i_d, i_q) = if self.holds_i_d { (-sin * x[1], cos * x[1]) } else { (x[0], x[1]) };
        let mut machine = Machine { resistance: self.resistance, inductance: self.inductance, flux_linkage: self.flux_linkage };
        hooks.machine(&Currents { i_d, i_q, theta_e: self.pole_pairs * theta }, x, dx, &mut machine);
        let (r, l, lambda) = (machine.resistance, machine.inductance, machine.flux_linkage);
        let w_e = self.pole_pairs * speed;
        // Equations (17), (18) without the voltages.
        let free_d = -r * i_d + w_e * l * i_q;
        let free_q = -r * i_q - w_e * (l * i_d + lambda);
        if self.holds_i_d {
            // In the drive's own frame i_d is 0 and remains 0, so only the current of the q axis of this frame changes. The rotation of the frame
            // against the rotor has no effect, because it multiplies this i_d.
            let [_, v_q] = hooks.voltage([0.0, inputs[1]], [0.0, x[1]]);
            dx[0] = 0.0;
            dx[1] = (v_q - sin * free_d + cos * free_q) / l;
            (outputs[0], outputs[1]) = (0.0, x[1]);
        } else {
            let turned = [cos * inputs[0] - sin * inputs[1], sin * inputs[0] + cos * inputs[1]];
            let [v_d, v_q] = hooks.voltage(turned, [i_d, i_q]);
            dx[0] = (v_d + free_d) / l;
            dx[1] = (v_q + free_q) / l;
            (outputs[0], outputs[1]) = (cos * i_d + sin * i_q, -sin * i_d + cos * i_q);
        }
        outputs[2] = speed;
        // Equation (21).
        let torque = 1.5 * self.pole_pairs * lambda * i_q;
        let motion = self.motion(x);
        let load = hooks.load(&Split { near: motion, inertia: self.inertia, load: inputs[2], held }, x, dx);
        dx[2] = (torque - self.viscous_friction * speed + hooks.effort(&motion) - load.effort) / self.drive_inertia;
        dx[3] = speed;
        load.piece
    }

    fn rates(&self, hooks: &Hooks, x: &[f64], dx: &[f64], span: f64) -> Rates {
        // `hypot` is not used: its protection against overflow makes it three times slower.
        let long = |a: f64, b: f64| (a * a + b * b).sqrt();
        let (length, change) = (long(x[0], x[1]), long(dx[0], dx[1]));
        // The time at which the current vector, extrapolated linearly, has its minimum length.
        let along = -(x[0] * dx[0] + x[1] * dx[1]);
        let nearest = if along > 0.0 { (along / (change * change)).min(span) } else { 0.0 };
        let least = long(x[0] + nearest * dx[0], x[1] + nearest * dx[1]);
        let current = (least, length + span * change);
        let own = self.resistance / self.inductance + self.viscous_friction / self.drive_inertia;
        let swing = (1.5 / (self.inductance * self.drive_inertia)).sqrt() * self.pole_pairs * self.flux_linkage;
        let turning = self.pole_pairs * x[2].abs();
        let scale = Scale {
            windings: Windings { inductance: self.inductance, decay: own, swing, turning, current, change },
            ..Scale::of(self.inertia, self.drive_inertia, (x[2], dx[2]), span)
        };
        // The products of speed and current are nonlinear; their rates are the electrical speed and the oscillation of current against speed. Linear
        // parts that decay faster (a current in a small inductance, the lag of a sensor, a stiff shaft) are solved by the exponential method, with an
        // error of 5e-5 of the largest current (measured).
        let machine = swing.max(turning);
        let fastest = own.max(machine).max(hooks.fastest_rate(&scale));
        Rates { fastest, excited: fastest, nonlinear: machine.max(hooks.nonlinear_rate(&scale)), varying: own }
    }
}

//! A driven linear axis: drive, screw or rack, carriage.
//!
//! In: the command, or in closed loop the reference. Out: the position, and in closed loop the command. The controller is part of the drive: it
//! measures the true position. Its command is computed at the instants of the record and is constant between them.

use super::{Plant, Rates};
use crate::effect::{FirstInstant, Motion, Scale, Split};
use crate::hooks::Hooks;
use crate::kind::StartValues;
use crate::parameters::{Parameters, VelocityFrom};
use crate::record::Record;

/// The axis.
pub struct ServoAxis {
    mass: f64,
    force_gain: f64,
    viscous_friction: f64,
    drive_mass: f64,
    command_limit: f64,
    gains: Option<(f64, f64)>,
    velocity_from: VelocityFrom,
}

impl ServoAxis {
    /// The axis with these parameters.
    #[must_use]
    pub fn new(parameters: &Parameters, hooks: &Hooks) -> Self {
        let mass = parameters.number("mass");
        ServoAxis {
            mass,
            force_gain: parameters.number("force_gain"),
            viscous_friction: parameters.number("viscous_friction"),
            drive_mass: mass * hooks.drive_share(),
            command_limit: parameters.number("command_limit"),
            gains: parameters.optional("position_gain").zip(parameters.optional("velocity_gain")),
            velocity_from: parameters.velocity_from,
        }
    }

    fn motion(&self, x: &[f64]) -> Motion {
        Motion { position: x[0], speed: x[1], viscous_friction: self.viscous_friction }
    }
}

impl Plant for ServoAxis {
    const STATES: usize = 2;

    fn start(&self, hooks: &Hooks, outputs: &StartValues, record: &Record, _inputs: &[f64; 3], x: &mut [f64]) {
        (x[0], x[1]) = (outputs[0], outputs[1]);
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
        let motion = self.motion(x);
        let load = hooks.load(&Split { near: motion, inertia: self.mass, load: 0.0, held }, x, dx);
        let force = self.force_gain * inputs[0] - self.viscous_friction * x[1] + hooks.effort(&motion) - load.effort;
        dx[0] = x[1];
        dx[1] = force / self.drive_mass;
        // The output is the command of the controller, before delays and gains. It has its own place among the inputs.
        (outputs[0], outputs[1]) = (x[0], inputs[1]);
        load.piece
    }

    fn rates(&self, hooks: &Hooks, x: &[f64], dx: &[f64], span: f64) -> Rates {
        let scale = Scale::of(self.mass, self.drive_mass, (x[1], dx[1]), span);
        let fastest = (self.viscous_friction / self.drive_mass).max(hooks.fastest_rate(&scale));
        Rates { fastest, excited: fastest, nonlinear: hooks.nonlinear_rate(&scale), varying: hooks.sum_of_rates(&scale) }
    }

    fn command(&self, reference: f64, x: &[f64], positions: [f64; 3], period: f64) -> f64 {
        let Some((position_gain, velocity_gain)) = self.gains else { return 0.0 };
        let speed = match self.velocity_from {
            VelocityFrom::State => x[1],
            // The formula ((q_k + q_k-1)/2 - (q_k-1 + q_k-2)/2)/T.
            VelocityFrom::Difference => (positions[0] - positions[2]) / (2.0 * period),
        };
        let command = velocity_gain * (position_gain * (reference - positions[0]) - speed);
        // `clamp` is not used: it panics if the limit is NaN. With these comparisons a command of NaN reaches the check of the integrator.
        if command > self.command_limit {
            self.command_limit
        } else if command < -self.command_limit {
            -self.command_limit
        } else {
            command
        }
    }
}

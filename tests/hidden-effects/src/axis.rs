//! The servo axis. Its states are the position of the drive and the lag of the carriage behind it.
//!
//! In: a command, or a reference that a controller follows. Out: the position; in closed loop also the command. The controller uses the true
//! position, as in docs/book/src/reference/plants.md.

use crate::flow::{Flow, STATES, State, Stepper};
use crate::plant::{Delay, Kind, Plant, Truth};

const POSITION: usize = 0;
const SPEED: usize = 1;
/// Drive position minus carriage position.
const TWIST: usize = 2;
const CARRIAGE_SPEED: usize = 3;
/// Deflection of the bristle of a friction with memory.
const BRISTLE: usize = 4;
const LAG: usize = 5;
const TIME: usize = 6;

/// The joint between the drive and the carriage behind it.
struct Joint {
    ratio: f64,
    stiffness: f64,
    damping: f64,
    gap: f64,
}

struct Law {
    mass: f64,
    force_gain: f64,
    joint: Option<Joint>,
    // Effects of the catalogue.
    coulomb: f64,
    forward: f64,
    backward: f64,
    viscous_forward: f64,
    viscous_backward: f64,
    stribeck_coulomb: f64,
    stribeck_static: f64,
    stribeck_velocity: f64,
    constant_load: f64,
    load_drift: f64,
    cogging: f64,
    pitch: f64,
    phase: f64,
    gain: f64,
    lag: Option<f64>,
    // Effects outside the catalogue.
    square: f64,
    bristle_force: f64,
    bristle_length: f64,
    friction_swing: f64,
    friction_period: f64,
    /// The constant command.
    command: f64,
}

struct Controller {
    position_gain: f64,
    velocity_gain: f64,
    limit: f64,
    from_difference: bool,
    period: f64,
    /// Positions of the last two rows. Before the record the axis stood at its start position.
    past: [f64; 2],
    command: f64,
}

/// A running axis.
pub struct Axis {
    law: Law,
    controller: Option<Controller>,
    y: State,
    stepper: Stepper,
    delay: Delay,
}

impl Axis {
    /// An axis at rest at 0.
    pub fn new(truth: &Truth, period: f64) -> Self {
        let of = |name| truth.parameters.get(name);
        let viscous = of("viscous_friction");
        let joint = |kind, ratio| {
            Some(Joint {
                ratio: truth.effect(kind, ratio)?,
                stiffness: truth.effect(kind, "stiffness")?,
                damping: truth.effect(kind, "damping")?,
                gap: truth.or(kind, "gap", 0.0),
            })
        };
        let law = Law {
            mass: of("mass"),
            force_gain: of("force_gain"),
            joint: joint("shaft-compliance", "inertia_ratio").or(joint("backlash", "mass_ratio")),
            coulomb: truth.or("coulomb-friction", "force", 0.0),
            forward: truth.or("asymmetric-friction", "forward", 0.0),
            backward: truth.or("asymmetric-friction", "backward", 0.0),
            viscous_forward: truth.or("asymmetric-friction", "viscous_forward", viscous),
            viscous_backward: truth.or("asymmetric-friction", "viscous_backward", viscous),
            stribeck_coulomb: truth.or("stribeck-friction", "coulomb", 0.0),
            stribeck_static: truth.or("stribeck-friction", "static", 0.0),
            stribeck_velocity: truth.or("stribeck-friction", "stribeck_velocity", 1.0),
            constant_load: truth.or("constant-load", "force", 0.0),
            load_drift: truth.or("load-drift", "force_rate", 0.0),
            cogging: truth.or("cogging-torque", "amplitude", 0.0),
            pitch: truth.or("cogging-torque", "pitch", 1.0),
            phase: truth.or("cogging-torque", "phase", 0.0),
            gain: truth.or("input-gain", "gain", 1.0),
            lag: truth.lags()[0],
            square: truth.or("square-spring", "stiffness", 0.0),
            bristle_force: truth.or("hysteresis", "force", 0.0),
            bristle_length: truth.or("hysteresis", "length", 1.0),
            friction_swing: truth.or("breathing-friction", "share", 0.0),
            friction_period: truth.or("breathing-friction", "period", 1.0),
            command: 0.0,
        };
        let controller = (truth.kind == Kind::ClosedAxis).then(|| Controller {
            position_gain: of("position_gain"),
            velocity_gain: of("velocity_gain"),
            limit: of("command_limit"),
            from_difference: truth.parameters.velocity_from_difference,
            period,
            past: [0.0; 2],
            command: 0.0,
        });
        let delay = Delay::new(truth.or("input-delay", "delay", 0.0), period);
        Axis { law, controller, y: [0.0; STATES], stepper: Stepper::new(0.1 * period), delay }
    }
}

/// The scales of the states: positions to 1e-7 of a decimetre, twists of a tenth of a millimetre.
const SCALE: State = [0.01, 0.01, 1e-4, 0.01, 1e-3, 0.01, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

impl Law {
    fn friction(&self, v: f64, time: f64) -> f64 {
        // With v_s = 1 mm/s.
        let sign = (v / 1e-3).tanh();
        let (level, viscous) =
            if v < 0.0 { (self.backward, self.viscous_backward) } else { (self.forward, self.viscous_forward) };
        let breath = 1.0 + self.friction_swing * (std::f64::consts::TAU * time / self.friction_period).sin();
        let stribeck = self.stribeck_coulomb
            + (self.stribeck_static - self.stribeck_coulomb) * (-(v / self.stribeck_velocity).powi(2)).exp();
        viscous * breath * v + (self.coulomb + level + stribeck) * sign
    }
}

impl Flow for Law {
    /// The direction of motion, and twice the contact (0 open, 1 the drive pushes forward, 2 it pulls back).
    fn regime(&self, y: &State) -> u8 {
        let contact = match &self.joint {
            Some(joint) if joint.gap > 0.0 => {
                if y[TWIST] > 0.5 * joint.gap {
                    1
                } else {
                    2 * u8::from(y[TWIST] < -0.5 * joint.gap)
                }
            }
            _ => 1,
        };
        u8::from(y[SPEED] < 0.0) + 2 * contact
    }

    fn derivative(&self, y: &State, regime: u8) -> State {
        let mut dy = [0.0; STATES];
        let v = y[SPEED];
        dy[POSITION] = v;
        dy[TIME] = 1.0;
        // The model of P. Dahl, "A solid friction model", 1968: dz/dt = v (1 - sign(v) z/length), force along z.
        dy[BRISTLE] = v - v.abs() * y[BRISTLE] / self.bristle_length;
        let mut force = self.gain * self.force_gain * self.command
            - self.friction(v, y[TIME])
            - self.constant_load
            - self.load_drift * y[TIME]
            - self.square * y[POSITION] * y[POSITION]
            - self.bristle_force * y[BRISTLE] / self.bristle_length
            + self.cogging * (std::f64::consts::TAU * y[POSITION] / self.pitch + self.phase).sin();
        let mut mass = self.mass;
        if let Some(joint) = &self.joint {
            let side = match regime / 2 {
                1 => Some(0.5 * joint.gap),
                2 => Some(-0.5 * joint.gap),
                _ => None,
            };
            let pushed = side.map_or(0.0, |side| joint.stiffness * (y[TWIST] - side) + joint.damping * (v - y[CARRIAGE_SPEED]));
            force -= pushed;
            mass = (1.0 - joint.ratio) * self.mass;
            dy[TWIST] = v - y[CARRIAGE_SPEED];
            dy[CARRIAGE_SPEED] = pushed / (joint.ratio * self.mass);
        }
        dy[SPEED] = force / mass;
        if let Some(time_constant) = self.lag {
            dy[LAG] = (y[POSITION] - y[LAG]) / time_constant;
        }
        dy
    }

    fn scale(&self) -> &State {
        &SCALE
    }
}

impl Plant for Axis {
    fn hold(&mut self, inputs: &[f64]) {
        let command = match &mut self.controller {
            None => inputs[0],
            Some(it) => {
                let q = self.y[POSITION];
                let v = if it.from_difference {
                    // The backward difference of the mean of two samples: (q_k + q_(k-1))/2 minus (q_(k-1) + q_(k-2))/2, over a period.
                    (q - it.past[1]) / (2.0 * it.period)
                } else {
                    self.y[SPEED]
                };
                it.past = [q, it.past[0]];
                it.command = (it.velocity_gain * (it.position_gain * (inputs[0] - q) - v)).clamp(-it.limit, it.limit);
                it.command
            }
        };
        self.delay.push(vec![command]);
    }

    fn advance(&mut self, period: f64) {
        for (duration, command) in self.delay.parts(period) {
            self.law.command = command[0];
            self.stepper.advance(&self.law, &mut self.y, duration);
        }
    }

    fn outputs(&self) -> Vec<f64> {
        let position = if self.law.lag.is_some() { self.y[LAG] } else { self.y[POSITION] };
        std::iter::once(position).chain(self.controller.as_ref().map(|it| it.command)).collect()
    }
}

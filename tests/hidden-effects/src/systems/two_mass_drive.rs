//! `examples/plants/two-mass-drive`: a motor drives a load through an elastic shaft.
//!
//! In: torque. Out: speeds of motor and load, angle of the load. The states are the two speeds, the angle of the motor and that of the load.

use super::body::{Body, Joint, Motion};
use super::{Drive, Input, Law, Output, Outside, Site, SiteKind, Slots, Steps, System, TIME, Truth};
use crate::flow::State;
use crate::random::Random;

/// The plant.
pub const SYSTEM: System = System {
    name: "two-mass-drive",
    text: include_str!("../../../../examples/plants/two-mass-drive/two-mass-drive.mo"),
    file: include_str!("../../../../examples/plants/two-mass-drive/plant.toml"),
    inputs: &[Input { name: "torque", unit: "N*m", range: (-2.5, 2.5), commands: true }],
    outputs: &[
        Output { name: "motor_speed", unit: "rad/s", noise: 0.05, range: (-40.0, 40.0) },
        Output { name: "load_speed", unit: "rad/s", noise: 0.05, range: (-40.0, 40.0) },
        Output { name: "load_angle", unit: "rad", noise: 0.002, range: (-15.0, 15.0) },
    ],
    parameters: &[
        ("motor_inertia", 0.002),
        ("load_inertia", 0.006),
        ("stiffness", 14.0),
        ("damping", 0.02),
        ("motor_friction", 0.008),
        ("load_friction", 0.012),
    ],
    tolerance: &[
        ("load_inertia", 0.05),
        ("stiffness", 0.1),
        ("damping", 0.2),
        ("motor_friction", 0.15),
        ("load_friction", 0.15),
    ],
    sites: &[
        Site { name: "motor", kind: SiteKind::Rotation, effort: 1.0, speed: 20.0, position: 6.0, inertia: 0.002 },
        Site { name: "load", kind: SiteKind::Rotation, effort: 1.0, speed: 20.0, position: 6.0, inertia: 0.006 },
        Site { name: "shaft", kind: SiteKind::Joint, effort: 1.0, speed: 5.0, position: 0.08, inertia: 0.0 },
    ],
    period: 0.002,
    rows: 3000,
    build: |truth, slots| Box::new(TwoMassDrive::new(truth, slots)),
    drive,
    changes: "load_friction",
};

struct TwoMassDrive {
    motor_inertia: f64,
    load_inertia: f64,
    stiffness: f64,
    damping: f64,
    motor_friction: f64,
    load_friction: f64,
    motor: Body,
    load: Body,
    shaft: Joint,
    outside: Outside,
    /// Motor and load.
    speeds: [usize; 2],
    angles: [usize; 2],
}

impl TwoMassDrive {
    fn new(truth: &Truth, slots: &mut Slots) -> Self {
        let of = |name| truth.get(name);
        TwoMassDrive {
            speeds: [slots.take(), slots.take()],
            angles: [slots.take(), slots.take()],
            motor_inertia: of("motor_inertia"),
            load_inertia: of("load_inertia"),
            stiffness: of("stiffness"),
            damping: of("damping"),
            motor_friction: of("motor_friction"),
            load_friction: of("load_friction"),
            motor: Body::new(truth, &SYSTEM.sites[0], slots),
            load: Body::new(truth, &SYSTEM.sites[1], slots),
            shaft: Joint::new(truth, &SYSTEM.sites[2], slots),
            outside: Outside::new(truth),
        }
    }

    fn twist(&self, y: &State) -> f64 {
        y[self.angles[0]] - y[self.angles[1]]
    }
}

impl Law for TwoMassDrive {
    fn start(&self, outputs: &[f64], _inputs: &[f64], y: &mut State) {
        (y[self.speeds[0]], y[self.speeds[1]]) = (outputs[0], outputs[1]);
        // The shaft starts without twist.
        (y[self.angles[0]], y[self.angles[1]]) = (outputs[2], outputs[2]);
        self.motor.start(outputs[2], outputs[0], y);
        self.load.start(outputs[2], outputs[1], y);
    }

    fn rates(&self, inputs: &[f64], y: &State, regime: u8, dy: &mut State) {
        let [fast, slow] = self.speeds.map(|state| y[state]);
        let spring = |twist: f64, rate: f64| self.stiffness * twist + self.damping * rate;
        let torque = self.shaft.effort(spring, self.twist(y), fast - slow, regime, y, dy);
        let load_friction = self.load_friction * self.outside.factor(y[TIME]);
        let motor = Motion {
            position: y[self.angles[0]],
            speed: fast,
            inertia: self.motor_inertia,
            beside: 0.0,
            effort: inputs[0] - self.motor_friction * fast - torque,
            load: 0.0,
            viscous: self.motor_friction,
            drive: inputs[0],
        };
        let load = Motion {
            position: y[self.angles[1]],
            speed: slow,
            inertia: self.load_inertia,
            beside: 0.0,
            effort: torque - load_friction * slow + self.outside.gust(y[TIME]) + self.outside.law(slow),
            load: 0.0,
            viscous: self.load_friction,
            drive: 0.0,
        };
        dy[self.speeds[0]] = self.motor.acceleration(&motor, y, dy);
        dy[self.speeds[1]] = self.load.acceleration(&load, y, dy);
        (dy[self.angles[0]], dy[self.angles[1]]) = (fast, slow);
    }

    fn outputs(&self, y: &State) -> Vec<f64> {
        vec![y[self.speeds[0]], y[self.speeds[1]], y[self.angles[1]]]
    }

    fn regime(&self, y: &State) -> u8 {
        self.shaft.regime(self.twist(y))
    }

    fn scale(&self, scale: &mut State) {
        self.speeds.iter().for_each(|state| scale[*state] = 0.1);
        self.angles.iter().for_each(|state| scale[*state] = 0.001);
        self.motor.scale(&SYSTEM.sites[0], scale);
        self.load.scale(&SYSTEM.sites[1], scale);
        self.shaft.scale(&SYSTEM.sites[2], scale);
    }
}

/// Speeds in both directions, a third of them slow, with a soft speed controller, and an additional binary sequence of torque.
fn drive(mut random: Random, period: f64) -> (Vec<f64>, Drive) {
    let (mut target, mut binary) = (Steps::new(), Steps::new());
    let mut sense = random.sign();
    let ms = 0.001 / period;
    let drive = move |row: usize, read: &[f64]| {
        let target = target.at(row, &mut random, (200.0 * ms, 600.0 * ms), |it| {
            sense = -sense;
            sense * if it.uniform(0.0, 1.0) < 0.35 { it.uniform(1.0, 6.0) } else { it.uniform(8.0, 35.0) }
        });
        let extra = binary.at(row, &mut random, (6.0 * ms, 50.0 * ms), |it| 0.4 * it.sign());
        vec![(0.04 * (target - read[0]) + 0.02 * target).clamp(-2.1, 2.1) + extra]
    };
    (vec![0.0; 3], Box::new(drive))
}

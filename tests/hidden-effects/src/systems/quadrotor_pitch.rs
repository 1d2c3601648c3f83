//! `examples/plants/quadrotor-pitch`: the pitch axis of a quadrotor in a gimbal.
//!
//! In: demanded thrusts of front and rear rotors. Out: pitch rate and pitch.

use super::body::{Body, Motion};
use super::{Drive, Input, Law, Output, Outside, Site, SiteKind, Slots, Steps, System, TIME, Truth};
use crate::flow::State;
use crate::random::Random;

/// The plant.
pub const SYSTEM: System = System {
    name: "quadrotor-pitch",
    text: include_str!("../../../../examples/plants/quadrotor-pitch/quadrotor-pitch.mo"),
    file: include_str!("../../../../examples/plants/quadrotor-pitch/plant.toml"),
    inputs: &[
        Input { name: "front", unit: "N", range: (3.5, 8.5), commands: true },
        Input { name: "rear", unit: "N", range: (3.5, 8.5), commands: true },
    ],
    outputs: &[
        Output { name: "pitch_rate", unit: "rad/s", noise: 0.01, range: (-2.0, 2.0) },
        Output { name: "pitch", unit: "rad", noise: 0.004, range: (-0.5, 0.5) },
    ],
    parameters: &[("inertia", 0.015), ("arm", 0.2), ("rotor_lag", 0.05), ("mass", 1.2), ("hang", 0.01), ("damping", 0.02)],
    tolerance: &[("inertia", 0.05), ("rotor_lag", 0.1), ("hang", 0.1), ("damping", 0.2)],
    sites: &[Site { name: "body", kind: SiteKind::Rotation, effort: 0.2, speed: 1.5, position: 0.4, inertia: 0.015 }],
    period: 0.005,
    rows: 3000,
    build: |truth, slots| Box::new(QuadrotorPitch::new(truth, slots)),
    drive,
    changes: "damping",
};

struct QuadrotorPitch {
    inertia: f64,
    arm: f64,
    lag: f64,
    /// Weight times the height of the axis above the centre of mass.
    restoring: f64,
    damping: f64,
    body: Body,
    outside: Outside,
    rate: usize,
    pitch: usize,
    thrust: [usize; 2],
}

impl QuadrotorPitch {
    fn new(truth: &Truth, slots: &mut Slots) -> Self {
        QuadrotorPitch {
            rate: slots.take(),
            pitch: slots.take(),
            thrust: [slots.take(), slots.take()],
            inertia: truth.get("inertia"),
            arm: truth.get("arm"),
            lag: truth.get("rotor_lag"),
            restoring: truth.get("mass") * 9.80665 * truth.get("hang"),
            damping: truth.get("damping"),
            body: Body::new(truth, &SYSTEM.sites[0], slots),
            outside: Outside::new(truth),
        }
    }
}

impl Law for QuadrotorPitch {
    fn start(&self, outputs: &[f64], inputs: &[f64], y: &mut State) {
        (y[self.rate], y[self.pitch]) = (outputs[0], outputs[1]);
        (y[self.thrust[0]], y[self.thrust[1]]) = (inputs[0], inputs[1]);
        self.body.start(outputs[1], outputs[0], y);
    }

    fn rates(&self, inputs: &[f64], y: &State, _regime: u8, dy: &mut State) {
        let (rate, pitch) = (y[self.rate], y[self.pitch]);
        let [front, rear] = self.thrust.map(|state| y[state]);
        let drive = self.arm * (front - rear);
        let damping = self.damping * self.outside.factor(y[TIME]);
        let motion = Motion {
            position: pitch,
            speed: rate,
            inertia: self.inertia,
            beside: 0.0,
            effort: drive - damping * rate - self.restoring * pitch.sin() + self.outside.gust(y[TIME]) + self.outside.law(rate),
            load: 0.0,
            viscous: damping,
            drive,
        };
        dy[self.rate] = self.body.acceleration(&motion, y, dy);
        dy[self.pitch] = rate;
        dy[self.thrust[0]] = (inputs[0] - front) / self.lag;
        dy[self.thrust[1]] = (inputs[1] - rear) / self.lag;
    }

    fn outputs(&self, y: &State) -> Vec<f64> {
        vec![y[self.rate], y[self.pitch]]
    }

    fn scale(&self, scale: &mut State) {
        (scale[self.rate], scale[self.pitch]) = (0.02, 0.005);
        self.thrust.iter().for_each(|state| scale[*state] = 0.1);
        self.body.scale(&SYSTEM.sites[0], scale);
    }
}

/// Pitch angles in both directions with an attitude controller, and a binary sequence on each pair of rotors.
fn drive(mut random: Random, period: f64) -> (Vec<f64>, Drive) {
    let (mut target, mut front, mut rear, mut lift) = (Steps::new(), Steps::new(), Steps::new(), Steps::new());
    let ms = 0.001 / period;
    let drive = move |row: usize, read: &[f64]| {
        let target = target.at(row, &mut random, (400.0 * ms, 1500.0 * ms), |it| it.uniform(-0.4, 0.4));
        let front = front.at(row, &mut random, (25.0 * ms, 150.0 * ms), |it| 0.3 * it.sign());
        let rear = rear.at(row, &mut random, (25.0 * ms, 150.0 * ms), |it| 0.3 * it.sign());
        let lift = lift.at(row, &mut random, (500.0 * ms, 2000.0 * ms), |it| it.uniform(5.0, 7.0));
        let (rate, pitch) = (read[0], read[1]);
        // The controller has 6 rad/s and half of critical damping, for 0.015 kg m^2 on two arms of 0.2 m.
        let half = (0.54 * (target - pitch) - 0.11 * rate) / 0.4;
        vec![lift + half.clamp(-1.0, 1.0) + front, lift - half.clamp(-1.0, 1.0) + rear]
    };
    (vec![0.0, 0.0], Box::new(drive))
}

//! `examples/plants/gear-motor`: a DC motor with a rigid gearbox.
//!
//! In: voltage and load. Out: current and speed of the output shaft. The gear is eliminated: one inertia at the output shaft.

use super::body::{Body, Motion};
use super::{Drive, Input, Law, Output, Outside, Site, SiteKind, Slots, Steps, System, TIME, Truth};
use crate::flow::State;
use crate::random::Random;

/// The plant.
pub const SYSTEM: System = System {
    name: "gear-motor",
    text: include_str!("../../../../examples/plants/gear-motor/gear-motor.mo"),
    file: include_str!("../../../../examples/plants/gear-motor/plant.toml"),
    inputs: &[
        Input { name: "voltage", unit: "V", range: (-24.0, 24.0), commands: true },
        Input { name: "load", unit: "N*m", range: (-2.0, 2.0), commands: false },
    ],
    outputs: &[
        Output { name: "current", unit: "A", noise: 0.03, range: (-8.0, 8.0) },
        Output { name: "speed", unit: "rad/s", noise: 0.03, range: (-20.0, 20.0) },
    ],
    parameters: &[
        ("resistance", 1.2),
        ("inductance", 0.004),
        ("torque_constant", 0.05),
        ("rotor_inertia", 4e-5),
        ("gear_ratio", 20.0),
        ("load_inertia", 0.02),
        ("viscous_friction", 0.05),
    ],
    tolerance: &[
        ("resistance", 0.05),
        ("inductance", 0.05),
        ("torque_constant", 0.03),
        ("load_inertia", 0.05),
        ("viscous_friction", 0.1),
    ],
    sites: &[
        Site { name: "shaft", kind: SiteKind::Rotation, effort: 2.0, speed: 10.0, position: 6.0, inertia: 0.02 },
        Site { name: "armature", kind: SiteKind::Winding, effort: 12.0, speed: 4.0, position: 0.0, inertia: 0.004 },
    ],
    period: 0.002,
    rows: 3000,
    build: |truth, slots| Box::new(GearMotor::new(truth, slots)),
    drive,
    changes: "viscous_friction",
};

struct GearMotor {
    resistance: f64,
    inductance: f64,
    torque_constant: f64,
    /// The inertia of the rotor, at the output shaft.
    reflected: f64,
    gear_ratio: f64,
    load_inertia: f64,
    viscous_friction: f64,
    shaft: Body,
    dead_time: f64,
    saturation_current: f64,
    /// Thermal resistance, time constant, state index.
    heating: Option<(f64, f64, usize)>,
    outside: Outside,
    current: usize,
    speed: usize,
    angle: usize,
}

impl GearMotor {
    fn new(truth: &Truth, slots: &mut Slots) -> Self {
        let of = |name| truth.get(name);
        let (current, speed, angle) = (slots.take(), slots.take(), slots.take());
        let heats = truth.effect("armature", "resistance-heating", "thermal_resistance");
        GearMotor {
            resistance: of("resistance"),
            inductance: of("inductance"),
            torque_constant: of("torque_constant"),
            reflected: of("gear_ratio").powi(2) * of("rotor_inertia"),
            gear_ratio: of("gear_ratio"),
            load_inertia: of("load_inertia"),
            viscous_friction: of("viscous_friction"),
            shaft: Body::new(truth, &SYSTEM.sites[0], slots),
            dead_time: truth.or("armature", "inverter-dead-time", "voltage_loss", 0.0),
            saturation_current: truth.or("armature", "magnetic-saturation", "saturation_current", f64::INFINITY),
            heating: heats
                .map(|it| (it, truth.or("armature", "resistance-heating", "thermal_time_constant", 1.0), slots.take())),
            outside: Outside::new(truth),
            current,
            speed,
            angle,
        }
    }
}

impl Law for GearMotor {
    fn start(&self, outputs: &[f64], _inputs: &[f64], y: &mut State) {
        (y[self.current], y[self.speed]) = (outputs[0], outputs[1]);
        self.shaft.start(0.0, outputs[1], y);
    }

    fn rates(&self, inputs: &[f64], y: &State, _regime: u8, dy: &mut State) {
        let (i, w, angle) = (y[self.current], y[self.speed], y[self.angle]);
        let warm = self.heating.map_or(0.0, |(.., state)| y[state]);
        // The temperature coefficient of copper.
        let resistance = self.resistance * (1.0 + 0.00393 * warm);
        if let Some((kelvin_per_watt, time_constant, state)) = self.heating {
            dy[state] = (kelvin_per_watt * resistance * i * i - warm) / time_constant;
        }
        let inductance = self.inductance / (1.0 + (i / self.saturation_current).powi(2));
        let lost = self.dead_time * i / (i * i + 0.25).sqrt();
        let constant = self.gear_ratio * self.torque_constant;
        dy[self.current] = (inputs[0] - lost - resistance * i - constant * w) / inductance;
        let viscous = self.viscous_friction * self.outside.factor(y[TIME]);
        let motion = Motion {
            position: angle,
            speed: w,
            inertia: self.load_inertia,
            beside: self.reflected,
            effort: constant * i - viscous * w + self.outside.gust(y[TIME]) + self.outside.law(w),
            load: inputs[1],
            viscous,
            drive: constant * i,
        };
        dy[self.speed] = self.shaft.acceleration(&motion, y, dy);
        dy[self.angle] = w;
    }

    fn outputs(&self, y: &State) -> Vec<f64> {
        vec![y[self.current], y[self.speed]]
    }

    fn scale(&self, scale: &mut State) {
        (scale[self.current], scale[self.speed], scale[self.angle]) = (0.1, 0.1, 0.1);
        self.shaft.scale(&SYSTEM.sites[0], scale);
    }
}

/// Steps of the voltage in both directions, a third of them slow, with an additional binary sequence; steps of the load.
fn drive(mut random: Random, period: f64) -> (Vec<f64>, Drive) {
    let (mut voltage, mut binary, mut load) = (Steps::new(), Steps::new(), Steps::new());
    let mut sense = random.sign();
    let ms = 0.001 / period;
    let drive = move |row: usize, _: &[f64]| {
        let step = voltage.at(row, &mut random, (120.0 * ms, 500.0 * ms), |it| {
            sense = -sense;
            sense * if it.uniform(0.0, 1.0) < 0.35 { it.uniform(0.5, 4.0) } else { it.uniform(5.0, 21.0) }
        });
        let extra = binary.at(row, &mut random, (6.0 * ms, 40.0 * ms), |it| 2.0 * it.sign());
        let load = load.at(row, &mut random, (150.0 * ms, 500.0 * ms), |it| it.uniform(-2.0, 2.0));
        vec![step + extra, load]
    };
    (vec![0.0, 0.0], Box::new(drive))
}

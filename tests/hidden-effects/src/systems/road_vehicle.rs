//! `examples/plants/road-vehicle`: longitudinal motion of a car.
//!
//! In: torque at the wheels and slope of the road. Out: speed. The state is the speed of the wheels; with tyre slip, the speed of the car is
//! different.

use super::body::{Body, Motion};
use super::{Drive, Input, Law, Output, Outside, Site, SiteKind, Slots, Steps, System, TIME, Truth};
use crate::flow::State;
use crate::random::Random;

/// The plant.
pub const SYSTEM: System = System {
    name: "road-vehicle",
    text: include_str!("../../../../examples/plants/road-vehicle/road-vehicle.mo"),
    file: include_str!("../../../../examples/plants/road-vehicle/plant.toml"),
    inputs: &[
        Input { name: "torque", unit: "N*m", range: (-500.0, 900.0), commands: true },
        Input { name: "slope", unit: "rad", range: (-0.04, 0.04), commands: false },
    ],
    outputs: &[Output { name: "speed", unit: "m/s", noise: 0.03, range: (3.0, 35.0) }],
    parameters: &[
        ("mass", 1450.0),
        ("wheel_inertia", 4.0),
        ("wheel_radius", 0.31),
        ("rolling_resistance", 0.011),
        ("rolling_growth", 1e-4),
        ("drag_area", 0.66),
        ("air_density", 1.2),
    ],
    tolerance: &[("mass", 0.03), ("rolling_resistance", 0.1), ("drag_area", 0.05)],
    sites: &[
        Site { name: "car", kind: SiteKind::Vehicle, effort: 300.0, speed: 20.0, position: 0.0, inertia: 1450.0 },
        Site { name: "motion", kind: SiteKind::Translation, effort: 1000.0, speed: 20.0, position: 0.0, inertia: 1450.0 },
    ],
    period: 0.2,
    rows: 2500,
    build: |truth, slots| Box::new(RoadVehicle::new(truth, slots)),
    drive,
    changes: "rolling_resistance",
};

struct RoadVehicle {
    mass: f64,
    wheel_inertia: f64,
    radius: f64,
    rolling: f64,
    growth: f64,
    /// Half of density times area.
    drag: f64,
    motion: Body,
    brake: f64,
    wind: f64,
    /// Stiffness and state index of tyres with slip.
    tyre: Option<(f64, usize)>,
    outside: Outside,
    wheel: usize,
}

impl RoadVehicle {
    fn new(truth: &Truth, slots: &mut Slots) -> Self {
        let of = |name| truth.get(name);
        let wheel = slots.take();
        RoadVehicle {
            mass: of("mass"),
            wheel_inertia: of("wheel_inertia"),
            radius: of("wheel_radius"),
            rolling: of("rolling_resistance"),
            growth: of("rolling_growth"),
            drag: 0.5 * of("air_density") * of("drag_area"),
            motion: Body::new(truth, &SYSTEM.sites[1], slots),
            brake: truth.or("car", "brake-drag", "torque", 0.0),
            wind: truth.or("car", "headwind", "wind", 0.0),
            tyre: truth.effect("car", "tyre-slip", "slip_stiffness").map(|stiffness| (stiffness, slots.take())),
            outside: Outside::new(truth),
            wheel,
        }
    }

    fn resistance(&self, v: f64, slope: f64, time: f64) -> f64 {
        let rolling = self.rolling * self.outside.factor(time) + self.growth * v;
        self.mass * 9.80665 * (rolling * slope.cos() + slope.sin()) + self.drag * (v + self.wind).powi(2)
    }
}

impl Law for RoadVehicle {
    fn start(&self, outputs: &[f64], _inputs: &[f64], y: &mut State) {
        y[self.wheel] = outputs[0] / self.radius;
        if let Some((_, state)) = self.tyre {
            y[state] = outputs[0];
        }
    }

    fn rates(&self, inputs: &[f64], y: &State, _regime: u8, dy: &mut State) {
        let (time, w) = (y[TIME], y[self.wheel]);
        let at_wheel =
            inputs[0] - self.brake * w.tanh() + self.radius * (self.outside.gust(time) + self.outside.law(self.radius * w));
        if let Some((stiffness, state)) = self.tyre {
            let v = y[state];
            let grip = stiffness * (self.radius * w - v) / v.abs().max(1.0);
            dy[self.wheel] = (at_wheel - self.radius * grip) / self.wheel_inertia;
            dy[state] = (grip - self.resistance(v, inputs[1], time)) / self.mass;
            return;
        }
        let v = self.radius * w;
        let motion = Motion {
            position: 0.0,
            speed: v,
            inertia: self.mass,
            beside: self.wheel_inertia / self.radius.powi(2),
            effort: at_wheel / self.radius - self.resistance(v, inputs[1], time),
            load: 0.0,
            viscous: 0.0,
            drive: 0.0,
        };
        dy[self.wheel] = self.motion.acceleration(&motion, y, dy) / self.radius;
    }

    fn outputs(&self, y: &State) -> Vec<f64> {
        vec![self.tyre.map_or(self.radius * y[self.wheel], |(_, state)| y[state])]
    }

    fn scale(&self, scale: &mut State) {
        scale[self.wheel] = 1.0;
        if let Some((_, state)) = self.tyre {
            scale[state] = 0.3;
        }
    }
}

/// Torque, coasting and brakes in turn, between 4 and 33 m/s, over hills.
fn drive(mut random: Random, period: f64) -> (Vec<f64>, Drive) {
    let start = vec![random.uniform(8.0, 25.0)];
    let hills: Vec<[f64; 3]> = (0..3)
        .map(|_| [random.uniform(0.003, 0.012), random.uniform(20.0, 120.0), random.uniform(0.0, std::f64::consts::TAU)])
        .collect();
    let mut torque = Steps::new();
    let per_second = 1.0 / period;
    let mut sense = 0.0;
    let drive = move |row: usize, read: &[f64]| {
        let time = row as f64 * period;
        let (slow, fast) = (read[0] < 5.0 && sense <= 0.0, read[0] > 32.0 && sense >= 0.0);
        if slow || fast {
            torque.end();
        }
        let value = torque.at(row, &mut random, (4.0 * per_second, 25.0 * per_second), |it| {
            let chance = it.uniform(0.0, 1.0);
            sense = if slow || (!fast && chance < 0.45) {
                1.0
            } else if chance < 0.85 && !(slow || fast && chance < 0.2) {
                0.0
            } else {
                -1.0
            };
            if sense > 0.0 {
                it.uniform(150.0, 900.0)
            } else if sense < 0.0 {
                it.uniform(-500.0, -100.0)
            } else {
                0.0
            }
        });
        let slope =
            hills.iter().map(|[height, seconds, phase]| height * (std::f64::consts::TAU * time / seconds + phase).sin()).sum();
        vec![value, slope]
    };
    (start, Box::new(drive))
}

//! `examples/plants/coupled-tanks`: a pump, two tanks joined by a pipe, a drain.
//!
//! In: the pump's voltage. Out: two levels.

use super::store::Store;
use super::{Drive, Input, Law, Output, Outside, Site, SiteKind, Slots, Steps, System, TIME, Truth};
use crate::flow::State;
use crate::random::Random;

/// The plant.
pub const SYSTEM: System = System {
    name: "coupled-tanks",
    text: include_str!("../../../../examples/plants/coupled-tanks/coupled-tanks.mo"),
    file: include_str!("../../../../examples/plants/coupled-tanks/plant.toml"),
    inputs: &[Input { name: "pump", unit: "V", range: (0.0, 10.0), commands: true }],
    outputs: &[
        Output { name: "level_1", unit: "m", noise: 0.001, range: (0.05, 0.5) },
        Output { name: "level_2", unit: "m", noise: 0.001, range: (0.03, 0.3) },
    ],
    parameters: &[("area_1", 0.02), ("area_2", 0.015), ("pump_gain", 3e-5), ("pipe_area", 9e-5), ("drain_area", 7e-5)],
    tolerance: &[("pump_gain", 0.03), ("pipe_area", 0.05), ("drain_area", 0.05)],
    sites: &[
        Site { name: "first_tank", kind: SiteKind::Storage, effort: 1.5e-4, speed: 0.3, position: 0.5, inertia: 0.02 },
        Site { name: "second_tank", kind: SiteKind::Storage, effort: 1.5e-4, speed: 0.2, position: 0.3, inertia: 0.015 },
    ],
    period: 1.0,
    rows: 2000,
    build: |truth, slots| Box::new(CoupledTanks::new(truth, slots)),
    drive,
    changes: "drain_area",
};

struct CoupledTanks {
    area: [f64; 2],
    pump_gain: f64,
    pipe_area: f64,
    drain_area: f64,
    first: Store,
    second: Store,
    outside: Outside,
    levels: [usize; 2],
}

impl CoupledTanks {
    fn new(truth: &Truth, slots: &mut Slots) -> Self {
        CoupledTanks {
            area: [truth.get("area_1"), truth.get("area_2")],
            pump_gain: truth.get("pump_gain"),
            pipe_area: truth.get("pipe_area"),
            drain_area: truth.get("drain_area"),
            first: Store::new(truth, &SYSTEM.sites[0]),
            second: Store::new(truth, &SYSTEM.sites[1]),
            outside: Outside::new(truth),
            levels: [slots.take(), slots.take()],
        }
    }
}

/// The speed of the water for a head (E. Torricelli, 1643), linear in the head within 2 mm.
fn torricelli(head: f64) -> f64 {
    (2.0 * 9.80665_f64).sqrt() * head / (head * head + 0.002 * 0.002).powf(0.25)
}

impl Law for CoupledTanks {
    fn start(&self, outputs: &[f64], _inputs: &[f64], y: &mut State) {
        (y[self.levels[0]], y[self.levels[1]]) = (outputs[0], outputs[1]);
    }

    fn rates(&self, inputs: &[f64], y: &State, _regime: u8, dy: &mut State) {
        let [one, two] = self.levels.map(|state| y[state]);
        let pipe = self.pipe_area * torricelli(one - two);
        let drain = self.drain_area * self.outside.factor(y[TIME]) * torricelli(two);
        let into = self.pump_gain * inputs[0] - pipe + self.outside.gust(y[TIME]) + self.outside.law(one);
        dy[self.levels[0]] = (into + self.first.flow(one, self.area[0])) / self.area[0];
        dy[self.levels[1]] = (pipe - drain + self.second.flow(two, self.area[1])) / self.area[1];
    }

    fn outputs(&self, y: &State) -> Vec<f64> {
        self.levels.map(|state| y[state]).to_vec()
    }

    fn scale(&self, scale: &mut State) {
        self.levels.iter().for_each(|state| scale[*state] = 0.01);
    }
}

/// Steps of the pump. It is reduced before the first tank is full, and increased before it is empty.
fn drive(mut random: Random, period: f64) -> (Vec<f64>, Drive) {
    let start = vec![random.uniform(0.15, 0.3), random.uniform(0.05, 0.12)];
    let mut pump = Steps::new();
    let mut is_up = false;
    let per_second = 1.0 / period;
    let drive = move |row: usize, read: &[f64]| {
        let far = (read[0] > 0.48 && is_up) || (read[0] < 0.07 && !is_up);
        if far {
            pump.end();
        }
        let value = pump.at(row, &mut random, (40.0 * per_second, 160.0 * per_second), |it| {
            is_up = if far { !is_up } else { it.uniform(0.0, 1.0) < 0.5 };
            if is_up { it.uniform(4.0, 9.5) } else { it.uniform(0.5, 4.0) }
        });
        vec![value]
    };
    (start, Box::new(drive))
}

//! `examples/plants/heated-block`: a heater in a block on a table.
//!
//! In: power and the temperature of the room. Out: three temperatures.

use super::store::Store;
use super::{Drive, Input, Law, Output, Outside, Site, SiteKind, Slots, Steps, System, TIME, Truth};
use crate::flow::State;
use crate::random::Random;

/// The plant.
pub const SYSTEM: System = System {
    name: "heated-block",
    text: include_str!("../../../../examples/plants/heated-block/heated-block.mo"),
    file: include_str!("../../../../examples/plants/heated-block/plant.toml"),
    inputs: &[
        Input { name: "power", unit: "W", range: (0.0, 120.0), commands: true },
        Input { name: "ambient", unit: "K", range: (289.0, 297.0), commands: false },
    ],
    outputs: &[
        Output { name: "heater_temperature", unit: "K", noise: 0.15, range: (295.0, 380.0) },
        Output { name: "block_temperature", unit: "K", noise: 0.1, range: (294.0, 345.0) },
        Output { name: "table_temperature", unit: "K", noise: 0.1, range: (293.0, 310.0) },
    ],
    parameters: &[
        ("heater_capacity", 90.0),
        ("block_capacity", 700.0),
        ("table_capacity", 1500.0),
        ("contact", 2.5),
        ("foot", 0.8),
        ("block_loss", 0.9),
        ("table_loss", 1.2),
    ],
    tolerance: &[("block_capacity", 0.03), ("contact", 0.05), ("foot", 0.1), ("block_loss", 0.1), ("table_loss", 0.1)],
    sites: &[
        Site { name: "heater", kind: SiteKind::Heat, effort: 50.0, speed: 60.0, position: 360.0, inertia: 90.0 },
        Site { name: "block", kind: SiteKind::Heat, effort: 50.0, speed: 40.0, position: 340.0, inertia: 700.0 },
        Site { name: "table", kind: SiteKind::Heat, effort: 20.0, speed: 15.0, position: 308.0, inertia: 1500.0 },
    ],
    period: 2.0,
    rows: 2500,
    build: |truth, slots| Box::new(HeatedBlock::new(truth, slots)),
    drive,
    changes: "block_loss",
};

struct HeatedBlock {
    capacity: [f64; 3],
    contact: f64,
    foot: f64,
    block_loss: f64,
    table_loss: f64,
    stores: [Store; 3],
    outside: Outside,
    states: [usize; 3],
}

impl HeatedBlock {
    fn new(truth: &Truth, slots: &mut Slots) -> Self {
        HeatedBlock {
            capacity: ["heater_capacity", "block_capacity", "table_capacity"].map(|name| truth.get(name)),
            contact: truth.get("contact"),
            foot: truth.get("foot"),
            block_loss: truth.get("block_loss"),
            table_loss: truth.get("table_loss"),
            stores: [0, 1, 2].map(|place| Store::new(truth, &SYSTEM.sites[place])),
            outside: Outside::new(truth),
            states: [slots.take(), slots.take(), slots.take()],
        }
    }
}

impl Law for HeatedBlock {
    fn start(&self, outputs: &[f64], _inputs: &[f64], y: &mut State) {
        self.states.iter().zip(outputs).for_each(|(state, value)| y[*state] = *value);
    }

    fn rates(&self, inputs: &[f64], y: &State, _regime: u8, dy: &mut State) {
        let [heater, block, table] = self.states.map(|state| y[state]);
        let (power, ambient) = (inputs[0], inputs[1]);
        let through_contact = self.contact * (heater - block);
        let through_foot = self.foot * (block - table);
        let to_room = self.block_loss * self.outside.factor(y[TIME]) * (block - ambient);
        let flows = [
            power - through_contact,
            through_contact - through_foot - to_room + self.outside.gust(y[TIME]) + self.outside.law(block),
            through_foot - self.table_loss * (table - ambient),
        ];
        for place in 0..3 {
            let content = y[self.states[place]];
            dy[self.states[place]] =
                (flows[place] + self.stores[place].flow(content, self.capacity[place])) / self.capacity[place];
        }
    }

    fn outputs(&self, y: &State) -> Vec<f64> {
        self.states.map(|state| y[state]).to_vec()
    }

    fn scale(&self, scale: &mut State) {
        self.states.iter().for_each(|state| scale[*state] = 1.0);
    }
}

/// Steps of the power, and a room that warms up and cools down.
fn drive(mut random: Random, period: f64) -> (Vec<f64>, Drive) {
    let room = random.uniform(291.0, 295.0);
    let (swing, seconds) = (random.uniform(1.0, 2.0), random.uniform(1200.0, 3000.0));
    let (mut power, mut window) = (Steps::new(), Steps::new());
    let per_second = 1.0 / period;
    let drive = move |row: usize, _: &[f64]| {
        let time = row as f64 * period;
        let watts = power.at(row, &mut random, (60.0 * per_second, 500.0 * per_second), |it| {
            if it.uniform(0.0, 1.0) < 0.3 { 0.0 } else { it.uniform(15.0, 120.0) }
        });
        let open = window.at(row, &mut random, (300.0 * per_second, 900.0 * per_second), |it| it.uniform(-2.0, 2.0));
        vec![watts, room + swing * (std::f64::consts::TAU * time / seconds).sin() + open]
    };
    (vec![room; 3], Box::new(drive))
}

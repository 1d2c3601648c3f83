//! Every effect at every place of the plants of `examples/plants/`, without noise, for comparison with another simulation of the same text.
//!
//! In: a seed. Out: plant files with one effect each, records of this package's plants with it, and the distance of another simulation from these
//! records in units of noise.

use super::{ALL, System, Truth, draw, files, run};
use crate::plant::Record;
use crate::random::Random;

/// One plant with one effect or none.
#[derive(Debug)]
pub struct Check {
    /// `gear-motor, coulomb-friction:shaft`
    pub name: String,
    /// The plant.
    pub system: &'static System,
    /// The file, with the effect.
    pub plant_file: String,
    /// The record, without noise.
    pub record: Record,
    /// The step of a coarse sensor, for each output.
    steps: Vec<Option<f64>>,
    /// The largest difference between this record and the one without the effect, in units of noise.
    pub visible: f64,
}

/// The largest permitted distance of two correct simulations, in units of noise: as for the other plants, see `verification::Check::allowed`.
pub const ALLOWED: f64 = 0.1;

impl Check {
    /// The record as a CSV.
    pub fn csv(&self) -> String {
        files::record(self.system, &self.record, None, &[], &[])
    }

    /// The largest distance of other outputs from the record, in units of noise, with the output and the row.
    pub fn distance(&self, outputs: &[Vec<f64>]) -> (f64, &'static str, usize) {
        largest(self.system, &self.record.outputs, outputs, &self.steps)
    }
}

fn largest(system: &System, ours: &[Vec<f64>], others: &[Vec<f64>], steps: &[Option<f64>]) -> (f64, &'static str, usize) {
    let mut worst = (0.0, system.outputs[0].name, 0);
    for (place, output) in system.outputs.iter().enumerate() {
        for (row, (one, other)) in ours[place].iter().zip(&others[place]).enumerate() {
            let mut apart = (one - other).abs();
            // Two simulations may round a value at the edge to either side: a difference of exactly one step is not an error, a larger one is.
            if let Some(step) = steps[place] {
                apart = apart.min((apart - step).abs());
            }
            let apart = apart / output.noise;
            if apart.is_nan() || apart > worst.0 {
                worst = (apart, output.name, row);
            }
        }
    }
    worst
}

/// Each plant without effects, then with every effect at every place. `quick` cuts the records to an eighth.
pub fn checks(seed: u64, quick: bool) -> Vec<Check> {
    let mut checks = vec![];
    for system in ALL {
        checks.push(check(system, None, seed, quick));
        checks.extend(draw::everywhere(system).into_iter().map(|effect| check(system, Some(effect), seed, quick)));
    }
    checks
}

fn check(system: &'static System, effect: Option<(&str, &str)>, seed: u64, quick: bool) -> Check {
    let name = effect.map_or("nominal".to_string(), |(kind, at)| format!("{kind}:{at}"));
    let name = format!("{}, {name}", system.name);
    let mut random = Random::new(seed, &name);
    let size = random.uniform(0.3, 0.8);
    let bare = Truth::nominal(system);
    let mut truth = bare.clone();
    truth.causes.extend(effect.map(|(kind, at)| draw::cause(system, kind, at, size, random.clone())));
    let rows = if quick { system.rows / 8 } else { system.rows };
    let (start, mut drive) = (system.drive)(random, system.period);
    let mut record = run::run(&truth, &start, rows, &mut drive);
    // A file gives the sensor readings at the start. Values of a sensor that rounds or clips are not true, so they are omitted.
    let read: Vec<f64> = record.outputs.iter().map(|column| column[0]).collect();
    run::finish(&truth, &mut record);
    let without = run::again(&bare, &start, &record.inputs);
    let none = vec![None; system.outputs.len()];
    let (visible, ..) = largest(system, &record.outputs, &without.outputs, &none);
    let coarse = |name: &str| truth.effect(name, "sensor-quantisation", "step");
    let steps = system.outputs.iter().map(|it| coarse(it.name)).collect();
    let noise: Vec<f64> = system.outputs.iter().map(|it| it.noise).collect();
    let plant_file = files::plant_file(&truth, &noise, Some(&read), &truth.causes);
    Check { name, system, plant_file, record, steps, visible }
}

//! Every effect of the catalogue, without noise, for comparison with another simulation of the same text.
//!
//! In: a seed. Out: plant files with one effect each, records of this package's plants with it, and the distance of another simulation from these
//! records in units of the sensors' noise.

use crate::draw::{self, Nominal};
use crate::excitation::excitation;
use crate::files;
use crate::plant::{self, Effect, Kind, Record, Truth};
use crate::random::Random;

/// One plant with one effect or none.
#[derive(Debug)]
pub struct Check {
    /// `pmac coulomb-friction`
    pub name: String,
    /// The plant.
    pub kind: Kind,
    /// The file, with the effect.
    pub plant_file: String,
    /// The record, without noise.
    pub record: Record,
    noise: Vec<f64>,
    /// The step of a coarse sensor, for each output.
    steps: Vec<Option<f64>>,
    /// The largest difference between this record and the one without the effect, in units of noise.
    pub visible: f64,
}

impl Check {
    /// The record as a CSV.
    pub fn csv(&self) -> String {
        files::record(self.kind, &self.record, &[], &[])
    }

    /// Whether an effect changes the plant, and not only the readings of its sensors or a number of the file.
    pub fn is_structural(&self) -> bool {
        !["nominal", "sensor", "parameter-error"].iter().any(|word| self.name.contains(word))
    }

    /// The largest permitted distance of two correct simulations, in units of noise.
    ///
    /// For a simulation with a fixed step, halving the step may change an output by a tenth. A diagnosis cannot detect this: a hundred rows with this
    /// distance are one squared standard deviation, and a cause must gain tens. A tolerance a hundred times smaller here changes no figure by 1e-4.
    pub fn allowed(&self) -> f64 {
        0.1
    }

    /// The largest distance of other outputs from the record, in units of noise, with the output and the row.
    pub fn distance(&self, outputs: &[Vec<f64>]) -> (f64, &'static str, usize) {
        largest(self.kind, &self.record.outputs, outputs, &self.noise, &self.steps)
    }
}

fn largest(
    kind: Kind,
    ours: &[Vec<f64>],
    others: &[Vec<f64>],
    noise: &[f64],
    steps: &[Option<f64>],
) -> (f64, &'static str, usize) {
    let mut worst = (0.0, kind.outputs()[0].0, 0);
    for (index, (name, _)) in kind.outputs().iter().enumerate() {
        for (row, (one, other)) in ours[index].iter().zip(&others[index]).enumerate() {
            let mut apart = (one - other).abs();
            // Two simulations may round a value at the edge to either side: a difference of exactly one step is not an error, a larger one is.
            if let Some(step) = steps[index] {
                apart = apart.min((apart - step).abs());
            }
            let apart = apart / noise[index];
            if apart.is_nan() || apart > worst.0 {
                worst = (apart, name, row);
            }
        }
    }
    worst
}

/// Each plant without effects, then with every effect. `quick` cuts the records to an eighth, those of a motor to a half: a shorter record may have
/// no reversal.
pub fn checks(seed: u64, quick: bool) -> Vec<Check> {
    let mut checks = vec![];
    for kind in [Kind::Motor, Kind::Car, Kind::OpenAxis, Kind::ClosedAxis] {
        let place = if kind == Kind::ClosedAxis { "servo-axis in closed loop" } else { kind.name() };
        checks.push(check(kind, &format!("{place}, nominal"), None, None, seed, quick));
        for effect in draw::catalogue(kind) {
            let sensor = effect.starts_with("sensor-");
            let outputs = if sensor { kind.outputs().len() } else { 1 };
            for output in 0..outputs {
                if ["sensor-lag", "sensor-delay"].contains(effect) && kind == Kind::ClosedAxis && output > 0 {
                    continue;
                }
                let of = if sensor { format!(":{}", kind.outputs()[output].0) } else { String::new() };
                let name = format!("{place}, {effect}{of}");
                checks.push(check(kind, &name, Some(effect), sensor.then_some(output), seed, quick));
            }
        }
    }
    checks
}

fn check(kind: Kind, name: &str, effect: Option<&str>, output: Option<usize>, seed: u64, quick: bool) -> Check {
    let mut random = Random::new(seed, name);
    let mut nominal = draw::nominal(kind, &mut random);
    if quick {
        nominal.rows /= if kind == Kind::Motor { 2 } else { 8 };
    }
    let effects: Vec<Effect> = effect.iter().map(|name| draw::effect(name, &nominal, output, &mut random)).collect();
    let gear = random.whole(2, 4) as usize;
    let bare = Truth { kind, parameters: nominal.parameters.clone(), effects: vec![], outside: vec![] };
    let mut truth = Truth { effects: effects.clone(), ..bare.clone() };
    for effect in effects.iter().filter(|effect| effect.kind == "parameter-error") {
        truth.parameters.set(effect.which.expect("a parameter").1, effect.values[0].1);
    }
    let mut record = run(&truth, &nominal, gear, &random);
    let start: Vec<f64> = record.outputs.iter().map(|column| column[0]).collect();
    plant::quantise(&truth, &mut record);
    let without = again(&bare, &record, &nominal, gear, &random);
    let none = vec![None; nominal.noise.len()];
    let (visible, ..) = largest(kind, &record.outputs, &without.outputs, &nominal.noise, &none);
    let steps = kind.outputs().iter().map(|(output, _)| {
        let coarse = effects.iter().find(|it| it.kind == "sensor-quantisation" && it.which == Some(("output", output)));
        coarse.map(|effect| effect.values[0].1)
    });
    let steps = steps.collect();
    let plant_file = files::plant_file(kind, &nominal.parameters, &[], &nominal.noise, Some(&start), &effects);
    Check { name: name.to_string(), kind, plant_file, record, noise: nominal.noise, steps, visible }
}

fn run(truth: &Truth, nominal: &Nominal, gear: usize, random: &Random) -> Record {
    let (start, mut drive) = excitation(nominal, gear, random.clone());
    plant::run(truth, start, nominal.period, nominal.rows, &mut drive)
}

/// Simulates another plant with the inputs of a record.
pub fn again(truth: &Truth, record: &Record, nominal: &Nominal, gear: usize, random: &Random) -> Record {
    let (start, _) = excitation(nominal, gear, random.clone());
    let mut inputs = |row: usize, _: &[f64]| record.inputs.iter().map(|column| column[row]).collect();
    plant::run(truth, start, nominal.period, record.inputs[0].len(), &mut inputs)
}

//! Every effect of the catalogue, against plants that share no code with `rsm-sim`.
//!
//! `hidden-effects` is written from docs/book/src/reference/plants.md alone: another frame, other states, another integrator. The two simulations
//! have only this text in common.

use hidden_effects::verification::{self, Check};
use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

/// An arbitrary seed: nothing was tuned with it. `hidden-effects verify` runs others, at full length.
const SEED: u64 = 20;

/// The outputs of `rsm-sim` for a plant file along the record of a check.
fn simulated(check: &Check, plant: &str) -> Vec<Vec<f64>> {
    let plant = PlantFile::read(&Source::new("plant.toml", plant)).unwrap_or_else(|faults| panic!("{faults}"));
    let record = Record::read(&Source::new("record.csv", check.csv()), &plant).unwrap_or_else(|faults| panic!("{faults}"));
    let mut simulator = Simulator::new(&plant, &record).unwrap_or_else(|faults| panic!("{}: {faults}", check.name));
    let outputs = simulator.run(&record).unwrap_or_else(|stopped| panic!("{}: {stopped}", check.name));
    check.kind.outputs().iter().map(|(name, _)| outputs.of(name).expect("an output of the plant").to_vec()).collect()
}

#[test]
fn both_simulations_follow_the_same_text() {
    let mut apart = vec![];
    for check in verification::checks(SEED, true) {
        let (distance, output, row) = check.distance(&simulated(&check, &check.plant_file));
        let (name, allowed, visible) = (&check.name, check.allowed(), check.visible);
        if distance > allowed || distance.is_nan() {
            apart.push(format!(
                "{name}: {output} at row {row} is {distance:.3} of the noise apart, {allowed} is allowed (the effect itself moves {visible:.1})"
            ));
        }
    }
    assert!(apart.is_empty(), "{}", apart.join("\n"));
}

#[test]
fn an_effect_that_is_left_out_stands_apart() {
    // The same records against the plant without the effect: a visible effect must be noticed, otherwise the test above cannot fail.
    let mut seen = 0;
    for check in verification::checks(SEED, true).iter().filter(|check| check.visible > 3.0 && check.is_structural()) {
        let nominal = check.plant_file.split("\n[[effects]]").next().expect("a text has a first part");
        assert!(check.distance(&simulated(check, nominal)).0 > check.allowed(), "{}", check.name);
        seen += 1;
    }
    // Of 41 that are neither of a sensor nor of a parameter; not all of them are visible in an eighth of a record.
    assert!(seen >= 25, "only {seen} effects show in the short records");
}

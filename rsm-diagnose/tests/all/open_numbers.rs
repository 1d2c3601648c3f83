//! A number of a cause that the validation records alone show.
//!
//! The record of a cart with a limited force is computed here, row by row in closed form, without code of the project.

use rsm_core::source::{Faults, Source};
use rsm_diagnose::plant::{Diagnosis, Options, Verdict, diagnose};
use rsm_sim::equation_plant;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::random::Random;

const CART: &str = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  parameter Real drag(unit = \"N.s/m\") = 1;\n  \
                    input Real force(unit = \"N\");\n  output Real speed(unit = \"m/s\", start = 0.0);\nequation\n  \
                    mass*der(speed) = force - drag*speed;\nend Cart;\n";

/// The limits of the force, in N, and the standard deviation of the noise, in m/s.
const LIMITS: [f64; 2] = [-2.5, 5.0];
const NOISE: f64 = 1e-3;

fn cart() -> PlantFile {
    let file = "format = 2\nmodel = \"cart.mo\"\n[tolerance]\nmass = 0.02\ndrag = 0.02\n";
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, CART));
    equation_plant::read(&Source::new("cart.toml", file), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

/// A record with steps of the force between two values in N.
fn record(plant: &PlantFile, [low, high]: [f64; 2], seed: u64) -> Record {
    let mut random = Random::new(seed);
    let (period, rows) = (0.02, 800);
    let decay = (-period * 1.0 / 2.0_f64).exp();
    let (mut speed, mut force) = (0.0, 0.0);
    let (mut time, mut forces, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..rows {
        if row % 40 == 0 {
            force = low + (high - low) * random.uniform();
        }
        time.push(f64::from(row) * period);
        forces.push(force);
        speeds.push(speed + NOISE * random.normal());
        let acting = force.clamp(LIMITS[0], LIMITS[1]);
        speed = acting + (speed - acting) * decay;
    }
    let columns: [(&str, &[f64]); 3] = [("time", &time), ("force", &forces), ("speed", &speeds)];
    Record::in_memory(plant, &columns).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The diagnosis of training records up to a force, and validation records up to another one.
fn diagnosed(training: f64, validation: f64) -> Diagnosis {
    let plant = cart();
    let records = |high: f64, seeds: [u64; 2]| seeds.map(|seed| record(&plant, [-4.0, high], seed));
    let options = Options { threads: 2, progress: &|_| {} };
    diagnose(&plant, &records(training, [1, 2]), &records(validation, [3, 4]), &options).unwrap()
}

#[test]
fn a_limit_that_the_validation_records_alone_reach_is_fitted_to_them() {
    let found = diagnosed(3.0, 8.0);
    let kinds: Vec<&str> = found.causes.iter().map(|cause| cause.kind).collect();
    assert_eq!((found.verdict, kinds), (Verdict::Explained, vec!["input-limit"]));
    let cause = &found.causes[0];
    for (number, limit) in cause.parameters.iter().zip(LIMITS) {
        // Twice the half of a 95 % interval: four standard deviations.
        assert!((number.value - limit).abs() < number.high - number.low, "{number:?}");
        assert!(number.high - number.low < 0.02, "{number:?}");
    }
    assert_eq!(cause.by_holdout, ["high"]);
}

#[test]
fn a_limit_that_no_record_reaches_agrees_with_all_records() {
    // Training ends at 3 N, validation at 4.9 N, just below the limit.
    let found = diagnosed(3.0, 4.9);
    let high = &found.causes[0].parameters[1];
    assert!(found.causes[0].kind == "input-limit" && !high.is_determined() && high.value > 4.5, "{high:?}");
}

#[test]
fn a_limit_that_no_record_reaches_stays_open_and_one_that_all_reach_is_that_of_training() {
    let found = diagnosed(3.0, 3.0);
    assert_eq!(found.causes[0].kind, "input-limit");
    let high = &found.causes[0].parameters[1];
    assert!(!high.is_determined() && found.causes[0].by_holdout.is_empty(), "{high:?}");
    let found = diagnosed(8.0, 8.0);
    assert_eq!((found.causes[0].kind, found.causes[0].by_holdout.len()), ("input-limit", 0));
    assert!(found.causes[0].parameters.iter().all(rsm_diagnose::plant::cause::Interval::is_determined));
}

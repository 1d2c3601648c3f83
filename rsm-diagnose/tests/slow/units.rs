//! Columns in another unit: every column of every plant with every factor, for plants with errors within their tolerances and noise; and records
//! without such a column.

use crate::random::Random;
use rsm_diagnose::plant::other_units::alternative_units;
use rsm_diagnose::plant::units::{WrongUnit, find};
use rsm_diagnose::plant::{Options, Verdict, diagnose};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{Drive, Record, inputs};

use super::{axis_record, car_record, effect, motor_record, plant, record, run};

/// The nominal plant, and a record of a true plant with random errors within its tolerances.
fn case(name: &str, more: &str, seed: u64) -> (PlantFile, Record) {
    let mut random = Random::new(seed);
    let nominal = plant(name, "");
    let mut truth = plant(name, more);
    for (parameter, tolerance) in &nominal.tolerance {
        let value = nominal.parameters.number(parameter) * (1.0 + tolerance * (2.0 * random.uniform() - 1.0));
        truth.parameters.set(parameter, value);
    }
    let text = match name {
        "pmac" => motor_record(),
        "driveline" => car_record(),
        _ => axis_record(),
    };
    let mut record = record(&text, &truth);
    let outputs = run(&truth, &record);
    for (k, signal) in nominal.kind.outputs().iter().enumerate() {
        let Some(values) = outputs.of(signal.name) else { continue };
        let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        // The noise is half a per cent of the largest reading.
        let noisy = values.iter().map(|value| value + 0.005 * largest * random.normal());
        record.measured[k] = Some(noisy.collect());
    }
    (nominal, record)
}

fn scaled(record: &Record, plant: &PlantFile, column: &str, factor: f64) -> Record {
    let mut record = record.clone();
    for (k, signal) in inputs(plant.kind, record.drive).iter().enumerate() {
        if signal.name == column {
            record.inputs[k].iter_mut().for_each(|value| *value *= factor);
        }
    }
    for (k, signal) in plant.kind.outputs().iter().enumerate() {
        let is_input = record.drive == Drive::Open && plant.kind.inputs().iter().any(|it| it.name == column);
        if signal.name == column && !is_input {
            record.measured[k].iter_mut().flatten().for_each(|value| *value *= factor);
        }
    }
    record
}

fn found(plant: &PlantFile, record: Record) -> Vec<WrongUnit> {
    find(plant, &[record], 1).into_iter().map(|it| it.0).collect()
}

/// Whether one column is named with its factor, alone or among those that the records cannot distinguish.
fn is_named(found: &[WrongUnit], column: &str, factor: f64) -> bool {
    let [one] = found else { return false };
    let its = one.columns == [column] && (one.factor / factor - 1.0).abs() < 1e-6;
    let low_to_high = one.gain[1] <= one.gain[0] && one.gain[0] <= one.gain[2];
    low_to_high && (its || one.alike.iter().any(|it| it.starts_with(&format!("{column} in "))))
}

#[test]
fn every_column_in_another_unit_is_named_as_that() {
    let mut wrong = Vec::new();
    let mut cases = 0;
    for (number, name) in ["pmac", "driveline", "servo-axis"].into_iter().enumerate() {
        let (nominal, record) = case(name, "", 5 + number as u64);
        let columns = inputs(nominal.kind, record.drive).iter().chain(nominal.kind.outputs());
        for signal in columns {
            for other in alternative_units(signal.unit) {
                for factor in [other.factor, 1.0 / other.factor] {
                    let found = found(&nominal, scaled(&record, &nominal, signal.name, factor));
                    cases += 1;
                    // A quarter of a load of 0.5 to 1.5 N m changes the motor's signals by little more than the noise: then nothing may be reported.
                    let hardly_shown = signal.name == "load_torque" && factor.max(1.0 / factor) < 1.5;
                    let right = is_named(&found, signal.name, factor) || (hardly_shown && found.is_empty());
                    if !right {
                        let told: Vec<String> = found.iter().map(ToString::to_string).collect();
                        wrong.push(format!("{name} {} {factor}: {told:?}", signal.name));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {cases}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn a_gain_of_two_per_cent_a_missing_effect_and_a_record_in_order_are_no_unit() {
    for seed in 0..4 {
        for (name, column, missing) in [
            ("pmac", "speed", effect("coulomb-friction", "torque = 0.3")),
            ("pmac", "load_torque", effect("constant-load", "torque = 0.8")),
            ("driveline", "throttle", effect("road-grade", "grade = 0.05")),
            ("servo-axis", "position", effect("coulomb-friction", "force = 30")),
        ] {
            for (more, gain) in [("", 1.0), ("", 1.02), (missing.as_str(), 1.0), (missing.as_str(), 0.98)] {
                let (nominal, record) = case(name, more, 40 + seed);
                let found = found(&nominal, scaled(&record, &nominal, column, gain));
                assert!(found.is_empty(), "{name} {column} {gain} {more}: {}", found[0]);
            }
        }
    }
}

#[test]
fn a_unit_is_named_beside_a_cause_with_the_gain_that_is_left_then() {
    let (nominal, record) = case("pmac", &effect("coulomb-friction", "torque = 0.3"), 3);
    let wrong = scaled(&record, &nominal, "speed", 30.0 / std::f64::consts::PI);
    let options = Options { threads: 1, progress: &|_| {} };
    let found = diagnose(&nominal, &[wrong], &[], &options).unwrap();
    assert!(is_named(&found.units, "speed", 30.0 / std::f64::consts::PI), "{:?}", found.units);
    let [_, low, high] = found.units[0].gain;
    assert!(low < 9.55 && 9.54 < high && high - low < 0.3, "{low} {high}");
    assert_eq!(found.verdict, Verdict::Explained, "{:?}", found.causes);
    assert_eq!(found.causes[0].kind, "coulomb-friction");
}

//! Every effect of the catalogue as a file, on the plants of equations, against plants that share no code with the project.
//!
//! The reference is that of `effects.rs`: `hidden-effects`, written from docs/book/src/reference/plants.md alone. It has the three built-in plants,
//! and those of `examples/plants/`, of which the project has only the texts.

use hidden_effects::systems::verify;
use hidden_effects::verification::{self, Check};
use rsm_core::source::Source;
use rsm_sim::equations::{EquationFile, Machine, Setting, Signals};
use rsm_sim::plant_file::PlantFile;

/// An arbitrary seed: nothing was tuned with it.
const SEED: u64 = 20;

/// The outputs that the engine of equations gives for a plant file of format 1 along the record of a check, or its error.
fn simulated(check: &Check, plant: &str) -> Result<Vec<Vec<f64>>, String> {
    let plant = PlantFile::read(&Source::new("plant.toml", plant)).map_err(|faults| faults.to_string())?;
    let record = Source::new("record.csv", check.csv());
    let closed = check.csv().lines().find(|it| !it.starts_with('#')).is_some_and(|it| it.contains("reference"));
    let file = EquationFile::of_first_format(&plant, closed).map_err(|faults| faults.to_string())?;
    let names: Vec<&str> = check.kind.outputs().iter().map(|it| it.0).collect();
    outputs(&file, &record, &names)
}

/// Outputs of a plant along a record.
fn outputs(file: &EquationFile, record: &Source, names: &[&str]) -> Result<Vec<Vec<f64>>, String> {
    let file = file.of_record(record).map_err(|faults| faults.to_string())?;
    let mut machine = Machine::new(&file).map_err(|faults| faults.to_string())?;
    let signals = Signals::read(record, &file, &machine).map_err(|faults| faults.to_string())?;
    let found = signals.simulate(&file, &mut machine, Setting { tolerance: 1e-9, ..Setting::default() });
    let found = found.map_err(|failed| format!("{failed:?}"))?;
    let outputs = machine.outputs();
    let of = |name: &str| outputs.iter().position(|it| it.0 == name).map(|k| found[k].clone());
    names.iter().map(|name| of(name).ok_or_else(|| format!("no output {name}"))).collect()
}

/// The outputs of a plant file of format 2 along the record of a check.
fn simulated_text(check: &verify::Check, plant: &str) -> Result<Vec<Vec<f64>>, String> {
    let text = |_: &str| Ok(Source::new(format!("{}.mo", check.system.name), check.system.text));
    let file = EquationFile::read(&Source::new("plant.toml", plant), &text).map_err(|faults| faults.to_string())?;
    let names: Vec<&str> = check.system.outputs.iter().map(|it| it.name).collect();
    outputs(&file, &Source::new("record.csv", check.csv()), &names)
}

#[test]
fn effects_on_the_plants_of_the_examples_follow_the_same_text() {
    let (mut apart, mut seen) = (vec![], 0);
    for check in verify::checks(SEED, true) {
        let (name, visible) = (&check.name, check.visible);
        match simulated_text(&check, &check.plant_file) {
            Ok(found) => {
                let (distance, output, row) = check.distance(&found);
                if distance > verify::ALLOWED || distance.is_nan() {
                    apart.push(format!(
                        "{name}: {output} at row {row} is {distance:.3} of the noise apart, {} is allowed (the effect itself moves {visible:.1})",
                        verify::ALLOWED
                    ));
                }
            }
            Err(what) => apart.push(format!("{name}: {what}")),
        }
        // A visible effect must be noticed if the file does not have it, otherwise this test cannot fail. A coarse sensor may differ by a step; an
        // angle that is read with an offset is an angle with another initial value.
        let is_seen = !name.contains("quantisation") && !name.ends_with("sensor-bias:load_angle");
        if visible > 3.0 && is_seen {
            let nominal = check.plant_file.split("\n[[effects]]").next().expect("a text has a first part");
            let found = simulated_text(&check, nominal).unwrap_or_else(|what| panic!("{name}: {what}"));
            assert!(check.distance(&found).0 > verify::ALLOWED, "{name}");
            seen += 1;
        }
    }
    assert!(apart.is_empty(), "{}", apart.join("\n"));
    // Most effects are visible in an eighth of a record; a drift or a radiation may not be.
    assert!(seen >= 200, "only {seen} effects show in the short records");
}

#[test]
fn effects_as_files_follow_the_same_text() {
    let mut apart = vec![];
    for check in verification::checks(SEED, true) {
        match simulated(&check, &check.plant_file) {
            Ok(found) => {
                let (distance, output, row) = check.distance(&found);
                let (name, allowed, visible) = (&check.name, check.allowed(), check.visible);
                if distance > allowed || distance.is_nan() {
                    apart.push(format!(
                        "{name}: {output} at row {row} is {distance:.3} of the noise apart, {allowed} is allowed (the effect itself moves {visible:.1})"
                    ));
                }
            }
            Err(what) => apart.push(format!("{}: {what}", check.name)),
        }
    }
    assert!(apart.is_empty(), "{}", apart.join("\n"));
}

#[test]
fn an_effect_that_is_left_out_stands_apart_from_its_record() {
    // The same records against the plant without the effect: a visible effect must be noticed, otherwise the test above cannot fail.
    let mut seen = 0;
    for check in verification::checks(SEED, true).iter().filter(|check| check.visible > 3.0 && check.is_structural()) {
        let nominal = check.plant_file.split("\n[[effects]]").next().expect("a text has a first part");
        let found = simulated(check, nominal).unwrap_or_else(|what| panic!("{}: {what}", check.name));
        assert!(check.distance(&found).0 > check.allowed(), "{}", check.name);
        seen += 1;
    }
    // As many as in `effects.rs`: the records are the same.
    assert!(seen >= 25, "only {seen} effects show in the short records");
}

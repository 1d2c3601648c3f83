//! The records of `examples/plants/`: each with a hidden cause, the same on every machine.
//!
//! In: nothing. Out: names and texts of files. The README of each example names the hidden cause.

use super::{ALL, Cause, System, Truth, files, run};
use crate::plant::Record;
use crate::random::Random;

/// The significant digits of a record: the last digit is below a hundredth of any noise, and far above the differences between mathematical functions
/// of two machines.
const DIGITS: usize = 6;

/// The hidden causes of each plant.
fn hidden(system: &System) -> Vec<Cause> {
    match system.name {
        "gear-motor" => vec![Cause::new("coulomb-friction", "shaft", &[("torque", 0.35)])],
        "coupled-tanks" => vec![Cause::new("leak", "first_tank", &[("conductance", 6e-5), ("rest", 0.0)])],
        "road-vehicle" => vec![Cause::new("headwind", "car", &[("wind", 4.0)])],
        "heated-block" => vec![Cause::new("radiation", "heater", &[("coefficient", 4e-10), ("ambient", 293.0)])],
        "two-mass-drive" => vec![Cause::new("backlash", "shaft", &[("gap", 0.03)])],
        _ => vec![Cause::new("input-gain", "front", &[("gain", 0.93)])],
    }
}

/// The true plant of an example.
pub fn truth(system: &'static System) -> Truth {
    Truth { causes: hidden(system), ..Truth::nominal(system) }
}

/// A record as its sensors read it; the second one is for validation.
pub fn record(system: &'static System, number: u64) -> Record {
    let truth = truth(system);
    let name = format!("{} example {number}", system.name);
    let (start, mut drive) = (system.drive)(Random::new(1, &name), system.period);
    let mut record = run::run(&truth, &start, system.rows, &mut drive);
    let mut random = Random::new(2, &name);
    for (column, output) in record.outputs.iter_mut().zip(system.outputs) {
        let noise = random.noise(system.rows, output.noise, 0.0);
        column.iter_mut().zip(noise).for_each(|(value, noise)| *value += noise);
    }
    run::finish(&truth, &mut record);
    record
}

/// All files, by their names in `examples/plants/`.
pub fn files() -> Vec<(String, String)> {
    let named = |system: &'static System, number: u64, name: &str| {
        let text = files::record(system, &record(system, number), Some(DIGITS), &[], &[]);
        (format!("{}/{name}.csv", system.name), text)
    };
    ALL.iter().flat_map(|system| [named(system, 1, "record"), named(system, 2, "validation")]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_of_the_examples_are_those_that_this_package_makes() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/plants");
        for (name, text) in files() {
            // The largest permitted size of a record in the repository.
            assert!(text.len() < 200_000, "{name} has {} bytes", text.len());
            let found = std::fs::read_to_string(folder.join(&name)).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(found == text, "{name} is stale: `cargo run -p hidden-effects -- examples --out examples/plants`");
        }
    }

    #[test]
    fn plant_files_of_the_examples_have_the_numbers_of_this_package() {
        for system in ALL {
            let noise = system.outputs.iter().map(|it| (it.name, it.noise));
            let numbers = system.parameters.iter().copied().chain(system.tolerance.iter().copied()).chain(noise);
            for (name, value) in numbers {
                let has = |line: &str| {
                    line.split_once(" = ").is_some_and(|it| it.0 == name && it.1.parse().is_ok_and(|it: f64| it == value))
                };
                assert!(system.file.lines().any(has), "{}: {name} = {value}", system.name);
                assert!(system.file.contains(&format!("model = \"{}.mo\"", system.name)));
            }
        }
    }
}

//! The list of tasks, each with its hash.
//!
//! In: a scenario. Out: [`Task`]s in a fixed order: plants, records, settings, repeats. A hash covers everything that affects a result: version of
//! the program, names and contents of files, bits of numbers, seed of the noise, requested outputs. It does not cover the index in the list, so a
//! longer list contains the tasks of a shorter one.

use std::fmt::Write as _;

use rsm_core::source::{Collector, Fault, Faults};
use rsm_fit::random::Random;
use rsm_sim::plant_file::PlantFile;
use sha2::{Digest as _, Sha256};

use crate::PROGRAM;
use crate::scenario::{Law, Number, Plant, Points, Scenario, Simulations, Work};

/// A task: a run or a diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// The hash of everything that affects its result: 32 hexadecimal digits of SHA-256.
    pub hash: String,
    /// The run or the diagnosis.
    pub what: TaskKind,
}

/// What a task computes.
#[derive(Debug, Clone, PartialEq)]
pub enum TaskKind {
    /// A run.
    Run {
        /// The index of the plant.
        plant: usize,
        /// The index of the record.
        record: usize,
        /// A value for each factor, in the unit of the plant.
        values: Vec<f64>,
        /// The seed of its noise, if it has noise.
        noise: Option<u64>,
    },
    /// A diagnosis, by its index.
    Diagnosis(usize),
}

/// All tasks of a scenario.
///
/// # Errors
/// If a drawn or planned number is not allowed for its plant, or if two tasks are equal.
pub fn list(scenario: &Scenario) -> Result<Vec<Task>, Faults> {
    let mut faults = Collector::new();
    let files: Vec<String> = scenario.files.iter().map(|(name, text)| format!("{name}\n{}", digest(text.as_bytes()))).collect();
    let tasks = match &scenario.work {
        Work::Simulate(all) => runs(scenario, all, &files, &mut faults),
        Work::Diagnose(all) => {
            let one = |(k, it): (usize, &crate::scenario::Diagnosis)| {
                let mut text = format!("{PROGRAM}\ndiagnosis\n{}\n", it.name);
                for (role, places) in ["plant", "records", "validate", "test"].iter().zip(&it.files) {
                    let _ = writeln!(text, "{role}");
                    places.iter().for_each(|place| text += &format!("{}\n", files[*place]));
                }
                Task { hash: digest(text.as_bytes()), what: TaskKind::Diagnosis(k) }
            };
            all.iter().enumerate().map(one).collect()
        }
    };
    let mut seen = std::collections::HashSet::new();
    if let Some(twice) = tasks.iter().find(|it| !seen.insert(it.hash.as_str())) {
        let what = format!("the task {} occurs twice in the list", twice.hash);
        let help = "two settings are the same: remove one of them from the plan, use `design = \"full-factorial\"` for lists, or set `noise = true`";
        faults.push(Fault::whole_file(scenario.source.name(), what).help(help));
    }
    faults.finish(Some(tasks))
}

/// The tasks of a shard, by index modulo the number of shards: shard 1 of 3 has the first, the fourth and so on.
#[must_use]
pub fn shard(tasks: &[Task], [shard, of]: [usize; 2]) -> Vec<&Task> {
    tasks.iter().skip(shard - 1).step_by(of).collect()
}

/// 32 hexadecimal digits: half of SHA-256. For a million tasks, two hashes are equal by chance in one of 10^27 lists.
fn digest(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(digest: &[u8]) -> String {
    digest[..16].iter().fold(String::with_capacity(32), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// A seed for one purpose, derived from the seed of the scenario and some indices.
fn derived(purpose: &str, numbers: [u64; 3]) -> u64 {
    let digest = Sha256::digest(format!("rsm sweep {purpose} {numbers:?}"));
    u64::from_le_bytes(digest[..8].try_into().expect("a digest has 32 bytes"))
}

/// The values of a setting for a plant. Random values depend only on the seed and the number of the setting, so a longer list begins with the shorter
/// one.
fn setting(scenario: &Scenario, all: &Simulations, plant: &Plant, setting: usize) -> Vec<f64> {
    let shares: Vec<f64> = match &all.points {
        Points::Design(points) => points[setting].clone(),
        Points::Random => {
            let mut random = Random::new(derived("setting", [scenario.seed, setting as u64, 0]));
            plant.places.iter().map(|_| random.share()).collect()
        }
    };
    let value = |(place, share): (&crate::scenario::Place, f64)| match &place.law {
        Law::Drawn(distribution) => distribution.quantile(share),
        Law::Planned(values) => values[setting],
    };
    plant.places.iter().zip(shares).map(value).collect()
}

/// A plant with the values of a setting.
pub(crate) fn set(plant: &Plant, values: &[f64]) -> PlantFile {
    let mut file = plant.file.clone();
    for (place, value) in plant.places.iter().zip(values) {
        match place.of {
            Number::Parameter(name) => file.parameters.set(name, *value),
            Number::Effect(index, name) => {
                let numbers = &mut file.effects[index].arguments.numbers;
                numbers.iter_mut().filter(|it| it.0 == name).for_each(|it| it.1 = *value);
            }
        }
    }
    file
}

/// For plants of format 1: the share of the inertia that the effects take. A share of 1 is an error, in a plant file and in a setting.
fn split(file: &PlantFile) -> f64 {
    if file.kind.is_first_format { file.split() } else { 0.0 }
}

/// Reports for each factor the first value that its plant does not allow.
fn check(scenario: &Scenario, all: &Simulations, plant: &Plant, settings: &[Vec<f64>], faults: &mut Collector) {
    let mut good = true;
    for (k, (place, factor)) in plant.places.iter().zip(&all.factors).enumerate() {
        let is_bad = |value: f64| !value.is_finite() || !place.bound.holds(value);
        let Some(run) = settings.iter().position(|values| is_bad(values[k])) else { continue };
        let what = format!(
            "setting {} of {} is {} {}, expected {}",
            run + 1,
            plant.name,
            settings[run][k],
            place.unit,
            place.bound.words()
        );
        let fault = scenario.fault(factor, &what);
        faults.push(match place.law {
            Law::Drawn(_) => fault.help("limit a normal distribution by `within = [LOW, HIGH]`"),
            Law::Planned(_) => fault,
        });
        good = false;
    }
    let has_effects = plant.places.iter().any(|it| matches!(it.of, Number::Effect(..)));
    if good
        && has_effects
        && let Some(run) = settings.iter().position(|values| split(&set(plant, values)) >= 1.0)
    {
        let what = format!(
            "setting {} of {}: the effects move the whole inertia to the load, expected a part of it",
            run + 1,
            plant.name
        );
        faults.push(Fault::whole_file(scenario.source.name(), what));
    }
}

fn runs(scenario: &Scenario, all: &Simulations, files: &[String], faults: &mut Collector) -> Vec<Task> {
    let mut tasks = Vec::new();
    for (p, plant) in all.plants.iter().enumerate() {
        let settings: Vec<Vec<f64>> = (0..all.settings).map(|it| setting(scenario, all, plant, it)).collect();
        check(scenario, all, plant, &settings, faults);
        for (r, record) in all.records.iter().enumerate() {
            let common = common(all, plant, record, scenario, files);
            for (s, values) in settings.iter().enumerate() {
                for repeat in 0..all.repeats {
                    let noise = all.noise.then(|| {
                        // 53 bits, which every JSON reader represents exactly.
                        derived("noise", [scenario.seed, s as u64, repeat as u64]) >> 11
                    });
                    let mut hash = common.clone();
                    for value in values {
                        hash.update(value.to_bits().to_le_bytes());
                    }
                    hash.update(format!("{noise:?}"));
                    let what = TaskKind::Run { plant: p, record: r, values: values.clone(), noise };
                    tasks.push(Task { hash: hex(&hash.finalize()), what });
                }
            }
        }
    }
    tasks
}

/// The part of the hash that all settings of a plant and a record share.
fn common(all: &Simulations, plant: &Plant, record: &str, scenario: &Scenario, files: &[String]) -> Sha256 {
    let mut text = format!("{PROGRAM}\nrun\nplant\n");
    plant.files.iter().for_each(|place| text += &format!("{}\n", files[*place]));
    let of_record = scenario.files.iter().position(|it| it.0 == record);
    let _ = writeln!(text, "record\n{}\nwanted", of_record.map_or("", |place| &files[place]));
    for (name, statistics) in &all.outputs {
        let words: Vec<&str> = statistics.iter().map(|it| it.name()).collect();
        let _ = writeln!(text, "{name} {}", words.join(" "));
    }
    let _ = writeln!(text, "whole {}\nset", all.whole_records);
    for (factor, place) in all.factors.iter().zip(&plant.places) {
        let _ = writeln!(text, "{} {:?}", factor.name, place.of);
    }
    Sha256::new_with_prefix(text)
}

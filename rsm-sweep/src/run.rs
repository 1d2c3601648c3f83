//! One task: a simulation with its figures, or a diagnosis.
//!
//! In: a task and its scenario. Out: its result as JSON, which depends only on the task. A simulation that fails also has a result: `failed` gives
//! the reason.

use rsm_fit::random::Random;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::{Outputs, Simulator};
use serde_json::{Map, Value, json};

use crate::PROGRAM;
use crate::scenario::{Scenario, Simulations, Statistic, Work};
use crate::tasks::{Task, TaskKind, set};

/// The data of one diagnosis.
#[derive(Debug)]
pub struct Case<'a> {
    /// The plant.
    pub plant: &'a PlantFile,
    /// Records for training, validation and test.
    pub records: [&'a [Record]; 3],
    /// The number of threads that it may use.
    pub threads: usize,
}

/// Runs a diagnosis and returns its JSON, or the reason of a failure. The JSON must not depend on the number of threads.
pub type Diagnose<'a> = dyn Fn(&Case<'_>) -> Result<Value, String> + Sync + 'a;

impl Task {
    /// Runs the task.
    ///
    /// # Panics
    /// If the task belongs to another scenario.
    #[must_use]
    pub fn run(&self, scenario: &Scenario, threads: usize, diagnose: &Diagnose<'_>) -> Value {
        let mut result = Map::new();
        result.insert("task".into(), json!(self.hash));
        result.insert("program".into(), json!(PROGRAM));
        match (&self.what, &scenario.work) {
            (TaskKind::Run { plant, record, values, noise }, Work::Simulate(all)) => {
                simulate(all, [*plant, *record], values, *noise, &mut result);
            }
            (TaskKind::Diagnosis(place), Work::Diagnose(all)) => {
                let it = &all[*place];
                let [records, validate, test] = &it.records;
                result.insert("name".into(), json!(it.name));
                result.insert("plant".into(), json!(it.plant_name));
                let made = diagnose(&Case { plant: &it.plant, records: [records, validate, test], threads });
                let (diagnosis, failed) = made.map_or_else(|why| (Value::Null, json!(why)), |value| (value, Value::Null));
                result.insert("diagnosis".into(), diagnosis);
                result.insert("failed".into(), failed);
            }
            _ => panic!("a task is run with the scenario that it is of"),
        }
        Value::Object(result)
    }
}

/// The bytes of a result, as stored in a folder and as returned by a worker.
#[must_use]
pub(crate) fn bytes(result: &Value) -> Vec<u8> {
    let mut text = result.to_string();
    text.push('\n');
    text.into_bytes()
}

fn simulate(
    all: &Simulations,
    [plant, record]: [usize; 2],
    values: &[f64],
    noise: Option<u64>,
    result: &mut Map<String, Value>,
) {
    let it = &all.plants[plant];
    let along = &it.records[record];
    result.insert("plant".into(), json!(it.name));
    result.insert("record".into(), json!(all.records[record]));
    let numbers = all.factors.iter().zip(&it.places).zip(values);
    let settings = numbers.map(|((factor, place), value)| (factor.name.clone(), json!({ "value": value, "unit": place.unit })));
    result.insert("settings".into(), Value::Object(settings.collect()));
    result.insert("noise_seed".into(), json!(noise));
    let file = set(it, values);
    let run = Simulator::new(&file, along).map_err(|faults| faults.to_string());
    let run = run.and_then(|mut simulator| simulator.run(along).map_err(|stopped| stopped.to_string()));
    let (outputs, failed) = match run {
        Ok(mut outputs) => {
            if let Some(seed) = noise {
                add_noise(&file, &mut outputs, seed);
            }
            (figures(all, along, &file, &outputs), Value::Null)
        }
        Err(why) => (Value::Null, json!(why)),
    };
    result.insert("outputs".into(), outputs);
    result.insert("failed".into(), failed);
}

/// Adds white normal noise to each output, as the plant file states.
fn add_noise(file: &PlantFile, outputs: &mut Outputs, seed: u64) {
    let mut random = Random::new(seed);
    for (signal, values) in outputs.signals.iter().zip(&mut outputs.values) {
        if let Some((_, sd)) = file.noise.iter().find(|it| it.0 == signal.name) {
            values.iter_mut().for_each(|value| *value += sd * random.normal());
        }
    }
}

fn figures(all: &Simulations, record: &Record, file: &PlantFile, outputs: &Outputs) -> Value {
    let one = |(name, statistics): &(String, Vec<Statistic>)| {
        let values = outputs.of(name).unwrap_or_default();
        let signal = outputs.signals.iter().find(|it| it.name == *name);
        let measured = file.kind.output(name).and_then(|place| record.measured[place].as_deref());
        let mut found = Map::from_iter([("unit".to_string(), json!(signal.map_or("1", |it| it.unit)))]);
        // serde_json writes null for a number that is not finite.
        for it in statistics {
            found.insert(it.name().into(), json!(statistic(*it, values, measured.unwrap_or_default())));
        }
        if all.whole_records {
            found.insert("values".into(), json!(values));
        }
        (name.clone(), Value::Object(found))
    };
    Value::Object(all.outputs.iter().map(one).collect())
}

fn statistic(which: Statistic, values: &[f64], measured: &[f64]) -> f64 {
    let count = values.len() as f64;
    match which {
        Statistic::Final => values.last().copied().unwrap_or(f64::NAN),
        Statistic::Min => values.iter().copied().fold(f64::INFINITY, f64::min),
        Statistic::Max => values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        Statistic::Mean => values.iter().sum::<f64>() / count,
        Statistic::Rms => (values.iter().map(|it| it * it).sum::<f64>() / count).sqrt(),
        Statistic::Rmse => (values.iter().zip(measured).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / count).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_by_hand() {
        let (values, measured) = ([3.0, -4.0, 0.0, 5.0], [3.0, -2.0, 0.0, 1.0]);
        let found = Statistic::ALL.map(|(_, it)| statistic(it, &values, &measured));
        // Squares: 9 + 16 + 0 + 25 = 50; differences 0, -2, 0, 4: 20.
        assert_eq!(found, [5.0, -4.0, 5.0, 1.0, 12.5f64.sqrt(), 5f64.sqrt()]);
        // Without rows the result is NaN, which JSON writes as null.
        assert_eq!(json!([statistic(Statistic::Mean, &[], &[]), f64::INFINITY]), json!([null, null]));
    }
}

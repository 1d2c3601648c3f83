//! What a simulation of a plant of equations costs, against the same plant in Rust.
//!
//! In: the shipped plants as texts, records of [`crate::simulation`]. Out: rows a second at an error that is at most that of the plant in Rust, of one lane and of eight; the time from text to first row.
//! The reference of both errors is the text at a tolerance of 1e-13.

use std::time::Instant;

use rsm_core::source::{Fault, Faults, Source};
use rsm_sim::equations::{EquationFile, Inputs, Lane, Lanes, Machine, Method, Setting, Signals};
use rsm_sim::record::Record;
use rsm_sim::schema;
use rsm_sim::simulate::Simulator;

use crate::simulation::Subject;

/// Runs of which the shortest counts.
const RUNS: usize = 31;

/// Lanes that run side by side.
pub const LANES: usize = 8;

/// A shipped plant as a text, with its record.
pub struct Text {
    /// The plant file.
    pub file: EquationFile,
    /// The machine, in the state of its start.
    pub machine: Machine,
    /// The record.
    pub signals: Signals,
    /// A run's start.
    pub lane: Lane,
    plant: String,
}

/// Seconds of the shortest of some runs.
pub fn shortest(mut run: impl FnMut()) -> f64 {
    let seconds = (0..RUNS).map(|_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    });
    seconds.fold(f64::INFINITY, f64::min)
}

fn read(plant: &str) -> EquationFile {
    let open = |name: &str| Err(Faults::one(Fault::whole_file(name, "a shipped text stands in the program")));
    EquationFile::read(&Source::new("plant.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

impl Text {
    /// The text of a subject's plant with the numbers of its plant file.
    ///
    /// # Panics
    /// When it cannot be read: it is part of the project.
    #[must_use]
    pub fn of(subject: &Subject, record: &Record) -> Text {
        let nominal = subject.nominal();
        let numbers: String = schema::parameters(nominal.kind)
            .iter()
            .filter_map(|it| Some(format!("{} = {:?}\n", it.name, nominal.parameters.optional(it.name)?)))
            .collect();
        let (model, more) = match subject.plant {
            "pmac" => ("pmac", ""),
            "driveline" => ("driveline", "gear = 3\n[initial]\nroad_speed = 15.0\n"),
            _ => ("servo-axis#ServoAxisClosedLoop", "velocity_from_difference = true\n[initial]\nposition = 0.0\n"),
        };
        let plant = format!("format = 2\nmodel = \"rsm:{model}\"\n[parameters]\n{numbers}{more}");
        let file = read(&plant);
        let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
        let names: Vec<String> = machine.inputs().into_iter().map(|it| it.0).collect();
        let mut columns: Vec<(&str, &[f64])> = vec![("time", &record.time)];
        columns.extend(names.iter().zip(&record.inputs).map(|(name, values)| (name.as_str(), values.as_slice())));
        let signals = Signals::in_memory(&file, &machine, &columns).unwrap_or_else(|faults| panic!("{faults}"));
        let first: Vec<f64> = signals.inputs.iter().map(|it| it[0]).collect();
        let (given, recorded) = signals.start(&file, &machine);
        let start =
            machine.start_along(&file, signals.time[0], &first, &given, &recorded).unwrap_or_else(|faults| panic!("{faults}"));
        let lane = Lane::new(&machine, start);
        Text { file, machine, signals, lane, plant }
    }

    /// The inputs of the record.
    #[must_use]
    pub fn inputs(&self) -> Inputs<'_> {
        Inputs { time: &self.signals.time, values: &self.signals.inputs }
    }

    /// The outputs by name, at a tolerance.
    ///
    /// # Panics
    /// When the run ends early.
    #[must_use]
    pub fn outputs(&self, tolerance: f64) -> Vec<(String, Vec<f64>)> {
        let setting = Setting { method: Method::Automatic, tolerance };
        let found = Lanes::new(&self.machine).run(std::slice::from_ref(&self.lane), self.inputs(), setting).remove(0);
        let found = found.unwrap_or_else(|stopped| panic!("{stopped}"));
        self.machine.outputs().into_iter().map(|it| it.0).zip(found).collect()
    }

    /// Rows a second of so many lanes, all rows counted.
    ///
    /// # Panics
    /// When a run ends early.
    #[must_use]
    pub fn rows_per_second(&self, lanes: usize, tolerance: f64) -> f64 {
        let setting = Setting { method: Method::Automatic, tolerance };
        let all = vec![self.lane.clone(); lanes];
        let mut code = Lanes::new(&self.machine);
        let seconds = shortest(|| {
            for found in code.run(&all, self.inputs(), setting) {
                found.unwrap_or_else(|stopped| panic!("{stopped}"));
            }
        });
        (lanes * self.signals.time.len()) as f64 / seconds
    }

    /// Seconds from the plant file to the first row.
    ///
    /// # Panics
    /// When it cannot run.
    #[must_use]
    pub fn first_row(&self) -> f64 {
        shortest(|| {
            let file = read(&self.plant);
            let machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
            let rows = Inputs { time: &self.signals.time[..2], values: self.inputs().values };
            let found = Lanes::new(&machine).run(std::slice::from_ref(&self.lane), rows, Setting::default()).remove(0);
            found.unwrap_or_else(|stopped| panic!("{stopped}"));
        })
    }
}

/// The largest difference of any output from a reference, as a share of the output's size.
#[must_use]
pub fn error(found: &[(String, Vec<f64>)], reference: &[(String, Vec<f64>)]) -> f64 {
    let mut worst = 0.0_f64;
    for (name, values) in found {
        let Some((_, wanted)) = reference.iter().find(|it| it.0 == *name) else { continue };
        let size = wanted.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let off = values.iter().zip(wanted).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        worst = worst.max(off / size);
    }
    worst
}

/// The outputs of the plant in Rust.
///
/// # Panics
/// When it cannot run.
#[must_use]
pub fn in_rust(subject: &Subject, record: &Record) -> Vec<(String, Vec<f64>)> {
    let found = Simulator::new(&subject.nominal(), record).unwrap_or_else(|faults| panic!("{faults}")).run(record);
    let found = found.unwrap_or_else(|stopped| panic!("{stopped}"));
    found.signals.iter().map(|it| it.name.to_string()).zip(found.values).collect()
}

/// The loosest of some tolerances at which a text is at least as exact as the plant in Rust; the error there, the error in Rust.
#[must_use]
pub fn comparable(text: &Text, subject: &Subject, record: &Record) -> (f64, f64, f64) {
    let reference = text.outputs(1e-13);
    let rust = error(&in_rust(subject, record), &reference);
    let mut last = (f64::NAN, f64::NAN, rust);
    for digits in 2..12 {
        let tolerance = 10.0_f64.powi(-digits);
        last = (tolerance, error(&text.outputs(tolerance), &reference), rust);
        if last.1 <= rust {
            break;
        }
    }
    last
}

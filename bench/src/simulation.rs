//! The cost of a simulation and of a diagnosis.
//!
//! In: the plants that rsm-sim ships, an effect for each, records of steps from fixed seeds. Out: rows per second along a record of 8000 rows, and
//! the seconds of a diagnosis of three such records with sensor noise. Every run does the same as `rsm simulate` and `rsm diagnose`, except for
//! reading and writing files.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use rsm_core::source::Source;
use rsm_diagnose::plant::random::Random;
use rsm_diagnose::plant::{Diagnosis, Options, diagnose};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

/// The number of rows of a record.
pub const ROWS: usize = 8000;

/// The number of runs; the shortest time is used. A run takes some milliseconds, and any interruption only adds time.
const RUNS: usize = 31;

/// A plant, and the hidden effect in its records.
#[derive(Debug, Clone, Copy)]
pub struct Subject {
    /// The name of its file among the shipped ones, without extension.
    pub plant: &'static str,
    /// The effect's kind.
    pub effect: &'static str,
    /// The effect's parameters, as in a plant file.
    pub numbers: &'static str,
}

/// The three plants, each with an effect that often occurs, of a magnitude that is visible in 8000 rows.
pub const SUBJECTS: [Subject; 3] = [
    Subject { plant: "pmac", effect: "coulomb-friction", numbers: "torque = 0.1" },
    Subject { plant: "driveline", effect: "backlash", numbers: "gap = 0.05" },
    Subject { plant: "servo-axis", effect: "coulomb-friction", numbers: "force = 20.0" },
];

impl Subject {
    /// The shipped plant.
    ///
    /// # Panics
    /// If it cannot be read: it is part of the project.
    #[must_use]
    pub fn nominal(&self) -> PlantFile {
        self.file("")
    }

    /// The plant with its effect.
    #[must_use]
    pub fn hidden(&self) -> PlantFile {
        self.file(&format!("\n[[effects]]\nkind = \"{}\"\nparameters = {{ {} }}\n", self.effect, self.numbers))
    }

    fn file(&self, effects: &str) -> PlantFile {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../rsm-sim/plants/{}.toml", self.plant));
        let shipped = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let name = format!("{}.toml", self.plant);
        PlantFile::read(&Source::new(name, shipped + effects)).unwrap_or_else(|faults| panic!("{faults}"))
    }

    /// A record of the plant with its effect and its sensors' noise.
    ///
    /// # Panics
    /// If the plant cannot run: it is part of the project.
    #[must_use]
    pub fn record(&self, seed: u64) -> Record {
        let plant = self.hidden();
        let mut random = Random::new(seed);
        let text = match self.plant {
            "pmac" => motor(&mut random),
            "driveline" => car(&mut random),
            _ => axis(&mut random),
        };
        let mut record = Record::read(&Source::new("record.csv", text), &plant).unwrap_or_else(|faults| panic!("{faults}"));
        let outputs = Simulator::new(&plant, &record).unwrap_or_else(|faults| panic!("{faults}")).run(&record);
        let outputs = outputs.unwrap_or_else(|stopped| panic!("{}: {stopped}", self.plant));
        for (signal, values) in outputs.signals.iter().zip(&outputs.values) {
            let sd = plant.noise.iter().find(|(name, _)| *name == signal.name).map_or(0.0, |(_, sd)| *sd);
            let place = plant.kind.output(signal.name).expect("an output of the plant has a place");
            record.measured[place] = Some(values.iter().map(|value| value + sd * random.normal()).collect());
        }
        record
    }
}

/// A value with random steps.
struct Steps {
    until: usize,
    value: f64,
}

impl Steps {
    fn at(&mut self, row: usize, random: &mut Random, rows: (f64, f64), value: impl FnOnce(&mut Random) -> f64) -> f64 {
        if row >= self.until {
            self.until = row + (rows.0 + (rows.1 - rows.0) * random.uniform()) as usize;
            self.value = value(random);
        }
        self.value
    }
}

const STILL: Steps = Steps { until: 0, value: 0.0 };

/// 2 s at 4 kHz: speeds up to 120 rad/s in both directions, set by the voltage of their EMF, p lambda = 0.24 V s, with steps of v_d and of the load.
fn motor(random: &mut Random) -> String {
    let mut text = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
    let (mut target, mut direct, mut load, mut speed) = (STILL, STILL, STILL, 0.0);
    for row in 0..ROWS {
        let target = target.at(row, random, (600.0, 1600.0), |it| 240.0 * it.uniform() - 120.0);
        let v_d = direct.at(row, random, (200.0, 800.0), |it| it.uniform() - 0.5);
        let load = load.at(row, random, (400.0, 1000.0), |it| it.uniform() - 0.5);
        // The speed follows within 25 ms: the current stays below 60 A.
        speed += 0.01 * (target - speed);
        let v_q = 0.24 * speed + 0.2;
        let _ = writeln!(text, "{},{v_d},{v_q},{load},0,0,0", row as f64 * 2.5e-4);
    }
    text
}

/// 80 s at 100 Hz in third gear: tip-ins of every depth, and the same number of tip-outs.
fn car(random: &mut Random) -> String {
    let mut text = "time[s],throttle[1],gear[1],engine_speed[rad/s],road_speed[m/s],acceleration[m/s^2]\n".to_string();
    let (mut pedal, mut is_in) = (STILL, false);
    for row in 0..ROWS {
        let throttle = pedal.at(row, random, (70.0, 250.0), |it| {
            is_in = !is_in;
            it.uniform() * if is_in { 0.8 } else { 0.05 }
        });
        let _ = writeln!(text, "{},{throttle},3,0,15,0", row as f64 * 0.01);
    }
    text
}

/// 8 s at 1 kHz in closed loop: between random positions at up to 0.2 m/s.
fn axis(random: &mut Random) -> String {
    let mut text = "time[s],reference[m],position[m],command[V]\n".to_string();
    let (mut goal, mut place, mut speed) = (STILL, 0.0, 0.0);
    for row in 0..ROWS {
        let goal = goal.at(row, random, (400.0, 1200.0), |it| 0.2 * it.uniform() - 0.1);
        // The reference brakes at 1 m/s^2, so that it stops at its target.
        let away: f64 = goal - place;
        let wanted = away.signum() * (2.0 * away.abs()).sqrt().min(0.2);
        speed += (wanted - speed).clamp(-1e-3, 1e-3);
        place += speed * 1e-3;
        let _ = writeln!(text, "{},{place},0,0", row as f64 * 1e-3);
    }
    text
}

/// Rows per second along a record, in the shortest of some runs.
///
/// # Panics
/// If the plant cannot run along it.
#[must_use]
pub fn rows_per_second(plant: &PlantFile, record: &Record) -> f64 {
    let mut simulator = Simulator::new(plant, record).unwrap_or_else(|faults| panic!("{faults}"));
    let seconds = (0..RUNS).map(|_| {
        let start = Instant::now();
        simulator.run(record).unwrap_or_else(|stopped| panic!("{stopped}"));
        start.elapsed().as_secs_f64()
    });
    record.rows() as f64 / seconds.fold(f64::INFINITY, f64::min)
}

/// A diagnosis of the nominal plant with two records, validated on a third, and its seconds with this number of threads.
///
/// # Panics
/// If there is nothing to compare: the records contain every output.
#[must_use]
pub fn diagnosed(subject: &Subject, threads: usize) -> (Diagnosis, f64) {
    let records: Vec<Record> = (1..=3).map(|seed| subject.record(seed)).collect();
    let nominal = subject.nominal();
    let start = Instant::now();
    let options = Options { threads, progress: &|_| {} };
    let found = diagnose(&nominal, &records[..2], &records[2..], &options).unwrap_or_else(|refused| panic!("{refused}"));
    (found, start.elapsed().as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_records_move_every_output_and_their_effect_shows() {
        for subject in SUBJECTS {
            let record = subject.record(1);
            assert_eq!(record.rows(), ROWS);
            let without = Simulator::new(&subject.nominal(), &record).unwrap().run(&record).unwrap();
            let mut shows = false;
            for (signal, values) in without.signals.iter().zip(&without.values) {
                let noise = subject.nominal().noise.iter().find(|(name, _)| *name == signal.name).unwrap().1;
                let measured = record.measured[subject.nominal().kind.output(signal.name).unwrap()].as_ref().unwrap();
                let (low, high) = measured.iter().fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(*it), high.max(*it)));
                // Ten standard deviations between the extremes is more than the noise gives in 8000 rows (eight).
                assert!(high - low > 10.0 * noise, "{} {}", subject.plant, signal.name);
                shows |= measured.iter().zip(values).any(|(a, b)| (a - b).abs() > 10.0 * noise);
            }
            assert!(shows, "{}: {} does not show", subject.plant, subject.effect);
        }
    }
}

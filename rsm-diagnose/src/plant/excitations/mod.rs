//! The library of excitations: records that a bench, a track or an axis could make next.
//!
//! In: the accepted plant and the range of its records. Out: [`Excitation`]s, each a record of inputs whose motion stays within the [`Limits`] of the
//! plant file (bus voltage, longest current vector, command limit) and of the records (speeds, travel, loads). A motion that exceeds them is made
//! smaller, and left out if it becomes too small to be useful. Independent of causes; evaluates nothing.

mod axis;
mod driveline;
mod inputs;
mod motor;
mod shapes;

use super::levenberg::Fit;
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{Drive, Record};
use rsm_sim::simulate::{Outputs, Simulator};

/// A possible record.
#[derive(Debug, Clone)]
pub struct Excitation {
    /// Its name.
    pub name: String,
    /// What happens in it, in words.
    pub words: &'static str,
    /// Inputs at every row, and outputs as the accepted plant predicts them.
    pub record: Record,
}

/// The limits of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// The kind of inputs that drive the plant in the records.
    pub drive: Drive,
    /// Sample period, in s.
    pub period: f64,
    /// Rows of a record.
    pub rows: usize,
    /// Lowest and highest simulated value of each output in the records.
    pub seen: [[f64; 2]; OUTPUTS],
    /// Lowest and highest load torque of a motor in the records, in N m.
    pub load: [f64; 2],
    /// Highest speed of an axis in the records, in m/s.
    pub speed: f64,
    /// Largest acceleration of the reference or the axis in the records, in m/s^2.
    pub acceleration: f64,
    /// Gears of a car in the records.
    pub gears: Vec<u8>,
    /// Lowest and highest value of each input of a plant of equations in the records.
    pub inputs: Vec<[f64; 2]>,
    /// For each output of a plant of equations, its first reading in the first record that holds it.
    pub starts: Vec<Option<f64>>,
    /// The parameters of a plant of equations that are set by the first record.
    pub settings: Vec<(&'static str, f64)>,
    /// The configuration of the first record.
    pub configuration: Option<usize>,
}

/// A motion may exceed the recorded range by this share of it. Models differ, and a small excess does no damage.
const SLACK: f64 = 0.05;

/// Amplitudes that are tried, as shares of the largest. With less than a fifth, the motion no longer matches its name.
const AMPLITUDES: [f64; 6] = [1.0, 0.8, 0.6, 0.45, 0.3, 0.2];

/// The smallest and the largest number of rows of a record: long enough for a noise floor (a spectrum of 512 rows), and short enough for hundreds of
/// simulations.
const ROWS: [usize; 2] = [1000, 8000];

impl Limits {
    /// The limits from the records of a fit.
    #[must_use]
    pub fn of(whitened: &WhitenedResiduals, fit: &Fit) -> Option<Limits> {
        let first = whitened.records.first()?;
        let mut limits = Limits {
            drive: first.record.drive,
            period: first.record.period,
            rows: whitened.records.iter().map(|it| it.record.rows()).max()?.clamp(ROWS[0], ROWS[1]),
            seen: [[f64::INFINITY, f64::NEG_INFINITY]; OUTPUTS],
            load: [f64::INFINITY, f64::NEG_INFINITY],
            speed: 0.0,
            acceleration: 0.0,
            gears: Vec::new(),
            inputs: Vec::new(),
            starts: Vec::new(),
            settings: first.record.settings.clone(),
            configuration: first.record.configuration,
        };
        limits.inputs = vec![[f64::INFINITY, f64::NEG_INFINITY]; first.record.inputs.len()];
        let first =
            |output: usize| whitened.records.iter().find_map(|it| it.record.measured[output].as_ref()?.first().copied());
        limits.starts = (0..fit.model.file.kind.outputs().len()).map(first).collect();
        for (prepared, simulated) in whitened.records.iter().zip(&fit.simulated) {
            let record = &prepared.record;
            for (output, values) in prepared.outputs.iter().zip(simulated) {
                limits.seen[*output] = widened(limits.seen[*output], values);
            }
            match fit.model.file.kind {
                kind if kind.is("pmac") => limits.load = widened(limits.load, &record.inputs[2]),
                kind if kind.is("driveline") => {
                    let gear = record.setting("gear").map_or(1, |gear| gear as u8);
                    if !limits.gears.contains(&gear) {
                        limits.gears.push(gear);
                    }
                }
                kind if kind.is("servo-axis") => {
                    // The axis follows its reference except for overshoot. In open loop, the simulated motion gives the speeds.
                    let path = match record.drive {
                        Drive::Closed => record.inputs.first(),
                        _ => simulated.first(),
                    };
                    let (speed, acceleration) = path.map_or((0.0, 0.0), |path| rates(path, record.period));
                    limits.speed = limits.speed.max(speed);
                    limits.acceleration = limits.acceleration.max(acceleration);
                }
                _ => {
                    for (range, values) in limits.inputs.iter_mut().zip(&record.inputs) {
                        *range = widened(*range, values);
                    }
                }
            }
        }
        limits.gears.sort_unstable();
        Some(limits)
    }

    /// Whether simulated outputs stay within the limits.
    fn contain(&self, file: &PlantFile, outputs: &Outputs) -> bool {
        let names = file.kind.outputs();
        let within = |output: usize, [low, high]: [f64; 2]| {
            let slack = SLACK * (high - low);
            let values = outputs.of(names[output].name).unwrap_or(&[]);
            values.iter().all(|value| *value >= low - slack && *value <= high + slack)
        };
        match file.kind {
            kind if kind.is("pmac") => {
                let most = file.parameters.number("current_limit");
                let i_q = outputs.of("i_q").unwrap_or(&[]);
                let short = |(k, q): (usize, &f64)| outputs.of("i_d").map_or(0.0, |i_d| i_d[k]).hypot(*q) <= most;
                // A motor that turned in one direction may turn in the other.
                let top = self.largest_speed();
                i_q.iter().enumerate().all(short) && within(2, [-top, top])
            }
            kind if kind.is("driveline") => {
                let seen = if self.seen[0][0].is_finite() { Some((0, self.seen[0])) } else { None };
                seen.is_none_or(|(output, range)| within(output, range)) && within(1, [0.0, f64::MAX])
            }
            kind if kind.is("servo-axis") => within(0, self.seen[0]),
            _ => (0..names.len()).all(|output| within(output, self.seen[output])),
        }
    }

    /// The highest recorded speed of a motor, in rad/s.
    fn largest_speed(&self) -> f64 {
        let [low, high] = self.seen[2];
        if low.is_finite() { low.abs().max(high.abs()) } else { 0.0 }
    }
}

/// A range, extended to contain more values.
fn widened(range: [f64; 2], values: &[f64]) -> [f64; 2] {
    values.iter().fold(range, |[low, high], value| [low.min(*value), high.max(*value)])
}

/// The largest first and second derivative of a path, over ten periods: a step of a reference has no finite derivative.
fn rates(path: &[f64], period: f64) -> (f64, f64) {
    const WIDTH: usize = 10;
    let span = WIDTH as f64 * period;
    let speeds: Vec<f64> = path.windows(WIDTH + 1).map(|w| (w[WIDTH] - w[0]) / span).collect();
    let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let changes: Vec<f64> = speeds.windows(WIDTH + 1).map(|w| (w[WIDTH] - w[0]) / span).collect();
    (largest(&speeds), largest(&changes))
}

/// Makes a record of a given amplitude; `None` if that is impossible.
type RecordMaker<'a> = dyn Fn(f64) -> Option<Record> + 'a;

/// A record of inputs that starts at time 0 and at rest. Its outputs are predicted later.
fn blank(name: &str, limits: &Limits, rows: usize, inputs: Vec<Vec<f64>>) -> Record {
    Record {
        file: name.to_string(),
        drive: limits.drive,
        time: (0..rows).map(|row| row as f64 * limits.period).collect(),
        period: limits.period,
        inputs,
        starts: Vec::new(),
        settings: limits.settings.clone(),
        configuration: limits.configuration,
        breaks: Vec::new(),
        measured: vec![Some(vec![0.0]); OUTPUTS],
    }
}

/// The excitations of a plant, in the order of the library. Every plant of `accepted` must stay within the limits along each; the first one predicts
/// the outputs.
#[must_use]
pub fn library(accepted: &[&PlantFile], limits: &Limits) -> Vec<Excitation> {
    let Some(first) = accepted.first() else { return Vec::new() };
    match first.kind {
        kind if kind.is("pmac") => motor::library(accepted, limits),
        kind if kind.is("driveline") => driveline::library(accepted, limits),
        kind if kind.is("servo-axis") => axis::library(accepted, limits),
        _ => inputs::library(accepted, limits),
    }
}

/// The record with the largest amplitude for which every plant stays within the limits.
fn largest_within_limits(
    accepted: &[&PlantFile],
    limits: &Limits,
    name: &str,
    words: &'static str,
    make: &RecordMaker<'_>,
) -> Option<Excitation> {
    AMPLITUDES.iter().find_map(|amplitude| {
        let record = predicted(accepted, limits, make(*amplitude)?)?;
        Some(Excitation { name: name.to_string(), words, record })
    })
}

/// The record with the first plant's outputs, if all plants stay within the limits.
fn predicted(accepted: &[&PlantFile], limits: &Limits, mut record: Record) -> Option<Record> {
    let mut prediction = None;
    for plant in accepted {
        let outputs = along(plant, &record)?;
        if !limits.contain(plant, &outputs) {
            return None;
        }
        prediction = prediction.or(Some(outputs));
    }
    let kind = accepted.first()?.kind;
    let outputs = prediction?;
    record.measured = kind.outputs().iter().map(|signal| outputs.of(signal.name).map(<[f64]>::to_vec)).collect();
    Some(record)
}

/// The outputs along a record, without the start values of the plant file.
fn along(plant: &PlantFile, record: &Record) -> Option<Outputs> {
    let bare = PlantFile { initial: Vec::new(), ..plant.clone() };
    Simulator::new(&bare, record).ok()?.run(record).ok()
}

/// A record as CSV text: inputs and predicted outputs, as `rsm simulate` reads it.
#[must_use]
pub fn csv(plant: &PlantFile, excitation: &Excitation) -> String {
    use rsm_sim::kind::Signal;
    let record = &excitation.record;
    let given = record.given(plant.kind);
    let mut columns: Vec<(Signal, &[f64])> = given.iter().map(|(signal, values)| (*signal, &**values)).collect();
    for (signal, values) in plant.kind.outputs().iter().zip(&record.measured) {
        if let Some(values) = values
            && !columns.iter().any(|(there, _)| there == signal)
        {
            columns.push((*signal, values));
        }
    }
    format!(
        "# {}: {}. Outputs are what extended.toml predicts; measure them.\n{}",
        excitation.name,
        excitation.words,
        rsm_sim::record::csv(&columns)
    )
}

/// The predicted outputs of a record in the order of its outputs.
#[must_use]
pub fn outputs_of(record: &Record, outputs: &[usize]) -> Option<Simulated> {
    outputs.iter().map(|output| record.measured[*output].clone()).collect()
}

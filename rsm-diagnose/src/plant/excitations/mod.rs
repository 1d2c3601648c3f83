//! The library of excitations: records that a bench, a track or an axis could make next.
//!
//! In: the accepted plant and the range of its records. Out: [`Excitation`]s, each a record of inputs whose motion stays within the [`Limits`] of the
//! plant file (bus voltage, longest current vector, command limit) and of the records (speeds, travel, loads). A motion that exceeds them is made
//! smaller, and left out if it becomes too small to be useful. The sites of a plant decide which records it gets: those of an electrical machine, of
//! a vehicle, of a body on a line, or changes of any inputs. Independent of causes; evaluates nothing.

mod axis;
mod inputs;
mod motor;
mod shapes;
mod vehicle;

use super::levenberg::Fit;
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_sim::equation_plant::{Body, SiteKind, SiteSignal, bodies, site_signals};
use rsm_sim::kind::{OUTPUTS, PlantKind};
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
    /// Highest speed of the reference, or of the body on a line, in the records, in m/s.
    pub speed: f64,
    /// Largest acceleration of the reference, or of the body on a line, in the records, in m/s^2.
    pub acceleration: f64,
    /// Lowest and highest value of each input in the records.
    pub inputs: Vec<[f64; 2]>,
    /// For each output, its first reading in the first record that holds it.
    pub starts: Vec<Option<f64>>,
    /// The parameters that are set by the first record.
    pub settings: Vec<(&'static str, f64)>,
    /// The parameters that are set by each record, without repetitions.
    pub all_settings: Vec<Vec<(&'static str, f64)>>,
    /// The quantities at the sites along the first record.
    signals: Vec<SiteSignal>,
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
            speed: 0.0,
            acceleration: 0.0,
            inputs: Vec::new(),
            starts: Vec::new(),
            settings: first.record.settings.clone(),
            all_settings: Vec::new(),
            signals: site_signals(&fit.model.for_record(0, &first.record), &first.record).unwrap_or_default(),
            configuration: first.record.configuration,
        };
        let path = line(fit.model.file.kind).and_then(|body| fit.model.file.kind.output(body.position?));
        limits.inputs = vec![[f64::INFINITY, f64::NEG_INFINITY]; first.record.inputs.len()];
        let first =
            |output: usize| whitened.records.iter().find_map(|it| it.record.measured[output].as_ref()?.first().copied());
        limits.starts = (0..fit.model.file.kind.outputs().len()).map(first).collect();
        for (prepared, simulated) in whitened.records.iter().zip(&fit.simulated) {
            let record = &prepared.record;
            for (output, values) in prepared.outputs.iter().zip(simulated) {
                limits.seen[*output] = widened(limits.seen[*output], values);
            }
            for (range, values) in limits.inputs.iter_mut().zip(&record.inputs) {
                *range = widened(*range, values);
            }
            if !limits.all_settings.contains(&record.settings) {
                limits.all_settings.push(record.settings.clone());
            }
            // The body follows its reference except for overshoot. Without a controller, the simulated motion gives the speeds.
            let path = match record.drive {
                Drive::Closed => record.inputs.first(),
                _ => prepared.outputs.iter().position(|it| Some(*it) == path).map(|k| &simulated[k]),
            };
            let (speed, acceleration) = path.map_or((0.0, 0.0), |path| rates(path, record.period));
            limits.speed = limits.speed.max(speed);
            limits.acceleration = limits.acceleration.max(acceleration);
        }
        limits.all_settings.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        Some(limits)
    }

    /// The first value of a scalar role of a site in the first record.
    fn role(&self, at: &str, role: &str) -> Option<f64> {
        let signal = self.signals.iter().find(|it| it.at == at && it.role == role)?;
        signal.parts.first()?.first().copied()
    }

    /// Whether the simulated values of an output stay within its values in the records.
    fn holds(&self, kind: PlantKind, outputs: &Outputs, output: usize) -> bool {
        let [low, high] = self.seen[output];
        is_within(kind, outputs, output, [low, high])
    }
}

/// Whether the simulated values of an output stay within a range.
fn is_within(kind: PlantKind, outputs: &Outputs, output: usize, [low, high]: [f64; 2]) -> bool {
    let slack = SLACK * (high - low);
    let values = outputs.of(kind.outputs()[output].name).unwrap_or(&[]);
    values.iter().all(|value| *value >= low - slack && *value <= high + slack)
}

/// The first body that moves on a line.
fn line(kind: PlantKind) -> Option<Body> {
    bodies(kind).into_iter().find(|it| it.kind == SiteKind::Translation)
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
    if accepted.is_empty() {
        return Vec::new();
    }
    motor::library(accepted, limits)
        .or_else(|| vehicle::library(accepted, limits))
        .or_else(|| axis::library(accepted, limits))
        .unwrap_or_else(|| inputs::library(accepted, limits))
}

/// Records that are being collected, and the rule that their outputs must keep.
struct Collected<'a> {
    accepted: &'a [&'a PlantFile],
    is_allowed: &'a dyn Fn(&PlantFile, &Outputs) -> bool,
    list: Vec<Excitation>,
}

impl<'a> Collected<'a> {
    fn new(accepted: &'a [&'a PlantFile], is_allowed: &'a dyn Fn(&PlantFile, &Outputs) -> bool) -> Self {
        Collected { accepted, is_allowed, list: Vec::new() }
    }

    /// Adds the record with the largest amplitude for which every plant stays within the limits.
    fn add(&mut self, name: &str, words: &'static str, make: &RecordMaker<'_>) {
        let found = AMPLITUDES.iter().find_map(|amplitude| {
            let record = self.predicted(make(*amplitude)?)?;
            Some(Excitation { name: name.to_string(), words, record })
        });
        self.list.extend(found);
    }

    /// The record with the first plant's outputs, if all plants stay within the limits.
    fn predicted(&self, mut record: Record) -> Option<Record> {
        let mut prediction = None;
        for plant in self.accepted {
            let outputs = along(plant, &record)?;
            if !(self.is_allowed)(plant, &outputs) {
                return None;
            }
            prediction = prediction.or(Some(outputs));
        }
        let kind = self.accepted.first()?.kind;
        let outputs = prediction?;
        record.measured = kind.outputs().iter().map(|signal| outputs.of(signal.name).map(<[f64]>::to_vec)).collect();
        Some(record)
    }
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

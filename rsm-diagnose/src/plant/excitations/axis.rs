//! Excitations of a body on a line: motions within the recorded travel, in closed loop as a reference, in open loop as a command.
//!
//! In: accepted plants and limits. Out: records of a reference or a command, the only input. An open-loop command is either the one that a velocity
//! and position controller needs for the motion on the accepted plant, or a pattern of pulses. The motion never leaves the recorded travel and never
//! exceeds the recorded speed.

use std::cell::{Cell, RefCell};

use super::shapes::{Path, binary};
use super::{Collected, Excitation, Limits, blank, line};
use rsm_sim::equation_plant::{Body, Rates};
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::{Drive, Record};
use rsm_sim::simulate::{Outputs, Simulator};

/// Samples per time constant of the velocity loop that finds a command. The loop is fast, and sampled finely enough to be stable with any mechanics.
const SAMPLES: f64 = 20.0;

/// The velocity loop is this many times faster than the position loop around it.
const CASCADE: f64 = 4.0;

/// The largest command of a motion, as a share of the command limit.
const OF_COMMAND: f64 = 0.9;

struct Axis<'a> {
    plant: &'a PlantFile,
    limits: &'a Limits,
    /// The output that is the position.
    position: usize,
    /// The largest command, in its unit.
    most: f64,
    /// The acceleration by a command of 1, in m/s^2.
    gain: f64,
    /// Ends of the travel, in m.
    low: f64,
    high: f64,
}

impl Axis<'_> {
    /// A record in which the axis follows a path from its middle.
    fn follows(&self, name: &str, path: &Path) -> Option<Record> {
        let rows = self.limits.rows;
        let (reference, _) = path.sampled(rows, self.limits.period);
        if self.limits.drive == Drive::Closed {
            return Some(self.at(blank(name, self.limits, rows, vec![reference])));
        }
        // The command that the controller needs on the accepted plant. Its speed is the difference of two positions.
        let rate = 1.0 / (SAMPLES * self.limits.period);
        let commands = RefCell::new(Vec::with_capacity(rows));
        let before = Cell::new(self.middle());
        let mut each_row = |row: usize, outputs: &[f64]| -> f64 {
            let position = outputs[self.position];
            let speed = (position - before.replace(position)) / self.limits.period;
            let wanted = if row == 0 { 0.0 } else { rate / CASCADE * (reference[row] - position) };
            let command = rate * (wanted - speed) / self.gain;
            commands.borrow_mut().push(command);
            command
        };
        let record = self.at(blank(name, self.limits, rows, vec![vec![0.0; rows]]));
        Simulator::new(&self.without_sensors(), &record).ok()?.run_controlled(&record, &mut each_row).ok()?;
        let commands = commands.into_inner();
        let most = OF_COMMAND * self.most;
        if commands.len() != rows || commands.iter().any(|command| command.abs() > most) {
            return None;
        }
        Some(self.at(blank(name, self.limits, rows, vec![commands])))
    }

    /// The plant without effects on its readings: a controller would react to a coarse reading.
    fn without_sensors(&self) -> PlantFile {
        let kind = self.plant.kind;
        let is_inside = |it: &&Entry| it.arguments.subject.as_deref().is_none_or(|at| kind.output(at).is_none());
        let effects = self.plant.effects.iter().filter(is_inside).cloned().collect();
        PlantFile { initial: Vec::new(), effects, ..self.plant.clone() }
    }

    /// The record, starting in the middle of the travel.
    fn at(&self, mut record: Record) -> Record {
        let start = match record.drive {
            Drive::Closed => record.inputs[0].first().copied().unwrap_or(0.0),
            _ => self.middle(),
        };
        record.measured[self.position] = Some(vec![start; record.rows()]);
        record
    }

    fn middle(&self) -> f64 {
        0.5 * (self.low + self.high)
    }

    fn seconds(&self) -> f64 {
        self.limits.rows as f64 * self.limits.period
    }
}

/// A motion at constant speed, with ramps of a fixed acceleration, as short pieces of constant acceleration.
fn moves(path: &mut Path, to: f64, speed: f64, acceleration: f64, period: f64) {
    let from = path.last();
    let distance = (to - from).abs();
    if distance == 0.0 || speed <= 0.0 || acceleration <= 0.0 {
        return;
    }
    let speed = speed.min((distance * acceleration).sqrt());
    let (ramp, flat) = (speed / acceleration, (distance / speed - speed / acceleration).max(0.0));
    let steps = ((2.0 * ramp + flat) / period).ceil().max(1.0) as usize;
    for step in 1..=steps {
        let t = (step as f64 * period).min(2.0 * ramp + flat);
        let gone = if t < ramp {
            0.5 * acceleration * t * t
        } else if t < ramp + flat {
            0.5 * speed * ramp + speed * (t - ramp)
        } else {
            distance - 0.5 * acceleration * (2.0 * ramp + flat - t).powi(2)
        };
        path.line_to(from + (to - from).signum() * gone, period);
    }
}

/// All excitations of a body on a line that one input moves; `None` for another plant.
pub(super) fn library(accepted: &[&PlantFile], limits: &Limits) -> Option<Vec<Excitation>> {
    let plant = accepted.first()?;
    let kind = plant.kind;
    let body = line(kind)?;
    let position = kind.output(body.position?)?;
    let [low, high] = limits.seen[position];
    let half = 0.5 * (high - low);
    let moves_at_all = half > 0.0 && half.is_finite() && limits.speed > 0.0 && limits.acceleration > 0.0;
    let [range] = limits.inputs[..] else { return None };
    if !moves_at_all {
        return None;
    }
    // A limit that the plant file does not have is that of the records.
    let recorded = range[0].abs().max(range[1].abs());
    let most = plant.parameters.optional("command_limit").unwrap_or(recorded);
    let gain = if limits.drive == Drive::Closed { 1.0 } else { acceleration_of_command(plant, limits, &body)? };
    let is_allowed = |_: &PlantFile, outputs: &Outputs| limits.holds(kind, outputs, position);
    let axis = Axis { plant, limits, position, most, gain, low, high };
    let mut list = Collected::new(accepted, &is_allowed);
    let (middle, period, seconds) = (axis.middle(), limits.period, axis.seconds());
    let (fast, steep) = (limits.speed, limits.acceleration);
    let mut add = |name: &str, words: &'static str, make: &super::RecordMaker<'_>| list.add(name, words, make);
    // Moves to one position after another at a speed, with rests, until the record is full.
    let places = |places: &[f64], speed: f64, rest: f64, a: f64| {
        let mut path = Path::from(middle);
        let mut k = 0;
        while path.end() < seconds {
            let before = path.end();
            moves(&mut path, middle + a * 0.9 * half * places[k % places.len()], speed, steep, period);
            path.hold(rest);
            k += 1;
            if path.end() <= before {
                break;
            }
        }
        path
    };
    add("trapezoids", "moves over the travel at the highest speed that was seen, in both directions, with rests", &|a| {
        axis.follows("trapezoids", &places(&[1.0, -1.0, 0.3, -0.6, 0.8], fast, 0.02 * seconds, a))
    });
    add("medium trapezoids", "moves at a third of the highest speed, in both directions", &|a| {
        axis.follows("medium trapezoids", &places(&[0.6, -0.6, 0.2, -0.2], fast / 3.0, 0.02 * seconds, a))
    });
    add("slow reversals", "slow moves with many reversals", &|a| {
        // Eight reversals: each stroke takes an eighth of the record.
        let reach = (0.03 * fast * seconds / 8.0).min(0.5 * half);
        let mut path = Path::from(middle);
        for k in 0..9 {
            let side = if k % 2 == 0 { 1.0 } else { -1.0 };
            path.line_to(middle + a * side * reach, seconds / 9.0);
        }
        axis.follows("slow reversals", &path)
    });
    add("inching", "small moves in one direction with rests, then back", &|a| {
        let stairs: Vec<f64> = (0..8).map(|k| if k < 4 { 0.08 * (k + 1) as f64 } else { 0.08 * (7 - k) as f64 }).collect();
        axis.follows("inching", &places(&stairs, 0.3 * fast, 0.05 * seconds, a))
    });
    add("rests", "moves to both ends with long rests", &|a| {
        axis.follows("rests", &places(&[0.8, -0.8], 0.5 * fast, 0.15 * seconds, a))
    });
    add("chirp", "a sine of rising frequency whose speed is that of the records", &|a| {
        // The number of periods per record grows from 1 to 24 in a geometric series. The amplitude falls as the frequency rises, so that the speed
        // stays the same.
        let mut path = Path::from(middle);
        let rows = limits.rows;
        for row in 1..rows {
            let t = row as f64 * period;
            let cycles = t / seconds * (1.0 + 11.5 * t / seconds);
            let rate = std::f64::consts::TAU * (1.0 + 23.0 * t / seconds) / seconds;
            let reach = (0.5 * half).min(0.5 * fast / rate).min(0.5 * steep / (rate * rate));
            path.line_to(middle + a * reach * (std::f64::consts::TAU * cycles).sin(), period);
        }
        axis.follows("chirp", &path)
    });
    if limits.drive != Drive::Closed {
        add("pulses", "pulses of the command in both directions, from rest", &|a| {
            // A pulse of half the limit. The amplitude is reduced until the motion stays within the travel.
            let level = 0.5 * a * most;
            let hold = (limits.rows / 64).max(1);
            let pattern = [1.0, -1.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0];
            let commands = (0..limits.rows).map(|row| level * pattern[row / hold % pattern.len()]).collect();
            Some(axis.at(blank("pulses", limits, limits.rows, vec![commands])))
        });
        add("binary command", "a binary sequence of the command", &|a| {
            let level = 0.3 * a * most;
            let hold = (limits.rows / 400).max(1);
            // Each value once forward and once backward, so that the sequence has no mean that drives the axis away.
            let half: Vec<f64> = binary(limits.rows / 2 + 1, hold, 0);
            let pairs = half.chunks(hold).flat_map(|part| part.iter().copied().chain(part.iter().map(|it| -it)));
            let commands: Vec<f64> = pairs.map(|it| level * it).take(limits.rows).collect();
            Some(axis.at(blank("binary command", limits, limits.rows, vec![commands])))
        });
    }
    Some(list.list)
}

/// The acceleration of a body by a command of 1 more, at rest at the start.
fn acceleration_of_command(plant: &PlantFile, limits: &Limits, body: &Body) -> Option<f64> {
    let record = blank("at rest", limits, 2, vec![vec![0.0; 2]]);
    let bare = PlantFile { initial: Vec::new(), effects: Vec::new(), ..plant.clone() };
    let mut rates = Rates::new(&bare, &record).ok()?;
    let speed = rates.states().iter().position(|it| Some(it.as_str()) == body.speed)?;
    let start = rates.start().to_vec();
    let [without, with] = [0.0, 1.0].map(|command| rates.at(0.0, &start, &[command])[speed]);
    Some(with - without).filter(|it| it.is_finite() && *it != 0.0)
}

//! Excitations of an axis: motions within the recorded travel, in closed loop as a reference, in open loop as a command.
//!
//! In: accepted plants and limits. Out: records of a reference or a command. An open-loop command is either the one that a velocity and position
//! controller needs for the motion on the accepted axis, or a pattern of pulses. The motion never leaves the recorded travel and never exceeds the
//! recorded speed.

use super::shapes::{Path, binary};
use super::{Excitation, Limits, blank, largest_within_limits};
use rsm_sim::plant_file::{Parameters, PlantFile, VelocityFrom};
use rsm_sim::record::{Drive, Record};
use rsm_sim::simulate::Simulator;

/// Samples per time constant of the velocity loop that finds a command. The loop is fast, and sampled finely enough to be stable with any mechanics.
const SAMPLES: f64 = 20.0;

/// The velocity loop is this many times faster than the position loop around it.
const CASCADE: f64 = 4.0;

/// The largest command of a motion, as a share of the command limit.
const OF_COMMAND: f64 = 0.9;

struct Axis<'a> {
    plant: &'a PlantFile,
    limits: &'a Limits,
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
        // The command that the controller needs on the accepted axis.
        let mut with_loop = self.plant.clone();
        with_loop.initial.clear();
        let parameters: &mut Parameters = &mut with_loop.parameters;
        let rate = 1.0 / (SAMPLES * self.limits.period);
        parameters.set("velocity_gain", rate * parameters.number("mass") / parameters.number("force_gain"));
        parameters.set("position_gain", rate / CASCADE);
        parameters.velocity_from = VelocityFrom::State;
        let closed = Record { drive: Drive::Closed, ..self.at(blank(name, self.limits, rows, vec![reference])) };
        let outputs = Simulator::new(&with_loop, &closed).ok()?.run(&closed).ok()?;
        let commands = outputs.of("command")?.to_vec();
        let most = OF_COMMAND * self.plant.parameters.number("command_limit");
        if commands.iter().any(|command| command.abs() > most) {
            return None;
        }
        Some(self.at(blank(name, self.limits, rows, vec![commands])))
    }

    /// The record, starting in the middle of the travel.
    fn at(&self, mut record: Record) -> Record {
        let start = match record.drive {
            Drive::Closed => record.inputs[0].first().copied().unwrap_or(0.0),
            _ => self.middle(),
        };
        record.measured[0] = Some(vec![start; record.rows()]);
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

/// All excitations of an axis.
pub(super) fn library(accepted: &[&PlantFile], limits: &Limits) -> Vec<Excitation> {
    let Some(plant) = accepted.first() else { return Vec::new() };
    let [low, high] = limits.seen[0];
    let half = 0.5 * (high - low);
    if half.is_nan() || half <= 0.0 || !half.is_finite() || limits.speed <= 0.0 || limits.acceleration <= 0.0 {
        return Vec::new();
    }
    let axis = Axis { plant, limits, low, high };
    let (middle, period, seconds) = (axis.middle(), limits.period, axis.seconds());
    let (fast, steep) = (limits.speed, limits.acceleration);
    let mut list = Vec::new();
    let mut add = |name: &str, words: &'static str, make: &super::RecordMaker<'_>| {
        list.extend(largest_within_limits(accepted, limits, name, words, make));
    };
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
    if limits.drive == Drive::Open {
        add("pulses", "pulses of the command in both directions, from rest", &|a| {
            // A pulse of half the limit. The amplitude is reduced until the motion stays within the travel.
            let level = 0.5 * a * plant.parameters.number("command_limit");
            let hold = (limits.rows / 64).max(1);
            let pattern = [1.0, -1.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0];
            let commands = (0..limits.rows).map(|row| level * pattern[row / hold % pattern.len()]).collect();
            Some(axis.at(blank("pulses", limits, limits.rows, vec![commands])))
        });
        add("binary command", "a binary sequence of the command", &|a| {
            let level = 0.3 * a * plant.parameters.number("command_limit");
            let hold = (limits.rows / 400).max(1);
            // Each value once forward and once backward, so that the sequence has no mean that drives the axis away.
            let half: Vec<f64> = binary(limits.rows / 2 + 1, hold, 0);
            let pairs = half.chunks(hold).flat_map(|part| part.iter().copied().chain(part.iter().map(|it| -it)));
            let commands: Vec<f64> = pairs.map(|it| level * it).take(limits.rows).collect();
            Some(axis.at(blank("binary command", limits, limits.rows, vec![commands])))
        });
    }
    list
}

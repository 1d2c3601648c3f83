//! Excitations of a vehicle: movements of its pedal on a test track, in each gear.
//!
//! In: accepted plants and limits. Out: records of the pedal, the only input. The pedal follows from the simulated engine speed, so that this stays
//! within the recorded range. The gear never changes, there is no brake, and the vehicle never rolls backward.

use std::cell::RefCell;

use super::shapes::binary;
use super::{Collected, Excitation, Limits, blank, is_within};
use rsm_sim::equation_plant::{SiteKind, bodies};
use rsm_sim::kind::{Decision, PlantKind};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::{Outputs, Simulator};

/// The throttle reverses this far inside the range of the engine speed, as a share of the range, because the driveline oscillates further.
const INSIDE: f64 = 0.12;

/// The throttle of a row, as a function of the row and the engine speed there.
type ThrottleLaw<'a> = dyn FnMut(usize, f64) -> f64 + 'a;

struct Track<'a> {
    plant: &'a PlantFile,
    limits: &'a Limits,
    /// The outputs: the speed of the engine and that of the vehicle.
    outputs: [usize; 2],
    /// Engine speeds at which the throttle reverses, in rad/s.
    engine: [f64; 2],
}

/// The parameters that a record determines, such as the gear.
type Settings = [(&'static str, f64)];

impl Track<'_> {
    /// A record without motion of the pedal, from a road speed.
    fn rolling(&self, settings: &Settings, road_speed: f64, pedal: f64, rows: usize) -> Record {
        let mut record = blank("track", self.limits, rows, vec![vec![pedal; rows]]);
        record.settings = settings.to_vec();
        record.measured[self.outputs[1]] = Some(vec![road_speed; rows]);
        record
    }

    /// The road speed of a steady roll at an engine speed: both are proportional.
    fn road_speed(&self, settings: &Settings, engine_speed: f64) -> Option<f64> {
        let bare = PlantFile { initial: Vec::new(), ..self.plant.clone() };
        let record = self.rolling(settings, 1.0, 0.0, 2);
        let outputs = Simulator::new(&bare, &record).ok()?.run(&record).ok()?;
        let name = self.plant.kind.outputs()[self.outputs[0]].name;
        Some(engine_speed / outputs.of(name)?.first()?).filter(|it| it.is_finite())
    }

    /// A record in one gear from an engine speed, with the throttle as a function of the engine speed.
    fn record(&self, settings: &Settings, engine_speed: f64, foot: &mut ThrottleLaw<'_>) -> Option<Record> {
        let rows = self.limits.rows;
        let road_speed = self.road_speed(settings, engine_speed)?;
        let first = foot(0, engine_speed);
        let mut record = self.rolling(settings, road_speed, first, rows);
        let throttle = RefCell::new(Vec::with_capacity(rows));
        let mut each_row = |row: usize, outputs: &[f64]| -> f64 {
            let value = if row == 0 { first } else { foot(row, outputs[self.outputs[0]]).clamp(0.0, 1.0) };
            throttle.borrow_mut().push(value);
            value
        };
        let bare = PlantFile { initial: Vec::new(), ..self.plant.clone() };
        Simulator::new(&bare, &record).ok()?.run_controlled(&record, &mut each_row).ok()?;
        record.inputs[0] = throttle.into_inner();
        Some(record)
    }
}

/// All excitations of a vehicle with an engine and a pedal; `None` for another plant.
pub(super) fn library(accepted: &[&PlantFile], limits: &Limits) -> Option<Vec<Excitation>> {
    let plant = accepted.first()?;
    let kind = plant.kind;
    let output = |is: SiteKind| bodies(kind).into_iter().find(|it| it.kind == is).and_then(|it| kind.output(it.speed?));
    let outputs = [output(SiteKind::Rotation)?, output(SiteKind::Vehicle)?];
    // A pedal is a share from 0 to 1.
    let [pedal] = kind.inputs() else { return None };
    let is_pedal = pedal.unit == "1" && limits.inputs[0][0] >= 0.0 && limits.inputs[0][1] <= 1.0;
    let [low, high] = limits.seen[outputs[0]];
    if !is_pedal || low.is_nan() || high - low <= 0.0 || !(high - low).is_finite() {
        return None;
    }
    let is_allowed = |_: &PlantFile, found: &Outputs| {
        limits.holds(kind, found, outputs[0]) && is_within(kind, found, outputs[1], [0.0, f64::MAX])
    };
    let engine = [low + INSIDE * (high - low), high - INSIDE * (high - low)];
    let track = Track { plant, limits, outputs, engine };
    let middle = 0.5 * (engine[0] + engine[1]);
    let rows_in = |seconds: f64| (seconds / limits.period).round().max(1.0) as usize;
    let mut list = Collected::new(accepted, &is_allowed);
    for settings in gears(kind, limits) {
        let settings = &settings[..];
        let mut add = |name: &str, words: &'static str, make: &super::RecordMaker<'_>| {
            let of: Vec<String> = settings.iter().map(|(name, value)| format!(", {name} {value}")).collect();
            list.add(&format!("{name}{}", of.concat()), words, make);
        };
        add("tip-in and tip-out", "the pedal from closed to open and back, between the engine speeds that were seen", &|a| {
            let mut pressed = true;
            let mut since = 0;
            track.record(settings, middle, &mut |row, speed| {
                // An oscillation of 2 Hz or more is visible in 0.6 s.
                let long = row - since >= rows_in(0.6);
                let turn = if pressed { speed > track.engine[1] } else { speed < track.engine[0] };
                if turn || (long && row - since >= rows_in(1.2)) {
                    (pressed, since) = (!pressed, row);
                }
                if pressed { a } else { 0.0 }
            })
        });
        add("coast-down", "the pedal closed from the highest engine speed that was seen", &|a| {
            let _ = a;
            let mut push = false;
            track.record(settings, track.engine[1], &mut |_, speed| {
                push = speed < track.engine[0] || (push && speed < track.engine[1]);
                f64::from(u8::from(push))
            })
        });
        add("part load", "steps of the pedal through part load", &|a| {
            let levels = [0.3, 0.6, 0.15, 0.45, 0.05, 0.75, 0.0];
            let mut lift = false;
            track.record(settings, middle, &mut |row, speed| {
                lift = speed > track.engine[1] || (lift && speed > middle);
                let level = levels[row / rows_in(0.8) % levels.len()];
                if lift {
                    0.0
                } else if speed < track.engine[0] {
                    0.8
                } else {
                    a * level
                }
            })
        });
        for (name, words, at) in [
            ("steady low", "a steady low speed, the pedal holding it", 0.15),
            ("steady high", "a steady high speed, the pedal holding it", 0.85),
        ] {
            add(name, words, &|_| {
                let target = track.engine[0] + at * (track.engine[1] - track.engine[0]);
                let mut held = 0.1;
                // A proportional and integral control: it corrects an error of a tenth of the range with full throttle, and compensates the road load
                // within 2 s.
                let gain = 1.0 / (0.1 * (track.engine[1] - track.engine[0]));
                track.record(settings, target, &mut |_, speed| {
                    let miss = gain * (target - speed);
                    held = (held + 0.5 * miss * limits.period).clamp(0.0, 1.0);
                    held + 0.5 * miss
                })
            });
        }
        add("binary pedal", "a binary sequence of the pedal, for the shuffle", &|a| {
            let sequence = binary(limits.rows, rows_in(0.12), 0);
            let mut lift = false;
            track.record(settings, middle, &mut |row, speed| {
                lift = speed > track.engine[1] || (lift && speed > middle);
                if lift {
                    0.0
                } else if speed < track.engine[0] {
                    0.8
                } else {
                    0.35 + 0.3 * a * sequence[row]
                }
            })
        });
    }
    Some(list.list)
}

/// The settings of the records, and those with the lowest, the middle and the highest gear: a parameter with whole values that a column gives.
fn gears(kind: PlantKind, limits: &Limits) -> Vec<Vec<(&'static str, f64)>> {
    let mut list = limits.all_settings.clone();
    let is_gear = |it: &&Decision| it.is_whole && it.column.is_some();
    let Some((gear, [low, high])) = kind.decisions.iter().find(is_gear).and_then(|it| Some((it.parameter, it.range?))) else {
        return list;
    };
    for value in [low, (0.5 * (low + high)).round(), high] {
        let mut other = limits.settings.clone();
        other.iter_mut().filter(|it| it.0 == gear).for_each(|it| it.1 = value);
        if !list.contains(&other) {
            list.push(other);
        }
    }
    list
}

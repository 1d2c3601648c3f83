//! Excitations of a car: throttle movements on a test track, in each gear.
//!
//! In: accepted plants and limits. Out: records of the throttle. The throttle follows from the simulated engine speed, so that this stays within the
//! recorded range. The gear never changes, the brake is never used, and the car never rolls backward: the plant has no reverse gear.

use std::cell::RefCell;

use super::shapes::binary;
use super::{Excitation, Limits, blank, largest_within_limits};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

/// The throttle reverses this far inside the range of the engine speed, as a share of the range, because the driveline oscillates further.
const INSIDE: f64 = 0.12;

/// The throttle of a row, as a function of the row and the engine speed there.
type ThrottleLaw<'a> = dyn FnMut(usize, f64) -> f64 + 'a;

struct Track<'a> {
    plant: &'a PlantFile,
    limits: &'a Limits,
    /// Engine speeds at which the throttle reverses, in rad/s.
    engine: [f64; 2],
}

impl Track<'_> {
    /// A record in one gear from an engine speed, with the throttle as a function of the engine speed.
    fn record(&self, gear: u8, engine_speed: f64, foot: &mut ThrottleLaw<'_>) -> Option<Record> {
        let rows = self.limits.rows;
        let parameters = self.plant.effective_parameters();
        let ratio = parameters.number(&format!("gear_ratios[{gear}]")) * parameters.number("final_drive_ratio");
        let road_speed = engine_speed / ratio * parameters.number("wheel_radius");
        let first = foot(0, engine_speed);
        let mut record = blank("track", self.limits, rows, vec![vec![first; rows]]);
        record.settings = vec![("gear", f64::from(gear))];
        record.measured[1] = Some(vec![road_speed; rows]);
        let throttle = RefCell::new(Vec::with_capacity(rows));
        let mut each_row = |row: usize, outputs: &[f64]| -> f64 {
            let value = if row == 0 { first } else { foot(row, outputs[0]).clamp(0.0, 1.0) };
            throttle.borrow_mut().push(value);
            value
        };
        let bare = PlantFile { initial: Vec::new(), ..self.plant.clone() };
        Simulator::new(&bare, &record).ok()?.run_controlled(&record, &mut each_row).ok()?;
        record.inputs[0] = throttle.into_inner();
        Some(record)
    }
}

/// All excitations of a car.
pub(super) fn library(accepted: &[&PlantFile], limits: &Limits) -> Vec<Excitation> {
    let Some(plant) = accepted.first() else { return Vec::new() };
    let [low, high] = limits.seen[0];
    if low.is_nan() || high - low <= 0.0 || !(high - low).is_finite() {
        return Vec::new();
    }
    let engine = [low + INSIDE * (high - low), high - INSIDE * (high - low)];
    let track = Track { plant, limits, engine };
    let middle = 0.5 * (engine[0] + engine[1]);
    let rows_in = |seconds: f64| (seconds / limits.period).round().max(1.0) as usize;
    let mut list = Vec::new();
    // The gears in the records, and the lowest, the middle and the highest gear.
    let mut gears = limits.gears.clone();
    gears.extend([1, 3, 5].into_iter().filter(|gear| !limits.gears.contains(gear)));
    for gear in gears {
        let mut add = |name: &str, words: &'static str, make: &super::RecordMaker<'_>| {
            list.extend(largest_within_limits(accepted, limits, &format!("{name}, gear {gear}"), words, make));
        };
        add("tip-in and tip-out", "the pedal from closed to open and back, between the engine speeds that were seen", &|a| {
            let mut pressed = true;
            let mut since = 0;
            track.record(gear, middle, &mut |row, speed| {
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
            track.record(gear, track.engine[1], &mut |_, speed| {
                push = speed < track.engine[0] || (push && speed < track.engine[1]);
                f64::from(u8::from(push))
            })
        });
        add("part load", "steps of the pedal through part load", &|a| {
            let levels = [0.3, 0.6, 0.15, 0.45, 0.05, 0.75, 0.0];
            let mut lift = false;
            track.record(gear, middle, &mut |row, speed| {
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
                track.record(gear, target, &mut |_, speed| {
                    let miss = gain * (target - speed);
                    held = (held + 0.5 * miss * limits.period).clamp(0.0, 1.0);
                    held + 0.5 * miss
                })
            });
        }
        add("binary pedal", "a binary sequence of the pedal, for the shuffle", &|a| {
            let sequence = binary(limits.rows, rows_in(0.12), 0);
            let mut lift = false;
            track.record(gear, middle, &mut |row, speed| {
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
    list
}

//! The equation errors of a plant: an observer with a short memory for each equation, driven by the recorded signals.
//!
//! ```text
//!   p' = f(readings, inputs) + (reading - p)/memory        what the equation misses = reading - p
//! ```
//!
//! In: a prepared record and a plant file with its effects. Out: the error of every equation that the columns of the record determine. For a motor:
//! the currents and the speed. For an axis: the position and, in closed loop, the command by the controller's law. For a car: the speed of the whole
//! driveline, in which the torques of its joints cancel, and the road speed from the acceleration. Nothing is differentiated: a reading's own noise
//! appears unchanged, and the noise of the other readings is integrated. Errors do not accumulate as in a free run. Fits nothing and runs no free
//! simulation.

use super::readings::{MEMORY, Readings, Version, WIDTH};
use crate::plant::whitened_residuals::Prepared;
use rsm_sim::hooks::Hooks;
use rsm_sim::kind::{PlantKind, StartValues};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::plants::Plant;
use rsm_sim::plants::driveline::Driveline;
use rsm_sim::plants::pmac::Pmac;
use rsm_sim::plants::servo_axis::ServoAxis;
use rsm_sim::record::{Drive, Record};

/// The largest number of states of a plant with effects: seven of the car and the rest for effects.
const STATES: usize = 16;

/// The equation errors of a record, and how many rates were evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct Innovations {
    /// For each equation, one value per row, in the unit of its reading.
    pub equations: Vec<Vec<f64>>,
    /// The number of rates that were evaluated.
    pub work: u64,
}

/// The names of the equations of a record, in the order of [`innovations`]; empty if the record lacks columns.
#[must_use]
pub fn names(prepared: &Prepared, kind: PlantKind) -> Vec<&'static str> {
    let has = |output: usize| prepared.outputs.contains(&output);
    let closed = prepared.record.drive == Drive::Closed;
    match kind {
        _ if kind.is("pmac") && !prepared.record.absent(kind).is_empty() => {
            if has(1) && has(2) {
                vec!["i_q", "speed"]
            } else {
                Vec::new()
            }
        }
        _ if kind.is("pmac") => {
            if has(0) && has(1) && has(2) {
                vec!["i_d", "i_q", "speed"]
            } else {
                Vec::new()
            }
        }
        PlantKind::Driveline if !has(0) || !has(1) => Vec::new(),
        PlantKind::Driveline => {
            if has(2) {
                vec!["driveline", "acceleration"]
            } else {
                vec!["driveline"]
            }
        }
        PlantKind::ServoAxis if !has(0) || closed && !has(1) => Vec::new(),
        PlantKind::ServoAxis => {
            if closed {
                vec!["position", "command"]
            } else {
                vec!["position"]
            }
        }
        // A plant of equations has its own states, and a record need not hold them.
        PlantKind::Equations(_) => Vec::new(),
    }
}

/// The output whose reading shows the error of an equation.
fn output_of(equation: &str) -> usize {
    match equation {
        "i_d" | "position" => 0,
        "speed" => 2,
        _ => 1,
    }
}

/// The equation errors of a plant file along a record. `None` if columns are missing, if an effect needs a signal that no column holds (a vehicle
/// with wheel slip), or if the plant's own states diverge.
#[must_use]
pub fn innovations(prepared: &Prepared, readings: &Readings, version: Version, file: &PlantFile) -> Option<Innovations> {
    if names(prepared, file.kind).is_empty() || prepared.record.rows() < 2 {
        return None;
    }
    let parameters = file.effective_parameters();
    let record = &prepared.record;
    let found = match file.kind {
        kind if kind.is("pmac") => {
            let hooks = Hooks::new(file, Pmac::STATES);
            let holds = !record.absent(kind).is_empty();
            let truths = truths(readings, version, file, &hooks, record);
            motor(&Pmac::new(&parameters, &hooks, holds), &hooks, record, &truths, holds)
        }
        PlantKind::ServoAxis => {
            let hooks = Hooks::new(file, ServoAxis::STATES);
            let truths = truths(readings, version, file, &hooks, record);
            let smooth = self::truths(readings, Version::Smooth, file, &hooks, record);
            axis(&ServoAxis::new(&parameters, &hooks), &hooks, record, &truths, smooth[0].as_ref()?, readings.rests())
        }
        PlantKind::Driveline => {
            let hooks = Hooks::new(file, Driveline::STATES);
            let truths = truths(readings, version, file, &hooks, record);
            let of = |name: &str| parameters.number(name);
            let (gear, last) = (parameters.gear_ratios[record.gear - 1], of("final_drive_ratio"));
            let shaft = of("transmission_inertia") + of("final_drive_inertia") / (last * last);
            let wheel = of("wheel_inertia") + of("mass") * of("wheel_radius") * of("wheel_radius");
            let geometry = Geometry {
                weights: [gear * last * of("engine_inertia"), last * shaft, wheel],
                ratios: [gear * last, last],
                radius: of("wheel_radius"),
            };
            car(&Driveline::new(&parameters, record.gear), &hooks, record, &truths, &geometry)
        }
        PlantKind::Equations(_) => None,
    };
    // A sensor with its own gain multiplies the error by that gain.
    let found = found.map(|mut found| {
        let hooks = Hooks::new(file, STATES);
        for (values, name) in found.equations.iter_mut().zip(names(prepared, file.kind)) {
            let reads = 1.0 / (hooks.truth(output_of(name), 1.0, 0.0) - hooks.truth(output_of(name), 0.0, 0.0));
            values.iter_mut().for_each(|value| *value *= reads);
        }
        found
    });
    found.filter(|it| it.equations.iter().flatten().all(|value| value.is_finite()))
}

fn truths(readings: &Readings, version: Version, file: &PlantFile, hooks: &Hooks, record: &Record) -> [Option<Vec<f64>>; 3] {
    [0, 1, 2].map(
        |output| if output < file.kind.outputs().len() { readings.truth(output, version, file, hooks, record) } else { None },
    )
}

/// The mean in each row of a delayed first input.
fn delayed(values: &[f64], hooks: &Hooks, period: f64) -> Vec<f64> {
    let late = hooks.delay() / period;
    let (whole, part) = (late.floor() as usize, late.fract());
    let at = |row: usize, later: usize| hooks.input(values[row.saturating_sub(later)]);
    (0..values.len()).map(|row| (1.0 - part) * at(row, whole) + part * at(row, whole + 1)).collect()
}

type State = [f64; STATES];

/// A plant along known states.
struct KnownStates<'a, P: Plant> {
    plant: &'a P,
    hooks: &'a Hooks,
    record: &'a Record,
    /// The inputs as they act, for each row.
    inputs: &'a dyn Fn(usize) -> [f64; 3],
    /// Sets the states that are known at a row.
    known: &'a dyn Fn(usize, &mut State),
    /// States of the plant that neither are in a column nor follow from columns.
    free: &'a [usize],
    /// The true outputs of the first row.
    first: [f64; 3],
}

impl<P: Plant> KnownStates<'_, P> {
    /// The change of the states in each row, by the plant's equations. States that are not known are integrated with the classical fourth-order
    /// Runge-Kutta method.
    fn changes(&self) -> Option<(Vec<State>, u64)> {
        let (plant, hooks) = (self.plant, self.hooks);
        let (states, rows) = (hooks.states(), self.record.rows());
        if states > STATES {
            return None;
        }
        let own: Vec<usize> = self.free.iter().copied().chain(P::STATES..states).collect();
        let mut work = 0;
        let mut rates = |inputs: &[f64; 3], x: &State| -> State {
            let (mut dx, mut outputs) = ([0.0; STATES], [0.0; 3]);
            plant.evaluate(hooks, None, inputs, &x[..states], &mut dx[..states], &mut outputs);
            work += 1;
            dx
        };
        let period = self.record.period;
        let mut x = [0.0; STATES];
        // States that no column holds start with the plant's normal start values.
        let mut starts = StartValues::default();
        starts[..3].copy_from_slice(&self.first);
        plant.start(hooks, &starts, self.record, &(self.inputs)(0), &mut x[..states]);
        if hooks.vehicle_speed(&x).is_some() {
            return None;
        }
        let mut changes = Vec::with_capacity(rows);
        for row in 0..rows - 1 {
            (self.known)(row, &mut x);
            let inputs = (self.inputs)(row);
            let mut next = x;
            (self.known)(row + 1, &mut next);
            let begin = rates(&inputs, &x);
            if !own.is_empty() {
                let mut half = x;
                for (half, next) in half.iter_mut().zip(&next) {
                    *half = 0.5 * (*half + next);
                }
                let with = |base: &State, rate: &State, share: f64| {
                    let mut at = *base;
                    own.iter().for_each(|k| at[*k] = x[*k] + share * period * rate[*k]);
                    at
                };
                let second = rates(&inputs, &with(&half, &begin, 0.5));
                let third = rates(&inputs, &with(&half, &second, 0.5));
                let fourth = rates(&inputs, &with(&next, &third, 1.0));
                for &k in &own {
                    next[k] = x[k] + period / 6.0 * (begin[k] + 2.0 * (second[k] + third[k]) + fourth[k]);
                }
            }
            // The input is constant over the row, so both ends see the same input. Simpson's rule (T. Simpson, 1743) is used, with the middle from
            // Hermite's cubic, because the currents of a motor oscillate within a row.
            let end = rates(&inputs, &next);
            let mut middle = x;
            for (k, middle) in middle.iter_mut().enumerate().take(states) {
                *middle = 0.5 * (x[k] + next[k]) + 0.125 * period * (begin[k] - end[k]);
            }
            let between = rates(&inputs, &middle);
            let mut change = [0.0; STATES];
            for (k, change) in change.iter_mut().enumerate().take(states) {
                *change = period / 6.0 * (begin[k] + 4.0 * between[k] + end[k]);
            }
            changes.push(change);
            x = next;
        }
        Some((changes, work))
    }
}

/// The innovation of a reading: the reading minus the observer's prediction.
fn innovation_of(readings: impl Iterator<Item = f64>, mut change: impl FnMut(usize) -> f64) -> Vec<f64> {
    let mut predicted = None;
    readings
        .enumerate()
        .map(|(row, reading)| {
            let before = predicted.map_or(reading, |predicted| predicted + change(row - 1));
            let innovation = reading - before;
            predicted = Some(before + innovation / MEMORY);
            innovation
        })
        .collect()
}

fn motor(plant: &Pmac, hooks: &Hooks, record: &Record, truths: &[Option<Vec<f64>>; 3], holds: bool) -> Option<Innovations> {
    let (i_q, speed) = (truths[1].as_ref()?, truths[2].as_ref()?);
    let rows = speed.len();
    let mut angle = Vec::with_capacity(rows);
    let mut theta = record.start("angle").unwrap_or(0.0);
    for row in 0..rows {
        theta += if row > 0 { 0.5 * record.period * (speed[row - 1] + speed[row]) } else { 0.0 };
        angle.push(theta);
    }
    let pairs: Vec<[f64; 2]> = match &truths[0] {
        Some(i_d) if !holds => (0..rows)
            .map(|row| {
                let (sin, cos) = hooks.frame_angle(angle[row]).sin_cos();
                [cos * i_d[row] - sin * i_q[row], sin * i_d[row] + cos * i_q[row]]
            })
            .collect(),
        _ => i_q.iter().map(|i_q| [0.0, *i_q]).collect(),
    };
    let zeros = Vec::new();
    let v_d = delayed(if record.inputs[0].is_empty() { &zeros } else { &record.inputs[0] }, hooks, record.period);
    let v_q = delayed(&record.inputs[1], hooks, record.period);
    let inputs = |row: usize| [v_d.get(row).copied().unwrap_or(0.0), v_q[row], record.inputs[2][row]];
    let known = |row: usize, x: &mut State| {
        x[..4].copy_from_slice(&[pairs[row][0], pairs[row][1], speed[row], angle[row]]);
    };
    let first = [truths[0].as_ref().map_or(0.0, |i_d| i_d[0]), i_q[0], speed[0]];
    let (changes, work) = KnownStates { plant, hooks, record, inputs: &inputs, known: &known, free: &[], first }.changes()?;
    let current = |k: usize| innovation_of(pairs.iter().map(|it| it[k]), |row| changes[row][k]);
    let mut equations: Vec<Vec<f64>> = (usize::from(holds)..2).map(current).collect();
    equations.push(innovation_of(speed.iter().copied(), |row| changes[row][2]));
    Some(Innovations { equations, work })
}

fn axis(
    plant: &ServoAxis,
    hooks: &Hooks,
    record: &Record,
    truths: &[Option<Vec<f64>>; 3],
    smooth: &[f64],
    rests: &[bool],
) -> Option<Innovations> {
    let position = truths[0].as_ref()?;
    let closed = record.drive == Drive::Closed;
    let command = if closed { truths[1].as_ref()? } else { record.inputs.first()? };
    let acting = delayed(command, hooks, record.period);
    let (period, last) = (record.period, position.len() - 1);
    let speed: Vec<f64> = (0..=last)
        .map(|row| {
            let (before, after) = (row.saturating_sub(1), (row + 1).min(last));
            (smooth[after] - smooth[before]) / ((after - before) as f64 * period)
        })
        .collect();
    let inputs = |row: usize| [acting[row], command[row], 0.0];
    let known = |row: usize, x: &mut State| (x[0], x[1]) = (smooth[row], speed[row]);
    let first = [smooth[0], speed[0], 0.0];
    let (changes, work) = KnownStates { plant, hooks, record, inputs: &inputs, known: &known, free: &[], first }.changes()?;
    // Both poles are at 1 - 1/memory. Slopes at the ends come from few readings, so the line through two inner points is used.
    let inner = |row: usize| speed[row.min(last)];
    let (mut predicted, mut moving) = (position[0], 2.0 * inner(WIDTH) - inner(2 * WIDTH));
    let by_force = (0..=last)
        .map(|row| {
            if rests[row] {
                // At rest, the holding force is unknown.
                (predicted, moving) = (smooth[row], speed[row]);
                return 0.0;
            }
            if row > 0 {
                let gained = changes[row - 1][1];
                predicted += period * (moving + 0.5 * gained);
                moving += gained;
            }
            let innovation = position[row] - predicted;
            predicted += 2.0 / MEMORY * innovation;
            moving += innovation / (MEMORY * MEMORY * period);
            innovation
        })
        .collect();
    let mut equations = vec![by_force];
    if closed {
        let reference = &record.inputs[0];
        let at = |row: usize, before: usize| position[row.saturating_sub(before)];
        let law = |row: usize| {
            plant.command(reference[row], &[position[row], speed[row]], [at(row, 0), at(row, 1), at(row, 2)], period)
        };
        equations.push((0..=last).map(|row| command[row] - law(row)).collect());
    }
    Some(Innovations { equations, work })
}

/// The kinematics of a driveline.
struct Geometry {
    /// Inertias of engine, shaft and wheel (with the vehicle), each multiplied by its ratio to the wheel.
    weights: [f64; 3],
    /// The speeds of engine and shaft divided by the speed of the wheel.
    ratios: [f64; 2],
    radius: f64,
}

fn car(
    plant: &Driveline,
    hooks: &Hooks,
    record: &Record,
    truths: &[Option<Vec<f64>>; 3],
    it: &Geometry,
) -> Option<Innovations> {
    let (engine, road) = (truths[0].as_ref()?, truths[1].as_ref()?);
    let throttle = delayed(&record.inputs[0], hooks, record.period);
    let inputs = |row: usize| [throttle[row], 0.0, 0.0];
    let mut turned = Vec::with_capacity(engine.len());
    let mut way = 0.0;
    for row in 0..engine.len() {
        way += if row > 0 { 0.5 * record.period * (engine[row - 1] + engine[row]) } else { 0.0 };
        turned.push(way);
    }
    // The angles of shaft and wheel follow from the engine's angle. The torque of a joint cancels in the sum over all bodies. The shaft's own inertia
    // is only a hundredth of that sum.
    let known = |row: usize, x: &mut State| {
        let wheel = road[row] / it.radius;
        let angle = turned[row];
        x[1..7].copy_from_slice(&[
            angle,
            engine[row],
            angle * it.ratios[1] / it.ratios[0],
            it.ratios[1] * wheel,
            angle / it.ratios[0],
            wheel,
        ]);
    };
    let first = [engine[0], road[0], 0.0];
    let (changes, work) = KnownStates { plant, hooks, record, inputs: &inputs, known: &known, free: &[0], first }.changes()?;
    let [of_engine, of_shaft, of_wheel] = it.weights;
    // Converted to a speed of the road.
    let scale = it.radius / (of_engine * it.ratios[0] + of_shaft * it.ratios[1] + of_wheel);
    let sum = |engine: f64, shaft: f64, wheel: f64| scale * (of_engine * engine + of_shaft * shaft + of_wheel * wheel);
    let whole = (0..engine.len()).map(|row| {
        let wheel = road[row] / it.radius;
        sum(engine[row], it.ratios[1] * wheel, wheel)
    });
    let mut equations = vec![innovation_of(whole, |row| sum(changes[row][2], changes[row][4], changes[row][6]))];
    if let Some(acceleration) = &truths[2] {
        let gained = |row: usize| 0.5 * record.period * (acceleration[row] + acceleration[row + 1]);
        equations.push(innovation_of(road.iter().copied(), gained));
    }
    Some(Innovations { equations, work })
}

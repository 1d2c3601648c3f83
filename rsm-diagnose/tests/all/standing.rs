//! Records in which a motor stands, an axis sticks or a car waits. Families from seeds.
//!
//! The machines are simulated here, with a static friction, by code that shares nothing with the plants.

use crate::random::Random;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::{plant, record};

/// Sub-steps of a row: at the fastest rate of these machines, 90 per second, a row of 1 ms is a tenth of the time constant.
const SUBSTEPS: usize = 10;

const ROWS: usize = 900;

/// The drive level: 1 in the middle of a motion, 0 at rest, in between during transitions.
struct Drive(Vec<f64>);

impl Drive {
    /// Rest before, during or after a motion, or all of them, for a random share of the rows.
    fn drawn(random: &mut Random) -> (String, Drive) {
        let share = 0.1 + 0.5 * random.uniform();
        let place = (4.0 * random.uniform()) as usize;
        let rests: &[f64] = [&[1.0, 0.0, 0.0][..], &[0.0, 1.0, 0.0], &[0.0, 0.0, 1.0], &[0.4, 0.3, 0.3]][place];
        let count = |part: f64| (part * ROWS as f64) as usize;
        let motion = count(0.5 * (1.0 - share));
        let mut rows = Vec::new();
        for (k, rest) in rests.iter().enumerate() {
            rows.extend(std::iter::repeat_n(0.0, count(share * rest)));
            if k < 2 {
                // Up and down over a fifth of the motion, and an oscillation in the middle.
                let edge = motion as f64 / 5.0;
                let shape = |row: usize| {
                    let level = (row as f64 / edge).min((motion - row) as f64 / edge).min(1.0);
                    level * (1.0 + 0.2 * (20.0 * row as f64 / motion as f64).sin())
                };
                rows.extend((0..motion).map(shape));
            }
        }
        rows.resize(ROWS, *rows.last().unwrap_or(&0.0));
        (format!("{:.0} % at rest, place {place}", 100.0 * share), Drive(rows))
    }
}

/// A body with dry friction: its speed after a time, with a force other than friction.
fn pushed(speed: f64, force: f64, (dry, holds): (f64, f64), mass: f64, time: f64) -> f64 {
    if speed == 0.0 && force.abs() <= holds {
        return 0.0;
    }
    let direction = if speed == 0.0 { force.signum() } else { speed.signum() };
    let next = speed + time * (force - dry * direction) / mass;
    // It stops instead of reversing.
    if speed * next < 0.0 { 0.0 } else { next }
}

/// Reads a signal with noise, with quantisation, with a dead band around 0.
fn read(values: &[f64], noise: f64, step: f64, dead: f64, random: &mut Random) -> Vec<f64> {
    let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let one = |value: &f64| {
        let value = value + noise * largest * random.normal();
        let value = if step > 0.0 { (value / (step * largest)).round() * step * largest } else { value };
        if value.abs() < dead * largest { 0.0 } else { value }
    };
    values.iter().map(one).collect()
}

/// The channels of a record besides its inputs: names as in a header, readings, and whether they have noise in motion.
pub(crate) struct Recorded {
    pub(crate) what: String,
    pub(crate) file: PlantFile,
    inputs: Vec<(&'static str, Vec<f64>)>,
    pub(crate) outputs: Vec<(&'static str, Vec<f64>, bool)>,
    period: f64,
    /// Rows in the middle of a motion.
    pub(crate) moving: Vec<usize>,
}

impl Recorded {
    pub(crate) fn record(&self) -> Record {
        let names = self.inputs.iter().map(|it| it.0).chain(self.outputs.iter().map(|it| it.0));
        let mut text = format!("time[s],{}\n", names.collect::<Vec<_>>().join(","));
        for row in 0..ROWS {
            let values = self.inputs.iter().map(|it| it.1[row]).chain(self.outputs.iter().map(|it| it.1[row]));
            let values: Vec<String> = values.map(|value| value.to_string()).collect();
            text += &format!("{},{}\n", row as f64 * self.period, values.join(","));
        }
        record(&text, &self.file)
    }
}

/// A motor that stands still while its drive is off, or is held with zero voltage.
pub(crate) fn motor(seed: u64) -> Recorded {
    let mut random = Random::new(seed);
    let (mut what, drive) = Drive::drawn(&mut random);
    let file = plant("pmac", "");
    let [resistance, inductance, flux, poles, inertia] =
        ["phase_resistance", "phase_inductance", "flux_linkage", "pole_pairs", "inertia"]
            .map(|name| file.parameters.number(name));
    let (mut i_d, mut i_q, mut speed) = (0.0_f64, 0.0_f64, 0.0_f64);
    let holds = 0.2 + 0.5 * random.uniform();
    let mut signals = [Vec::new(), Vec::new(), Vec::new()];
    let voltage: Vec<f64> = drive.0.iter().map(|level| 25.0 * level).collect();
    // After 50 ms at standstill without voltage, four times the time constant of the winding, some drives open their bridge.
    let opens = random.uniform() < 0.5;
    let mut stands = 0;
    let mut open = Vec::new();
    for v_q in &voltage {
        stands = if *v_q == 0.0 && speed == 0.0 { stands + 1 } else { 0 };
        let is_open = opens && stands > 50;
        if is_open {
            (i_d, i_q) = (0.0, 0.0);
        }
        open.push(is_open);
        signals.iter_mut().zip([i_d, i_q, speed]).for_each(|(signal, value)| signal.push(value));
        for _ in 0..SUBSTEPS {
            let time = 1e-3 / SUBSTEPS as f64;
            let electrical = poles * speed;
            let rate_d = (-resistance * i_d + electrical * inductance * i_q) / inductance;
            let rate_q = (v_q - resistance * i_q - electrical * (inductance * i_d + flux)) / inductance;
            (i_d, i_q) = (i_d + time * rate_d, i_q + time * rate_q);
            speed = pushed(speed, 1.5 * poles * flux * i_q - 0.001 * speed, (0.8 * holds, holds), inertia, time);
        }
    }
    // Counts of an encoder, a dead band, or an analogue signal.
    let sensor = (3.0 * random.uniform()) as usize;
    let noise = 0.001 + 0.003 * random.uniform();
    let (speed_noise, step, dead) = [(0.0, 0.005, 0.0), (noise, 0.0, 5.0 * noise), (noise, 0.0, 0.0)][sensor];
    what = format!("motor {seed}, {what}, sensor {sensor}, opens {opens}");
    let speed = read(&signals[2], speed_noise, step, dead, &mut random);
    let mut current = |values: &[f64]| {
        let mut readings = read(values, 0.004, 0.0, 0.0, &mut random);
        // With an open bridge the drive logs exactly 0.
        readings.iter_mut().zip(&open).filter(|it| *it.1).for_each(|(reading, _)| *reading = 0.0);
        readings
    };
    let (i_d, i_q) = (current(&signals[0]), current(&signals[1]));
    let zeros = vec![0.0; ROWS];
    Recorded {
        what,
        moving: (0..ROWS).filter(|row| drive.0[*row] > 0.8).collect(),
        file,
        inputs: vec![("v_d[V]", zeros.clone()), ("v_q[V]", voltage), ("load_torque[N*m]", zeros)],
        outputs: vec![("i_d[A]", i_d, true), ("i_q[A]", i_q, true), ("speed[rad/s]", speed, sensor > 0)],
        period: 1e-3,
    }
}

/// The nominal axis: no dry friction.
pub(crate) fn nominal_axis() -> PlantFile {
    let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 100\nforce_gain = 35\nviscous_friction = 150\ncommand_limit = 10\n\
                [tolerance]\nmass = 0.01\nviscous_friction = 0.05\n";
    PlantFile::read(&rsm_core::source::Source::new("axis.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// An axis that sticks until its drive overcomes the friction. At rest its command oscillates below that level. `dry` and `holds` in N.
pub(crate) fn axis(seed: u64, (dry, holds): (f64, f64), period: f64) -> Recorded {
    let mut random = Random::new(1000 + seed);
    let (mut what, drive) = Drive::drawn(&mut random);
    let (mut position, mut speed) = (0.1, 0.0_f64);
    let mut positions = Vec::new();
    let mut sign = 1.0;
    let mut command = Vec::new();
    for (row, level) in drive.0.iter().enumerate() {
        if row % 130 == 0 {
            sign = -sign;
        }
        // Back and forth in motion; at rest, half of the force that would move it.
        let volts = if *level > 0.0 { 3.0 * sign * level } else { 0.5 * holds / 35.0 * (0.05 * row as f64).sin() };
        command.push(volts);
        positions.push(position);
        for _ in 0..SUBSTEPS {
            let time = period / SUBSTEPS as f64;
            speed = pushed(speed, 35.0 * volts - 150.0 * speed, (dry, holds), 100.0, time);
            position += time * speed;
        }
    }
    // An encoder, an encoder with noise of a third of its step, or an analogue sensor.
    let sensor = (3.0 * random.uniform()) as usize;
    what = format!("axis {seed}, {what}, sensor {sensor}");
    let (noise, step) = [(0.0, 1e-5), (3e-6, 1e-5), (1e-4, 0.0)][sensor];
    let position = read(&positions, noise, step, 0.0, &mut random);
    Recorded {
        what,
        moving: (0..ROWS).filter(|row| drive.0[*row] > 0.8).collect(),
        file: nominal_axis(),
        inputs: vec![("command[V]", command)],
        outputs: vec![("position[m]", position, sensor == 2)],
        period,
    }
}

/// A car that stands, starts and stops in one gear. Its speed follows the driver; engine speed and acceleration follow from its speed.
pub(crate) fn car(seed: u64) -> Recorded {
    let mut random = Random::new(2000 + seed);
    let (mut what, drive) = Drive::drawn(&mut random);
    let speed: Vec<f64> = drive.0.iter().map(|level| 12.0 * level).collect();
    let acceleration: Vec<f64> = (0..ROWS).map(|row| 50.0 * (speed[(row + 1).min(ROWS - 1)] - speed[row])).collect();
    // Idle speed below it, with an open clutch.
    let engine: Vec<f64> = speed.iter().map(|speed| (2.2 * 3.7 / 0.32 * speed).max(85.0)).collect();
    // Teeth that pass too slowly to be counted, steps of a bus, or an analogue signal.
    let sensor = (3.0 * random.uniform()) as usize;
    let (noise, step, dead) = [(0.002, 0.0, 0.03), (0.0, 0.002, 0.0), (0.002, 0.0, 0.0)][sensor];
    let road = read(&speed, noise, step, dead, &mut random);
    what = format!("car {seed}, {what}, sensor {sensor}");
    let engine = read(&engine, 0.003, 0.0, 0.0, &mut random);
    let acceleration = read(&acceleration, 0.01, 0.0, 0.0, &mut random);
    Recorded {
        what,
        moving: (0..ROWS).filter(|row| drive.0[*row] > 0.8).collect(),
        file: plant("driveline", ""),
        inputs: vec![("throttle[1]", drive.0.iter().map(|level| 0.5 * level).collect()), ("gear[1]", vec![2.0; ROWS])],
        outputs: vec![
            ("engine_speed[rad/s]", engine, true),
            ("road_speed[m/s]", road, sensor != 1),
            ("acceleration[m/s^2]", acceleration, true),
        ],
        period: 0.02,
    }
}

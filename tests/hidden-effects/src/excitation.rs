//! The excitation of the plants, as on a bench, on a track or by a controller, from the noise-free readings.
//!
//! In: a nominal plant and a stream of random numbers. Out: inputs row by row. A drive does not depend on the effects.

use crate::draw::Nominal;
use crate::plant::{Kind, Start};
use crate::random::Random;

/// Computes the inputs of a row from the readings just before it.
pub type Drive = Box<dyn FnMut(usize, &[f64]) -> Vec<f64>>;

/// The drive of one record, and its start. Records of a car have different gears.
pub fn excitation(nominal: &Nominal, gear: usize, random: Random) -> (Start, Drive) {
    match nominal.kind {
        Kind::Motor => (Start::Rest, motor(nominal, random)),
        Kind::Car => car(nominal, gear, random),
        Kind::OpenAxis => (Start::Rest, pulses(random)),
        Kind::ClosedAxis => (Start::Rest, trapezoids(nominal, random)),
    }
}

/// Changes a value at random instants.
struct Steps {
    until: usize,
    value: f64,
}

impl Steps {
    fn new() -> Self {
        Steps { until: 0, value: 0.0 }
    }

    /// The value at a row; a new random value is drawn after its number of rows (at least 1).
    fn at(&mut self, row: usize, random: &mut Random, rows: (f64, f64), value: impl FnOnce(&mut Random) -> f64) -> f64 {
        if row >= self.until {
            self.until = row + (random.uniform(rows.0, rows.1) as usize).max(1);
            self.value = value(random);
        }
        self.value
    }
}

/// Four quadrants with a speed and current controller, with steps of load, steps of i_d, and a binary sequence on both voltages, so that the voltages
/// contain more than the response of the controller. A third of the speeds are slow, for the effects near reversal.
fn motor(nominal: &Nominal, mut random: Random) -> Drive {
    let of = |name| nominal.parameters.get(name);
    let (r, l, lambda, pairs, inertia) =
        (of("phase_resistance"), of("phase_inductance"), of("flux_linkage"), of("pole_pairs"), of("inertia"));
    let period = nominal.period;
    let torque_constant = 1.5 * pairs * lambda;
    // 60 V of EMF: with the voltage drop and the cross coupling of 36 A this is well below 270 V/sqrt 3.
    let top = 60.0 / (pairs * lambda);
    let (speed_rate, current_rate) = (60.0, 700.0);
    let speed_gain = inertia * speed_rate / torque_constant;
    let (mut speed_sum, mut d_sum, mut q_sum) = (0.0, 0.0, 0.0);
    // Every second speed is backward, so that a short record also contains both directions.
    let mut sense = random.sign();
    let (mut reference, mut load, mut direct) = (Steps::new(), Steps::new(), Steps::new());
    let (mut d_binary, mut q_binary) = (Steps::new(), Steps::new());
    Box::new(move |row, read| {
        let [i_d, i_q, w] = [read[0], read[1], read[2]];
        let ms = 0.001 / period;
        let target = reference.at(row, &mut random, (150.0 * ms, 400.0 * ms), |it| {
            sense = -sense;
            sense * if it.uniform(0.0, 1.0) < 0.35 { it.uniform(4.0, 40.0) } else { it.uniform(0.2, 1.0) * top }
        });
        let load = load.at(row, &mut random, (90.0 * ms, 260.0 * ms), |it| torque_constant * it.uniform(-9.0, 9.0));
        let d_target = direct.at(row, &mut random, (60.0 * ms, 200.0 * ms), |it| it.one_of(&[0.0, 0.0, -6.0, -12.0, 6.0]));
        let d_extra = d_binary.at(row, &mut random, (2.0 * ms, 10.0 * ms), |it| 1.5 * it.sign());
        let q_extra = q_binary.at(row, &mut random, (2.0 * ms, 10.0 * ms), |it| 1.5 * it.sign());
        let miss = target - w;
        speed_sum = (speed_sum + miss * period * speed_rate / 5.0).clamp(-100.0, 100.0);
        let q_target = (speed_gain * (miss + speed_sum)).clamp(-36.0, 36.0);
        let (d_miss, q_miss) = (d_target - i_d, q_target - i_q);
        d_sum = (d_sum + r * current_rate * period * d_miss).clamp(-20.0, 20.0);
        q_sum = (q_sum + r * current_rate * period * q_miss).clamp(-20.0, 20.0);
        let w_e = pairs * w;
        let v_d = l * current_rate * d_miss + d_sum - w_e * l * i_q + d_extra;
        let v_q = l * current_rate * q_miss + q_sum + w_e * (l * i_d + lambda) + q_extra;
        // Below the limit (20) of 155 V.
        let back = (140.0 / v_d.hypot(v_q)).min(1.0);
        vec![back * v_d, back * v_q, load]
    })
}

/// Tip-ins of every depth and tip-outs, in one gear, between 130 and 480 rad/s of the engine.
fn car(nominal: &Nominal, gear: usize, mut random: Random) -> (Start, Drive) {
    let of = |name| nominal.parameters.get(name);
    let ratio = nominal.parameters.gear_ratios[gear - 1] * of("final_drive_ratio");
    let speed = of("wheel_radius") * random.uniform(180.0, 260.0) / ratio;
    let per_second = 1.0 / nominal.period;
    let mut pedal = Steps::new();
    let mut is_in = false;
    let drive = move |row: usize, read: &[f64]| {
        let engine = if row == 0 { 200.0 } else { read[0] };
        if (engine > 480.0 && is_in) || (engine < 130.0 && !is_in) {
            pedal.until = row;
        }
        let throttle = pedal.at(row, &mut random, (0.7 * per_second, 2.5 * per_second), |it| {
            is_in = if engine > 480.0 {
                false
            } else if engine < 130.0 {
                true
            } else {
                !is_in
            };
            if is_in { it.uniform(0.25, 1.0) } else { it.uniform(0.0, 0.08) }
        });
        vec![throttle, gear as f64]
    };
    (Start::Rolling(speed), Box::new(drive))
}

/// Pulses of the command in both directions; the direction is reversed if the axis has moved far.
fn pulses(mut random: Random) -> Drive {
    let mut pulse = Steps::new();
    Box::new(move |row, read| {
        let far = read[0].abs() > 0.25;
        let position = read[0];
        let command = pulse.at(row, &mut random, (60.0, 450.0), |it| {
            let sign = if far { -position.signum() } else { it.sign() };
            if it.uniform(0.0, 1.0) < 0.15 { 0.0 } else { sign * it.spread(0.5, 4.0) }
        });
        vec![command]
    })
}

/// Trapezoids of speed between random positions, some of them slow, with rests between them.
fn trapezoids(nominal: &Nominal, mut random: Random) -> Drive {
    let (period, rows) = (nominal.period, nominal.rows);
    let mut reference = vec![0.0; 100];
    let mut place = 0.0_f64;
    while reference.len() < rows {
        let target = random.uniform(-0.15, 0.15);
        let distance = (target - place).abs();
        // The command limit of 10 V is sufficient for 110 kg at 2 m/s^2, even with the smallest force gain.
        let acceleration = random.uniform(0.5, 1.5);
        let slow = random.uniform(0.0, 1.0) < 0.3;
        let cruise = if slow { random.uniform(0.01, 0.04) } else { random.uniform(0.08, 0.3) };
        let speed = f64::min(cruise, (distance * acceleration).sqrt());
        let (ramp, flat) = (speed / acceleration, (distance / speed - speed / acceleration).max(0.0));
        // A slow move is shortened, so that it does not fill the record.
        let last = if slow { f64::min(2.0 * ramp + flat, 1.2) } else { 2.0 * ramp + flat };
        let steps = (last / period) as usize;
        for step in 1..=steps {
            let t = step as f64 * period;
            let gone = if t < ramp {
                0.5 * acceleration * t * t
            } else if t < ramp + flat {
                0.5 * speed * ramp + speed * (t - ramp)
            } else {
                distance - 0.5 * acceleration * (2.0 * ramp + flat - t).max(0.0).powi(2)
            };
            reference.push(place + (target - place).signum() * gone);
        }
        place = *reference.last().expect("the list began with rows");
        reference.extend(std::iter::repeat_n(place, random.uniform(50.0, 300.0) as usize));
    }
    Box::new(move |row, _| vec![reference[row.min(reference.len() - 1)]])
}

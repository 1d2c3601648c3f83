//! Disturbances that are not in the catalogue.
//!
//! In: a name, a plant, a stream of random numbers. Out: their magnitudes, large enough to leave structure that no entry of the catalogue explains;
//! and the changes of those that affect only the readings. Disturbances inside a plant are in the plant's own file.

use crate::draw::Nominal;
use crate::plant::{Effect, Kind, Record, Truth};
use crate::random::Random;

/// All disturbances, with their plants.
pub const ALL: [(Kind, &str); 13] = [
    (Kind::Motor, "phase-unbalance"),
    (Kind::Motor, "bus-sag"),
    (Kind::Motor, "slipping-flywheel"),
    (Kind::Motor, "emi-bursts"),
    (Kind::Motor, "pole-wheel"),
    (Kind::Car, "mount-resonance"),
    (Kind::Car, "tyre-burst"),
    (Kind::Car, "rolling-hills"),
    (Kind::Car, "intake-resonance"),
    (Kind::OpenAxis, "hysteresis"),
    (Kind::ClosedAxis, "square-spring"),
    (Kind::ClosedAxis, "breathing-friction"),
    (Kind::ClosedAxis, "scale-error"),
];

/// A disturbance with its magnitude.
pub fn disturbance(name: &str, nominal: &Nominal, random: &mut Random) -> Effect {
    let of = |name| nominal.parameters.get(name);
    match name {
        // One winding with a bad joint: the resistance differs along two axes of the stator, which gives a current at twice the electrical frequency.
        "phase-unbalance" => Effect::new("phase-unbalance", &[("share", random.uniform(0.15, 0.4))]),
        // A supply whose voltage decreases with the square of the current: 5 to 15 % at 30 A.
        "bus-sag" => Effect::new("bus-sag", &[("per_square_ampere", random.uniform(0.05, 0.15) / 900.0)]),
        // A second inertia coupled by dry friction: it follows slow motions and slips in fast ones.
        "slipping-flywheel" => {
            let values = [("inertia", of("inertia") * random.uniform(0.4, 1.2)), ("torque", random.uniform(0.4, 1.5))];
            Effect::new("slipping-flywheel", &values)
        }
        // Interference on a current sensor, a fixed frequency in bursts.
        "emi-bursts" => {
            let values = [
                ("amplitude", random.uniform(0.15, 0.6)),
                ("frequency", random.uniform(300.0, 900.0)),
                ("every", random.uniform(0.05, 0.2)),
            ];
            Effect::new("emi-bursts", &values)
        }
        // A speed sensor whose wheel has teeth of uneven pitch: a wave of the rotor's angle in its readings, half to one and a half times the noise,
        // with an order that no winding has.
        "pole-wheel" => {
            let amplitude = nominal.noise[2] * random.uniform(0.45, 1.5);
            Effect::new("pole-wheel", &[("amplitude", amplitude), ("order", random.whole(5, 40) as f64 + 0.5)])
        }
        // An accelerometer on a flexible bracket.
        "mount-resonance" => Effect::new(
            "mount-resonance",
            &[("frequency", random.uniform(5.0, 12.0)), ("damping_ratio", random.uniform(0.03, 0.1))],
        ),
        // From a random instant on, the rolling resistance is several times higher.
        "tyre-burst" => Effect::new("tyre-burst", &[("times", random.uniform(3.0, 6.0)), ("time", random.uniform(8.0, 20.0))]),
        // A road with hills.
        "rolling-hills" => {
            Effect::new("rolling-hills", &[("slope", random.uniform(0.01, 0.04)), ("wavelength", random.uniform(60.0, 200.0))])
        }
        // An intake with better filling at some speeds than at others.
        "intake-resonance" => {
            Effect::new("intake-resonance", &[("share", random.uniform(0.08, 0.25)), ("period", random.uniform(80.0, 160.0))])
        }
        // Friction with memory: the force increases over millimetres, not at once.
        "hysteresis" => {
            Effect::new("hysteresis", &[("force", random.uniform(8.0, 25.0)), ("length", random.uniform(0.01, 0.04))])
        }
        // A force proportional to the square of the position, 10 to 40 N at 0.15 m.
        "square-spring" => Effect::new("square-spring", &[("stiffness", random.uniform(10.0, 40.0) / 0.0225)]),
        // Viscous friction that increases and decreases with the circulation of a lubricant.
        "breathing-friction" => {
            Effect::new("breathing-friction", &[("share", random.uniform(0.3, 0.7)), ("period", random.uniform(1.0, 3.0))])
        }
        // An interpolated encoder with an error that is periodic in its scale.
        "scale-error" => Effect::on(
            "scale-error",
            "position",
            &[("amplitude", random.uniform(5e-6, 3e-5)), ("period", random.uniform(1e-3, 4e-3))],
        ),
        _ => unreachable!("{name} is no disturbance of ours"),
    }
}

/// Interference: (amplitude, frequency, seconds from burst to burst).
fn interference(truth: &Truth) -> Option<(f64, f64, f64)> {
    let of = |name| truth.effect("emi-bursts", name);
    Some((of("amplitude")?, of("frequency")?, of("every")?))
}

/// The share of time with bursts.
const BURSTING: f64 = 0.4;

/// An uneven wheel: (amplitude, order).
fn wheel(truth: &Truth) -> Option<(f64, f64)> {
    let of = |name| truth.effect("pole-wheel", name);
    Some((of("amplitude")?, of("order")?))
}

/// The disturbances between plant and record: interference on `i_q`, the wheel of the speed sensor. `exact` is the record before any sensor.
pub fn on_readings(truth: &Truth, exact: &Record, record: &mut Record) {
    if let Some((amplitude, frequency, every)) = interference(truth) {
        for (row, value) in record.outputs[1].iter_mut().enumerate() {
            let time = row as f64 * record.period;
            if time % every < BURSTING * every {
                *value += amplitude * (std::f64::consts::TAU * frequency * time).sin();
            }
        }
    }
    if let Some((amplitude, order)) = wheel(truth) {
        let mut angle = 0.0;
        for (value, speed) in record.outputs[2].iter_mut().zip(&exact.outputs[2]) {
            *value += amplitude * (order * angle).sin();
            angle += speed * record.period;
        }
    }
}

/// The root mean square of these, divided by the noise.
pub fn signal_on_readings(truth: &Truth, nominal: &Nominal) -> f64 {
    let bursts = interference(truth).map_or(0.0, |(amplitude, ..)| amplitude * (0.5 * BURSTING).sqrt() / nominal.noise[1]);
    bursts.max(wheel(truth).map_or(0.0, |(amplitude, _)| amplitude * 0.5_f64.sqrt() / nominal.noise[2]))
}

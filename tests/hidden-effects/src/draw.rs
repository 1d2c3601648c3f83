//! Random choices from a seed: nominal plants, and effects with their magnitudes.
//!
//! In: a stream of random numbers. Out: parameters within the range of real machines, effects from clearly visible to marginal. The ranges are our
//! own, similar to the plants of the shipped files and to the published EMPS axis. If a magnitude follows from another number, a comment says so.

use crate::plant::{Effect, Kind, Parameters};
use crate::random::Random;

/// The data of a plant file without effects.
#[derive(Debug, Clone)]
pub struct Nominal {
    /// The kind of plant.
    pub kind: Kind,
    /// All parameters.
    pub parameters: Parameters,
    /// Relative standard deviations; a parameter that is not listed is exact.
    pub tolerance: Vec<(&'static str, f64)>,
    /// Standard deviation of every output's noise.
    pub noise: Vec<f64>,
    /// Seconds between rows.
    pub period: f64,
    /// Rows of a record.
    pub rows: usize,
}

/// A plant of this kind.
pub fn nominal(kind: Kind, random: &mut Random) -> Nominal {
    match kind {
        Kind::Motor => motor(random),
        Kind::Car => car(random),
        Kind::OpenAxis | Kind::ClosedAxis => axis(kind, random),
    }
}

fn motor(random: &mut Random) -> Nominal {
    let values = vec![
        ("phase_resistance", random.uniform(0.06, 0.2)),
        ("phase_inductance", random.uniform(0.5e-3, 1.5e-3)),
        ("flux_linkage", random.uniform(0.04, 0.08)),
        ("pole_pairs", random.whole(3, 5) as f64),
        ("inertia", random.uniform(0.005, 0.02)),
        ("viscous_friction", random.uniform(0.5e-3, 3e-3)),
        ("bus_voltage", 270.0),
        ("current_limit", 60.0),
    ];
    Nominal {
        kind: Kind::Motor,
        parameters: Parameters { values, gear_ratios: vec![], velocity_from_difference: false },
        tolerance: vec![("phase_resistance", 0.05), ("phase_inductance", 0.05), ("inertia", 0.03), ("viscous_friction", 0.1)],
        noise: vec![0.05, 0.05, 0.05],
        // The period is a quarter of a millisecond: at 300 rad/s and 5 pole pairs it is a fifteenth of an electrical revolution.
        period: 0.00025,
        rows: 8000,
    }
}

fn car(random: &mut Random) -> Nominal {
    let stretch = random.uniform(0.9, 1.1);
    let values = vec![
        ("engine_inertia", random.uniform(0.12, 0.25)),
        ("transmission_inertia", random.uniform(0.01, 0.03)),
        ("final_drive_inertia", random.uniform(0.02, 0.05)),
        ("wheel_inertia", random.uniform(1.0, 3.0)),
        ("mass", random.uniform(1200.0, 1700.0)),
        ("wheel_radius", random.uniform(0.29, 0.33)),
        ("final_drive_ratio", random.uniform(3.4, 4.0)),
        // 10 to 25 N m per degree, a clutch disc with its springs, so that the effects of the clutch are visible beside those of the shaft.
        ("clutch_stiffness", random.uniform(600.0, 1400.0)),
        ("clutch_damping", random.uniform(5.0, 15.0)),
        ("driveshaft_stiffness", random.uniform(4000.0, 8000.0)),
        ("driveshaft_damping", random.uniform(40.0, 90.0)),
        ("transmission_damping", 0.1),
        ("final_drive_damping", 0.1),
        ("wheel_damping", 0.1),
        ("rolling_resistance_1", random.uniform(0.08, 0.13)),
        ("rolling_resistance_2", 0.0),
        ("drag_area", random.uniform(0.55, 0.85)),
        ("air_density", 1.2),
        ("grade", 0.0),
        ("torque_0", random.uniform(100.0, 130.0)),
        ("torque_1", random.uniform(0.5, 0.65)),
        ("torque_2", -0.001),
        ("torque_lag", random.uniform(0.06, 0.12)),
        ("engine_friction_0", random.uniform(12.0, 18.0)),
        ("engine_friction_1", random.uniform(0.02, 0.04)),
    ];
    let gear_ratios = [3.5, 2.1, 1.45, 1.1, 0.88].map(|ratio| ratio * stretch).to_vec();
    Nominal {
        kind: Kind::Car,
        parameters: Parameters { values, gear_ratios, velocity_from_difference: false },
        tolerance: vec![
            ("mass", 0.02),
            ("driveshaft_stiffness", 0.05),
            ("driveshaft_damping", 0.1),
            ("drag_area", 0.03),
            ("torque_lag", 0.1),
        ],
        noise: vec![0.5, 0.02, 0.05],
        period: 0.01,
        rows: 3000,
    }
}

fn axis(kind: Kind, random: &mut Random) -> Nominal {
    let mass = random.uniform(40.0, 110.0);
    let force_gain = random.uniform(25.0, 45.0);
    // The bandwidth of the speed loop, force_gain velocity_gain/mass, is between 50 and 90 rad/s, that of the position loop is half of it: a damping
    // ratio near 0.7.
    let bandwidth = random.uniform(50.0, 90.0);
    let mut values = vec![
        ("mass", mass),
        ("force_gain", force_gain),
        ("viscous_friction", random.uniform(100.0, 250.0)),
        ("command_limit", 10.0),
    ];
    let closed = kind == Kind::ClosedAxis;
    if closed {
        values.push(("position_gain", 0.5 * bandwidth));
        values.push(("velocity_gain", bandwidth * mass / force_gain));
    }
    Nominal {
        kind,
        parameters: Parameters { values, gear_ratios: vec![], velocity_from_difference: closed && random.sign() > 0.0 },
        tolerance: vec![("mass", 0.02), ("viscous_friction", 0.05)],
        noise: if closed { vec![1e-6, 0.005] } else { vec![1e-5] },
        period: 0.001,
        rows: 8000,
    }
}

/// Every kind of the catalogue that is possible on this plant, in the order of docs/book/src/reference/plants.md.
pub fn catalogue(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::Motor => &[
            "parameter-error",
            "coulomb-friction",
            "asymmetric-friction",
            "stribeck-friction",
            "windage",
            "constant-load",
            "load-drift",
            "cogging-torque",
            "torque-ripple",
            "magnetic-saturation",
            "resistance-heating",
            "inverter-dead-time",
            "voltage-limit",
            "angle-offset",
            "angle-eccentricity",
            "input-delay",
            "input-gain",
            "sensor-gain",
            "sensor-bias",
            "sensor-lag",
            "sensor-delay",
            "sensor-quantisation",
            "sensor-drift",
            "shaft-compliance",
        ],
        Kind::Car => &[
            "parameter-error",
            "input-delay",
            "input-gain",
            "sensor-gain",
            "sensor-bias",
            "sensor-lag",
            "sensor-delay",
            "sensor-quantisation",
            "sensor-drift",
            "backlash",
            "clutch-stiffening",
            "clutch-slip",
            "tyre-slip",
            "road-grade",
            "headwind",
            "brake-drag",
            "throttle-nonlinearity",
            "combustion-ripple",
        ],
        Kind::OpenAxis | Kind::ClosedAxis => &[
            "parameter-error",
            "coulomb-friction",
            "asymmetric-friction",
            "stribeck-friction",
            "constant-load",
            "load-drift",
            "cogging-torque",
            "input-delay",
            "input-gain",
            "sensor-gain",
            "sensor-bias",
            "sensor-lag",
            "sensor-delay",
            "sensor-quantisation",
            "sensor-drift",
            "shaft-compliance",
            "backlash",
        ],
    }
}

/// A gain with an error between `least` and `most`, up or down.
fn off(random: &mut Random, least: f64, most: f64) -> f64 {
    1.0 + random.sign() * random.spread(least, most)
}

/// The error of an axis's force. It has the same effect as an equal relative error of mass and friction, so it is calibration as long as the mass
/// stays within two standard deviations of its tolerance, 4 %; and the file's mass itself has an error of up to 3 %.
const OF_FORCE: (f64, f64) = (0.08, 0.15);

/// An effect of the catalogue, with a magnitude. `output` selects the output of a sensor effect; otherwise it is random.
pub fn effect(name: &str, nominal: &Nominal, output: Option<usize>, random: &mut Random) -> Effect {
    let kind = nominal.kind;
    let names = kind.outputs();
    let output = output.unwrap_or_else(|| random.whole(0, names.len() as u64 - 1) as usize);
    // A constant command has no memory, so a lag is not visible between rows: on an axis only positions have lags or delays.
    let output = if ["sensor-lag", "sensor-delay"].contains(&name) && kind == Kind::ClosedAxis { 0 } else { output };
    let sensed = names[output].0;
    let sigma = nominal.noise[output];
    let size = typical(sensed);
    let seconds = nominal.period * nominal.rows as f64;
    if let Some(found) = beyond(name, nominal, random) {
        return found;
    }
    match name {
        "parameter-error" => parameter_error(nominal, random),
        "mass-error" => {
            let (least, most) = OF_FORCE;
            let value = nominal.parameters.get("mass") * off(random, least, most);
            Effect { kind: "parameter-error", which: Some(("parameter", "mass")), values: vec![("value", value)] }
        }
        "input-gain" => {
            let (least, most) = if matches!(kind, Kind::OpenAxis | Kind::ClosedAxis) { OF_FORCE } else { (0.03, 0.12) };
            Effect::new("input-gain", &[("gain", off(random, least, most))])
        }
        // One to six periods for an axis or a motor; a throttle is slower.
        "input-delay" => {
            let periods = if kind == Kind::Car { random.spread(4.0, 15.0) } else { random.spread(1.0, 6.0) };
            Effect::new("input-delay", &[("delay", periods * nominal.period)])
        }
        "sensor-gain" => Effect::on("sensor-gain", sensed, &[("gain", off(random, 0.015, 0.08))]),
        "sensor-bias" => Effect::on("sensor-bias", sensed, &[("bias", random.sign() * random.spread(0.01, 0.06) * size)]),
        // At the end of a record it is as large as a constant load may be.
        "load-drift" if kind == Kind::Motor => {
            Effect::new("load-drift", &[("torque_rate", random.sign() * random.spread(0.05, 0.6) / seconds)])
        }
        "load-drift" => Effect::new("load-drift", &[("force_rate", random.sign() * random.spread(1.0, 12.0) / seconds)]),
        "sensor-drift" => {
            let rate = random.sign() * random.spread(0.02, 0.08) * size / seconds;
            Effect::on("sensor-drift", sensed, &[("rate", rate)])
        }
        "sensor-lag" => {
            let periods = random.spread(4.0, 20.0);
            Effect::on("sensor-lag", sensed, &[("time_constant", periods * nominal.period)])
        }
        "sensor-delay" => Effect::on("sensor-delay", sensed, &[("delay", random.spread(1.5, 8.0) * nominal.period)]),
        "sensor-quantisation" => Effect::on("sensor-quantisation", sensed, &[("step", random.spread(5.0, 25.0) * sigma)]),
        "shaft-compliance" | "backlash" if kind != Kind::Car => {
            let inertia = nominal.parameters.get(if kind == Kind::Motor { "inertia" } else { "mass" });
            let hertz = if kind == Kind::Motor { random.uniform(40.0, 150.0) } else { random.uniform(15.0, 40.0) };
            let ratio = random.uniform(0.25, 0.6);
            // The reduced inertia at this frequency, with a damping of a twentieth to a seventh.
            let reduced = inertia * ratio * (1.0 - ratio);
            let rate = std::f64::consts::TAU * hertz;
            let spring = [("stiffness", reduced * rate * rate), ("damping", 2.0 * random.uniform(0.05, 0.15) * reduced * rate)];
            if name == "backlash" {
                let gap = random.spread(2e-4, 1.5e-3);
                Effect::new("backlash", &[("gap", gap), ("mass_ratio", ratio), spring[0], spring[1]])
            } else {
                Effect::new("shaft-compliance", &[("inertia_ratio", ratio), spring[0], spring[1]])
            }
        }
        _ => match kind {
            Kind::Motor => of_motor(name, nominal, random),
            Kind::Car => of_car(name, nominal, random),
            Kind::OpenAxis | Kind::ClosedAxis => of_axis(name, random),
        },
    }
}

/// An effect of the catalogue beyond the usual range: a wave of any order, a delay of tens of rows, a friction that is most of the effort, a large
/// sensor error. `None` for other words.
fn beyond(name: &str, nominal: &Nominal, random: &mut Random) -> Option<Effect> {
    let (kind, period) = (nominal.kind, nominal.period);
    let found = match (name, kind) {
        // 12 slots with 14 poles make 84 cycles per revolution, 9 with 10 make 90: the most common small motors.
        ("any-order", Kind::Motor) => Effect::new(
            "cogging-torque",
            &[
                ("amplitude", random.spread(0.15, 0.8)),
                ("cycles", random.whole(1, 100) as f64),
                ("phase", random.uniform(-3.0, 3.0)),
            ],
        ),
        ("any-order", _) => of_axis("cogging-torque", random),
        // 10 to 40 rows for a motor or an axis; a throttle is slower: 0.2 to 0.6 s.
        ("late-input", Kind::Car) => Effect::new("input-delay", &[("delay", random.spread(20.0, 60.0) * period)]),
        ("late-input", _) => Effect::new("input-delay", &[("delay", random.spread(10.0, 40.0) * period)]),
        ("late-sensor", _) => {
            let names = kind.outputs();
            let output = if kind == Kind::ClosedAxis { 0 } else { random.whole(0, names.len() as u64 - 1) as usize };
            Effect::on("sensor-delay", names[output].0, &[("delay", random.spread(10.0, 60.0) * period)])
        }
        // A fifth to more than half of the drive's effort in the records.
        ("heavy-friction", Kind::Motor) => Effect::new("coulomb-friction", &[("torque", random.spread(0.6, 3.0))]),
        ("heavy-friction", _) => Effect::new("coulomb-friction", &[("force", random.spread(25.0, 80.0))]),
        ("far-gain", _) => {
            let names = kind.outputs();
            let output = random.whole(0, names.len() as u64 - 1) as usize;
            Effect::on("sensor-gain", names[output].0, &[("gain", off(random, 0.15, 0.45))])
        }
        _ => return None,
    };
    Some(found)
}

/// The range of an output in the records of `excitation`. Biases and drifts are shares of it.
fn typical(output: &str) -> f64 {
    match output {
        "i_d" | "i_q" => 20.0,
        "speed" => 150.0,
        "engine_speed" => 250.0,
        "road_speed" => 15.0,
        "acceleration" => 3.0,
        "position" => 0.1,
        _ => 3.0,
    }
}

fn parameter_error(nominal: &Nominal, random: &mut Random) -> Effect {
    // The parameters with an effect on a record of this plant that is larger than the noise.
    let names: &[&'static str] = match nominal.kind {
        Kind::Motor => &["phase_resistance", "phase_inductance", "flux_linkage", "inertia"],
        // Third gear occurs in one training record and in one validation record.
        Kind::Car => &["mass", "driveshaft_stiffness", "engine_inertia", "torque_lag", "drag_area", "gear_ratios[3]"],
        Kind::OpenAxis | Kind::ClosedAxis => &["mass", "viscous_friction", "force_gain"],
    };
    let name = random.one_of(names);
    let tolerance = nominal.tolerance.iter().find(|(known, _)| *known == name).map(|(_, tolerance)| *tolerance);
    // An error beyond 2 sigma is a cause: from 4 on it is unambiguous. The error of an exact parameter is some per cent.
    let factor = match tolerance {
        Some(sigma) => off(random, 4.0 * sigma, (8.0 * sigma).min(0.6)),
        None if name == "force_gain" => off(random, OF_FORCE.0, OF_FORCE.1),
        None => off(random, 0.04, 0.12),
    };
    Effect {
        kind: "parameter-error",
        which: Some(("parameter", name)),
        values: vec![("value", nominal.parameters.get(name) * factor)],
    }
}

fn two_levels(random: &mut Random, low: f64, high: f64) -> (f64, f64) {
    let first = random.spread(low, high);
    let second = first * random.uniform(1.4, 2.2);
    if random.sign() > 0.0 { (first, second) } else { (second, first) }
}

fn of_motor(name: &str, nominal: &Nominal, random: &mut Random) -> Effect {
    let of = |name| nominal.parameters.get(name);
    match name {
        "coulomb-friction" => Effect::new("coulomb-friction", &[("torque", random.spread(0.05, 0.5))]),
        "asymmetric-friction" => {
            let (forward, backward) = two_levels(random, 0.06, 0.3);
            let mut values = vec![("forward", forward), ("backward", backward)];
            if random.sign() > 0.0 {
                let (up, down) = two_levels(random, 0.8, 1.2);
                values.push(("viscous_forward", of("viscous_friction") * up));
                values.push(("viscous_backward", of("viscous_friction") * down));
            }
            Effect::new("asymmetric-friction", &values)
        }
        "stribeck-friction" => {
            let coulomb = random.spread(0.08, 0.3);
            let values = [
                ("coulomb", coulomb),
                ("static", coulomb * random.uniform(1.6, 2.5)),
                ("stribeck_velocity", random.uniform(5.0, 15.0)),
            ];
            Effect::new("stribeck-friction", &values)
        }
        "windage" => Effect::new("windage", &[("coefficient", random.spread(2e-6, 2e-5))]),
        "constant-load" => Effect::new("constant-load", &[("torque", random.sign() * random.spread(0.05, 0.6))]),
        "cogging-torque" => {
            let cycles = of("pole_pairs") * random.one_of(&[2.0, 6.0, 12.0]);
            let phase = random.uniform(-3.0, 3.0);
            Effect::new("cogging-torque", &[("amplitude", random.spread(0.15, 0.8)), ("cycles", cycles), ("phase", phase)])
        }
        "torque-ripple" => Effect::new("torque-ripple", &[("amplitude", random.spread(0.01, 0.06))]),
        "magnetic-saturation" => Effect::new("magnetic-saturation", &[("saturation_current", random.spread(25.0, 70.0))]),
        "resistance-heating" => {
            // About 300 A^2 on average: 1.5 r 300 W times this thermal resistance in K/W is 30 to 100 K.
            let kelvin = random.uniform(30.0, 100.0);
            let resistance = kelvin / (1.5 * of("phase_resistance") * 300.0);
            let time = random.uniform(0.4, 1.5);
            Effect::new("resistance-heating", &[("thermal_resistance", resistance), ("thermal_time_constant", time)])
        }
        "inverter-dead-time" => Effect::new("inverter-dead-time", &[("voltage_loss", random.spread(0.2, 2.0))]),
        // The records need up to 60 V of EMF: see excitation::motor. With this limit they are clipped.
        "voltage-limit" => Effect::new("voltage-limit", &[("limit", random.uniform(25.0, 42.0))]),
        "angle-offset" => Effect::new("angle-offset", &[("angle", random.sign() * random.spread(0.01, 0.1))]),
        "angle-eccentricity" => Effect::new("angle-eccentricity", &[("amplitude", random.sign() * random.spread(0.01, 0.08))]),
        _ => unreachable!("{name} does not stand on a motor"),
    }
}

fn of_car(name: &str, nominal: &Nominal, random: &mut Random) -> Effect {
    match name {
        "backlash" => Effect::new("backlash", &[("gap", random.spread(0.015, 0.08))]),
        "clutch-stiffening" => {
            // At the twist for 120 N m the cubic term is 0.4 to 1.5 times the linear one.
            let k = nominal.parameters.get("clutch_stiffness");
            let twist = 120.0 / k;
            Effect::new("clutch-stiffening", &[("cubic_stiffness", random.uniform(0.4, 1.5) * k / (twist * twist))])
        }
        "clutch-slip" => Effect::new("clutch-slip", &[("capacity", random.uniform(120.0, 170.0))]),
        "tyre-slip" => Effect::new("tyre-slip", &[("slip_stiffness", random.spread(1.5e4, 6e4))]),
        "road-grade" => Effect::new("road-grade", &[("grade", random.sign() * random.spread(0.005, 0.05))]),
        "headwind" => Effect::new("headwind", &[("wind", random.sign() * random.spread(1.5, 8.0))]),
        "brake-drag" => Effect::new("brake-drag", &[("torque", random.spread(15.0, 120.0))]),
        "throttle-nonlinearity" => Effect::new("throttle-nonlinearity", &[("exponent", off(random, 0.08, 0.4))]),
        "combustion-ripple" => Effect::new("combustion-ripple", &[("amplitude", random.spread(0.3, 1.0))]),
        _ => unreachable!("{name} does not stand on a driveline"),
    }
}

fn of_axis(name: &str, random: &mut Random) -> Effect {
    match name {
        "coulomb-friction" => Effect::new("coulomb-friction", &[("force", random.spread(2.0, 25.0))]),
        "asymmetric-friction" => {
            let (forward, backward) = two_levels(random, 3.0, 15.0);
            let mut values = vec![("forward", forward), ("backward", backward)];
            if random.sign() > 0.0 {
                let (up, down) = two_levels(random, 100.0, 160.0);
                values.push(("viscous_forward", up));
                values.push(("viscous_backward", down));
            }
            Effect::new("asymmetric-friction", &values)
        }
        "stribeck-friction" => {
            let coulomb = random.spread(4.0, 15.0);
            let values = [
                ("coulomb", coulomb),
                ("static", coulomb * random.uniform(1.6, 2.5)),
                ("stribeck_velocity", random.uniform(0.006, 0.03)),
            ];
            Effect::new("stribeck-friction", &values)
        }
        "constant-load" => Effect::new("constant-load", &[("force", random.sign() * random.spread(1.0, 12.0))]),
        "cogging-torque" => {
            let values = [
                ("amplitude", random.spread(2.0, 12.0)),
                ("pitch", random.uniform(0.004, 0.02)),
                ("phase", random.uniform(-3.0, 3.0)),
            ];
            Effect::new("cogging-torque", &values)
        }
        _ => unreachable!("{name} does not stand on an axis"),
    }
}

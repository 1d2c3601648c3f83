//! The possible effects at each place of the plants of `examples/plants/`, and their random magnitudes.
//!
//! In: a plant, a place, a size between 0 and 1, a stream of random numbers. Out: the numbers of an effect. At size 1 an effect is as large as the
//! usual quantities at its place. The size in a case follows from the change that it causes (`cases.rs`).

use super::{Cause, Input, Output, Site, SiteKind, System};
use crate::random::Random;

const TURNS: [&str; 12] = [
    "asymmetric-friction",
    "cogging-torque",
    "combustion-ripple",
    "constant-load",
    "coulomb-friction",
    "imbalance",
    "load-drift",
    "quadratic-drag",
    "shaft-compliance",
    "static-load-spring",
    "stribeck-friction",
    "windage",
];
/// For a translation without a position.
const MOVES: [&str; 6] =
    ["asymmetric-friction", "constant-load", "coulomb-friction", "load-drift", "quadratic-drag", "stribeck-friction"];
const COMMANDS: [&str; 8] = [
    "input-bias",
    "input-dead-band",
    "input-delay",
    "input-exponent",
    "input-gain",
    "input-lag",
    "input-limit",
    "throttle-nonlinearity",
];
const READS: [&str; 8] = [
    "sensor-bias",
    "sensor-delay",
    "sensor-drift",
    "sensor-gain",
    "sensor-lag",
    "sensor-limit",
    "sensor-lost-sign",
    "sensor-quantisation",
];

/// Every effect of the catalogue at every place of a plant where it is possible: kind and place.
pub fn everywhere(system: &System) -> Vec<(&'static str, &'static str)> {
    let mut list = vec![];
    for site in system.sites {
        let kinds: &[&str] = match site.kind {
            SiteKind::Rotation => &TURNS,
            SiteKind::Translation => &MOVES,
            SiteKind::Joint => &["backlash", "clutch-slip", "clutch-stiffening", "hysteresis"],
            SiteKind::Winding => &["inverter-dead-time", "magnetic-saturation", "resistance-heating"],
            SiteKind::Storage => &["leak", "overflow"],
            SiteKind::Heat => &["leak", "radiation"],
            SiteKind::Vehicle => &["brake-drag", "headwind", "tyre-slip"],
        };
        // Only a driven body has a drive torque that can have a ripple.
        let is_driven = !(system.name == "two-mass-drive" && site.name == "load");
        list.extend(kinds.iter().filter(|kind| is_driven || **kind != "combustion-ripple").map(|kind| (*kind, site.name)));
    }
    for input in system.inputs {
        list.extend(COMMANDS.iter().map(|kind| (*kind, input.name)));
    }
    for output in system.outputs {
        list.extend(READS.iter().map(|kind| (*kind, output.name)));
    }
    list.extend(system.parameters.iter().map(|(name, _)| ("parameter-error", *name)));
    list
}

/// Whether a case may hide an effect there; comments give the reasons for exceptions.
pub fn is_asked(system: &System, kind: &str, at: &str) -> bool {
    if let Some(input) = system.inputs.iter().find(|it| it.name == at) {
        // A throttle acts in one direction. A measured disturbance has no dead band, limit or power law; its scale is that of its sensor, including
        // the offset.
        return match kind {
            "throttle-nonlinearity" => input.commands && input.range.0 >= 0.0,
            "input-bias" | "input-gain" | "input-delay" | "input-lag" => true,
            // A thrust of 8 N is far from a dead band.
            "input-dead-band" => input.commands && input.range.0 <= 0.0,
            _ => input.commands,
        };
    }
    if let Some(output) = system.outputs.iter().find(|it| it.name == at) {
        return kind != "sensor-lost-sign" || output.range.0 < 0.0;
    }
    // The same law with two names.
    kind != "windage"
}

/// An effect at a place, with a size in (0, 1].
///
/// # Panics
/// For a place or a kind that the plant does not have: both come from `everywhere`.
pub fn cause(system: &System, kind: &str, at: &str, size: f64, mut random: Random) -> Cause {
    let random = &mut random;
    let seconds = system.period * system.rows as f64;
    let numbers = if let Some(site) = system.site(at) {
        on_site(kind, site, size, seconds, random)
    } else if let Some(input) = system.inputs.iter().find(|it| it.name == at) {
        on_input(kind, input, size, system.period, random)
    } else if let Some(output) = system.outputs.iter().find(|it| it.name == at) {
        on_output(kind, output, size, system, random)
    } else {
        let nominal = system.parameters.iter().find(|it| it.0 == at).unwrap_or_else(|| panic!("no place {at}")).1;
        vec![("value", nominal * (random.sign() * 0.7 * size).exp())]
    };
    Cause::new(kind, at, &numbers)
}

type Numbers = Vec<(&'static str, f64)>;

fn on_site(kind: &str, site: &Site, size: f64, seconds: f64, random: &mut Random) -> Numbers {
    let Site { effort, speed, position, inertia, .. } = *site;
    let turns = site.kind == SiteKind::Rotation;
    let (load, rate) = if turns { ("torque", "torque_rate") } else { ("force", "force_rate") };
    let some = 0.5 * size * effort;
    match kind {
        "coulomb-friction" => vec![(load, some)],
        "asymmetric-friction" => {
            let (more, less) = (some * random.uniform(0.8, 1.0), some * random.uniform(0.15, 0.5));
            let (forward, backward) = if random.sign() > 0.0 { (more, less) } else { (less, more) };
            vec![("forward", forward), ("backward", backward)]
        }
        "stribeck-friction" => {
            vec![("coulomb", 0.4 * some), ("static", some), ("stribeck_velocity", speed * random.spread(0.1, 0.5))]
        }
        "quadratic-drag" | "windage" => vec![("coefficient", some / (speed * speed))],
        "constant-load" => vec![(load, random.sign() * some)],
        "load-drift" => vec![(rate, random.sign() * some / seconds)],
        "cogging-torque" => vec![
            ("amplitude", some),
            ("cycles", random.one_of(&[2.0, 3.0, 4.0, 6.0, 8.0, 12.0])),
            ("phase", random.uniform(-3.0, 3.0)),
        ],
        "imbalance" => vec![("amplitude", some), ("phase", random.uniform(-3.0, 3.0))],
        "combustion-ripple" => vec![("amplitude", 0.5 * size)],
        "static-load-spring" => vec![("stiffness", some / position), ("rest", position * random.uniform(-0.3, 0.3))],
        "shaft-compliance" => {
            let ratio = random.uniform(0.25, 0.6);
            // A softer spring is a larger effect: 8 Hz at size 1, 160 Hz at a twentieth.
            let hertz = 8.0 / size.max(0.05);
            let reduced = inertia * ratio * (1.0 - ratio);
            let around = std::f64::consts::TAU * hertz;
            let damping = 2.0 * random.uniform(0.05, 0.15) * reduced * around;
            vec![("inertia_ratio", ratio), ("stiffness", reduced * around * around), ("damping", damping)]
        }
        "backlash" => vec![("gap", position * size)],
        "clutch-stiffening" => vec![("cubic_stiffness", 2.0 * some / position.powi(3))],
        // Above twice a usual effort nothing slips.
        "clutch-slip" => vec![("capacity", 2.0 * effort * (1.0 - 0.85 * size))],
        "hysteresis" => vec![("level", some), ("stiffness", some / (position * random.uniform(0.05, 0.2)))],
        // For a winding, the usual voltage is its effort and the usual current its speed.
        "inverter-dead-time" => vec![("voltage_loss", 0.5 * some)],
        "magnetic-saturation" => vec![("saturation_current", speed / size)],
        "resistance-heating" => vec![
            // 150 K at size 1, with the usual voltage and the usual current.
            ("thermal_resistance", 150.0 * size / (effort * speed * 0.4)),
            ("thermal_time_constant", seconds * random.spread(0.1, 0.4)),
        ],
        "leak" if site.kind == SiteKind::Storage => vec![("conductance", some / position), ("rest", 0.0)],
        "leak" => vec![("conductance", some / speed), ("rest", random.uniform(285.0, 300.0))],
        "radiation" => {
            let ambient = random.uniform(288.0, 298.0);
            let hot = position.powi(4) - 293.0_f64.powi(4);
            vec![("coefficient", some / hot), ("ambient", ambient)]
        }
        "overflow" => vec![("level_limit", position - 0.6 * size * speed)],
        "brake-drag" => vec![("torque", some)],
        "headwind" => vec![("wind", random.sign() * 15.0 * size)],
        "tyre-slip" => vec![("slip_stiffness", 4000.0 / size)],
        _ => unreachable!("{kind} on a site"),
    }
}

fn on_input(kind: &str, input: &Input, size: f64, period: f64, random: &mut Random) -> Numbers {
    let (low, high) = input.range;
    let spread = high - low;
    match kind {
        "input-bias" => vec![("bias", random.sign() * 0.2 * size * spread)],
        "input-gain" => vec![("gain", (random.sign() * 0.5 * size).exp())],
        "input-dead-band" => vec![("width", 0.5 * size * spread)],
        "input-delay" => vec![("delay", 40.0 * size * period)],
        "input-lag" => vec![("time_constant", 40.0 * size * period)],
        "input-exponent" | "throttle-nonlinearity" => vec![("exponent", (random.sign() * 0.5 * size).exp())],
        "input-limit" => vec![("low", low + 0.45 * size * spread), ("high", high - 0.45 * size * spread)],
        _ => unreachable!("{kind} on an input"),
    }
}

fn on_output(kind: &str, output: &Output, size: f64, system: &System, random: &mut Random) -> Numbers {
    let (low, high) = output.range;
    let (spread, seconds) = (high - low, system.period * system.rows as f64);
    match kind {
        "sensor-bias" => vec![("bias", random.sign() * 0.3 * size * spread)],
        "sensor-gain" => vec![("gain", (random.sign() * 0.4 * size).exp())],
        "sensor-drift" => vec![("rate", random.sign() * 0.5 * size * spread / seconds)],
        "sensor-delay" => vec![("delay", 40.0 * size * system.period)],
        "sensor-lag" => vec![("time_constant", 40.0 * size * system.period)],
        // A step of 10 times the noise changes a reading by 3 times the noise.
        "sensor-quantisation" => vec![("step", output.noise * 100.0 * size)],
        "sensor-limit" => vec![("low", low + 0.4 * size * spread), ("high", high - 0.4 * size * spread)],
        "sensor-lost-sign" => vec![],
        _ => unreachable!("{kind} on an output"),
    }
}

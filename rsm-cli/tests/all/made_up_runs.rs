//! Generates the data that the tests of the command fit, and checks that the files in the repository are equal to them. `RSM_BLESS=1` writes them.
//!
//! An ideal surface permanent-magnet motor (17), (18) in steady state at its voltage limit (20), with the parameters of the trial in which the ladder
//! of coordinates was measured: 0.08 ohm, 0.9 mH, 0.06 Wb, 4 pole pairs, 270 V. A dynamometer sets torque and speed in random order; the currents are
//! measured with noise.

use std::fmt::Write as _;
use std::path::Path;

const RESISTANCE: f64 = 0.08;
const INDUCTANCE: f64 = 0.9e-3;
const FLUX_LINKAGE: f64 = 0.06;
const POLE_PAIRS: f64 = 4.0;
const BUS_VOLTAGE: f64 = 270.0;

/// 1 sigma of a current sensor of 0.2 % of 60 A.
const NOISE_A: f64 = 0.12;

/// The d-axis current nearest to zero at which the voltage vector has its largest permitted length: (r i_d - w_e L i_q)^2 + (r i_q + w_e (L i_d +
/// lambda))^2 = (bus/sqrt 3)^2, or 0 if no field weakening is needed.
fn weakening_current(torque: f64, speed: f64) -> (f64, f64) {
    let w_e = POLE_PAIRS * speed;
    let i_q = torque / (1.5 * POLE_PAIRS * FLUX_LINKAGE);
    let (reactance, emf) = (w_e * INDUCTANCE, w_e * FLUX_LINKAGE);
    let a = RESISTANCE.powi(2) + reactance.powi(2);
    let half_b = reactance * emf;
    let c = (reactance * i_q).powi(2) + (RESISTANCE * i_q + emf).powi(2) - BUS_VOLTAGE.powi(2) / 3.0;
    let i_d = if c <= 0.0 { 0.0 } else { (-half_b + (half_b * half_b - a * c).sqrt()) / a };
    (i_d, i_q)
}

/// SplitMix64 (Steele, Lea, Flood 2014): sufficient for noise and order, and the same on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The sum of twelve uniform numbers minus six: variance 1, and bounded, like the noise of a sensor.
    fn noise(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    fn shuffle<T>(&mut self, items: &mut [T]) {
        for k in (1..items.len()).rev() {
            items.swap(k, (self.next() % (k as u64 + 1)) as usize);
        }
    }
}

fn rpm(speed: f64) -> f64 {
    (speed * 30.0 / std::f64::consts::PI).round()
}

fn csv(title: &str, mut points: Vec<(f64, f64)>, random: &mut Random) -> String {
    random.shuffle(&mut points);
    let mut text = format!("# {title}\nrun[1],torque[N*m],speed[rpm],i_d[A],i_q[A],current_advance[deg]\n");
    for (run, (torque, speed)) in points.into_iter().enumerate() {
        let (i_d, i_q) = weakening_current(torque, speed * std::f64::consts::PI / 30.0);
        let (i_d, i_q) = (i_d + NOISE_A * random.noise(), i_q + NOISE_A * random.noise());
        let advance = (-i_d).atan2(i_q).to_degrees();
        let _ = writeln!(text, "{},{torque:.2},{speed:.0},{i_d:.3},{i_q:.3},{advance:.3}", run + 1);
    }
    text
}

fn files() -> [(&'static str, String); 2] {
    let mut random = Random(26);
    let (torques, speeds) = (8, 8);
    let grid = (0..torques * speeds).map(|k| {
        let (row, column) = (f64::from(k / speeds), f64::from(k % speeds));
        // From 1 N m: without torque and current, the angle of the vector is only noise.
        (1.0 + 13.0 * row / f64::from(torques - 1), rpm(660.5 + 139.0 * column / f64::from(speeds - 1)))
    });
    let data = csv("A made-up dynamometer run: grid of torque and speed in random order", grid.collect(), &mut random);
    let unseen: Vec<(f64, f64)> = (0..40)
        .map(|_| ((100.0 * (1.0 + 13.0 * random.uniform())).round() / 100.0, rpm(660.5 + 139.0 * random.uniform())))
        .collect();
    [
        ("dyno.csv", data),
        ("dyno-unseen.csv", csv("A second made-up run, points at random, never used in the fit", unseen, &mut random)),
    ]
}

#[test]
fn the_runs_are_what_is_made_here() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/weakening");
    for (name, text) in files() {
        let path = folder.join(name);
        if std::env::var_os("RSM_BLESS").is_some() {
            std::fs::write(&path, &text).unwrap();
        }
        assert!(std::fs::read_to_string(&path).unwrap() == text, "{name} is stale: run with RSM_BLESS=1 and read the diff");
    }
}

#[test]
fn the_motor_is_at_its_voltage_limit() {
    // Calculated by hand: 660 rad/s without torque. w_e = 2640, emf 158.4 V, limit 155.885 V, reactance 2.376 ohm: i_d = -(158.4 - 155.9)/2.376
    // = -1.06 A, without the resistive voltage drop.
    let (i_d, i_q) = weakening_current(0.0, 660.0);
    assert!((i_d + 1.06).abs() < 0.01 && i_q == 0.0, "{i_d}");
}

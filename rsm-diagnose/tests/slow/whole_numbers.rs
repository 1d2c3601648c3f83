//! A wave over an angle whose number of periods per turn no fit moves.
//!
//! The records of a short swing are computed here with Runge-Kutta steps of order 4, without code of the project.

use rsm_core::source::{Faults, Source};
use rsm_diagnose::plant::{Diagnosis, Options, Verdict, diagnose};
use rsm_sim::equation_plant;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::random::Random;

const ARM: &str = "model Arm\n  parameter Real inertia(unit = \"kg.m2\") = 0.02;\n  parameter Real drag(unit = \"N.m.s/rad\") = 0.01;\n  \
                   parameter Real stiffness(unit = \"N.m/rad\") = 0.1;\n  \
                   input Real torque(unit = \"N.m\");\n  output Real speed(unit = \"rad/s\", start = 0.0);\n  \
                   output Real angle(unit = \"rad\", start = 0.0);\nequation\n  der(angle) = speed;\n  \
                   inertia*der(speed) = torque - drag*speed - stiffness*angle;\nend Arm;\n";

const SITE: &str = "[sites.arm]\nkind = \"rotation\"\nposition = \"angle\"\nspeed = \"speed\"\ninertia = \"inertia\"\nviscous_friction = \"drag\"\n\
                    drive = \"torque\"\n";

const NOISE: f64 = 1e-3;

fn arm() -> PlantFile {
    let file = format!("format = 2\nmodel = \"arm.mo\"\n[tolerance]\ninertia = 0.05\ndrag = 0.2\nstiffness = 0.1\n{SITE}");
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, ARM));
    equation_plant::read(&Source::new("arm.toml", file), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

/// A record of 4 s with steps of the torque; the arm swings by about a radian, a sixth of a turn.
fn record(plant: &PlantFile, wave: (f64, f64, f64), seed: u64) -> Record {
    let mut random = Random::new(seed);
    let (amplitude, cycles, phase) = wave;
    let (period, rows, parts) = (0.005, 800, 5);
    let (mut state, mut torque) = ([0.0, 0.0], 0.0);
    let [mut time, mut torques, mut speeds, mut angles] = [const { Vec::new() }; 4];
    for row in 0..rows {
        if row % 80 == 0 {
            torque = 0.08 * (random.uniform() - 0.5);
        }
        time.push(f64::from(row) * period);
        torques.push(torque);
        angles.push(state[0] + NOISE * random.normal());
        speeds.push(state[1] + 5.0 * NOISE * random.normal());
        let rate = |[angle, speed]: [f64; 2]| {
            let wave = amplitude * (cycles * angle + phase).sin();
            [speed, (torque + wave - 0.01 * speed - 0.1 * angle) / 0.02]
        };
        let h = period / f64::from(parts);
        for _ in 0..parts {
            let moved = |by: [f64; 2], share: f64| [state[0] + share * by[0], state[1] + share * by[1]];
            let k1 = rate(state);
            let k2 = rate(moved(k1, 0.5 * h));
            let k3 = rate(moved(k2, 0.5 * h));
            let k4 = rate(moved(k3, h));
            state = [0, 1].map(|k| state[k] + h / 6.0 * (k1[k] + 2.0 * k2[k] + 2.0 * k3[k] + k4[k]));
        }
    }
    let columns: [(&str, &[f64]); 4] = [("time", &time), ("torque", &torques), ("speed", &speeds), ("angle", &angles)];
    Record::in_memory(plant, &columns).unwrap_or_else(|faults| panic!("{faults}"))
}

fn diagnosed(wave: (f64, f64, f64), seed: u64) -> Diagnosis {
    let plant = arm();
    let records = |seeds: [u64; 2]| seeds.map(|it| record(&plant, wave, 10 * seed + it));
    diagnose(&plant, &records([1, 2]), &records([3, 4]), &Options { threads: 2, progress: &|_| {} }).unwrap()
}

#[test]
fn the_periods_per_turn_are_found_along_a_part_of_a_turn() {
    let mut wrong = Vec::new();
    for seed in 0..12 {
        let mut random = Random::new(100 + seed);
        let wave = (0.02, (2.0 + 5.0 * random.uniform()).round(), 6.0 * random.uniform());
        let found = diagnosed(wave, seed);
        let cause = found.causes.first();
        let cycles = cause.and_then(|it| it.parameters.iter().find(|it| it.name == "cycles")).map(|it| it.value);
        if (found.verdict, cause.map(|it| it.kind), cycles) != (Verdict::Explained, Some("cogging-torque"), Some(wave.1)) {
            wrong.push((seed, wave, found.verdict, cause.map(|it| it.kind), cycles));
        }
    }
    // Six were wrong before neighbours were tried. At seed 5 an imbalance, one period per turn, takes the place of two periods.
    assert!(wrong.len() <= 1, "{wrong:?}");
}

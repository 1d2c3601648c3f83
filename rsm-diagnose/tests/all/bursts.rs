//! Bursts of noise in records with a cause, whose effect is a hundred times the noise and hides them at first.
//!
//! The records of a cart are computed here, row by row in closed form, without code of the project.

use rsm_core::source::{Faults, Source};
use rsm_diagnose::plant::{Diagnosis, Options, Verdict, diagnose};
use rsm_sim::equation_plant;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::random::Random;

const CART: &str = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  parameter Real drag(unit = \"N.s/m\") = 10;\n  \
                    input Real force(unit = \"N\");\n  output Real speed(unit = \"m/s\", start = 0.0);\nequation\n  \
                    mass*der(speed) = force - drag*speed;\nend Cart;\n";

/// The standard deviation of the noise, in m/s.
const NOISE: f64 = 1e-3;

fn cart() -> PlantFile {
    let file = "format = 2\nmodel = \"cart.mo\"\n[tolerance]\nmass = 0.02\ndrag = 0.02\n";
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, CART));
    equation_plant::read(&Source::new("cart.toml", file), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

/// A record with a new force in every fourth row, which acts two rows late, and with bursts of six times the noise.
fn record(plant: &PlantFile, late: usize, seed: u64) -> Record {
    let mut random = Random::new(seed);
    let (period, rows) = (0.02, 1000);
    let decay = (-period * 10.0 / 2.0_f64).exp();
    let (mut speed, mut next) = (0.0, 150);
    let (mut time, mut forces, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..rows {
        let force = if row % 4 == 0 { 10.0 * (random.uniform() - 0.5) } else { forces[row - 1] };
        time.push(row as f64 * period);
        forces.push(force);
        if row > next + 20 {
            next += 250;
        }
        let loud = if row >= next { 6.0 } else { 0.0 };
        speeds.push(speed + NOISE * (random.normal() + loud * random.normal()));
        let acting = if row >= late { forces[row - late] } else { 0.0 } / 10.0;
        speed = acting + (speed - acting) * decay;
    }
    let columns: [(&str, &[f64]); 3] = [("time", &time), ("force", &forces), ("speed", &speeds)];
    Record::in_memory(plant, &columns).unwrap_or_else(|faults| panic!("{faults}"))
}

fn diagnosed(late: usize) -> Diagnosis {
    let plant = cart();
    let records = |seeds: [u64; 2]| seeds.map(|seed| record(&plant, late, seed));
    diagnose(&plant, &records([1, 2]), &records([3, 4]), &Options { threads: 2, progress: &|_| {} }).unwrap()
}

#[test]
fn bursts_that_a_delay_hides_are_found_after_it() {
    for late in [0, 2] {
        let found = diagnosed(late);
        // A linear cart with one output does not distinguish a late force from a late reading.
        let causes: Vec<bool> = found.causes.iter().map(|cause| cause.kind.ends_with("-delay")).collect();
        let expected = if late == 0 { (Verdict::NoDiscrepancy, vec![]) } else { (Verdict::Explained, vec![true]) };
        assert_eq!((found.verdict, causes), expected);
        let bursts = found.findings.iter().filter(|it| it.what.contains("burst")).count();
        // Four in each record; a short one may be missed.
        assert!((12..=16).contains(&bursts), "{late}: {bursts}");
    }
}

//! The damping surface of the throttle follows a car that wears: the shipped model, and tip-in runs of a car whose driveshaft loses its damping.

use std::fmt::Write as _;

use rsm_core::check::Checked;
use rsm_core::lower::Recursive;
use rsm_core::number::Precision;
use rsm_core::source::Source;
use rsm_fit::random::Random;
use rsm_fit::track::{Track, Tracked};
use rsm_rigs::track::figures::{LASH, with_lash};
use rsm_rigs::track::measure::measure;
use rsm_rigs::track::plan::{RPM, TipIn};
use rsm_rigs::track::run::tip_in;
use rsm_sim::plant_file::PlantFile;

const RUNS: u32 = 200;

fn text(path: &str) -> String {
    std::fs::read_to_string(format!("{}/../{path}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// The car of the shipped surfaces, with a share of the driveshaft's damping.
fn car(share: f64) -> PlantFile {
    let of_new = text("rsm-sim/plants/driveline.toml");
    let worn = of_new.replace("driveshaft_damping = 65.0", &format!("driveshaft_damping = {:?}", 65.0 * share));
    assert!(share == 1.0 || worn != of_new);
    with_lash(&PlantFile::read(&Source::new("driveline.toml", worn)).unwrap(), LASH).unwrap()
}

/// Tip-in runs in random gears at random engine speeds, in the order in which they are made. The damping falls by a third over all of them if the car
/// wears.
fn runs(wears: bool) -> Source {
    let mut random = Random::new(82);
    let mut csv = String::from("speed[m/s],gear[1],damping_ratio[1]\n");
    for k in 0..RUNS {
        let share = if wears { 1.0 - f64::from(k) / f64::from(3 * RUNS) } else { 1.0 };
        let gear = 1 + (random.share() * 5.0) as usize;
        let run = TipIn { run: k, gear, engine_speed: (1200.0 + 3600.0 * random.share()) * RPM, load: 0.0 };
        let car = car(share);
        let found = measure(&car, &run, &tip_in(&car, &run, 7, None).unwrap()).unwrap();
        writeln!(csv, "{},{gear},{}", found.road_speed, found.mode.shape.damping_ratio).unwrap();
    }
    Source::new("runs.csv", csv)
}

fn tracked(runs: &Source) -> Tracked {
    let checked = Checked::read(&Source::new("driveline.toml", text("generated/coefficients/driveline.toml"))).unwrap();
    let surface = checked.model().surfaces.iter().position(|surface| surface.name == "damping_ratio").unwrap();
    // A run in fifth gear has an error of 0.01. A memory of 50 runs, a quarter of the record.
    let settings = Recursive { forgetting: 0.98, noise: 0.01, gate: 5.0, limit: 0.03, start: 0.01 };
    // The throttle's step is in f32.
    let track = Track { surface, settings, precision: Precision::F32 };
    track.run(&checked, std::slice::from_ref(runs)).unwrap().0
}

#[test]
fn the_damping_surface_of_the_throttle_follows_the_wear_of_the_car() {
    let found = tracked(&runs(true));
    let frozen = found.rows - found.used;
    assert!(found.used > 190, "{frozen} rows are frozen: {:?}", found.frozen);
    // A quarter of the damping is gone in the last part, 0.04 at a mean of 0.16. The surface is about 50 runs behind,
    // in which the damping falls by 0.01.
    let last = found.parts.last().unwrap();
    let (with, without) = (last.rmse.unwrap(), last.rmse_of_file.unwrap());
    assert!(without > 0.035 && with < 0.35 * without, "{with} {without}");
    // The constant term is the damping in the middle of the box: its fall is found to within its standard errors.
    let middle = &found.coefficients[0];
    assert!(middle.before - middle.after > 4.0 * middle.standard_error, "{middle:?}");
}

#[test]
fn a_new_car_keeps_its_damping_surface() {
    let found = tracked(&runs(false));
    // Following costs less than the noise of a run, 0.01; what is beyond the file's own error is the noise of the coefficients.
    for part in &found.parts {
        assert!(part.rmse.unwrap() < 0.01 && part.rmse_of_file.unwrap() < 0.01, "{part:?}");
    }
    let moved = found.coefficients.iter().map(|it| (it.after - it.before).abs() / it.standard_error).fold(0.0, f64::max);
    // 15 coefficients: the largest of so many normal numbers is below 3 in 96 % of records.
    assert!(moved < 3.0, "{moved}");
}

//! The track: what a run is, what is measured of it, and a compensator that the rounds find, on ten runs with a fixed seed.

use rsm_core::check::Checked;
use rsm_core::source::Source;
use rsm_fit::{Outcome, Specification, fit};
use rsm_rigs::track::experiment::{csv, experiment};
use rsm_rigs::track::figures::{LASH, Study, with_lash};
use rsm_rigs::track::gearbox::{self, Against, LOADS, OTHER_RATIOS, fit_mode, loaded, prediction};
use rsm_rigs::track::measure::{Measured, measure};
use rsm_rigs::track::plan::{RPM, TipIn, TrackPlan};
use rsm_rigs::track::rounds::{self, COMPENSATOR, Poles, Settings, fit_surfaces, tune, zeta};
use rsm_rigs::track::run::{COAST_ROWS, Compensation, PERIOD, tip_in};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

const SEED: u64 = 11;

fn car() -> PlantFile {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../rsm-sim/plants/driveline.toml")).unwrap();
    PlantFile::read(&Source::new("driveline.toml", text)).unwrap()
}

fn silent(mut car: PlantFile) -> PlantFile {
    car.noise.clear();
    car
}

fn run(gear: usize, rpm: f64) -> TipIn {
    TipIn { run: 1, gear, engine_speed: rpm * RPM, load: 0.0 }
}

#[test]
fn a_run_is_what_the_simulator_makes_of_its_record() {
    let car = silent(car());
    let trace = tip_in(&car, &run(2, 3000.0), SEED, None).unwrap();
    let record = Record::read(&Source::new("run.csv", trace.csv()), &car).unwrap();
    let again = Simulator::new(&car, &record).unwrap().run(&record).unwrap();
    for (name, values) in [("acceleration", &trace.acceleration), ("engine_speed", &trace.engine_speed)] {
        for (made, again) in values.iter().zip(again.of(name).unwrap()) {
            // The period of a record is the mean of its decimals: 5e-4 (1 +- 2^-52), which moves nothing by more than its rounding.
            assert!((made - again).abs() < 1e-6, "{name}: {made} {again}");
        }
    }
    assert_eq!((trace.demand[COAST_ROWS - 1], trace.demand[COAST_ROWS]), (0.0, 1.0));
    assert!((trace.time[COAST_ROWS] - COAST_ROWS as f64 * PERIOD).abs() < 1e-12);
}

#[test]
fn noise_is_that_of_the_plant_file_and_of_the_seed() {
    let car = car();
    let clean = tip_in(&silent(car.clone()), &run(4, 2000.0), SEED, None).unwrap();
    let noisy = tip_in(&car, &run(4, 2000.0), SEED, None).unwrap();
    assert_eq!(noisy, tip_in(&car, &run(4, 2000.0), SEED, None).unwrap());
    assert_ne!(noisy, tip_in(&car, &run(4, 2000.0), SEED + 1, None).unwrap());
    let sigma = |noisy: &[f64], clean: &[f64]| {
        let squares: f64 = noisy.iter().zip(clean).map(|(a, b)| (a - b).powi(2)).sum();
        (squares / clean.len() as f64).sqrt()
    };
    // 3601 samples: a sigma is known to 1/sqrt(7200) = 1.2 %; five of them.
    for (found, sigma) in [
        (sigma(&noisy.acceleration, &clean.acceleration), 0.05),
        (sigma(&noisy.road_speed, &clean.road_speed), 0.02),
        (sigma(&noisy.engine_speed, &clean.engine_speed), 0.5),
    ] {
        assert!((found / sigma - 1.0).abs() < 0.06, "{found} {sigma}");
    }
}

#[test]
fn the_mode_is_that_of_the_linear_driveline() {
    // Two inertias on a spring, by hand, third gear: J_1 = (0.17 1.5^2 + 0.014 + 0.031/3.7^2) 3.7^2 = 5.459 at the wheel, J_2 = 160.7; the clutch
    // (10000 1.5^2 3.7^2 = 308025 N m/rad at the wheel) in series with the shaft: k = 4920, and its damper d = 65 (4920/5000)^2 + 924 (4920/308025)^2
    // = 63.2. 1/J = 1/5.459 + 1/160.7 = 0.1894: w = sqrt(k/J) = 30.5; zeta = d sqrt(1/(J k))/2 = 0.196, and 0.03 1.5^2 3.7^2/(2 5.459 w) = 0.003 by
    // the engine's friction: 0.199. The slope of the torque map behind its lag adds less than 0.01 at 3000 rpm.
    let car = silent(car());
    let trace = tip_in(&car, &run(3, 3000.0), SEED, None).unwrap();
    let found = measure(&car, &run(3, 3000.0), &trace).unwrap();
    let shape = found.mode.shape;
    assert!((shape.natural_frequency / 30.5 - 1.0).abs() < 0.01, "{shape:?}");
    assert!((shape.damping_ratio - 0.199).abs() < 0.01, "{shape:?}");
    // The delay is none: half a millisecond of hold, and what is not of second order.
    assert!(shape.delay.abs() < 0.003, "{shape:?}");
}

#[test]
fn threads_change_no_bit() {
    let plan = TrackPlan { runs: TrackPlan::experiment(SEED).runs[..3].to_vec() };
    let text = |threads: usize| {
        let runs = experiment(&car(), &plan, SEED, None, threads).unwrap();
        csv(&runs.iter().map(|(measured, _)| measured.clone()).collect::<Vec<Measured>>(), &[])
    };
    assert_eq!(text(1), text(3));
}

/// Ten runs, two speeds in each gear, are enough for the terms of the surfaces.
#[test]
fn the_rounds_bring_the_damping_of_the_response_to_its_target() {
    let car = car();
    let plan = TrackPlan::full(&[1800.0, 4200.0], &[0.0], SEED);
    let settings = Settings { seed: SEED, poles: Poles::WITHOUT_LASH, threads: 2 };
    let tuned = tune(&car, &plan, &settings).unwrap_or_else(|faults| panic!("{faults}"));
    let (before, _) = zeta(&tuned.uncompensated);
    let best = &tuned.rounds[tuned.best];
    // The full experiment gives 0.70 and 0.03 (`rsm demo`). The mean of ten has a noise of 0.02/sqrt(10), the largest of ten is at 1.5 of
    // them, and ten rows leave two to smooth them: twice the targets of the full one would be failure.
    assert!((best.zeta_mean - 0.7).abs() < 0.02, "{} {}", best.zeta_mean, best.zeta_max_residual);
    assert!(best.zeta_max_residual < 0.07, "{}", best.zeta_max_residual);
    assert!(before > 1.0 && tuned.rounds[0].zeta_max_residual > best.zeta_max_residual, "{before}");
    // Where there was an overshoot, it is well below half (0.1 to 0.35 in the full experiment).
    assert!(best.overshoot_ratio_worst < 0.45, "{}", best.overshoot_ratio_worst);
}

#[test]
fn with_lash_the_shipped_compensator_halves_the_overshoot_and_says_what_it_costs() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../generated/coefficients/driveline.toml");
    let checked = Checked::read(&Source::new("driveline.toml", std::fs::read_to_string(path).unwrap())).unwrap();
    let compensation = Compensation::new(&checked, COMPENSATOR).unwrap();
    let car = with_lash(&car(), LASH).unwrap();
    for (gear, rpm) in [(1, 2500.0), (2, 4000.0)] {
        let measured = |compensation: Option<&Compensation>| {
            let run = run(gear, rpm);
            measure(&car, &run, &tip_in(&car, &run, SEED, compensation).unwrap()).unwrap()
        };
        let (before, after) = (measured(None), measured(Some(&compensation)));
        // 0.18 and 0.26 in the experiment; 0.5 is the target.
        assert!(after.overshoot < 0.4 * before.overshoot, "{} {}", before.overshoot, after.overshoot);
        let price = after.rise_time / before.rise_time;
        assert!((1.2..2.4).contains(&price), "{price}");
    }
}

#[test]
fn the_ratio_predicts_another_gearbox() {
    // Natural frequency goes with the gear ratio: measured on this car at four ratios, a line in 1/ratio through the logarithms of two of them
    // must predict a ratio that no run had. What is known of a car with other ratios is measured on that car.
    let other = |ratio: f64| {
        let mut car = silent(car());
        car.parameters.set("gear_ratios[3]", ratio);
        let trace = tip_in(&car, &run(3, 3000.0), SEED, None).unwrap();
        measure(&car, &run(3, 3000.0), &trace).unwrap().mode.shape
    };
    let (low, middle, high) = (other(1.2), other(1.4), other(1.7));
    let share = (1.0 / 1.4 - 1.0 / 1.7) / (1.0 / 1.2 - 1.0 / 1.7);
    let predicted = high.damping_ratio + share * (low.damping_ratio - high.damping_ratio);
    // zeta is nearly straight in 1/ratio (both go with the square root of 1/J_1 at these ratios): the bend is below 1 %.
    assert!((predicted / middle.damping_ratio - 1.0).abs() < 0.02, "{predicted} {}", middle.damping_ratio);
    assert!(low.natural_frequency > middle.natural_frequency && middle.natural_frequency > high.natural_frequency);
}

const STUDY: Study = Study { seed: SEED, threads: 2 };

#[test]
fn surfaces_against_the_ratio_predict_a_gearbox_that_no_fit_saw() {
    let found = prediction(&car(), OTHER_RATIOS, &STUDY).unwrap_or_else(|faults| panic!("{faults}"));
    // The full experiment leaves 1.6 % of the damping and 0.7 % of the frequency, which is the noise of single runs in the high gears (3 % and 1 %,
    // over the mean of all runs): with another seed a fifth more or less. Twice of it would be a surface of the wrong shape.
    for residual in [found.unseen, found.other] {
        assert!(residual.damping_percent < 2.5 && residual.frequency_percent < 1.3, "{residual:?}");
        assert_eq!(residual.outside, 0);
    }
    // On its own car the gear number does as well (1.5 %); on the other it is a guess: 9 % of both.
    let (own, guess) = (found.by_gear_unseen, found.by_gear_other);
    assert!(own.damping_percent < 2.5 && own.frequency_percent < 1.3, "{own:?}");
    assert!(guess.damping_percent > 3.0 * found.other.damping_percent, "{guess:?}");
    assert!(guess.frequency_percent > 5.0 * found.other.frequency_percent, "{guess:?}");
    // Damping is positive without being told so: the constraint is proven, and none of its points is active.
    let of_damping = found.outcome.responses[0].statistics.as_ref().unwrap();
    assert_eq!(of_damping.constraints.as_ref().map(|it| it.active), Some(false));
}

#[test]
fn surfaces_with_the_load_hold_at_loads_between() {
    let found = loaded(&car(), &STUDY).unwrap_or_else(|faults| panic!("{faults}"));
    // 1.1 % and 0.65 %, the noise of single runs; twice of it would be a surface of the wrong shape.
    let left = found.unseen;
    assert!(left.damping_percent < 2.2 && left.frequency_percent < 1.3 && left.outside == 0, "{left:?}");
    // By hand, first gear: J_1 = 29.0, J_2 = 160.7 at the wheel, which 320 kg make 193.5. w goes with the root of 1/J_1 + 1/J_2: -1.3 %. In the
    // higher gears J_1 is smaller and less moves. The slope of a surface of 75 runs is known to some tenths of a percent.
    let [low, high] = found.frequency_moved_percent;
    assert!((-1.9..-0.9).contains(&low) && high.abs() < 1.0, "{low} {high}");
    // The damping moves as little: with the root of 1/J, and by the noise of fifth gear.
    let [low, high] = found.damping_moved_percent;
    assert!(low > -5.0 && high < 3.0 && low < high, "{low} {high}");
}

/// The fit of a specification whose data are files.
fn from_files(specification: String, files: &[(&str, String)]) -> Outcome {
    let folder = std::env::temp_dir().join(format!("rsm-track-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for (name, text) in files {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let specification = Specification::from_source(Source::new("fit.toml", specification), folder.clone()).unwrap();
    let outcome = fit::fit(&specification, &mut |_| {});
    std::fs::remove_dir_all(&folder).unwrap();
    outcome.unwrap()
}

fn same(memory: &Outcome, files: &Outcome) {
    assert!(!memory.model.surfaces.is_empty());
    assert_eq!(memory.responses, files.responses);
    assert_eq!(memory.model.inputs, files.model.inputs);
    let bare = |outcome: &Outcome| {
        let mut surfaces = outcome.model.surfaces.clone();
        surfaces.iter_mut().for_each(|surface| surface.evidence.clear());
        surfaces
    };
    assert_eq!(bare(memory), bare(files));
}

#[test]
fn fits_in_memory_are_those_of_the_specifications_that_are_shipped() {
    let plan = TrackPlan::full(&[1500.0, 3000.0, 4500.0], &[0.0], SEED);
    let mut measured: Vec<Measured> = experiment(&car(), &plan, SEED, None, 2).unwrap().into_iter().map(|(it, _)| it).collect();
    let unseen = measured.split_off(13);
    let poles: Vec<f64> = (0..measured.len()).map(|k| 0.5 + 0.01 * k as f64).collect();
    let terms = Poles::WITHOUT_LASH.damping_terms;
    let files = [("data.csv", rounds::data(&measured, &poles)), ("unseen.csv", rounds::unseen_data(&unseen))];
    let text = rounds::specification("data.csv", Some("unseen.csv"), terms);
    same(&fit_surfaces(&measured, &poles, Some(&unseen), terms).unwrap(), &from_files(text, &files));
    measured.extend(unseen);
    for against in [Against::Gear, Against::Ratio, Against::RatioAndLoad] {
        if against == Against::RatioAndLoad {
            // The loads do not act here: only that both ways see them.
            measured.iter_mut().enumerate().for_each(|(k, it)| it.run.load = LOADS[k % 3]);
        }
        let files = [("data.csv", csv(&measured, &[]))];
        same(&fit_mode(against, &measured).unwrap(), &from_files(gearbox::specification(against, "data.csv", None), &files));
    }
}

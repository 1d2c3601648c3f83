//! A tolerance that is a thousand times smaller changes no output by more than a hundredth of its sensor noise, also with the effects that are most
//! difficult for the steps.

use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::{Method, Outputs, Simulator, Stopped};

use super::{axis_record, car_record, effect, motor_record, plant, record, run};

/// The largest change of each output, in units of its noise.
fn moves(plant: &PlantFile, record: &Record) -> Vec<(&'static str, f64)> {
    let coarse = run(plant, record);
    let fine: Outputs = Simulator::new(plant, record).unwrap().tolerance(1e-11).run(record).unwrap();
    let of = |k: usize| {
        let name = coarse.signals[k].name;
        let noise = plant.noise.iter().find(|(found, _)| *found == name).unwrap().1;
        let pairs = coarse.values[k].iter().zip(&fine.values[k]);
        (name, pairs.map(|(a, b)| (a - b).abs() / noise).fold(0.0, f64::max))
    };
    (0..coarse.signals.len()).map(of).collect()
}

fn holds(what: &str, plant: &PlantFile, text: &str) {
    let record = record(text, plant);
    for (name, moved) in moves(plant, &record) {
        println!("{what}: {name} moves by {moved:.2e} of its noise");
        // At a hundredth of the noise, the error of the steps is not visible in a record.
        assert!(moved < 0.01, "{what}: {name} moves by {moved} of its noise");
    }
}

#[test]
fn of_the_motor() {
    let friction = effect("stribeck-friction", "coulomb = 0.2, static = 0.4, stribeck_velocity = 5.0");
    let shaft = effect("shaft-compliance", "inertia_ratio = 0.5, stiffness = 500.0, damping = 0.05");
    let cogging = effect("cogging-torque", "amplitude = 0.1, cycles = 24, phase = 0.0");
    holds("motor", &plant("pmac", ""), &motor_record());
    holds("motor with friction, shaft and cogging", &plant("pmac", &(friction + &shaft + &cogging)), &motor_record());
}

#[test]
fn of_the_driveline() {
    let lash = effect("backlash", "gap = 0.0524");
    let tyre = effect("tyre-slip", "slip_stiffness = 40000.0");
    let slip = effect("clutch-slip", "capacity = 120.0");
    holds("car", &plant("driveline", ""), &car_record());
    holds("car with lash", &plant("driveline", &lash), &car_record());
    holds("car with lash, tyre and clutch", &plant("driveline", &(lash + &tyre + &slip)), &car_record());
}

#[test]
fn of_the_axis() {
    let friction = effect("coulomb-friction", "force = 20.4");
    let play = effect("backlash", "gap = 0.00002, mass_ratio = 0.3, stiffness = 5e6, damping = 2000.0");
    holds("axis", &plant("servo-axis", ""), &axis_record());
    holds("axis with friction", &plant("servo-axis", &friction), &axis_record());
    holds("axis with friction and play", &plant("servo-axis", &(friction + &play)), &axis_record());
}

#[test]
fn a_run_that_takes_more_work_than_it_may_is_given_up() {
    // A clutch that stiffens while it slips winds up: its springs oscillate faster and faster.
    let stiffening = effect("clutch-stiffening", "cubic_stiffness = 20000.0");
    let car = plant("driveline", &(stiffening + &effect("clutch-slip", "capacity = 60.0")));
    let record = record(&car_record(), &car);
    let given = |work: usize| Simulator::new(&car, &record).unwrap().at_most(work).run(&record).map(|_| ());
    let mut whole = Simulator::new(&car, &record).unwrap();
    whole.run(&record).unwrap();
    // A row before the tip-in needs little work. The limit is an integer per row, on average over the run.
    let mean = whole.work() as usize / record.rows();
    assert!(whole.work() as usize > mean * record.rows());
    let short = given(mean);
    // The clutch slips from the tip-in at row 250.
    assert!(matches!(short, Err(Stopped::TooLong { row }) if row > 250), "{short:?}");
    assert_eq!(given(mean + 1), Ok(()));
}

#[test]
fn the_same_files_give_the_same_bits() {
    let car = plant("driveline", &effect("backlash", "gap = 0.0524"));
    let record = record(&car_record(), &car);
    let mut simulator = Simulator::new(&car, &record).unwrap();
    let first = simulator.run(&record).unwrap();
    // Again with the same simulator, and with a new one.
    assert_eq!(first, simulator.run(&record).unwrap());
    assert_eq!(first, run(&car, &record));
}

#[test]
fn every_method_gives_the_same_outputs_within_the_noise() {
    let cases = [
        ("pmac", plant("pmac", &effect("cogging-torque", "amplitude = 0.1, cycles = 24, phase = 0.0")), motor_record()),
        ("driveline", plant("driveline", &effect("road-grade", "grade = 0.02")), car_record()),
        ("servo-axis", plant("servo-axis", &effect("coulomb-friction", "force = 20.4")), axis_record()),
    ];
    for (name, plant, text) in cases {
        let record = record(&text, &plant);
        let expected = run(&plant, &record);
        let step = record.period / 8.0;
        for method in [Method::Explicit, Method::Stiff, Method::Fixed { step }] {
            let found = Simulator::new(&plant, &record).unwrap().method(method).run(&record).unwrap();
            assert_eq!(found.signals, expected.signals);
            for (k, signal) in found.signals.iter().enumerate() {
                let noise = plant.noise.iter().find(|(known, _)| *known == signal.name).unwrap().1;
                let pairs = expected.values[k].iter().zip(&found.values[k]);
                let moved = pairs.map(|(a, b)| (a - b).abs() / noise).fold(0.0, f64::max);
                // A step of constant length has no control of its error: at an eighth of a row it stays below the noise.
                let allowed = if matches!(method, Method::Fixed { .. }) { 0.5 } else { 0.01 };
                assert!(moved < allowed, "{name}, {method:?}: {} moves by {moved} of its noise", signal.name);
            }
        }
    }
}

#[test]
fn a_fixed_step_that_does_not_divide_the_period_is_refused() {
    let plant = plant("servo-axis", "");
    let record = record(&axis_record(), &plant);
    let run = |step: f64| Simulator::new(&plant, &record).unwrap().method(Method::Fixed { step }).run(&record);
    let Err(Stopped::Step(what)) = run(0.3 * record.period) else { panic!("a step of 0.3 periods is accepted") };
    assert!(what.contains("divided by a whole number"), "{what}");
    assert!(run(0.25 * record.period).is_ok());
}

//! The next experiment: causes with the same effect on the records are distinguished by the proposed record; causes that no record can distinguish
//! are reported as such.

use crate::random::Random;
use rsm_core::source::Source;
use rsm_diagnose::plant::excitations::{self, Limits};
use rsm_diagnose::plant::experiment::{NextExperiment, next};
use rsm_diagnose::plant::levenberg::{self, Fit};
use rsm_diagnose::plant::model::Model;
use rsm_diagnose::plant::noise::NoiseFloor;
use rsm_diagnose::plant::whitened_residuals::{Prepared, WhitenedResiduals};
use rsm_diagnose::plant::{Alias, Diagnosis, Options, Verdict, diagnose};
use rsm_sim::kind::{OUTPUTS, PlantKind, by_output};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::{axis_record, car_record, effect, motor_record, plant, record, run};

/// Noise of the outputs, as in the shipped plant files.
fn noise(kind: PlantKind) -> [f64; OUTPUTS] {
    let own: &[f64] = match kind {
        _ if kind.is("pmac") => &[0.2, 0.2, 0.3],
        _ if kind.is("driveline") => &[0.5, 0.02, 0.05],
        _ => &[2e-7, 0.01],
    };
    by_output(own, 0.0)
}

/// The outputs of a plant along a record, with noise.
fn measured(true_plant: &PlantFile, mut along: Record, seed: u64) -> Record {
    let mut random = Random::new(seed);
    let outputs = run(true_plant, &along);
    for (output, signal) in true_plant.kind.outputs().iter().enumerate() {
        let noisy = |value: &f64| value + noise(true_plant.kind)[output] * random.normal();
        along.measured[output] = outputs.of(signal.name).map(|values| values.iter().map(noisy).collect());
    }
    along
}

/// A motor that turns only forward, for one second.
fn forward(true_plant: &PlantFile, seed: u64) -> Record {
    let mut random = Random::new(seed);
    let mut text = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
    let (mut target, mut speed, mut load) = (80.0, 60.0, 0.3);
    for k in 0..1200 {
        if k % 250 == 100 {
            target = 40.0 + 100.0 * random.uniform();
        }
        if k % 400 == 200 {
            load = 0.2 + random.uniform();
        }
        speed += 0.01 * (target - speed);
        text += &format!("{},0,{},{load},0,2,60\n", f64::from(k) / 1000.0, 0.24 * speed + 0.2);
    }
    measured(true_plant, record(&text, true_plant), seed)
}

fn diagnosed(records: &[Record], unseen: &[Record]) -> Diagnosis {
    diagnose(&plant("pmac", ""), records, unseen, &Options { threads: 2, progress: &|_| {} }).unwrap()
}

#[test]
fn friction_and_a_constant_load_are_told_apart_by_the_record_that_is_asked_for() {
    for (kind, rival) in [("coulomb-friction", "constant-load"), ("constant-load", "coulomb-friction")] {
        let true_plant = plant("pmac", &effect(kind, "torque = 0.1"));
        let mut records: Vec<Record> = (1..=2).map(|seed| forward(&true_plant, seed)).collect();
        let unseen = [forward(&true_plant, 3)];
        let found = diagnosed(&records, &unseen);
        // In forward rotation, both brake the rotor with the same torque.
        let cause = &found.causes[0];
        assert!([kind, rival].contains(&cause.kind), "{}", cause.kind);
        let other = if cause.kind == kind { rival } else { kind };
        assert!(cause.indistinguishable_from.iter().any(|it| it == other), "{:?}", cause.indistinguishable_from);
        let Some(NextExperiment::Distinguishes { excitation, differences }) = &found.next else { panic!("{:?}", found.next) };
        assert!(differences.iter().any(|it| it.rival == other && it.enough && it.times_noise > 0.1), "{differences:?}");

        // As on a test bench: the file is read, the true plant runs along it, and all records are diagnosed again.
        let file = excitations::csv(&found.plant, excitation);
        records.push(measured(&true_plant, record(&file, &true_plant), 4));
        let again = diagnosed(&records, &unseen);
        assert_eq!(again.verdict, Verdict::Explained);
        let causes: Vec<(&str, &[String])> =
            again.causes.iter().map(|cause| (cause.kind, cause.indistinguishable_from.as_slice())).collect();
        assert_eq!(causes, [(kind, [].as_slice())]);
        assert!(again.next.is_none(), "{:?}", again.next);
    }
}

/// A plant fitted without changes to its own simulation along a record.
fn fitted(file: &PlantFile, records: &[Record]) -> (WhitenedResiduals, Fit) {
    let floors = noise(file.kind).map(|sd| NoiseFloor::white(sd.max(1e-9)));
    let outputs = file.kind.outputs().len();
    let prepared = records.iter().map(|it| Prepared::new(it.clone(), outputs)).collect();
    let whitened = WhitenedResiduals::new(prepared, floors, 2);
    let fit = levenberg::linearised(&whitened, model(file, records)).unwrap();
    (whitened, fit)
}

/// The plant of a file with unknown tolerances and starts; the numbers of its effects are fixed.
fn model(file: &PlantFile, records: &[Record]) -> Model {
    let nominal = PlantFile { effects: Vec::new(), ..file.clone() };
    let records: Vec<&Record> = records.iter().collect();
    let nominal = Model::nominal(&nominal, &records, noise(file.kind));
    nominal.with_effects(&nominal, file.effects.clone())
}

/// A car in second gear with a dragging brake, and a rival explanation.
fn car_against(rival: &str) -> Option<NextExperiment> {
    // The torque is 100 N m at the wheel.
    let true_plant = plant("driveline", &effect("brake-drag", "torque = 100.0"));
    let records = [measured(&true_plant, record(&car_record(), &true_plant), 1)];
    let (whitened, fit) = fitted(&true_plant, &records);
    let rival = plant("driveline", rival);
    let alias = Alias { cause: "brake-drag".into(), rival: "the rival".into(), model: model(&rival, &records), limit: 30.0 };
    next(&whitened, &fit, &[alias], Verdict::Explained, &|_| {})
}

#[test]
fn no_record_tells_a_dragging_brake_from_a_slope_and_that_is_said() {
    // The grade follows from sin(grade) = T/(r m g) = 100/(0.32 * 1560 * 9.80665) = 0.020427.
    match car_against(&effect("road-grade", "grade = 0.020428")) {
        Some(NextExperiment::NotDistinguishable { differences, tried }) => {
            assert!(tried >= 12 && differences.len() == 1 && !differences[0].enough, "{tried} {differences:?}");
            // While the wheel turns forward, both are the same torque.
            assert!(differences[0].times_noise < 0.01, "{differences:?}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn another_gear_tells_a_dragging_brake_from_friction_of_the_engine() {
    // In second gear 100 N m at the wheel are 100/(2.2 * 3.7) = 12.285 N m at the engine, whose friction is 15 N m.
    let friction = effect("parameter-error", "parameter = \"engine_friction_0\", value = 27.285");
    match car_against(&friction) {
        Some(NextExperiment::Distinguishes { excitation, differences }) => {
            assert!(excitation.record.setting("gear") != Some(2.0), "{}", excitation.name);
            assert!(differences[0].enough && differences[0].times_noise > 1.0, "{differences:?}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_error_without_a_cause_is_looked_for_where_it_is() {
    let file = plant("pmac", "");
    let mut records = vec![forward(&file, 1)];
    // Three times the noise on i_d below 60 rad/s, where the record has few rows, and nowhere else.
    let speed = records[0].measured[2].clone().unwrap();
    for (value, speed) in records[0].measured[0].as_mut().unwrap().iter_mut().zip(&speed) {
        *value += if *speed < 60.0 { 0.6 } else { 0.0 };
    }
    let (whitened, fit) = fitted(&file, &records);
    let Some(NextExperiment::CoversError { excitation, expected, present }) =
        next(&whitened, &fit, &[], Verdict::Unexplained, &|_| {})
    else {
        panic!("there is an error to look for")
    };
    let slow = |record: &Record| {
        let speed = record.measured[2].as_ref().unwrap();
        speed.iter().filter(|value| **value < 60.0).count() as f64 / speed.len() as f64
    };
    assert!(slow(&records[0]) < 0.25 && slow(&excitation.record) > 0.9, "{}", excitation.name);
    // The error is nine times the noise's energy on one of three outputs, so its mean excess is 3; in the present record it occurs in a quarter of
    // the rows.
    assert!(expected > 2.0 && present < 1.0, "{expected} {present}");
    assert!(next(&whitened, &fit, &[], Verdict::Explained, &|_| {}).is_none());
}

#[test]
fn every_excitation_keeps_the_limits_and_reads_back() {
    let half = "position_gain = 160.18\nvelocity_gain = 243.45\nvelocity_from = \"difference\"\n";
    let open_axis = std::fs::read_to_string(super::path("plants/servo-axis.toml")).unwrap().replace(half, "");
    let open_axis = PlantFile::read(&Source::new("axis.toml", open_axis)).unwrap();
    let mut pulses = "time[s],command[V],position[m]\n".to_string();
    for k in 0..1000 {
        let command = [2.0, -2.0, -2.0, 2.0][k / 250];
        pulses += &format!("{},{command},0\n", k as f64 / 1000.0);
    }
    let cases = [
        (plant("pmac", ""), motor_record(), 12),
        // Five gears, of which one is already in the list, with six excitations; not every excitation is possible in every gear.
        (plant("driveline", ""), car_record(), 15),
        (plant("servo-axis", ""), axis_record(), 5),
        (open_axis, pulses, 6),
    ];
    for (file, text, least) in cases {
        let records = [measured(&file, record(&text, &file), 1)];
        let (whitened, fit) = fitted(&file, &records);
        let limits = Limits::of(&whitened, &fit).unwrap();
        let library = excitations::library(&[&file], &limits);
        let names: Vec<&str> = library.iter().map(|it| it.name.as_str()).collect();
        assert!(library.len() >= least, "{}: {names:?}", file.kind.name());
        for excitation in &library {
            let name = &excitation.name;
            assert_eq!(names.iter().filter(|it| *it == name).count(), 1, "{name}");
            let read = record(&excitations::csv(&file, excitation), &file);
            assert_eq!((read.rows(), read.drive), (excitation.record.rows(), records[0].drive), "{name}");
            let outputs = run(&file, &read);
            for (k, signal) in file.kind.outputs().iter().enumerate() {
                // The command of an axis in open loop is an input.
                let Some(values) = outputs.of(signal.name) else { continue };
                // The same simulation, with times from a file. Its decimals are read back to the same bits, and the period is the mean of the steps,
                // so the last digits of states after thousands of sub-steps may differ.
                let predicted = excitation.record.measured[k].as_ref().unwrap();
                let most = predicted.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
                let off = values.iter().zip(predicted).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
                assert!(off <= 1e-6 * most, "{name}: {off} of {most}");
            }
            // Values may exceed the observed range by a twentieth of it.
            let within = |k: usize, low: f64, high: f64| {
                let slack = 0.05 * (high - low);
                outputs
                    .of(file.kind.outputs()[k].name)
                    .unwrap()
                    .iter()
                    .all(|value| (low - slack..=high + slack).contains(value))
            };
            let [low, high] = limits.seen[0];
            match file.kind {
                kind if kind.is("pmac") => {
                    let longest = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max(a.hypot(*b)));
                    // Equation (20) with the 270 V and 60 A of the shipped motor.
                    assert!(longest(&read.inputs[0], &read.inputs[1]) <= 270.0 / 3.0_f64.sqrt(), "{name}");
                    assert!(longest(outputs.of("i_d").unwrap(), outputs.of("i_q").unwrap()) <= 60.0, "{name}");
                    let top = limits.seen[2][0].abs().max(limits.seen[2][1].abs());
                    assert!(within(2, -top, top), "{name}");
                }
                kind if kind.is("driveline") => {
                    assert!(read.inputs[0].iter().all(|throttle| (0.0..=1.0).contains(throttle)), "{name}");
                    assert!(within(0, low, high), "{name}");
                }
                _ => assert!(within(0, low, high), "{name}"),
            }
        }
    }
}

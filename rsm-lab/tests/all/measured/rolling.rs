//! The rolling records of an outrunner under a constant voltage: what repeats with its rotation, in both of them.

use std::path::Path;

use rsm_core::source::Source;
use rsm_fit::table::{Table, Wanted};
use rsm_lab::diagnosis::{Diagnosis, Options, Verdict, diagnose};
use rsm_lab::orders::wave;
use rsm_lab::plant_file::PlantFile;
use rsm_lab::record::Record;

/// Angle, speed and current as logged, row by row: their instants jitter, which an order of rotation does not mind.
struct Rolling {
    angle: Vec<f64>,
    speed: Vec<f64>,
    current: Vec<f64>,
    voltage: Vec<f64>,
}

impl Rolling {
    fn read(name: &str) -> Option<Rolling> {
        let source = Source::read(&super::folder("bldc-cogging")?.join(name)).unwrap();
        let names = ["pos_rad", "vel_rad_s", "i_q_A", "u_q_V"];
        let numbers = names.iter().map(|name| (*name).to_string()).collect();
        let table = Table::read(&source, &Wanted { numbers, ..Wanted::default() }).unwrap();
        let [angle, speed, current, voltage] = names.map(|name| table.column(name).unwrap().values.clone());
        Some(Rolling { angle, speed, current, voltage })
    }

    /// Its first rows as a record of a motor under voltage, at the logger's 1 ms.
    fn record(&self, plant: &PlantFile, rows: usize) -> Record {
        let mut text = "time[s],v_q[V],load_torque[N*m],angle[rad],i_q[A],speed[rad/s]\n".to_string();
        for row in 0..rows {
            let [voltage, angle, current, speed] = [&self.voltage, &self.angle, &self.current, &self.speed].map(|it| it[row]);
            text += &format!("{},{voltage},0,{angle},{current},{speed}\n", row as f64 * 1e-3);
        }
        Record::read(&Source::new("rolling.csv", text), plant).unwrap()
    }
}

#[test]
fn the_waves_of_the_rotation_are_those_of_the_motor_in_both_records() {
    let (Some(one), Some(other)) = (Rolling::read("rolling_1.csv"), Rolling::read("rolling_2.csv")) else { return };
    // Speed: 12 is once an electrical revolution, 24 twice, 18 neither: it is of the stator's teeth. 1 and 2 are of the shaft or the encoder. Current: 12, and its third and sixth
    // multiples. Everything else in either is below a fiftieth of the variance.
    for (name, orders) in [("speed", &[12, 18, 1, 24][..]), ("current", &[12, 36, 72][..])] {
        let mut shares = [0.0; 2];
        for &order in orders {
            let waves = [&one, &other].map(|it| wave(&it.angle, if name == "speed" { &it.speed } else { &it.current }, order));
            println!("{name} at {order} a revolution: {waves:?}");
            // 30 revolutions each: what is the motor's is the same in both, to a fifth of its amplitude and to 20 degrees (12 in the current drifts by 19: with the
            // temperature or the start, it is not told).
            assert!((waves[0].amplitude / waves[1].amplitude - 1.0).abs() < 0.2, "{name} {order} {waves:?}");
            let turn = (waves[0].phase - waves[1].phase).rem_euclid(std::f64::consts::TAU);
            assert!(turn.min(std::f64::consts::TAU - turn) < 20.0_f64.to_radians(), "{name} {order} {waves:?}");
            shares.iter_mut().zip(waves).for_each(|(sum, wave)| *sum += wave.share);
        }
        println!("{name}: {:.2} and {:.2} of the variance", shares[0], shares[1]);
        assert!(shares.iter().all(|share| *share > 0.85), "{name} {shares:?}");
    }
}

#[test]
fn the_diagnosis_finds_the_cogging_of_one_record_and_names_nothing_absurd_in_the_other() {
    let (Some(one), Some(other)) = (Rolling::read("rolling_1.csv"), Rolling::read("rolling_2.csv")) else { return };
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("plants/outrunner.toml");
    let plant = PlantFile::read(&Source::read(&file).unwrap()).unwrap();
    // A third of each, ten revolutions: on seven, the amplitude of the second is seven times that of the first, with other companions.
    let [one, other] = [one, other].map(|it| it.record(&plant, 1300));
    let options = Options { threads: 2, progress: &|_| {} };
    let amplitude = |found: &Diagnosis| {
        super::tell("rolling", found);
        assert_ne!(found.verdict, Verdict::NoDiscrepancy);
        let cogging = found.entries().find(|cause| cause.kind == "cogging-torque")?;
        let number = |name: &str| cogging.parameters.iter().find(|it| it.name == name).unwrap().value;
        assert_eq!(number("cycles"), 12.0);
        Some(number("amplitude"))
    };
    let swapped = amplitude(&diagnose(&plant, std::slice::from_ref(&other), std::slice::from_ref(&one), &options).unwrap());
    let straight = amplitude(&diagnose(&plant, &[one], &[other], &options).unwrap());
    // About 0.8 mN m, with an interval of a quarter either way on so few revolutions. Trained on the other record the search ends among helpers of which one carries a cogging of 11 mN m:
    // more than the drive has, and refused. Refusing that helper first would leave the cogging; this is not done yet.
    let plausible = |it: f64| (it / 0.8e-3).ln().abs() < 0.5;
    assert!(swapped.is_some_and(plausible) && straight.is_none_or(plausible), "{straight:?} {swapped:?}");
}

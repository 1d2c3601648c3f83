//! The black-box correction of a diagnosis, on an axis that is integrated here. It has a spring whose force is proportional to the square of the
//! position, which is not in the catalogue, and noise that nothing explains.

use crate::random::Random;
use rsm_core::check::Checked;
use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_diagnose::plant::correction::{self, CorrectionResult, Simulation};
use rsm_diagnose::plant::noise::NoiseFloor;
use rsm_diagnose::plant::whitened_residuals::{Prepared, WhitenedResiduals};
use rsm_sim::equation_plant::{SiteSignal, servo_axis, site_signals};
use rsm_sim::kind::by_output;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

const PLANT: &str = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 80.0\nforce_gain = 35.0\nviscous_friction = 100.0\ncommand_limit = 10.0\n\
                     position_gain = 40.0\nvelocity_gain = 170.0\n";

/// The number of rows of a record, 1 ms each.
const ROWS: usize = 3000;

/// Standard deviations of the noise of position and command.
const NOISE: [f64; 2] = [2e-6, 0.01];

/// Position and command of the axis of docs/book/src/reference/plants.md 2.3 with a force of -stiffness q abs(q): semi-implicit Euler with 20 steps
/// per row. Each record has two sines with other periods, slow enough for the command to stay within its limit.
fn axis(stiffness: f64, periods: [f64; 2]) -> [Vec<f64>; 3] {
    let (mut q, mut v) = (0.0_f64, 0.0_f64);
    let mut columns = [Vec::new(), Vec::new(), Vec::new()];
    for row in 0..ROWS {
        let time = row as f64 * 1e-3;
        let wave = |period: f64| (std::f64::consts::TAU * time / period).sin();
        let reference = 0.1 * wave(periods[0]) + 0.03 * wave(periods[1]);
        let command = (170.0 * (40.0 * (reference - q) - v)).clamp(-10.0, 10.0);
        for (column, value) in columns.iter_mut().zip([reference, q, command]) {
            column.push(value);
        }
        for _ in 0..20 {
            v += 5e-5 * (35.0 * command - 100.0 * v - stiffness * q * q.abs()) / 80.0;
            q += 5e-5 * v;
        }
    }
    columns
}

/// Records with the simulation of the axis without the spring along them.
struct Case {
    whitened: WhitenedResiduals,
    simulated: Vec<Vec<Vec<f64>>>,
    signals: Vec<Vec<SiteSignal>>,
}

impl Case {
    fn simulation(&self) -> Simulation<'_> {
        Simulation { whitened: &self.whitened, simulated: &self.simulated, signals: &self.signals }
    }
}

/// Whitened records of the axis with the spring and noise.
fn records(stiffness: f64, all: &[[f64; 2]], seed: u64) -> Case {
    let plant = PlantFile::read(&Source::new("axis.toml", PLANT)).unwrap();
    let mut random = Random::new(seed);
    let mut records = Vec::new();
    let (mut simulated, mut signals) = (Vec::new(), Vec::new());
    for periods in all {
        let [reference, position, command] = axis(stiffness, *periods);
        let mut text = "time[s],reference[m],position[m],command[V]\n".to_string();
        for row in 0..ROWS {
            let (q, u) = (position[row] + NOISE[0] * random.normal(), command[row] + NOISE[1] * random.normal());
            text += &format!("{},{},{q},{u}\n", row as f64 / 1000.0, reference[row]);
        }
        let record = Record::read(&Source::new("axis.csv", text), &plant).unwrap();
        signals.push(site_signals(&plant, &record).unwrap());
        records.push(Prepared::new(record, 2));
        let [_, position, command] = axis(0.0, *periods);
        simulated.push(vec![position, command]);
    }
    let floors = by_output(&NOISE, 1.0).map(NoiseFloor::white);
    Case { whitened: WhitenedResiduals::new(records, floors, 1), simulated, signals }
}

const TRAINING: [[f64; 2]; 2] = [[3.0, 1.6], [2.4, 1.9]];
const UNSEEN: [[f64; 2]; 1] = [[2.7, 1.7]];

#[test]
fn a_square_spring_is_corrected_on_unseen_records_and_the_file_checks() {
    let (training, unseen) = (records(2000.0, &TRAINING, 1), records(2000.0, &UNSEEN, 2));
    let found = correction::correction(servo_axis(), training.simulation(), unseen.simulation());
    let CorrectionResult::Useful(found) = found else { panic!("{found:?}") };
    // The spring's force is a function of the position, and in a stiff loop the command compensates it, so nearly all of the error is removed. The
    // transients of the loop remain, and a third-order approximation of q abs(q).
    assert!(found.unseen && found.gain > 0.9 && found.low > 0.8 && found.low < found.gain, "{} {}", found.gain, found.low);
    let command = found.outputs.iter().find(|it| it.output == 1).unwrap();
    // The correction keeps terms until they explain 99 % of what the best selection explains: a tenth of the error remains, and noise.
    assert!(command.before > 8.0 * command.after, "{command:?}");
    assert!(command.terms.iter().any(|term| term.contains("position")), "{:?}", command.terms);
    // The compiler accepts the offered file, and the file states what it is.
    let text = model_file::write(&found.model);
    assert!(text.contains("command_correction") && text.contains("black box"), "{text}");
    Checked::read(&Source::new("correction.toml", text)).unwrap();
    // The report draws the same signals as were validated.
    let (prepared, simulated) = (&unseen.whitened.records[0], &unseen.simulated[0]);
    let added = correction::added(servo_axis(), &found, prepared, simulated, &unseen.signals[0], 1).unwrap();
    let left: f64 = (0..ROWS).map(|row| (prepared.measured(1)[row] - simulated[1][row] - added[row]).powi(2)).sum();
    assert!(((left / ROWS as f64).sqrt() / NOISE[1] - command.after).abs() < 1e-6);
}

#[test]
fn without_unseen_records_the_last_third_judges() {
    let training = records(2000.0, &TRAINING, 1);
    let nobody = training.whitened.with_records(Vec::new());
    let unseen = Simulation { whitened: &nobody, simulated: &[], signals: &[] };
    let found = correction::correction(servo_axis(), training.simulation(), unseen);
    let CorrectionResult::Useful(found) = found else { panic!("{found:?}") };
    assert!(!found.unseen && found.gain > 0.8, "{}", found.gain);
}

#[test]
fn noise_is_not_corrected() {
    for seed in 1..=5 {
        let (training, unseen) = (records(0.0, &TRAINING, seed), records(0.0, &UNSEEN, 100 + seed));
        let found = correction::correction(servo_axis(), training.simulation(), unseen.simulation());
        assert!(matches!(found, CorrectionResult::NoGain { .. }), "seed {seed}: {found:?}");
    }
}

#[test]
fn what_hangs_on_nothing_that_is_simulated_is_refused() {
    // A disturbance at 3.1 Hz, independent of the axis. Its phase is different in each record, and so is the motion.
    let disturbed = |all: &[[f64; 2]], seed: u64| {
        let mut case = records(0.0, all, seed);
        for (k, prepared) in case.whitened.records.iter_mut().enumerate() {
            let phase = (seed + k as u64) as f64;
            for (row, value) in prepared.record.measured[1].as_mut().unwrap().iter_mut().enumerate() {
                *value += 0.1 * (std::f64::consts::TAU * 3.1 * row as f64 / 1000.0 + phase).sin();
            }
        }
        case
    };
    let (training, unseen) = (disturbed(&TRAINING, 1), disturbed(&UNSEEN, 6));
    let found = correction::correction(servo_axis(), training.simulation(), unseen.simulation());
    assert!(matches!(found, CorrectionResult::NoGain { .. }), "{found:?}");
}

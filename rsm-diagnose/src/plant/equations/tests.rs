//! Records with a known cause, and what the equations say of it.

use rsm_core::source::Source;
use rsm_sim::kind::OUTPUTS;

use super::super::calibration::calibrate;
use super::super::hypotheses;
use super::super::model::InitialMotion;
use super::super::noise::NoiseFloor;
use super::super::survey;
use super::super::whitened_residuals::{Prepared, WhitenedResiduals};
use super::*;
use rsm_fit::random::Random;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

const MOTOR: &str = "format = 1\nplant = \"pmac\"\n[parameters]\nphase_resistance = 0.1\nphase_inductance = 1e-3\nflux_linkage = 0.06\npole_pairs = 4\ninertia = 0.01\n\
    viscous_friction = 2e-3\nbus_voltage = 270\ncurrent_limit = 60\n[tolerance]\nphase_resistance = 0.05\ninertia = 0.03\n";

const AXIS: &str = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 80\nforce_gain = 30\nviscous_friction = 200\ncommand_limit = 10\n[tolerance]\nmass = 0.02\n";

fn file(text: &str) -> PlantFile {
    PlantFile::read(&Source::new("plant.toml", text.to_string())).unwrap()
}

fn effect(kind: &str, parameters: &str) -> String {
    format!("[[effects]]\nkind = \"{kind}\"\nparameters = {{ {parameters} }}\n")
}

/// So many rows of a true plant along a record of these columns, with noise of these standard deviations.
fn record(text: &str, header: &str, rows: usize, row: impl Fn(usize) -> String, sds: &[f64]) -> Record {
    let truth = file(text);
    let mut csv = format!("{header}\n");
    (0..rows).for_each(|k| csv += &format!("{}\n", row(k)));
    let mut record = Record::read(&Source::new("r.csv", csv), &truth).unwrap();
    let simulated = Simulator::new(&truth, &record).unwrap().run(&record).unwrap();
    let mut random = Random::new(7);
    for (k, (signal, sd)) in truth.kind.outputs().iter().zip(sds).enumerate() {
        let Some(values) = simulated.of(signal.name) else { continue };
        record.measured[k] = Some(values.iter().map(|value| value + sd * random.normal()).collect());
    }
    record
}

/// A motor that runs up, reverses and rests under steps of its voltage.
fn motor(effects: &str, rows: usize) -> Record {
    let row = |k: usize| {
        let v_q = [12.0, 25.0, 18.0, -6.0, -20.0, -12.0, 4.0, 30.0][k / 400 % 8];
        format!("{},{},{v_q},{},0,0,0", k as f64 * 0.00025, -0.1 * v_q, if k / 1000 % 2 == 1 { 0.4 } else { 0.0 })
    };
    let header = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]";
    record(&format!("{MOTOR}{effects}"), header, rows, row, &[0.05, 0.05, 0.05])
}

/// An axis that moves to and fro.
fn axis(effects: &str, rows: usize) -> Record {
    let row = |k: usize| {
        let u = [6.0, -5.0, 8.0, 0.0, -7.0, 4.0, -3.5][k / 350 % 7];
        format!("{},{u},0", k as f64 * 0.001)
    };
    record(&format!("{AXIS}{effects}"), "time[s],command[V],position[m]", rows, row, &[1e-5])
}

fn screened(plant: &str, record: Record) -> EquationScreen {
    let file = file(plant);
    let outputs = file.kind.outputs().len();
    let mut whitened = WhitenedResiduals::new(vec![Prepared::new(record, outputs)], [NoiseFloor::white(1.0); OUTPUTS], 1);
    let (nominal, fit) = calibrate(&mut whitened, &file, InitialMotion::Steady).unwrap();
    let survey = survey::survey(&whitened, &fit);
    let all = hypotheses::all(file.kind, &survey, &whitened.records[0].outputs);
    screen(&whitened, &nominal, &all).unwrap()
}

fn number(term: &Term, name: &str) -> f64 {
    term.entry.arguments.number(name)
}

#[test]
fn a_plant_within_its_tolerance_has_no_term() {
    let found = screened(MOTOR, motor("", 3200));
    assert!(found.terms.is_empty(), "{:?}", found.terms);
    assert_eq!(found.equations, ["i_d", "i_q", "speed"]);
    let found = screened(AXIS, axis("", 3000));
    assert!(found.terms.is_empty(), "{:?}", found.terms);
}

#[test]
fn a_wave_of_any_order_is_found_beside_a_friction() {
    // 37 is prime, and beyond what lists of teeth and poles have.
    let effects =
        effect("coulomb-friction", "torque = 0.8") + &effect("cogging-torque", "amplitude = 0.5, cycles = 37, phase = 1.0");
    let found = screened(MOTOR, motor(&effects, 6400));
    let labels: Vec<&str> = found.terms.iter().map(|it| it.label.as_str()).collect();
    assert_eq!(labels, ["coulomb-friction", "cogging-torque"], "{:?}", found.terms);
    // 6400 rows of noise of 0.05 rad/s beside steps of 0.08 rad/s a memory: a per cent.
    assert!((number(&found.terms[0], "torque") / 0.8 - 1.0).abs() < 0.02, "{:?}", found.terms);
    assert_eq!(number(&found.terms[1], "cycles"), 37.0);
    assert!((number(&found.terms[1], "amplitude") / 0.5 - 1.0).abs() < 0.05, "{:?}", found.terms);
    assert!((number(&found.terms[1], "phase") - 1.0).abs() < 0.1, "{:?}", found.terms);
    // A start of the search for each count of terms, and the order for the catalogue: no guess of anything else.
    assert_eq!(found.models.iter().map(|it| it.file.effects.len()).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(found.orders.iter().map(|(_, guess)| guess.values[1]).collect::<Vec<_>>(), [37.0]);
    assert!(found.terms[1].left < found.terms[0].left && found.terms[0].left < found.calibrated);
}

#[test]
fn a_delay_and_a_sensor_that_is_off_are_found_far_from_the_plant_file() {
    let found = screened(MOTOR, motor(&effect("input-delay", "delay = 0.004"), 3200));
    assert_eq!(found.terms.first().map(|it| it.label.as_str()), Some("input-delay"), "{:?}", found.terms);
    assert!((number(&found.terms[0], "delay") / 0.004 - 1.0).abs() < 0.02, "{:?}", found.terms);
    let found = screened(MOTOR, motor(&effect("sensor-gain", "output = \"i_q\", gain = 0.7"), 3200));
    assert_eq!(found.terms.first().map(|it| it.label.as_str()), Some("sensor-gain:i_q"), "{:?}", found.terms);
    assert!((number(&found.terms[0], "gain") / 0.7 - 1.0).abs() < 0.01, "{:?}", found.terms);
}

#[test]
fn a_friction_that_holds_an_axis_is_found_where_it_moves() {
    let found = screened(AXIS, axis(&effect("coulomb-friction", "force = 90"), 4900));
    assert_eq!(found.terms.first().map(|it| it.label.as_str()), Some("coulomb-friction"), "{:?}", found.terms);
    assert!((number(&found.terms[0], "force") / 90.0 - 1.0).abs() < 0.03, "{:?}", found.terms);
}

#[test]
fn the_work_is_that_of_the_rows_that_are_looked_at() {
    // Half a second: 12,000 rows, three rates each, for some 150 guesses twice and the steps of a few terms. Longer records take no more.
    let (short, long) = (screened(MOTOR, motor("", MOST_ROWS)), screened(MOTOR, motor("", MOST_ROWS + 4000)));
    assert_eq!(short.work, long.work);
    assert!(short.work < 600 * 3 * MOST_ROWS as u64, "{}", short.work);
}

#[test]
fn a_wave_of_any_period_is_found_beside_a_friction() {
    let effects =
        effect("coulomb-friction", "force = 30") + &effect("cogging-torque", "amplitude = 20, pitch = 0.0123, phase = 0.4");
    let found = screened(AXIS, axis(&effects, 4900));
    let mut labels: Vec<&str> = found.terms.iter().map(|it| it.label.as_str()).collect();
    labels.sort_unstable();
    assert_eq!(labels, ["cogging-torque", "coulomb-friction"], "{:?}", found.terms);
    let wave = found.terms.iter().find(|it| it.label == "cogging-torque").unwrap();
    assert!((number(wave, "pitch") / 0.0123 - 1.0).abs() < 1e-3, "{wave:?}");
    assert!((number(wave, "amplitude") / 20.0 - 1.0).abs() < 0.05, "{wave:?}");
    assert!((number(wave, "phase") - 0.4).abs() < 0.1, "{wave:?}");
}

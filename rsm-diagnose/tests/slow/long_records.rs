//! Records so long that a part of their rows is searched first: the answer must hold on all rows, its numbers come from all of them, and a fault of
//! the data is reported wherever it is. An axis with friction, three records of 9000 rows.

use crate::random::Random;
use rsm_diagnose::plant::row_share::{RowShare, Searched};
use rsm_diagnose::plant::{Diagnosis, Options, Verdict, diagnose};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::{record, run};

const ROWS: usize = 9000;

/// The noise of the position.
const SD: f64 = 1e-4; // m

/// An axis of 100 kg in open loop that stops within a tenth of a second.
fn axis(effects: &str) -> PlantFile {
    let text = format!(
        "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 100\nforce_gain = 350\nviscous_friction = 4000\ncommand_limit = 10\n\
         [tolerance]\nviscous_friction = 0.05\n{effects}\n"
    );
    PlantFile::read(&rsm_core::source::Source::new("axis.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

fn friction() -> PlantFile {
    axis("[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 20 }\n")
}

/// Pulses of the command in both directions.
fn moved(true_plant: &PlantFile, random: &mut Random) -> Record {
    let mut text = "time[s],command[V],position[m]\n".to_string();
    let (mut until, mut command, mut sign) = (0, 0.0, 1.0);
    for k in 0..ROWS {
        if k >= until {
            until = k + 40 + (150.0 * random.uniform()) as usize;
            sign = -sign;
            command = sign * (1.0 + 3.0 * random.uniform());
        }
        text += &format!("{},{command},0\n", k as f64 / 500.0);
    }
    let mut record = record(&text, true_plant);
    let outputs = run(true_plant, &record);
    record.measured[0] = Some(outputs.of("position").unwrap().iter().map(|value| value + SD * random.normal()).collect());
    record
}

fn records(true_plant: &PlantFile, seed: u64) -> Vec<Record> {
    let mut random = Random::new(seed);
    (0..3).map(|k| Record { file: format!("record-{k}.csv"), ..moved(true_plant, &mut random) }).collect()
}

fn diagnosed(records: &[Record]) -> Diagnosis {
    let options = Options { threads: 2, progress: &|_| {} };
    diagnose(&axis(""), &records[..2], &records[2..], &options).unwrap()
}

/// The only cause, and the width of the interval of its force.
fn force(found: &Diagnosis) -> f64 {
    let [cause] = found.causes.as_slice() else { panic!("{:?} {:?}", found.verdict, found.causes) };
    assert_eq!((found.verdict, cause.kind), (Verdict::Explained, "coulomb-friction"));
    let force = cause.parameters.iter().find(|it| it.name == "force").unwrap();
    assert!(force.low < 20.0 && 20.0 < force.high, "{force:?}");
    force.high - force.low
}

#[test]
fn a_cause_that_a_part_of_the_rows_shows_gets_its_numbers_from_all_rows() {
    let long = records(&friction(), 1);
    let found = diagnosed(&long);
    let (used, all) = (found.unused_rows.unwrap(), found.all_rows.as_ref().unwrap());
    assert!(used.used < 15_000 && used.total == 3 * ROWS, "{used:?}");
    assert!(all.rows == 3 * ROWS && all.is_only_noise(), "{all}");
    // The same rows without the others: 2 x 4000 in place of 2 x 9000 for the numbers, so intervals are wider by the root of 2.25. The inputs differ
    // from part to part, hence the wide margin.
    let short: Vec<Record> = long.iter().map(|it| it.piece(0..4000)).collect();
    let of_short = diagnosed(&short);
    assert!(of_short.unused_rows.is_none());
    let wider = force(&of_short) / force(&found);
    assert!((1.25..2.5).contains(&wider), "{wider}");
}

#[test]
fn rivals_that_no_row_distinguishes_stay_equal_however_strong_the_effect_is() {
    // In open loop the gain of the command, the force per volt and the gain of the position are one factor. A fit to an error of many times the
    // noise follows a curved valley: the friction was calibrated for the wrong factor.
    for (gain, seed) in [(0.98, 4), (0.8, 5), (0.8, 6), (0.5, 8)] {
        let effect = format!("[[effects]]\nkind = \"input-gain\"\nparameters = {{ gain = {gain} }}\n");
        let found = diagnosed(&records(&axis(&effect), seed));
        assert!(found.unused_rows.is_some() && found.verdict == Verdict::Explained, "{gain} {seed}: {:?}", found.verdict);
        let [cause] = found.causes.as_slice() else { panic!("{gain} {seed}: {:?}", found.causes) };
        let mut equal = cause.indistinguishable_from.clone();
        equal.push(cause.kind.to_string());
        for kind in ["input-gain", "parameter-error", "sensor-gain"] {
            assert!(equal.iter().any(|it| it.starts_with(kind)), "{gain} {seed}: {equal:?}");
        }
        assert!(cause.confidence < 0.6 && cause.confidence_of_any > 0.9, "{gain} {seed}: {cause:?}");
        assert!(found.aliases.iter().any(|it| it.rival.contains("gain")), "{gain} {seed}");
        assert!(found.next.is_some());
    }
}

#[test]
fn an_error_that_only_the_other_rows_show_is_not_missed() {
    let mut long = records(&friction(), 2);
    // The sensor is displaced for a while.
    let place = 2500..2900;
    outside_of_the_part(&long, place.clone());
    long[1].measured[0].as_mut().unwrap()[place].iter_mut().for_each(|value| *value += 30.0 * SD);
    let found = diagnosed(&long);
    assert!(found.unused_rows.is_none() && found.all_rows.is_none(), "{:?}", found.all_rows);
    assert!(found.verdict == Verdict::Unexplained || !found.findings.is_empty(), "{:?} {:?}", found.verdict, found.causes);
}

#[test]
fn a_fault_of_the_data_in_the_other_rows_is_reported() {
    let mut long = records(&friction(), 3);
    let place = 2500..2520;
    outside_of_the_part(&long, place.clone());
    let values = long[1].measured[0].as_mut().unwrap();
    let held = values[place.start];
    values[place.clone()].fill(held);
    let found = diagnosed(&long);
    assert!(found.unused_rows.is_some());
    force(&found);
    let [fault] = found.findings.as_slice() else { panic!("{:?}", found.findings) };
    assert_eq!(fault.record, "record-1.csv");
    assert_eq!((fault.what, fault.channel.as_str(), fault.rows), ("stuck", "position", (place.start, place.end - 1)));
}

/// Checks that the first search uses none of these rows.
fn outside_of_the_part(records: &[Record], rows: std::ops::Range<usize>) {
    let share = RowShare::of_rows(&records[..2], &records[2..], Searched::Part);
    for piece in share.pieces(&records[1], &axis("")) {
        assert!(piece.from + piece.record.rows() <= rows.start || rows.end <= piece.from, "{}", piece.record.file);
    }
}

//! Invalid plant files and records are refused with exactly the message in the file beside them.
//!
//! `cases/rejected/NAME.toml` is a plant file; `PLANT.NAME.csv` is a record of a shipped plant. `.txt` is the message. `RSM_BLESS=1` rewrites the
//! messages; the difference is reviewed like code.

use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

use super::refused::{ACCEPTED, assert_beside, files};
use super::{path, plant};

fn message(name: &str, text: &str) -> String {
    let Some(record) = name.strip_suffix(".csv") else {
        return match PlantFile::read(&Source::new(name, text)) {
            Err(faults) => faults.to_string(),
            Ok(_) => ACCEPTED.to_string(),
        };
    };
    let plant = plant(record.split('.').next().unwrap(), "");
    match Record::read(&Source::new(name, text), &plant) {
        Err(faults) => faults.to_string(),
        Ok(record) => match Simulator::new(&plant, &record) {
            Err(fault) => fault.to_string(),
            Ok(_) => ACCEPTED.to_string(),
        },
    }
}

fn cases() -> Vec<String> {
    files(&path("tests/cases/rejected"), &["toml", "csv"])
}

#[test]
fn every_bad_file_gets_the_message_beside_it() {
    let folder = path("tests/cases/rejected");
    let names = cases();
    assert!(names.len() >= 14, "{} cases", names.len());
    let read = |name: &String| std::fs::read_to_string(folder.join(name)).unwrap();
    assert_beside(&folder, names.iter().map(|name| (format!("{name}.txt"), message(name, &read(name)))));
}

#[test]
fn mutilated_files_are_refused_without_a_panic() {
    let folder = path("tests/cases/rejected");
    for name in cases() {
        let text = std::fs::read(folder.join(&name)).unwrap();
        // A step of 7 keeps the test below a few seconds.
        for at in (0..text.len()).step_by(7) {
            for bytes in [text[..at].to_vec(), [&text[..at], &text[at + 1..]].concat()] {
                assert!(!message(&name, &String::from_utf8_lossy(&bytes)).is_empty());
            }
        }
    }
}

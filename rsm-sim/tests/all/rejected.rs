//! Bad plant files and bad records are refused with the whole message that stands beside them.
//!
//! `cases/rejected/NAME.toml` is a plant file; `PLANT.NAME.csv` is a record of a shipped plant. `.txt` is the message. `RSM_BLESS=1` rewrites
//! the messages; the difference is reviewed like code.

use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

use super::{path, plant};

fn message(name: &str, text: &str) -> String {
    let Some(record) = name.strip_suffix(".csv") else {
        return match PlantFile::read(&Source::new(name, text)) {
            Err(faults) => faults.to_string(),
            Ok(_) => "ACCEPTED".to_string(),
        };
    };
    let plant = plant(record.split('.').next().unwrap(), "");
    match Record::read(&Source::new(name, text), &plant) {
        Err(faults) => faults.to_string(),
        Ok(record) => match Simulator::new(&plant, &record) {
            Err(fault) => fault.to_string(),
            Ok(_) => "ACCEPTED".to_string(),
        },
    }
}

fn cases() -> Vec<String> {
    let entries = std::fs::read_dir(path("tests/cases/rejected")).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> =
        entries.map(|name| name.into_string().unwrap()).filter(|name| !name.ends_with(".txt")).collect();
    names.sort();
    names
}

#[test]
fn every_bad_file_gets_the_message_beside_it() {
    let folder = path("tests/cases/rejected");
    let names = cases();
    assert!(names.len() >= 14, "{} cases", names.len());
    let mut wrong = Vec::new();
    for name in names {
        let found = message(&name, &std::fs::read_to_string(folder.join(&name)).unwrap()) + "\n";
        let expected_in = folder.join(format!("{name}.txt"));
        if std::env::var_os("RSM_BLESS").is_some() {
            std::fs::write(&expected_in, &found).unwrap();
        }
        let expected = std::fs::read_to_string(&expected_in).unwrap_or_default();
        if found != expected || found.starts_with("ACCEPTED") {
            wrong.push(format!("--- {name}\nexpected:\n{expected}found:\n{found}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
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

//! Bad scenarios are refused with the whole message that stands beside them. `RSM_BLESS=1` rewrites the messages; the difference is reviewed like code.

use rsm_core::source::Source;
use rsm_sweep::scenario::Scenario;
use rsm_sweep::tasks;

use super::{open, path};

fn message(name: &str, text: &str) -> String {
    match Scenario::read(&Source::new(name, text), &open).and_then(|scenario| tasks::list(&scenario)) {
        Err(faults) => faults.to_string(),
        Ok(_) => "ACCEPTED".to_string(),
    }
}

fn cases() -> Vec<String> {
    let entries = std::fs::read_dir(path("cases/rejected")).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = entries.map(|name| name.into_string().unwrap()).filter(|it| it.ends_with(".toml")).collect();
    names.sort();
    names
}

#[test]
fn every_bad_scenario_gets_the_message_beside_it() {
    let folder = path("cases/rejected");
    let names = cases();
    assert!(names.len() >= 35, "{} cases", names.len());
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
fn mutilated_scenarios_are_refused_without_a_panic() {
    for name in cases().into_iter().filter(|it| !it.contains("too-many")) {
        let text = std::fs::read(path("cases/rejected").join(&name)).unwrap();
        // A step of 11 keeps the test below a few seconds.
        for at in (0..text.len()).step_by(11) {
            for bytes in [text[..at].to_vec(), [&text[..at], &text[at + 1..]].concat()] {
                assert!(!message(&name, &String::from_utf8_lossy(&bytes)).is_empty());
            }
        }
    }
}

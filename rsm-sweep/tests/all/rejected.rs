//! Bad scenarios are refused with the whole message that stands beside them. `RSM_BLESS=1` rewrites the messages; the difference is reviewed like
//! code.

use rsm_core::source::Source;
use rsm_sweep::scenario::Scenario;
use rsm_sweep::tasks;

use super::refused::{ACCEPTED, assert_beside, files};
use super::{open, path};

fn message(name: &str, text: &str) -> String {
    match Scenario::read(&Source::new(name, text), &open).and_then(|scenario| tasks::list(&scenario)) {
        Err(faults) => faults.to_string(),
        Ok(_) => ACCEPTED.to_string(),
    }
}

fn cases() -> Vec<String> {
    files(&path("cases/rejected"), &["toml"])
}

#[test]
fn every_bad_scenario_gets_the_message_beside_it() {
    let folder = path("cases/rejected");
    let names = cases();
    assert!(names.len() >= 35, "{} cases", names.len());
    let read = |name: &String| std::fs::read_to_string(folder.join(name)).unwrap();
    assert_beside(&folder, names.iter().map(|name| (format!("{name}.txt"), message(name, &read(name)))));
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

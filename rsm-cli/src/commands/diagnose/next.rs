//! The proposed next experiment: as a sentence, as JSON and as a file.
//!
//! In: a diagnosis. Out: a sentence, an object, next_experiment.csv. Chooses nothing: the record comes from rsm-diagnose.

use rsm_diagnose::plant::Diagnosis;
use rsm_diagnose::plant::excitations::{self, Excitation};
use rsm_diagnose::plant::experiment::{Difference, NextExperiment};
use serde_json::{Value, json};

use crate::output;

/// The name of the file.
pub const FILE: &str = "next_experiment.csv";

/// The proposed record, if there is one.
fn excitation(found: &Diagnosis) -> Option<&Excitation> {
    match found.next.as_ref()? {
        NextExperiment::Distinguishes { excitation, .. } | NextExperiment::CoversError { excitation, .. } => Some(excitation),
        NextExperiment::NotDistinguishable { .. } => None,
    }
}

/// The text of the file, if there is a record.
pub fn csv(found: &Diagnosis) -> Option<String> {
    excitation(found).map(|it| excitations::csv(&found.plant, it))
}

/// The next experiment in words: which record to make, its purpose, and the expected difference as a multiple of the noise.
pub fn sentence(found: &Diagnosis) -> Option<String> {
    Some(match found.next.as_ref()? {
        NextExperiment::Distinguishes { excitation, differences } => {
            let record = record(excitation);
            let (distinguished, others): (Vec<&Difference>, Vec<&Difference>) = differences.iter().partition(|it| it.enough);
            let distinguished: Vec<String> = distinguished
                .iter()
                .map(|it| format!("{} from {} ({:.2} times the noise)", it.cause, it.rival, it.times_noise))
                .collect();
            let mut text = format!(
                "Make the record \"{}\" ({}; {record}, in {FILE}): it would distinguish {}.",
                excitation.name,
                excitation.words,
                distinguished.join(", and ")
            );
            if !others.is_empty() {
                let pairs: Vec<String> = others.iter().map(|it| format!("{} from {}", it.cause, it.rival)).collect();
                text += &format!(" It would not distinguish {}.", pairs.join(", nor "));
            }
            text
        }
        NextExperiment::NotDistinguishable { differences, tried } => {
            let pairs: Vec<String> = differences
                .iter()
                .map(|it| format!("{} from {} (at most {:.2} times the noise)", it.cause, it.rival, it.times_noise))
                .collect();
            format!(
                "No record of the library ({tried} were tried) distinguishes {}. Measure another plant, with a known change of a quantity on which the two act differently \
                 (another mass, load or inertia, the same road in the other direction), or the quantity itself.",
                pairs.join(", nor ")
            )
        }
        NextExperiment::CoversError { excitation, expected, present } => format!(
            "Make the record \"{}\" ({}; {}, in {FILE}): most of its rows are in the region of the unexplained error. Its expected squared error above the noise is {:.2} \
             of the noise's own, {:.2} in the present records.",
            excitation.name,
            excitation.words,
            record(excitation),
            expected,
            present
        ),
    })
}

fn record(excitation: &Excitation) -> String {
    let record = &excitation.record;
    format!("{} rows of {} s", record.rows(), record.period)
}

/// The same as JSON; null if no experiment is proposed.
pub fn value(found: &Diagnosis) -> Value {
    let pairs = |differences: &[Difference]| -> Vec<Value> {
        let each = differences.iter().map(|it| {
            json!({
                "cause": it.cause,
                "rival": it.rival,
                "times_noise": output::finite(it.times_noise),
                "squared_difference": output::finite(it.squared),
                "told_apart": it.enough,
            })
        });
        each.collect()
    };
    match &found.next {
        None => Value::Null,
        Some(NextExperiment::Distinguishes { excitation, differences }) => {
            json!({ "record": excitation.name, "file": FILE, "pairs": pairs(differences) })
        }
        Some(NextExperiment::NotDistinguishable { differences, tried }) => {
            json!({ "record": null, "tried": tried, "pairs": pairs(differences) })
        }
        Some(NextExperiment::CoversError { excitation, expected, present }) => {
            json!({ "record": excitation.name, "file": FILE, "expected_error": expected, "present_error": present })
        }
    }
}

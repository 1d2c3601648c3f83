//! Files of other tools, read from outside the crate.

mod mat;
mod mdf;
mod two_loggers;

use rsm_import::{File, Record, Wishes, import};

/// A file of the test data.
fn file(name: &str) -> File {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    File { name: name.to_string(), bytes: std::fs::read(path).unwrap() }
}

/// The values of a column.
fn column<'a>(record: &'a Record, name: &str) -> &'a [f64] {
    let names: Vec<&str> = record.columns.iter().map(|column| column.name.as_str()).collect();
    &record.columns.iter().find(|column| column.name == name).unwrap_or_else(|| panic!("no `{name}` in {names:?}")).values
}

fn rounded(value: f64) -> f64 {
    format!("{value:.6}").parse().unwrap()
}

/// Whether the notes contain every part.
fn assert_notes(record: &Record, parts: &[&str]) {
    let notes = record.notes.join("\n");
    for part in parts {
        assert!(notes.contains(part), "no {part:?} in\n{notes}");
    }
}

/// A file cut off at 150 places, and changed at every `step`-th byte: a record or a fault, never a panic.
fn assert_damage_is_a_fault(whole: &File, step: usize) {
    let with = |bytes: Vec<u8>| import(&[File { name: whole.name.clone(), bytes }], &Wishes::default());
    let cuts = (0..whole.bytes.len()).step_by(whole.bytes.len() / 150 + 1);
    let faults = cuts.filter(|length| with(whole.bytes[..*length].to_vec()).is_err()).count();
    assert!(faults > 60, "{}: {faults}", whole.name);
    for at in (0..whole.bytes.len()).step_by(step) {
        for value in [0, 0xff] {
            let mut bytes = whole.bytes.clone();
            bytes[at] = value;
            let _ = with(bytes);
        }
    }
}

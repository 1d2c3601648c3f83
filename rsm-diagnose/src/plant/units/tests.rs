//! The units that a column may have.

use std::path::Path;

use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::{candidates, columns};

/// The columns of a shipped plant's record that may be in r.m.s. values, as a header or as readings.
fn of_a_wave(plant: &str) -> Vec<Vec<&'static str>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants");
    let read = |ending: &str| Source::read(&folder.join(format!("{plant}.{ending}"))).unwrap();
    let file = PlantFile::read(&read("toml")).unwrap();
    let record = Record::read(&read("csv"), &file).unwrap();
    let all = candidates(&columns(file.kind, &[record]));
    all.into_iter().filter(|it| it.unit == "r.m.s. values").map(|it| it.which.names).collect()
}

#[test]
fn only_quantities_of_a_rotating_frame_have_root_mean_squares() {
    // The record has no readings of i_d.
    assert_eq!(of_a_wave("pmac"), [vec!["v_d"], vec!["v_q"], vec!["i_q"], vec!["v_d", "v_q"]]);
    // Its input is a voltage too, and no part of a wave.
    assert!(of_a_wave("servo-axis").is_empty());
}

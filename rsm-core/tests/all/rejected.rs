//! Every rule of the model file: a folder of rejected files, each beside the whole message that it must give. `RSM_BLESS=1` rewrites the messages;
//! the difference is reviewed like code.

use std::path::Path;

use rsm_core::check::Checked;
use rsm_core::source::Source;

use crate::refused::{ACCEPTED, assert_beside, files};

#[test]
fn every_rejected_file_gives_its_whole_message() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/rejected");
    let names = files(&folder, &["toml"]);
    assert!(names.len() >= 30, "only {} cases found", names.len());
    let case = |name: String| {
        let source = Source::new(&name, std::fs::read_to_string(folder.join(&name)).unwrap());
        let found = Checked::read(&source).map_or_else(|faults| faults.to_string(), |_| ACCEPTED.to_string());
        (name.replace(".toml", ".txt"), found)
    };
    assert_beside(&folder, names.into_iter().map(case));
}

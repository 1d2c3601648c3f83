//! What the compiler says about a call that cannot be expanded: the whole message, in `tests/ui/*.stderr` beside the call. RSM_BLESS=1 writes it
//! anew.

use std::path::Path;

use super::cargo_project::Project;
use super::refused_files;

const MODELS: [(&str, &str); 3] = [
    ("models/two_inputs.toml", include_str!("../models/two_inputs.toml")),
    ("models/three_faults.toml", include_str!("../models/three_faults.toml")),
    ("models/too_large.toml", include_str!("../models/too_large.toml")),
];

#[test]
fn a_fault_is_a_compile_error_under_the_literal_with_the_files_line_and_column() {
    let ui = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ui");
    let cases = refused_files::files(&ui, &["rs"]);
    assert!(cases.len() >= 6, "a case went missing: {cases:?}");

    let project = Project::new("rsm-macros-refused");
    for (name, text) in MODELS {
        project.write(name, text);
    }
    let message = |case: String| {
        let name = case.strip_suffix(".rs").unwrap();
        project.write(&format!("src/bin/{case}"), &std::fs::read_to_string(ui.join(&case)).unwrap());
        let output = project.cargo(&["check", "--bin", name]);
        let said = String::from_utf8(output.stderr).unwrap();
        // Cargo's own last words name nothing of ours.
        let message = said.split("\nerror: could not compile").next().unwrap().trim_end();
        let found = if output.status.success() { refused_files::ACCEPTED } else { message };
        (format!("{name}.stderr"), found.to_string())
    };
    refused_files::assert_beside(&ui, cases.into_iter().map(message));
}

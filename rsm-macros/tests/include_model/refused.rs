//! What the compiler says about a call that cannot be expanded: the whole message, in `tests/ui/*.stderr` beside the call. RSM_BLESS=1 writes it anew.

use std::path::{Path, PathBuf};

use super::cargo_project::Project;

const MODELS: [(&str, &str); 3] = [
    ("models/two_inputs.toml", include_str!("../models/two_inputs.toml")),
    ("models/three_faults.toml", include_str!("../models/three_faults.toml")),
    ("models/too_large.toml", include_str!("../models/too_large.toml")),
];

#[test]
fn a_fault_is_a_compile_error_under_the_literal_with_the_files_line_and_column() {
    let ui = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ui");
    let mut cases: Vec<PathBuf> = std::fs::read_dir(&ui).unwrap().map(|entry| entry.unwrap().path()).collect();
    cases.retain(|path| path.extension().is_some_and(|extension| extension == "rs"));
    cases.sort();
    assert!(cases.len() >= 6, "a case went missing: {cases:?}");

    let project = Project::new("rsm-macros-refused");
    for (name, text) in MODELS {
        project.write(name, text);
    }
    let mut wrong = Vec::new();
    for case in cases {
        let name = case.file_stem().unwrap().to_str().unwrap();
        project.write(&format!("src/bin/{name}.rs"), &std::fs::read_to_string(&case).unwrap());
        let output = project.cargo(&["check", "--bin", name]);
        assert!(!output.status.success(), "{name}: compiled, but should not");
        let said = String::from_utf8(output.stderr).unwrap();
        // Cargo's own last words name nothing of ours.
        let message = said.split("\nerror: could not compile").next().unwrap().trim_end().to_string() + "\n";
        let golden = case.with_extension("stderr");
        if std::env::var_os("RSM_BLESS").is_some() {
            std::fs::write(&golden, &message).unwrap();
        }
        let expected = std::fs::read_to_string(&golden).unwrap_or_default();
        if message != expected {
            wrong.push(format!("{name}: expected\n{expected}\nfound\n{message}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

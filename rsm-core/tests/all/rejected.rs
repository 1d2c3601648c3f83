//! Every rule of the model file: a folder of rejected files, each beside the whole message that it must give.
//! `RSM_BLESS=1` rewrites the messages; the diff is reviewed like code.

use std::path::Path;

use rsm_core::check::Checked;
use rsm_core::source::Source;

#[test]
fn every_rejected_file_gives_its_whole_message() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/rejected");
    let bless = std::env::var_os("RSM_BLESS").is_some();
    let mut names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    names.sort();
    assert!(names.len() >= 30, "only {} cases found", names.len());
    let mut wrong = Vec::new();
    for path in names {
        let file_name = path.file_name().unwrap().to_str().unwrap();
        let source = Source::new(file_name, std::fs::read_to_string(&path).unwrap());
        let found = match Checked::read(&source) {
            Ok(_) => format!("{file_name} was accepted\n"),
            Err(faults) => format!("{faults}\n"),
        };
        let expected_path = path.with_extension("txt");
        if bless {
            std::fs::write(&expected_path, &found).unwrap();
            continue;
        }
        let expected = std::fs::read_to_string(&expected_path).unwrap_or_default();
        if found != expected {
            wrong.push(format!("{file_name}\n-- expected\n{expected}-- found\n{found}"));
        }
        assert!(!found.contains("was accepted"), "{found}");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
